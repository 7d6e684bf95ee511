"""The twin of a run shows the rotors that the run kept, and what the analysis makes of them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rotortrack.errors import InputError
from rotortrack.pipeline.register_run import register_movies
from rotortrack.pipeline.run import run_movie
from rotortrack.pipeline.store import BUDGET
from rotortrack.settings import Layer
from rotortrack.simulate.film.filming import film_scene
from rotortrack.simulate.scene import make_scene
from rotortrack.tradeoff.closed_loop import config_layer
from rotortrack.tradeoff.twin import error_budget, twin_of

SCENE = {
    "film": {"width_px": 72, "height_px": 48, "n_frames": 1000, "exposure_s": 0.002},
    "rotors": [
        {
            "x_nm": [2000.0, 5600.0],
            "y_nm": [2500.0, 2600.0],
            "radius_nm": 120.0,
            "photons": 900.0,
            "omega_rad_s": 40.0,
            "direction": "cw",
            "diffusion_rad2_s": 3.0,
        }
    ],
    "background": {"photons": 4.0},
    "camera": {},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin")
    filmed = film_scene(make_scene([Layer("test", SCENE)]), folder / "film.tif")
    layers = [config_layer(filmed)]
    run_movie(filmed.movie, layers, folder / "run")
    return filmed.movie, layers, folder / "run"


def test_the_twin_is_filmed_as_the_run_measured(run):
    twin = twin_of(run[2])
    assert twin.rotors == (0, 1)
    assert twin.left_out == {}
    for rotor in twin.scene.film.rotors:
        assert rotor.radius_nm == pytest.approx(120.0, rel=0.02)
        assert rotor.omega_rad_s == pytest.approx(40.0, abs=8.0)
        assert rotor.direction == "cw"
        assert rotor.diffusion_rad2_s == pytest.approx(3.0, rel=0.3)
        assert rotor.photons == pytest.approx(900.0, rel=0.03)
    places = np.sort([rotor.x_nm[0] for rotor in twin.scene.film.rotors])
    np.testing.assert_allclose(places, [2000.0, 5600.0], atol=3.0)
    assert twin.scene.film.background.photons == pytest.approx(4.0, rel=0.1)
    assert twin.scene.film.film.n_frames == 1000


def test_the_budget_of_errors_is_written_into_the_run_and_goes_with_its_rotors(run, tmp_path):
    movie, layers, folder = run
    told = error_budget(folder, tmp_path / "films", films=2)
    assert json.loads((folder / BUDGET).read_text(encoding="utf-8")) == told
    assert [row["rotor"] for row in told["rotors"]] == [0, 1]
    for row in told["rotors"]:
        assert row["kept"] == row["found"] == 1.0
        assert abs(row["omega_bias"]) <= row["omega_rms_error"] < 20.0
        assert row["radius_rms_error"] < 2.0
    other = Layer("test", {"motion": {"min_steps": 30}})
    run_movie(movie, [*layers, other], folder)
    assert not (folder / BUDGET).exists()


def test_the_twin_of_two_colours_shows_the_first(tmp_path):
    split = {"layout": "left-right", "shift_nm": [60.0, -40.0]}
    both = {
        "film": {"width_px": 128, "height_px": 64, "n_frames": 600, "exposure_s": 0.002},
        "split": split,
        "background": {"photons": 4.0},
        "camera": {},
    }
    rotors = [{**SCENE["rotors"][0], "x_nm": [2000.0, 5000.0], "y_nm": [1800.0, 5100.0], "ends": 2}]
    cells = {**both, "rotors": rotors}
    beads = {**both, "fiducials": {"pitch_nm": 700.0, "missing": 0.15}}
    beads["film"] = {**both["film"], "n_frames": 10, "seed": 5}
    filmed = film_scene(make_scene([Layer("test", cells)]), tmp_path / "cells.tif")
    film_scene(make_scene([Layer("test", beads)]), tmp_path / "beads.tif")
    given = [
        Layer("test", {"channels": {"split": "left-right"}, "movie": {"pixel_size_nm": 108.3}})
    ]
    made = register_movies([tmp_path / "beads.tif"], [], given)
    made.registration.write(tmp_path / "channels.json")
    own = config_layer(filmed).values
    own = {**own, "movie": {k: v for k, v in own["movie"].items() if k != "region"}}
    channels = {"split": "left-right", "registration": str(tmp_path / "channels.json")}
    layers = [Layer("film", own), Layer("test", {"channels": channels})]
    run_movie(tmp_path / "cells.tif", layers, tmp_path / "run")
    told = error_budget(tmp_path / "run", tmp_path / "films", films=1)
    assert [row["found"] for row in told["rotors"]] == [1.0, 1.0]


def test_a_run_without_rotors_has_no_twin(tmp_path):
    with pytest.raises(InputError):
        twin_of(tmp_path)
