import numpy as np
import pytest

from rotortrack.motion.occupancy import (
    brownian_amplitude,
    confinement,
    dwell_places,
    memory,
    strayed_rad,
)

from .planted import FRAME_S, PARTS, filmed, free, held


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("diffusion", [0.5, 5.0, 40.0])
def test_amplitudes_of_diffusion_alone_are_as_expected(order, diffusion):
    rng = np.random.default_rng(1)
    duration = 4.0
    squares = np.array(
        [
            abs(np.exp(1j * order * free(rng, 2000 * PARTS, diffusion, 0.0)[::PARTS]).mean()) ** 2
            for _ in range(400)
        ]
    )
    expected = brownian_amplitude(order, diffusion, duration)
    assert np.mean(squares) == pytest.approx(expected**2, rel=0.2)
    if order**2 * diffusion * duration > 50:
        assert expected == pytest.approx(np.sqrt(2 / (order**2 * diffusion * duration)), rel=0.02)
        # Exponential: a chance of 1e-4 to exceed three times the amplitude.
        assert np.mean(squares > 2.3 * expected**2) == pytest.approx(0.1, abs=0.05)


def test_no_diffusion_keeps_the_amplitude_at_one():
    assert brownian_amplitude(1, 0.0, 16.0) == 1.0
    assert brownian_amplitude(1, 1e-5, 16.0) == pytest.approx(1.0, abs=1e-4)


def test_memory_tells_well_and_diffusion_of_a_confined_rotor():
    rng = np.random.default_rng(2)
    spread, diffusion = 0.5, 8.0
    path = held(rng, 80_000, diffusion, spread)
    rotor = filmed(rng, path, 0.2, 0.2, 0.0, 0.0, diffusion)
    found = memory(rotor.frame, rotor.theta, 1, FRAME_S)
    assert found.wander_rad == pytest.approx(spread, rel=0.06)
    assert found.diffusion_rad2_s == pytest.approx(diffusion, rel=0.2)
    assert found.amplitude == pytest.approx(np.exp(-0.5 * spread**2), rel=0.03)


def test_memory_of_a_stuck_rotor_sees_no_motion_in_the_noise():
    rng = np.random.default_rng(3)
    wander = []
    for _ in range(20):
        rotor = filmed(rng, np.zeros(80_000), 0.3, 0.1, 1.0, 0.0, 0.0)
        wander.append(memory(rotor.frame, rotor.theta, 1, FRAME_S).wander_rad)
    assert max(wander) < np.deg2rad(5.0)


def test_memory_of_a_few_frames_is_nothing_or_finite():
    assert np.isnan(memory(np.array([5]), np.array([0.1]), 1, FRAME_S).amplitude)
    found = memory(np.array([5, 6, 9]), np.array([0.1, 0.2, 0.3]), 1, FRAME_S)
    assert np.isfinite(found.amplitude)


def test_two_places_are_found_with_their_changes():
    rng = np.random.default_rng(4)
    states = np.repeat([0, 1, 0, 1, 0], [300, 200, 100, 250, 150])
    theta = np.where(states == 0, 0.5, 0.5 + np.deg2rad(165)) + rng.normal(0, 0.2, 1000)
    found = dwell_places(theta)
    assert found.first_rad == pytest.approx(0.5, abs=0.05)
    assert np.rad2deg(found.apart_rad) == pytest.approx(165, abs=4)
    assert found.shares == pytest.approx((0.55, 0.45), abs=0.01)
    assert found.toggles == 4
    assert found.outside < 0.01
    assert found.saddle < 0.2


def test_one_place_has_no_opposite():
    theta = np.random.default_rng(5).normal(0.0, 0.5, 5000)
    found = dwell_places(theta)
    assert not found.toggles or min(found.shares) < 0.01


def test_range_and_confinement():
    theta = np.mod(np.linspace(0.0, 10.0, 10_001), 2 * np.pi)
    assert strayed_rad(theta) == pytest.approx(9.98)
    # The chance of staying between walls L apart for T is about exp(-pi^2 D T / L^2).
    rng = np.random.default_rng(6)
    paths = np.cumsum(rng.normal(0.0, np.sqrt(2 * 1e-3), (4000, 2000)), axis=1)
    inside = np.abs(paths).max(axis=1)
    durations = 2.0
    stayed = np.mean(inside < 1.0)
    assert stayed == pytest.approx(4 / np.pi * np.exp(-confinement(2.0, 1.0, durations)), rel=0.3)
