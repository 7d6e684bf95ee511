"""The sample data set: small, whole, readable by other programs, the same every time."""

from __future__ import annotations

import tomllib

import numpy as np
import pandas as pd
import pytest
import tifffile

from rotortrack.cameras.options import CameraOptions
from rotortrack.movies.options import MovieOptions
from rotortrack.settings import Layer, read_toml, resolve
from rotortrack.simulate.ideal_film import film
from rotortrack.simulate.sample import (
    SAMPLE_CAMERA,
    SAMPLE_SEED,
    make_sample,
    manifest,
    sample_scene,
)


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sample") / "rotors"
    make_sample(folder)
    return folder


def test_sample_is_complete_and_its_movie_is_below_6_megabytes(sample):
    assert set(manifest(sample)) == {
        "config.toml",
        "movie.tif",
        "truth/rotors.csv",
        "truth/spots.parquet",
    }
    assert (sample / "movie.tif").stat().st_size <= 6e6


def test_sample_is_made_again_bit_for_bit(sample, tmp_path):
    make_sample(tmp_path / "again")
    assert manifest(tmp_path / "again") == manifest(sample)


def test_another_program_reads_the_frames_that_were_filmed(sample):
    with tifffile.TiffFile(sample / "movie.tif") as file:
        pages = file.asarray()
    assert pages.shape == (1600, 64, 96)
    filmed = film(sample_scene(), SAMPLE_CAMERA, np.random.default_rng([SAMPLE_SEED, 1]))
    for start in (0, 1000, 1590):
        np.testing.assert_array_equal(pages[start : start + 10], filmed.frames(start, start + 10))


def test_configuration_is_accepted_and_names_every_value_of_movie_and_camera(sample):
    values = read_toml(sample / "config.toml")
    settings = resolve({"movie": MovieOptions, "camera": CameraOptions}, [Layer("config", values)])
    assert settings["movie"].pixel_size_nm == 108.3
    assert settings["movie"].exposure_s == settings["movie"].frame_interval_s == 0.002
    assert settings["camera"].gain_e_per_adu == SAMPLE_CAMERA.gain_e_per_adu
    assert settings["camera"].offset_adu == 100.0
    assert tomllib.loads((sample / "config.toml").read_text())["camera"]["read_noise_e"] == 1.4


def test_truth_tables_agree_with_each_other_and_with_the_movie(sample):
    spots = pd.read_parquet(sample / "truth" / "spots.parquet")
    rotors = pd.read_csv(sample / "truth" / "rotors.csv")
    assert len(spots) == 1600 * 8
    assert (rotors["omega_rad_s"] > 0).sum() == 3
    assert (rotors["omega_rad_s"] < 0).sum() == 2
    assert rotors["photons"].between(600.0, 1000.0).all()
    merged = spots.merge(rotors, on="rotor", suffixes=("", "_centre"))
    away = np.hypot(merged["x_nm"] - merged["x_nm_centre"], merged["y_nm"] - merged["y_nm_centre"])
    assert (away <= merged["radius_nm"] * (1.0 + 1e-12)).all()
    # The brightest pixels of the mean frame lie at rotors.
    mean = tifffile.imread(sample / "movie.tif").mean(axis=0)
    row, column = np.unravel_index(mean.argmax(), mean.shape)
    nearest = np.hypot(rotors["x_nm"] / 108.3 - column - 0.5, rotors["y_nm"] / 108.3 - row - 0.5)
    assert nearest.min() < 3.0
