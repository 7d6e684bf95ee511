"""What the movie, a configuration file and flags say together, and what is said of it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from rotortrack.cameras import photon_transfer
from rotortrack.cameras.camera import Camera
from rotortrack.errors import ConfigurationError, GainWarning, MetadataWarning
from rotortrack.movies.metadata import Value
from rotortrack.movies.movie import ArrayMovie
from rotortrack.movies.select import select
from rotortrack.pipeline.localise_run import (
    OpenedMovie,
    extent,
    localise_to_file,
    settings_for_movie,
)
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, resolve

FILE, CONFIG, FLAG = "file (OME)", "config run.toml", "flag"


def movie_of(**metadata):
    known = {name: Value(value, FILE) for name, value in metadata.items()}
    return ArrayMovie(np.zeros((4, 5, 6), np.uint16), known)


def layers_of(**by_origin):
    names = {"config": CONFIG, "flag": FLAG}
    return [Layer(names[origin], {"movie": values}) for origin, values in by_origin.items()]


def settled(movie, layers):
    """Give the options and the sentences of all warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        settings = settings_for_movie(movie, layers)
    assert all(one.category is MetadataWarning for one in caught)
    return settings, [str(one.message) for one in caught]


@pytest.mark.parametrize("field", ["pixel_size_nm", "frame_interval_s", "exposure_s"])
def test_the_flag_wins_over_the_configuration_over_the_file(field):
    movie = movie_of(**{field: 1.0})
    settings, said = settled(movie, layers_of(config={field: 2.0}, flag={field: 3.0}))
    assert getattr(settings["movie"], field) == 3.0
    assert settings.origins[f"movie.{field}"] == FLAG
    assert said == [
        f"{field} is 3 by {FLAG} but 1 by {FILE}: the former is used",
        f"{field} is 3 by {FLAG} but 2 by {CONFIG}: the former is used",
    ]
    settings, said = settled(movie, layers_of(config={field: 2.0}))
    assert getattr(settings["movie"], field) == 2.0
    assert said == [f"{field} is 2 by {CONFIG} but 1 by {FILE}: the former is used"]
    assert settled(movie, [])[1] == []


def test_values_within_a_hundredth_agree():
    movie = movie_of(pixel_size_nm=100.0, frame_interval_s=0.002)
    layers = layers_of(config={"pixel_size_nm": 100.9}, flag={"pixel_size_nm": 100.4})
    settings, said = settled(movie, layers)
    assert settings["movie"].pixel_size_nm == 100.4
    assert said == []


@pytest.mark.parametrize(
    ("given", "doubtful"),
    [
        ({"flag": {"frame_interval_s": 0.002}}, "exposure_s"),
        ({"flag": {"exposure_s": 0.02}}, "frame_interval_s"),
    ],
)
def test_an_exposure_longer_than_the_interval_is_doubtful_and_limited(given, doubtful):
    settings, said = settled(movie_of(exposure_s=0.02, frame_interval_s=0.002), layers_of(**given))
    assert settings["movie"].exposure_s == settings["movie"].frame_interval_s == 0.002
    assert settings.origins["movie.exposure_s"].endswith("limited to the frame interval")
    (sentence,) = said
    assert "exposure_s is 0.02 by" in sentence
    assert "frame_interval_s of 0.002 by" in sentence
    assert f"{doubtful} is doubtful" in sentence


def test_an_exposure_longer_than_the_interval_by_the_user_is_an_error():
    given = {"config": {"frame_interval_s": 0.002}, "flag": {"exposure_s": 0.02}}
    with pytest.raises(ConfigurationError, match="correct one of them"):
        settings_for_movie(movie_of(), layers_of(**given))


def test_an_exposure_that_fills_a_measured_interval_is_limited_in_silence():
    settings, said = settled(movie_of(exposure_s=0.002, frame_interval_s=0.001999), [])
    assert settings["movie"].exposure_s == 0.001999
    assert said == []


def test_the_table_counts_numbers_for_time_and_recorded_frames_for_occupancy():
    movie = movie_of(pixel_size_nm=100.0)
    movie.numbers = np.array([0, 3, 4, 9])
    part = select(movie, frames=(1, 4))
    source = OpenedMovie(part, settings_for_movie(part, []), camera=None)
    info = extent(source, {})
    assert info.frames == 10
    assert info.provenance["first_frame"] == 3
    assert info.provenance["recorded_frames"] == 3


GAIN = 0.5


def film_of_spots(frames=80):
    """Give a film of bright spots, each at one place of a grid, on an uneven background."""
    y, x = np.mgrid[0:72, 0:72]
    light = 8.0 + 0.2 * x
    for row in range(9, 72, 18):
        for column in range(9, 72, 18):
            light += 100.0 * np.exp(-0.5 * ((x - column) ** 2 + (y - row) ** 2) / 1.3**2)
    camera = Camera(100.0, GAIN, 1.5)
    rng = np.random.default_rng(3)
    return ArrayMovie(camera.to_counts(np.broadcast_to(light, (frames, *light.shape)), rng))


def localised(tmp_path, gain_e_per_adu):
    movie = film_of_spots()
    settings = resolve(SECTIONS, [Layer(FLAG, {"movie": {"pixel_size_nm": 100.0}})])
    source = OpenedMovie(movie, settings, Camera(100.0, gain_e_per_adu, 1.5))
    return localise_to_file(source, tmp_path / "locs.parquet", workers=1)


@pytest.mark.parametrize("gain_e_per_adu", [1.0 / GAIN, 0.5 * GAIN])
def test_a_gain_that_the_noise_contradicts_is_named(tmp_path, gain_e_per_adu):
    with pytest.warns(GainWarning, match="check gain_e_per_adu"):
        localised(tmp_path, gain_e_per_adu)


def test_a_right_gain_costs_no_second_look_at_the_movie(tmp_path, monkeypatch):
    looked = []
    monkeypatch.setattr(photon_transfer, "gain_from_movie", lambda *_, **__: looked.append(1))
    assert localised(tmp_path, GAIN).localisations > 1000
    assert not looked
