"""The sample data: small, whole, readable by other programs, the same every time."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import tifffile

from rotortrack.cameras.options import CameraOptions
from rotortrack.movies.options import MovieOptions
from rotortrack.settings import Layer, read_toml, resolve
from rotortrack.simulate.film.film import Film
from rotortrack.simulate.film.filming import shapes_for
from rotortrack.simulate.sample import SAMPLES, make_sample, manifest, sample_scene
from rotortrack.simulate.scene import read_scene
from rotortrack_cli.commands.simulate_film import SAMPLE_NAMES

SHAPES = {
    "rotors": (1600, 64, 96),
    "salt": (700, 64, 64),
    "two_colours": (500, 64, 128),
    "fiducials": (20, 64, 128),
}


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    folder = tmp_path_factory.mktemp("samples")
    for name in SAMPLES:
        make_sample(folder / name, name)
    return folder


def truth_of(folder):
    return (
        pd.read_csv(folder / "truth" / "rotors.csv"),
        pd.read_parquet(folder / "truth" / "spots.parquet"),
    )


def test_the_command_knows_every_sample():
    assert tuple(SAMPLES) == SAMPLE_NAMES


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_is_complete(samples, name):
    wished = {"config.toml", "scene.toml", "movie.tif", "truth/rotors.csv", "truth/spots.parquet"}
    if name == "rotors":
        wished.add("daq.csv")
    if name == "fiducials":
        wished.add("truth/fiducials.csv")
    assert set(manifest(samples / name)) == wished


def test_all_samples_together_are_below_12_megabytes(samples):
    files = [path for path in samples.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= 11.5e6


def test_a_sample_is_made_again_bit_for_bit(samples, tmp_path):
    make_sample(tmp_path / "again", "salt")
    assert manifest(tmp_path / "again") == manifest(samples / "salt")


@pytest.mark.parametrize("name", SAMPLES)
def test_another_program_reads_the_frames_that_its_own_scene_films(samples, name):
    with tifffile.TiffFile(samples / name / "movie.tif") as file:
        pages = file.asarray()
    assert pages.shape == SHAPES[name]
    scene = read_scene(samples / name / "scene.toml", [], None)
    film = Film(scene.film, shapes_for(scene))
    filmed = next(iter(film.blocks()))
    np.testing.assert_array_equal(pages[: len(filmed)], filmed)


@pytest.mark.parametrize("name", SAMPLES)
def test_configuration_is_accepted_and_names_every_value_of_movie_and_camera(samples, name):
    values = read_toml(samples / name / "config.toml")
    settings = resolve({"movie": MovieOptions, "camera": CameraOptions}, [Layer("config", values)])
    assert settings["movie"].pixel_size_nm == 108.3
    assert settings["movie"].exposure_s == settings["movie"].frame_interval_s == 0.002
    camera = settings["camera"]
    assert (camera.offset_adu, camera.gain_e_per_adu, camera.read_noise_e) == (100.0, 1.5, 1.4)


def test_the_voltage_experiment_has_every_kind_of_rotor_on_its_own_circle(samples):
    rotors, spots = truth_of(samples / "rotors")
    assert len(spots) == 1600 * 8
    assert (rotors["omega_rad_s"] > 0).sum() == 3
    assert (rotors["omega_rad_s"] < 0).sum() == 2
    assert set(rotors["motion"]) == {"driven", "brownian", "stuck", "two_position"}
    assert rotors["photons"].between(600.0, 1000.0).all()
    merged = spots.merge(rotors, on="rotor", suffixes=("", "_centre"))
    away = np.hypot(merged["x_nm"] - merged["x_nm_centre"], merged["y_nm"] - merged["y_nm_centre"])
    assert (away <= merged["radius_nm"] * (1.0 + 1e-9)).all()
    # Twice the voltage from 1.6 s on: about twice the way.
    turning = spots[spots["rotor"] == 0].sort_values("frame")
    angle = np.unwrap(turning["theta_rad"])
    before, after = angle[800] - angle[0], angle[-1] - angle[800]
    assert after > 1.3 * before > 0.0


def test_rods_of_the_voltage_experiment_are_seen_where_they_are(samples):
    rotors, _ = truth_of(samples / "rotors")
    mean = tifffile.imread(samples / "rotors" / "movie.tif").mean(axis=0)
    row, column = np.unravel_index(mean.argmax(), mean.shape)
    nearest = np.hypot(rotors["x_nm"] / 108.3 - column - 0.5, rotors["y_nm"] / 108.3 - row - 0.5)
    assert nearest.min() < 3.0


def test_both_colours_of_the_samples_have_one_distortion(samples):
    scenes = [sample_scene(name) for name in ("two_colours", "fiducials")]
    assert scenes[0].film.split == scenes[1].film.split
    rotors, _ = truth_of(samples / "two_colours")
    assert rotors["end_to_end_nm"].between(0.0, 450.0, inclusive="neither").all()
    points = pd.read_csv(samples / "fiducials" / "truth" / "fiducials.csv")
    assert len(points) > 60
    shift = points["second_x_nm"] - points["x_nm"]
    assert shift.std() > 5.0
