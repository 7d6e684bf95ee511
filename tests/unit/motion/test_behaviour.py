import numpy as np
import pytest

from rotortrack.motion.behaviour import classify
from rotortrack.motion.diffusion import UNKNOWN, Diffusion
from rotortrack.motion.increments import StepSizes
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.speed import Speed


def name(*, omega=0.0, omega_sd=1.0, excess=1.0, d=5.0, d_sd=0.2, n_steps=5000, step_sd=0.3, **own):
    """Classify a rotor that was followed for 10 s; by default it is plainly Brownian."""
    return classify(
        Speed(omega, omega_sd, 1e4, excess),
        Diffusion(d, d_sd, 0.01, np.zeros((2, 2))),
        StepSizes(0.0, step_sd, n_steps),
        10.0,
        MotionOptions(**own),
    )


def test_a_significant_speed_is_driven_with_its_sign():
    assert name(omega=3.6) == "driven_ccw"
    assert name(omega=-3.6) == "driven_cw"


def test_a_speed_below_the_threshold_is_not():
    assert name(omega=3.4) == "brownian"
    assert name(omega=3.4, driven_z=3.0) == "driven_ccw"


def test_opposite_poles_beyond_diffusion_are_not_brownian():
    stats = (Speed(0.0, 1.0, 1e4, 1.0), Diffusion(5.0, 0.2, 0.01, np.zeros((2, 2))))
    for strength, expected in ((1.4, "brownian"), (4.4, "unclassified")):
        found = classify(
            *stats, StepSizes(0.0, 0.3, 5000), 10.0, MotionOptions(), pole_strength=strength
        )
        assert found == expected


def test_a_significant_creep_of_a_few_degrees_is_not_driven():
    # 0.03 rad/s turn it by 17 degrees in 10 s: that is stage drift, not a motor.
    assert name(omega=0.03, omega_sd=0.001, d=0.0, d_sd=1e-4) == "stuck"
    assert name(omega=0.03, omega_sd=0.001, d=0.0, d_sd=1e-4, stuck_turn_deg=10.0) == "driven_ccw"


def test_no_diffusion_is_stuck_if_it_is_known_to_be_none():
    # 30 degrees in 10 s are a diffusion coefficient of 0.0137 rad^2/s.
    assert name(d=0.0, d_sd=0.006) == "stuck"
    assert name(d=0.0, d_sd=0.5) == "unclassified"
    assert name(d=1.0, d_sd=0.6) == "unclassified"
    assert name(d=0.02, d_sd=0.002) == "brownian"


def test_a_wandering_speed_is_not_called_brownian():
    assert name(excess=4.0) == "unclassified"


def test_folded_steps_say_nothing_about_behaviour():
    assert name(step_sd=1.8) == "unclassified"
    assert name(step_sd=1.8, omega=10.0) == "unclassified"


@pytest.mark.parametrize("unknown", [{"n_steps": 19}, {"omega_sd": np.nan}])
def test_what_cannot_be_measured_stays_unclassified(unknown):
    unknown = {"omega": 50.0} | unknown
    assert name(**unknown) == "unclassified"


def test_unknown_diffusion_stays_unclassified():
    speed, steps = Speed(50.0, np.nan, np.nan, 1.0), StepSizes(0.1, 0.1, 100)
    assert classify(speed, UNKNOWN, steps, 10.0, MotionOptions()) == "unclassified"
