"""The angle of an ideal rotor during every exposure, in exact steps.

A frame's exposure is cut into equal parts, as many as `exposure.parts_of` says. Each part is given
the *mean* angle over it, which is drawn jointly with the end of the part, exactly: so the angle
averaged over an exposure has its exact law whatever the number of parts (variance of increments
2 D dt (1 - 2 Rb)), and a slow rotor needs one part alone. The position averaged over a part lies
inside the circle, by `exposure.inward`.
"""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.exposure import PARTS_OF_A_FLIP, inward, parts_of
from rotortrack.simulate.ideal import IdealRotor


def exposure_parts(rotor: IdealRotor, exposure_s: float) -> int:
    """Return into how many parts an exposure is cut, by `exposure.parts_of`.

    A stuck rotor needs one; a two-position one `PARTS_OF_A_FLIP`.

    Raises
    ------
    ConfigurationError
        The rotor turns so much within an exposure that more than `MOST_PARTS` were needed.
    """
    parts = parts_of(rotor.omega_rad_s * exposure_s, rotor.diffusion_rad2_s * exposure_s)
    return max(parts, PARTS_OF_A_FLIP) if rotor.kind == "two_position" else parts


def exposure_inward(rotor: IdealRotor, exposure_s: float) -> float:
    """Return by which factor the position averaged over a part is nearer to the centre."""
    if rotor.kind == "stuck":
        return 1.0
    part_s = exposure_s / exposure_parts(rotor, exposure_s)
    return inward(rotor.omega_rad_s * part_s, rotor.diffusion_rad2_s * part_s)


def exposure_angles(
    rotor: IdealRotor,
    *,
    n_frames: int,
    frame_interval_s: float,
    exposure_s: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return the mean angle over each part of each exposure, rad, never wrapped.

    A motion that the rotor's kind does not have draws no random number.

    Parameters
    ----------
    rotor
        How it moves.
    n_frames, frame_interval_s, exposure_s
        Frame k is exposed from k * frame_interval_s for exposure_s.
    rng
        The rotor's own stream.

    Returns
    -------
    Angles, shape (n_frames, parts); (1, 1) for a stuck rotor, which broadcasts.
    """
    if rotor.kind == "stuck":
        return np.full((1, 1), float(rotor.start_rad))
    parts = exposure_parts(rotor, exposure_s)
    part_s = exposure_s / parts
    middles_s = (
        np.arange(n_frames)[:, np.newaxis] * frame_interval_s + (np.arange(parts) + 0.5) * part_s
    )
    angles = np.full(middles_s.shape, float(rotor.start_rad))
    if rotor.kind == "two_position":
        flips = _event_times(rotor, n_frames * frame_interval_s, rng)
        angles += np.pi * (np.searchsorted(flips, middles_s, side="right") % 2)
        if rotor.wobble_sd_rad:
            angles += _wobble(middles_s, rotor.wobble_sd_rad, rotor.diffusion_rad2_s, rng)
        return angles
    if rotor.kind == "switching":
        flips = _event_times(rotor, n_frames * frame_interval_s, rng)
        angles += rotor.omega_rad_s * _time_forward_less_backward(middles_s, flips)
    elif rotor.kind == "driven":
        angles += rotor.omega_rad_s * middles_s
    if rotor.diffusion_rad2_s:
        dead_s = max(frame_interval_s - exposure_s, 0.0)
        angles += _brownian(n_frames, parts, part_s, dead_s, rotor.diffusion_rad2_s, rng)
    return angles


def _brownian(
    n_frames: int,
    parts: int,
    part_s: float,
    dead_s: float,
    diffusion: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Draw Brownian motion: its mean over every part of every exposure.

    Over a part of length h that starts at W: end = W + w with w ~ N(0, 2 D h), and mean = W + w/2
    + N(0, 2 D h / 12), the last independent of w (the area under a Brownian bridge).
    """
    normal = rng.standard_normal((2, n_frames, parts))
    scale = math.sqrt(2.0 * diffusion * part_s)
    steps = scale * normal[0]
    if dead_s > 0.0:
        idle = math.sqrt(2.0 * diffusion * dead_s) * rng.standard_normal((n_frames, 1))
        steps = np.concatenate([steps, idle], axis=1)
    ends = np.cumsum(steps).reshape(steps.shape)
    middles = (ends - 0.5 * steps)[:, :parts]
    means: NDArray[np.float64] = middles + scale / math.sqrt(12.0) * normal[1]
    return means


def _wobble(
    times_s: NDArray[np.float64], sd_rad: float, diffusion: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw a stationary Ornstein-Uhlenbeck process at given times (exact transition law)."""
    relaxation_s = sd_rad**2 / diffusion
    # An infinite time before the first sample forgets the start: the process is stationary.
    keep = np.exp(-np.diff(times_s.ravel(), prepend=-np.inf) / relaxation_s)
    kicks = sd_rad * np.sqrt(1.0 - keep**2) * rng.standard_normal(keep.size)
    walk = accumulate(
        zip(keep.tolist(), kicks.tolist(), strict=True),
        lambda angle, step: step[0] * angle + step[1],
        initial=0.0,
    )
    return np.fromiter(walk, dtype=np.float64, count=keep.size + 1)[1:].reshape(times_s.shape)


def _event_times(
    rotor: IdealRotor, duration_s: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return the sorted times of a rotor's flips, drawing them only when a rate is given."""
    if rotor.event_times_s:
        return np.sort(np.asarray(rotor.event_times_s, dtype=np.float64))
    count = rng.poisson(rotor.event_rate_per_s * duration_s)
    return np.sort(rng.uniform(0.0, duration_s, count))


def _time_forward_less_backward(
    times_s: NDArray[np.float64], flips_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Integrate a sign that starts at +1 and flips at each event, from 0 to each time."""
    knots = np.concatenate([[0.0], flips_s[flips_s > 0.0], [np.inf]])
    # Events at or before time 0 have already turned the sign.
    sign = (-1.0) ** (np.arange(knots.size - 1) + np.count_nonzero(flips_s <= 0.0))
    reached = np.concatenate([[0.0], np.cumsum(sign[:-1] * np.diff(knots[:-1]))])
    leg = np.searchsorted(knots, times_s, side="right") - 1
    elapsed: NDArray[np.float64] = reached[leg] + sign[leg] * (times_s - knots[leg])
    return elapsed
