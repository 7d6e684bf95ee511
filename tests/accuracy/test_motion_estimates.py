"""Corners of the grid of `tests/benchmarks/speed_coverage.py`, simulated in position.

The path has twelve parts a frame, the camera averages positions over the exposure, and noise is
added to x and y. Truth is the omega that was put in.
"""

import numpy as np
import pytest

from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.readings import Circle

FRAME_S = 0.002
PARTS = 12


def positions(rng, n, omega, diffusion, sigma, missing, exposed):
    pace = FRAME_S / PARTS
    path = np.cumsum(rng.normal(omega * pace, np.sqrt(2 * diffusion * pace), n * PARTS))
    on_circle = np.exp(1j * path).reshape(n, PARTS)[:, : PARTS if exposed else 1].mean(axis=1)
    frame = np.flatnonzero(rng.random(n) >= missing)
    x = 100 * (on_circle.real + rng.normal(0.0, sigma, n))
    y = -100 * (on_circle.imag + rng.normal(0.0, sigma, n))
    radius = 100 * np.sqrt(np.mean(np.abs(on_circle) ** 2))
    circle = Circle(x_nm=0.0, y_nm=0.0, radius_nm=radius)
    return frame, x[frame], y[frame], np.full(frame.size, 100 * sigma), circle, on_circle


def estimate(simulated, exposed):
    frame, x, y, sd, circle, _ = simulated
    return estimate_motion(
        frame, x, y, sd, sd, circle, frame_interval_s=FRAME_S, exposure_s=exposed * FRAME_S
    )


# (rotors, frames, omega, D, sigma over radius, part missing, exposed, method)
CORNERS = [
    (200, 2000, 30.0, 5.0, 0.1, 0.4, 1.0, "increments"),
    (80, 1500, -200.0, 120.0, 0.1, 0.6, 1.0, "circular"),
    (80, 2000, 15.0, 20.0, 0.5, 0.2, 0.0, "circular"),
]


@pytest.mark.parametrize("corner", CORNERS)
def test_speeds_and_diffusion_are_unbiased_with_honest_intervals(corner):
    rotors, n, omega, diffusion, sigma, missing, exposed, method = corner
    rng = np.random.default_rng(30)
    found = [
        estimate(positions(rng, n, omega, diffusion, sigma, missing, exposed), exposed)
        for _ in range(rotors)
    ]
    assert {one.method for one in found} == {method}
    fits = [one.fit for one in found]
    # Three standard errors everywhere.
    scatter = 3.0 / np.sqrt(rotors)
    omegas = np.array([fit.omega_rad_s for fit in fits])
    pulls = (omegas - omega) / [fit.omega_sd_rad_s for fit in fits]
    assert abs(pulls.mean()) < scatter
    assert abs(pulls.std() - 1.0) < scatter / np.sqrt(2.0) + 0.02
    least = 0.95 - scatter * np.sqrt(0.95 * 0.05)
    inside = [fit.omega_interval_rad_s[0] < omega < fit.omega_interval_rad_s[1] for fit in fits]
    assert np.mean(inside) > least
    diffusions = np.array([fit.diffusion_rad2_s for fit in fits])
    relative = np.mean([fit.diffusion_relative_sd for fit in fits])
    assert abs(diffusions.mean() / diffusion - 1.0) < scatter * relative + 0.01
    assert diffusions.std() / diffusion < relative * (1.1 + scatter)
    inside = [
        fit.diffusion_interval_rad2_s[0] < diffusion < fit.diffusion_interval_rad2_s[1]
        for fit in fits
    ]
    assert np.mean(inside) > least
    assert np.mean([one.resampled for one in found]) < 0.05


def test_one_undriven_rotor_in_twenty_is_called_driven_at_5_percent():
    rng = np.random.default_rng(31)
    p = [
        estimate(positions(rng, 1500, 0.0, 10.0, 0.15, 0.2, 1.0), 1.0).fit.drift_p
        for _ in range(400)
    ]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.08
    assert 0.4 < np.mean(p) < 0.6


@pytest.mark.parametrize(
    ("diffusion", "sigma", "exposed"), [(2.0, 0.2, 1.0), (20.0, 0.4, 0.0), (60.0, 0.2, 1.0)]
)
def test_posterior_positions_beat_the_single_frame_bound_as_they_should(diffusion, sigma, exposed):
    rng = np.random.default_rng(32)
    simulated = positions(rng, 8000, 20.0, diffusion, sigma, 0.0, exposed)
    after = estimate(simulated, exposed).posterior
    truth = 100 * simulated[-1]
    square = (after.x_nm - truth.real) ** 2 + (after.y_nm + truth.imag) ** 2
    q = 2 * diffusion * FRAME_S / sigma**2
    goal = np.sqrt(0.5 / np.sqrt(1 + 4 / q))
    assert np.sqrt(square.mean() / 2) / (100 * sigma) < 1.05 * goal
    pull = np.sqrt(square.mean() / np.mean(after.x_sd_nm**2 + after.y_sd_nm**2))
    assert 0.95 < pull < 1.05
