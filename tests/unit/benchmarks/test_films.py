"""The benchmark's films show what their recipes say."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

_path = Path(__file__).parents[2] / "benchmarks" / "films.py"
_spec = importlib.util.spec_from_file_location("benchmark_films", _path)
films = sys.modules[_spec.name] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(films)


def test_light_of_a_spot_is_the_integral_over_its_pixels():
    from scipy.stats import norm

    image = films.spots(np.array([100.3]), np.array([30.8]), np.array([700.0]), 1.25)
    edges = np.arange(257)
    gx, gy = (np.diff(norm.cdf(edges, centre, 1.25)) for centre in (100.3, 30.8))
    assert image == pytest.approx(700.0 * np.outer(gy, gx), abs=1e-5)


@pytest.mark.parametrize("name", films.FILMS)
def test_counts_have_the_mean_and_variance_of_the_recipe(name):
    recipe = dataclasses.replace(films.FILMS[name], frames=40, emitters=0.0)
    film = films.make(recipe)
    gain, read = film.sensor.gain_e_per_adu, film.sensor.read_noise_e
    electrons = (film.counts - film.sensor.offset_adu) * gain
    spread = np.sqrt((8.0 + np.mean(read**2)) / film.counts.size)
    assert electrons.mean() == pytest.approx(8.0, abs=5 * spread)
    rounding = np.mean(gain**2) / 12.0
    expected = 8.0 + np.mean(read**2) + rounding
    # Of a map, hot pixels rule how well forty frames tell it.
    assert electrons.var(axis=0, ddof=1).mean() == pytest.approx(expected, rel=0.02)
    assert np.sqrt(np.mean(read**2)) == pytest.approx(1.6, abs=0.05)


def test_emitters_have_their_number_place_and_photons():
    film = films.make(dataclasses.replace(films.FILMS["bright"], frames=100))
    assert len(film.frame) == pytest.approx(2500, abs=5 * np.sqrt(2500))
    assert np.median(film.photons) == pytest.approx(800.0, rel=5 * 1.2533 * 0.5 / np.sqrt(2500))
    for place in (film.x_px, film.y_px):
        assert 2.0 <= place.min() < 2.6
        assert 253.4 < place.max() <= 254.0


def test_a_film_follows_from_its_recipe_alone():
    recipe = dataclasses.replace(films.FILMS["maps"], frames=2)
    first, again = films.make(recipe), films.make(recipe)
    assert np.array_equal(first.counts, again.counts)
    other = films.make(dataclasses.replace(recipe, seed=9))
    assert not np.array_equal(first.counts, other.counts)


def test_the_sweep_covers_what_is_asked():
    recipes = list(films.sweep_recipes())
    for key, asked in (
        ("photons", (100, 250, 800, 2000, 5000)),
        ("background", (2, 8, 20, 50)),
        ("emitters", (5, 25, 60)),
        ("sigma_px", (1.0, 1.25, 1.5, 1.8)),
    ):
        assert {getattr(recipe, key) for recipe in recipes} == set(asked)
    assert len({recipe.name for recipe in recipes}) == len(recipes)
