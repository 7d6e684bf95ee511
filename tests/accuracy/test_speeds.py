"""Speeds, diffusion and behaviour of rotors whose positions are simulated with plain numpy.

Truth is the omega that was put in, not the mean of the trajectory that came out. The path is
averaged over the exposure in position, as a camera does, and the noise is on x and y.
"""

from collections import Counter

import numpy as np
import pytest

from rotortrack.motion.angles import angle
from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.increments import increments
from rotortrack.motion.measure import measure_rotor
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.readings import Circle
from rotortrack.motion.tracks import Track

FRAME_S = 0.002
UNIT_CIRCLE = Circle(0.0, 0.0, 1.0)
REPEATS = 200
PARTS = 6


def positions(rng, path, sigma, missing):
    """Track of exposure-averaged positions on the unit circle, sigma in radii."""
    exposed = np.exp(1j * path).reshape(-1, PARTS).mean(axis=1)
    n = exposed.size
    x = exposed.real + rng.normal(0.0, sigma, n)
    y = -exposed.imag + rng.normal(0.0, sigma, n)
    return seen(x, y, np.flatnonzero(rng.random(n) >= missing), sigma)


def seen(x, y, frame, sigma, circle=UNIT_CIRCLE):
    theta = angle(x, y, np.float64(circle.x_nm), np.float64(circle.y_nm))[frame]
    sd = np.full(frame.size, sigma)
    return Track(frame, theta, x[frame], y[frame], sd, sd, circle)


def diffusing(rng, n, omega, diffusion, sigma, missing):
    pace = FRAME_S / PARTS
    step = rng.normal(omega * pace, np.sqrt(2.0 * diffusion * pace), n * PARTS)
    return positions(rng, np.cumsum(step), sigma, missing)


def toggling(rng, n, rate, swing, sigma):
    """Jump between two angles at a rate in 1/s."""
    jumps = rng.random(n * PARTS) < rate * FRAME_S / PARTS
    return positions(rng, swing * (np.cumsum(jumps) % 2), sigma, 0.0)


def measure(track, gap_mode="drop"):
    options = MotionOptions(gap_mode=gap_mode)
    return measure_rotor(track, options, frame_interval_s=FRAME_S, exposure_s=FRAME_S)


def estimate(track):
    """Speed and diffusion alone, which take a quarter of the time of everything."""
    seen_of = (track.frame, track.x_nm, track.y_nm, track.x_sd_nm, track.y_sd_nm, track.circle)
    return estimate_motion(*seen_of, frame_interval_s=FRAME_S, exposure_s=FRAME_S).fit


# (frames, omega, D, sigma over radius, part missing)
CASES = [
    (8000, 2.0, 0.2, 0.2, 0.0),
    (4000, 10.0, 2.0, 0.2, 0.0),
    (4000, 0.0, 2.0, 0.2, 0.2),
    (1500, 100.0, 2.0, 0.2, 0.4),
    (4000, -40.0, 20.0, 0.1, 0.4),
    (3000, 100.0, 60.0, 0.2, 0.1),
]


@pytest.mark.parametrize("case", CASES)
def test_speeds_have_pulls_of_one_and_no_bias(case):
    n, omega, diffusion, sigma, missing = case
    rng = np.random.default_rng(20)
    found = [estimate(diffusing(rng, n, omega, diffusion, sigma, missing)) for _ in range(REPEATS)]
    speeds = np.array([fit.omega_rad_s for fit in found])
    pulls = (speeds - omega) / [fit.omega_sd_rad_s for fit in found]
    assert 0.85 < np.sqrt(np.mean(pulls**2)) < 1.15
    ends = (fit.omega_interval_rad_s for fit in found)
    assert 0.90 <= np.mean([low < omega < high for low, high in ends]) <= 0.99
    assert abs(speeds.mean() - omega) < 3.0 * speeds.std() / np.sqrt(REPEATS)
    diffusions = np.array([fit.diffusion_rad2_s for fit in found])
    allowed = 3.0 * diffusions.std() / np.sqrt(REPEATS) + 0.02 * diffusion
    assert abs(diffusions.mean() - diffusion) < allowed


def covariance_based(track):
    """Estimate D from lag-0 and lag-1 products alone; blur and noise cancel in their sum."""
    step = increments(track.frame, track.theta_rad, "drop").step_rad
    step = step - step.mean()
    return (np.mean(step**2) / 2.0 + np.mean(step[1:] * step[:-1])) / FRAME_S


def test_diffusion_is_known_to_5_percent_where_the_covariance_based_estimator_has_17():
    rng = np.random.default_rng(21)
    tracks = [diffusing(rng, 8000, 0.0, 2.0, 0.2, 0.0) for _ in range(100)]
    found = np.array([estimate(track).diffusion_rad2_s for track in tracks])
    assert found.mean() == pytest.approx(2.0, rel=0.02)
    assert found.std() / 2.0 < 0.06
    assert 0.13 < np.std([covariance_based(track) for track in tracks]) / 2.0 < 0.22


@pytest.mark.parametrize(
    ("sigma", "missing", "gap_mode"),
    [(0.05, 0.0, "drop"), (0.2, 0.0, "drop"), (0.2, 0.3, "drop"), (0.2, 0.3, "bridge")],
)
def test_no_stuck_rotor_is_reported_as_driven(sigma, missing, gap_mode):
    rng = np.random.default_rng(22)
    found = Counter(
        measure(diffusing(rng, 2000, 0.0, 0.0, sigma, missing), gap_mode).behaviour.name
        for _ in range(REPEATS)
    )
    assert found["driven_ccw"] + found["driven_cw"] == 0
    # The 95 % interval of D excludes zero once in 40 by chance.
    assert found["brownian"] <= 0.04 * REPEATS
    if missing == 0.0 or gap_mode == "bridge":
        assert found["stuck"] > 0.95 * REPEATS


@pytest.mark.parametrize(
    ("swing_deg", "rate"), [(180, 1.0), (180, 20.0), (176, 20.0), (160, 20.0), (90, 1.0)]
)
def test_no_toggling_rotor_is_reported_as_driven(swing_deg, rate):
    rng = np.random.default_rng(23)
    found = Counter(
        measure(toggling(rng, 3000, rate, np.deg2rad(swing_deg), 0.1)).behaviour.name
        for _ in range(REPEATS // 5)
    )
    assert found["driven_ccw"] + found["driven_cw"] == 0


def test_a_stuck_spot_inside_its_own_circle_is_not_driven_nor_called_brownian():
    # A circle fitted to noise runs through the noise, so its angles are random in every frame.
    rng = np.random.default_rng(24)
    for _ in range(50):
        x, y = rng.normal(0.0, [[1.0], [0.6]], (2, 2000))
        track = seen(x, y, np.arange(2000), 1.0, Circle(0.2, -0.1, 1.0))
        assert measure(track).behaviour.name == "unclassified"


# With D = 0.5 a rotor strays by 2 rad in the 4 s, too little to tell it from a confined one.
@pytest.mark.parametrize(("diffusion", "least"), [(0.5, 80), (10.0, 95), (60.0, 95)])
def test_brownian_rotors_are_named_so_or_not_named_at_all(diffusion, least):
    rng = np.random.default_rng(25)
    found = Counter(
        measure(diffusing(rng, 2000, 0.0, diffusion, 0.2, 0.0)).behaviour.name for _ in range(100)
    )
    assert found["brownian"] >= least
    assert found["brownian"] + found["unclassified"] >= 99
