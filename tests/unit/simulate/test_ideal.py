"""What an ideal scene accepts, and what it says of mistakes."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.ideal import IdealRotor, IdealScene

PLACE = {"x_nm": 1000.0, "y_nm": 1000.0, "radius_nm": 100.0, "photons": 800.0}


def scene(**changes):
    values = {
        "shape_px": (20, 30),
        "n_frames": 5,
        "pixel_size_nm": 100.0,
        "frame_interval_s": 0.002,
        "exposure_s": 0.001,
        "sigma_nm": 120.0,
        "background_photons": 5.0,
        "rotors": (IdealRotor(kind="stuck", **PLACE),),
    }
    return IdealScene(**(values | changes))


@pytest.mark.parametrize(
    ("kind", "motion"),
    [
        ("driven", {"omega_rad_s": -3.0}),
        ("driven", {"omega_rad_s": 3.0, "diffusion_rad2_s": 1.0}),
        ("brownian", {"diffusion_rad2_s": 1.0}),
        ("stuck", {}),
        ("switching", {"omega_rad_s": 3.0, "event_times_s": (0.5,)}),
        ("switching", {"omega_rad_s": 3.0, "event_rate_per_s": 2.0}),
        ("two_position", {"event_rate_per_s": 2.0}),
        (
            "two_position",
            {"event_rate_per_s": 2.0, "wobble_sd_rad": 0.1, "diffusion_rad2_s": 1.0},
        ),
    ],
)
def test_each_kind_takes_the_values_that_it_needs(kind, motion):
    assert IdealRotor(kind=kind, **PLACE, **motion).kind == kind


@pytest.mark.parametrize(
    ("kind", "motion", "named"),
    [
        ("spinning", {}, "kind"),
        ("driven", {}, "omega_rad_s"),
        ("brownian", {}, "diffusion_rad2_s"),
        ("brownian", {"diffusion_rad2_s": 1.0, "omega_rad_s": 1.0}, "omega_rad_s"),
        ("stuck", {"diffusion_rad2_s": 1.0}, "diffusion_rad2_s"),
        ("stuck", {"event_rate_per_s": 1.0}, "event_rate_per_s"),
        ("switching", {"omega_rad_s": 1.0}, "event_times_s"),
        (
            "switching",
            {"omega_rad_s": 1.0, "event_rate_per_s": 1.0, "event_times_s": (1.0,)},
            "one of them",
        ),
        ("two_position", {"event_rate_per_s": 1.0, "wobble_sd_rad": 0.1}, "diffusion_rad2_s"),
        ("driven", {"omega_rad_s": 1.0, "wobble_sd_rad": 0.1}, "two_position"),
        ("driven", {"omega_rad_s": float("nan")}, "omega_rad_s"),
    ],
)
def test_value_that_a_kind_lacks_or_has_no_use_for_is_refused(kind, motion, named):
    with pytest.raises(ConfigurationError, match=named):
        IdealRotor(kind=kind, **PLACE, **motion)


def test_all_mistakes_of_a_rotor_are_listed_at_once():
    with pytest.raises(ConfigurationError) as caught:
        IdealRotor(kind="stuck", x_nm=0.0, y_nm=np.inf, radius_nm=-1.0, photons=-5.0)
    assert len(caught.value.mistakes) == 3


def test_all_mistakes_of_a_scene_are_listed_at_once():
    with pytest.raises(ConfigurationError) as caught:
        scene(pixel_size_nm=40.0, exposure_s=0.003, dark_probability=1.5, drift_nm=(1.0, 2.0, 3.0))
    text = str(caught.value)
    for word in ("exposure_s", "dark_probability", "drift_nm", "rotor 0"):
        assert word in text
    assert "outside the frame of 30 x 20 px" in text


def test_linear_drift_starts_at_nothing_and_ends_at_what_was_asked():
    drift = scene(drift_nm=(40.0, -20.0)).drift_by_frame_nm()
    np.testing.assert_allclose(drift, [[0, 0], [10, -5], [20, -10], [30, -15], [40, -20]])


def test_drift_table_is_used_as_it_stands():
    table = np.arange(10.0).reshape(5, 2)
    np.testing.assert_array_equal(scene(drift_nm=table).drift_by_frame_nm(), table)
    assert scene().drift_by_frame_nm() is None
