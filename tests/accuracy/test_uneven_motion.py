"""Stick and slip, and washboards, are told from plain drift and diffusion by the residuals.

Paths have ten parts a frame; the camera averages positions over the exposure. 2000 frames, 10 %
of them missing.
"""

import numpy as np
import pytest

from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.readings import Circle

FRAME_S = 0.002
PARTS = 10
PART_S = FRAME_S / PARTS
STEPS = 2000 * PARTS
CIRCLE = Circle(x_nm=0.0, y_nm=0.0, radius_nm=100.0)


def filmed(rng, path, sigma):
    place = 100.0 * np.exp(1j * path).reshape(-1, PARTS).mean(axis=1)
    frame = np.flatnonzero(rng.random(place.size) >= 0.1)
    x, y = rng.normal(0.0, 100.0 * sigma, (2, place.size)) + np.stack([place.real, -place.imag])
    sd = np.full(frame.size, 100.0 * sigma)
    return estimate_motion(
        frame,
        x[frame],
        y[frame],
        sd,
        sd,
        CIRCLE,
        frame_interval_s=FRAME_S,
        exposure_s=FRAME_S,
    )


def walk(rng, diffusion, omega):
    spread = np.sqrt(2.0 * diffusion * PART_S)
    return np.cumsum(rng.normal(omega * PART_S, spread, STEPS))


def stick_and_slip(rng):
    """Rest for 0.1 s, then slip at 60 rad/s for 0.03 s, both exponential on average."""
    slips, at, now = np.zeros(STEPS), 0, 0.0
    while at < STEPS:
        lasts = max(int(rng.exponential(0.03 if now else 0.1) / PART_S), 1)
        slips[at : at + lasts] = now
        at, now = at + lasts, 1.0 - now
    noise = rng.normal(0.0, np.sqrt(2.0 * 2.0 * PART_S), STEPS)
    return np.cumsum(slips * (60.0 * PART_S + noise))


def washboards(rng, count, diffusion, tilt, height, wells):
    """Diffuse under a tilt (kT per rad) over so many wells of ``height cos(wells theta)`` kT."""
    kicks = rng.normal(0.0, np.sqrt(2.0 * diffusion * PART_S), (STEPS, count))
    theta = np.zeros(count)
    path = np.empty((STEPS, count))
    for k in range(STEPS):
        force = tilt + height * wells * np.sin(wells * theta)
        theta = theta + diffusion * PART_S * force + kicks[k]
        path[k] = theta
    return path.T


def flagged(found):
    return np.mean([one.white.p < 1e-3 for one in found])


def test_stick_and_slip_is_flagged():
    rng = np.random.default_rng(41)
    found = [filmed(rng, stick_and_slip(rng), 0.15) for _ in range(40)]
    assert flagged(found) >= 0.9
    assert all(one.resampled == (one.white.p < 1e-3) for one in found)


@pytest.mark.parametrize(
    ("diffusion", "tilt", "height", "wells"), [(10.0, 3.0, 1.0, 4), (20.0, 0.0, 1.8, 3)]
)
def test_washboards_are_flagged_by_their_directions(diffusion, tilt, height, wells):
    rng = np.random.default_rng(42)
    found = [
        filmed(rng, path, 0.15) for path in washboards(rng, 30, diffusion, tilt, height, wells)
    ]
    assert flagged(found) >= 0.9
    assert np.mean([one.white.angle_p < 1e-4 for one in found]) >= 0.9


def test_plain_diffusion_stuck_or_slow_or_driven_is_flagged_in_one_of_a_hundred_at_most():
    rng = np.random.default_rng(43)
    stuck = [filmed(rng, walk(rng, 0.0, 0.0), rng.uniform(0.1, 0.3)) for _ in range(100)]
    moving = [
        filmed(
            rng,
            walk(
                rng, np.exp(rng.uniform(np.log(0.01), np.log(60.0))), rng.choice([0.0, 3.0, 30.0])
            ),
            rng.uniform(0.1, 0.25),
        )
        for _ in range(300)
    ]
    assert flagged(stuck) <= 0.01
    assert flagged(moving) <= 0.01
    # Nor are their probabilities piled up near zero: of 400, a tenth is 40 +- 6.
    assert np.mean([one.white.p < 0.1 for one in stuck + moving]) < 0.15
