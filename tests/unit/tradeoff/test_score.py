"""The truth that an analysis is compared with, and the bound of its positions."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.settings import Layer
from rotortrack.simulate.film.filming import film_scene
from rotortrack.simulate.scene import make_scene
from rotortrack.tradeoff.score import read_truth, score, truth_bound
from rotortrack.tradeoff.summary import summarise

_ROTORS = {"x_nm": [2000.0], "y_nm": [2000.0], "omega_rad_s": 40.0, "direction": "ccw"}


def truth_of(tmp_path, *rotors, **sections):
    values = {
        "film": {"width_px": 40, "height_px": 40, "n_frames": 50, "exposure_s": 0.002},
        "rotors": [{**_ROTORS, **own} for own in rotors or ({},)],
        "background": {"photons": 8.0},
        "camera": {},
        **sections,
    }
    scene = make_scene([Layer("test", values)])
    return read_truth(film_scene(scene, tmp_path / "film.tif").truth)


@pytest.mark.parametrize(
    ("times_s", "millivolts", "rotor", "omega"),
    [
        ([0.0, 0.05], [50.0, 100.0], {}, 30.0),
        ([0.0, 0.3], [50.0, 100.0], {}, 20.0),
        ([0.0, 0.05, 0.3], [50.0, 100.0, -900.0], {}, 30.0),
        ([0.0, 0.05], [50.0, -100.0], {"arrive_s": 0.05}, -40.0),
        ([0.0, 0.05], [50.0, 100.0], {"leave_s": 0.05}, 20.0),
        ([0.0, 0.02], [50.0, 100.0], {"arrive_s": 0.01, "leave_s": 0.05}, 35.0),
    ],
)
def test_the_true_speed_is_the_mean_over_what_is_filmed_of_a_rotor(
    tmp_path, times_s, millivolts, rotor, omega
):
    voltage = {"times_s": times_s, "voltages_mv": millivolts}
    truth = truth_of(tmp_path, rotor, voltage=voltage)
    assert truth.rotors["mean_omega_rad_s"].tolist() == pytest.approx([omega])


def test_a_second_rotor_that_comes_after_the_film_makes_no_double(tmp_path):
    truth = truth_of(tmp_path, {"second_after_s": 0.2}, {"second_after_s": 0.05})
    rotors = truth.rotors
    assert rotors["double"].tolist() == [False, True, False, True]
    assert rotors["expected"].tolist() == ["kept", "refused", "", "refused"]


def test_photons_that_the_camera_misses_do_not_sharpen_the_bound(tmp_path):
    whole = truth_of(tmp_path / "whole", background={"photons": 4.0})
    half = truth_of(
        tmp_path / "half", background={"photons": 8.0}, camera={"quantum_efficiency": 0.5}
    )
    assert truth_bound(half, 1200.0) == pytest.approx(truth_bound(whole, 600.0), rel=1e-9)


@pytest.mark.parametrize(
    ("psf", "sigma_nm"),
    [
        ({"sigma_nm": 140.0}, 140.0),
        ({"defocus_nm": 300.0}, 130.0 * 1.25),
        ({"astigmatism_nm": 800.0, "defocus_nm": 400.0}, 130.0 * 5.0**0.25),
        ({"model": "airy", "wavelength_nm": 700.0}, 0.225 * 700.0 / 1.4),
    ],
)
def test_the_bound_knows_the_width_of_the_spots(tmp_path, psf, sigma_nm):
    assert truth_of(tmp_path, psf=psf).sigma_nm == pytest.approx(sigma_nm)


def test_drift_is_taken_off_the_true_places(tmp_path):
    still = truth_of(tmp_path / "still").spots
    moved = truth_of(tmp_path / "moved", drift={"total_nm": [70.0, -9.0]}).spots
    for name in ("x_nm", "y_nm"):
        np.testing.assert_allclose(moved[name], still[name], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("drift", "error_nm"), [({"total_nm": [9.0, 0.0]}, 1.0), (None, 13.0)])
def test_where_the_stage_began_is_no_error_of_the_centres(tmp_path, drift, error_nm):
    truth = truth_of(tmp_path, **({"drift": drift} if drift else {}))
    found = truth.spots[["frame", "x_nm", "y_nm", "rotor"]].assign(x_sd_nm=5.0, y_sd_nm=5.0)
    found["x_nm"] += 12.0
    found["y_nm"] += 12.0
    rotors = truth.rotors[["rotor", "x_nm", "y_nm"]] + [0.0, 13.0, 13.0]
    numbers = dict.fromkeys(
        (
            *("radius_nm", "radius_sd_nm", "omega_rad_s", "omega_sd_rad_s", "diffusion_rad2_s"),
            *("speed_ci_low_deg_s", "speed_ci_high_deg_s"),
            *("diffusion_ci_low_rad2_s", "diffusion_ci_high_rad2_s"),
        ),
        1.0,
    )
    rotors = rotors.assign(verdict="kept", behaviour="driven_ccw", **numbers)
    measures = summarise([score(truth, found, rotors)])
    assert measures["centre_rmse_nm"].value == pytest.approx(error_nm)
