from dataclasses import replace

import numpy as np
import pytest

from rotortrack.motion.behaviour import NOT_CLASSIFIED, classify
from rotortrack.motion.changepoints import find_switches
from rotortrack.motion.estimate import NOT_ESTIMATED, estimate_motion
from rotortrack.motion.increments import StepSizes, increments, step_sizes
from rotortrack.motion.likelihood import Fit
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.readings import Circle

from .planted import FRAME_S, NAMES, filmed, free, plant, washboard

STEPS = StepSizes(0.0, 0.3, 5000)


def called(rotor, **options):
    estimate = estimate_motion(
        rotor.frame,
        rotor.x_nm,
        rotor.y_nm,
        rotor.sd_nm,
        rotor.sd_nm,
        Circle(0.0, 0.0, 100.0),
        frame_interval_s=FRAME_S,
        exposure_s=FRAME_S,
    )
    return classify(
        estimate,
        step_sizes(increments(rotor.frame, rotor.theta, "drop")),
        rotor.frame,
        rotor.theta,
        find_switches(rotor.frame, rotor.theta, frame_interval_s=FRAME_S, exposure_s=FRAME_S),
        frame_interval_s=FRAME_S,
        options=MotionOptions(**options),
    )


@pytest.mark.parametrize("name", NAMES)
def test_planted_behaviours_are_recognised(name):
    for seed in range(4):
        rotor = plant(name, np.random.default_rng([seed, NAMES.index(name)]))
        found = called(rotor)
        assert found.name == name, (seed, found)
        assert (found.margin > 1.0) == (name != "unclassified")
        assert any(character.isdigit() for character in found.evidence)


def test_weak_drift_is_never_called_something_else():
    allowed = {"driven_ccw", "brownian", "unclassified"}
    for seed in range(6):
        rng = np.random.default_rng([seed, 99])
        rotor = plant("driven_ccw", rng, speed_range=(1.0, 4.0))
        assert called(rotor).name in allowed


def test_a_driven_rotor_that_changes_speed_but_not_direction_is_driven():
    rng = np.random.default_rng(1)
    speeds = np.where(np.arange(80_000) < 30_000, -20.0, -45.0)
    rotor = filmed(rng, free(rng, 80_000, 5.0, speeds), 0.2, 0.1, 1.0, -30.0, 5.0)
    assert called(rotor).name == "driven_cw"


def test_a_rotor_pinned_in_one_place_that_escapes_is_neither_confined_nor_brownian():
    rng = np.random.default_rng(2)
    path = washboard(rng, 80_000, 20.0, 0.0, (1.5,))
    assert np.ptp(path) > 2 * np.pi
    found = called(filmed(rng, path, 0.2, 0.1, 1.0, 0.0, 20.0))
    assert found.name == "unclassified"
    assert found.margin < 1.0


def test_a_driven_rotor_with_pinning_is_driven():
    rng = np.random.default_rng(3)
    path = washboard(rng, 80_000, 10.0, 3.0, (0.0, 1.0))
    assert called(filmed(rng, path, 0.2, 0.1, 1.0, 20.0, 10.0)).name == "driven_ccw"


def told(*, omega=0.0, omega_sd=1.0, p=0.5, d=5.0, d_range=(4.6, 5.4), n_steps=5000, **own):
    """Classify made-up estimates of a rotor that was followed for 10 s round the circle."""
    fit = Fit(omega, omega_sd, (omega - 2, omega + 2), p, d, 0.2, d_range, 0.04, 1.0)
    theta = np.mod(2.4 * np.arange(5001) ** 1.1, 2 * np.pi)
    return classify(
        replace(NOT_ESTIMATED, fit=fit),
        replace(STEPS, n_steps=n_steps),
        np.arange(5001),
        theta,
        None,
        frame_interval_s=FRAME_S,
        options=MotionOptions(**own),
    )


def test_a_significant_speed_is_driven_with_its_sign_and_margin():
    found = told(omega=4.2, p=2.7e-5, driven_z=3.0)
    assert found.name == "driven_ccw"
    assert found.margin == pytest.approx(4.2 / 3.0, rel=0.01)
    assert told(omega=-4.2, p=2.7e-5).name == "driven_cw"
    assert "4.2 +- 1 rad/s" in found.evidence


def test_between_driven_and_brownian_lies_doubt():
    assert told(omega=2.8, p=0.005, driven_z=3.0).name == "unclassified"
    assert told(omega=2.8, p=0.005, driven_z=2.5).name == "driven_ccw"
    assert told(omega=2.0, p=0.05).name == "brownian"


def test_a_significant_creep_of_a_few_degrees_is_not_driven():
    # 0.03 rad/s turn it by 17 degrees in 10 s: that is stage drift, not a motor.
    assert told(omega=0.03, p=1e-9, d=1e-5, d_range=(0.0, 1e-4)).name != "driven_ccw"


def test_what_cannot_be_measured_stays_unclassified():
    assert told(n_steps=19, omega=50.0, p=0.0).name == "unclassified"
    assert told(omega_sd=np.nan, omega=50.0).margin == 0.0
    assert NOT_CLASSIFIED.name == "unclassified"


def test_angles_that_are_noise_alone_say_nothing():
    theta = np.random.default_rng(4).uniform(-np.pi, np.pi, 5001)
    found = classify(
        replace(NOT_ESTIMATED, fit=Fit(0.0, 1.0, (-2, 2), 0.5, 90.0, 9.0, (70, 120), 0.1, 1.0)),
        replace(STEPS, sd_rad=1.8),
        np.arange(5001),
        theta,
        None,
        frame_interval_s=FRAME_S,
        options=MotionOptions(),
    )
    assert (found.name, found.margin) == ("unclassified", 0.0)
