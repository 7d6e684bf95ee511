"""The whole analysis on films whose truth is known: honest speeds, no false drive."""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest

from rotortrack.cameras.camera import Camera
from rotortrack.errors import RotortrackWarning
from rotortrack.localise.engine import localise_all
from rotortrack.pipeline import stages
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, resolve
from rotortrack.simulate.ideal_examples import example_scene
from rotortrack.simulate.ideal_film import film

SEEDS = 24
CAMERA = Camera(offset_adu=100.0, gain_e_per_adu=0.4545, read_noise_e=1.4)
KINDS = ("driven", "driven", "driven", "driven", "brownian", "stuck", "stuck")


def analyse(seed):
    """One film: its true rotors, each with the measured row nearest to it."""
    rng = np.random.default_rng([2026, seed])
    scene = example_scene(KINDS, rng=rng, n_frames=1500)
    movie = film(scene, CAMERA, rng)
    settings = resolve(
        SECTIONS,
        [
            Layer(
                "test",
                {"movie": {"pixel_size_nm": 108.3, "frame_interval_s": 0.002, "exposure_s": 0.002}},
            )
        ],
    )
    localisations = localise_all(movie, CAMERA, pixel_size_nm=108.3, workers=1)
    corrected = stages.correct(localisations, settings, pixel_size_nm=108.3)
    found = stages.find(corrected.localisations, corrected.trusted, settings, n_frames=1500)
    rotors = stages.move(found.localisations, found.rotors, settings).rotors
    truth = movie.truth_rotors
    x, y = rotors["x_nm"].to_numpy(), rotors["y_nm"].to_numpy()
    distance = np.hypot(
        truth["x_nm"].to_numpy()[:, None] - x, truth["y_nm"].to_numpy()[:, None] - y
    )
    nearest = rotors.iloc[distance.argmin(axis=1)].reset_index(drop=True)
    near = distance.min(axis=1) < truth["radius_nm"].to_numpy() + 60.0
    return truth.add_prefix("true_").join(nearest).assign(seed=seed, near=near)


@pytest.fixture(scope="module")
def measured():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RotortrackWarning)
        with ThreadPoolExecutor(2) as pool:
            return pd.concat(pool.map(analyse, range(SEEDS)), ignore_index=True)


def test_every_rotor_is_found(measured):
    assert measured["near"].mean() > 0.99


def test_speeds_of_driven_rotors_are_as_certain_as_they_say(measured):
    driven = measured[(measured["true_kind"] == "driven") & (measured["verdict"] == "kept")]
    assert len(driven) > 0.9 * 4 * SEEDS
    pull = (driven["omega_rad_s"] - driven["true_omega_rad_s"]) / driven["omega_sd_rad_s"]
    assert 0.85 <= np.sqrt((pull**2).mean()) <= 1.15


def test_no_stuck_rotor_is_reported_as_driven(measured):
    stuck = measured[measured["true_kind"] == "stuck"]
    assert len(stuck) == 2 * SEEDS
    assert not stuck["behaviour"].str.startswith("driven").any()
    assert (stuck["verdict"] == "refused").mean() > 0.95


def test_brownian_rotors_are_seldom_called_driven(measured):
    brownian = measured[(measured["true_kind"] == "brownian") & (measured["verdict"] == "kept")]
    assert brownian["behaviour"].str.startswith("driven").sum() <= 1


def test_the_direction_is_right_whenever_it_is_claimed(measured):
    claimed = measured[measured["behaviour"].isin(["driven_ccw", "driven_cw"])]
    claimed = claimed[claimed["true_kind"] == "driven"]
    assert len(claimed) > 50
    ccw = claimed["behaviour"] == "driven_ccw"
    assert (ccw == (claimed["true_omega_rad_s"] > 0)).all()


def test_circles_are_where_and_as_large_as_they_were(measured):
    moving = measured[(measured["true_kind"] != "stuck") & (measured["verdict"] == "kept")]
    # A slow rotor of a short film leaves its circle half empty; the median judges the method.
    away = np.hypot(moving["x_nm"] - moving["true_x_nm"], moving["y_nm"] - moving["true_y_nm"])
    assert away.median() < 1.0
    assert (away < 15.0).all()
    ratio = moving["radius_nm"] / moving["true_radius_nm"]
    assert abs(ratio.median() - 1.0) < 0.003
    # What is left uncorrected of the motion blur would show in the fast ones.
    fast = moving["true_omega_rad_s"].abs() > 50.0
    assert abs(ratio[fast].median() - 1.0) < 0.003


def test_diffusion_is_measured_without_bias(measured):
    moving = measured[measured["true_kind"].isin(["driven", "brownian"])]
    moving = moving[moving["verdict"] == "kept"]
    pull = (moving["diffusion_rad2_s"] - moving["true_diffusion_rad2_s"]) / moving[
        "diffusion_sd_rad2_s"
    ]
    assert abs(pull.mean()) < 0.35
    assert np.sqrt((pull**2).mean()) < 1.3
