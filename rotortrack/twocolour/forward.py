"""What a microscope would have measured of the rods of a scan: twins of the measured rotors.

Measured distances are not freed of their noise but simulated ones are given the same: a twin of a
rotor is a simulated rod, drawn by its weight, with as many frames as the rotor, its uncertainties
frame by frame, an error of the registration drawn for all its frames, its exposure and diffusion,
and a speed of the measured ones. Twins whose ring would not have passed the screening are drawn
again. A simulated rod is rigid, so that nothing of a twin breathes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.motion.blur import radius_factor
from rotortrack.twocolour.measured import MeasuredGroup, histograms
from rotortrack.twocolour.population import RodPopulation

Floats = NDArray[np.float64]

RIGID_NOTE: Final = (
    "simulated rods are rigid: measured ones breathe, which widens their distances beyond those of "
    "their twins"
)

_PATHS: Final = 128
"""Exposures that are drawn for each twin; a frame takes one of them."""
_PARTS: Final = 12
"""Moments of an exposure: a radius blurred by half a turn is missed by 3e-3 of it."""


@dataclass(frozen=True)
class Twins:
    """Simulated twins of measured rotors.

    Attributes
    ----------
    rod
        Which rod of the population each is, shape (twins, rotors).
    mean_nm
        Mean of its distances as they would be measured.
    true_nm
        Its distance as it would be estimated free of noise.
    counts
        Frames in the bins of a histogram, shape (twins, rotors, bins).
    accepted
        Part of the population that passes the screening, averaged over rotors.
    unscreened
        Rotors at whose noise no rod of the population passes; their twins were not screened.
    """

    rod: NDArray[np.int64]
    mean_nm: Floats
    true_nm: Floats
    counts: NDArray[np.int32]
    accepted: float
    unscreened: int


def rescaled_speeds_deg_s(group: MeasuredGroup, rods: RodPopulation) -> Floats:
    """Give the rods the measured distribution of speeds, the faster rod the faster speed.

    A simulated rod turns some hundred times as fast as a measured one, and no one factor of
    friction gives all of them the measured spread.

    Returns
    -------
    ndarray
        Signed speed of each rod of the population, deg/s; nan where no rotor has a speed.
    """
    measured = np.abs(group.speed_deg_s[np.isfinite(group.speed_deg_s)])
    if not measured.size:
        return np.full(len(rods.weight), np.nan)
    order = np.argsort(np.abs(rods.rate_rev_s), kind="stable")
    rank = np.empty(len(order))
    rank[order] = np.cumsum(rods.weight[order]) - 0.5 * rods.weight[order]
    speeds: Floats = np.quantile(measured, np.clip(rank, 0.0, 1.0))
    return speeds * np.sign(rods.rate_rev_s)


def draw_twins(
    group: MeasuredGroup,
    rods: RodPopulation,
    edges: Floats,
    *,
    twins: int,
    fitted_noise: bool = False,
    rng: np.random.Generator,
) -> Twins:
    """Draw twins of each rotor from a population of simulated rods.

    Parameters
    ----------
    group, rods
        What was measured, and what it is compared with.
    edges
        Of the histograms of frames, from 0, nm.
    twins
        How many each rotor gets.
    fitted_noise
        Scale the uncertainties to the noise that the distances themselves tell, which the error of
        the registration is part of, instead of drawing that.
    rng
        Random numbers.

    Notes
    -----
    Costs about 20 ns for each frame of a twin.
    """
    omega = np.nan_to_num(np.radians(rescaled_speeds_deg_s(group, rods)))
    exposure_s = float(np.nan_to_num(group.film.exposure_s))
    known = group.diffusion_rad2_s[np.isfinite(group.diffusion_rad2_s)]
    typical = float(np.median(known)) if known.size else 0.0
    diffusion = np.where(np.isfinite(group.diffusion_rad2_s), group.diffusion_rad2_s, typical)
    first = group.first_frame
    shape = (twins, group.n)
    rod = np.zeros(shape, np.int64)
    mean, true = np.zeros(shape), np.zeros(shape)
    counts = np.zeros((*shape, len(edges) - 1), np.int32)
    accepted, unscreened = 0.0, 0
    for i in range(group.n):
        passing = rods.weight * _passing(group, rods, omega, diffusion[i], exposure_s, i)
        accepted += float(passing.sum()) / group.n
        if not passing.any():
            unscreened += 1
            passing = rods.weight
        rod[:, i] = rng.choice(len(passing), twins, p=passing / passing.sum())
        frames = slice(first[i], first[i + 1])
        n = int(group.n_frames[i])
        scale = group.noise_ratio[i] if fitted_noise else 1.0
        x_sd, y_sd = scale * group.x_sd_nm[frames], scale * group.y_sd_nm[frames]
        shift_sd = 0.0 if fitted_noise else group.registration_sd_nm[i]
        distance = np.empty((twins, n))
        for j in range(twins):
            chosen = rod[j, i]
            path = _exposures(omega[chosen], diffusion[i], exposure_s, rng)
            length = rods.distance_nm[chosen] * np.abs(path)
            seen = length[rng.integers(0, _PATHS, n)] * np.exp(2j * np.pi * rng.random(n))
            shift = rng.normal(0.0, shift_sd, 2)
            distance[j] = np.hypot(
                seen.real + shift[0] + x_sd * rng.standard_normal(n),
                seen.imag + shift[1] + y_sd * rng.standard_normal(n),
            )
            true[j, i] = max(rng.normal(length.mean(), group.true_sd_nm[i]), 0.0)
        mean[:, i] = distance.mean(axis=1)
        counts[:, i] = histograms(distance.ravel(), np.full(twins, n), edges)
    return Twins(rod, mean, true, counts, accepted, unscreened)


def _passing(
    group: MeasuredGroup,
    rods: RodPopulation,
    omega_rad_s: Floats,
    diffusion_rad2_s: float,
    exposure_s: float,
    i: int,
) -> Floats:
    """Give the part of each rod's two ends whose ring is wide enough at a rotor's noise.

    The screening asks for sqrt(R^2 / 2 + s^2) / s >= min_spread, R being blurred by the exposure.
    """
    noise = group.localisation_sd_nm[i]
    if not (np.isfinite(noise) and noise > 0):
        return np.ones(len(rods.weight))
    blur = np.array([radius_factor(speed, diffusion_rad2_s, exposure_s) for speed in omega_rad_s])
    radius = rods.radius_nm * blur[:, None]
    spread = np.sqrt(0.5 * radius**2 + noise**2) / noise
    # Which end has the colour that was screened is not known.
    part: Floats = np.mean(spread >= group.film.min_spread, axis=1)
    return part


def _exposures(
    omega_rad_s: float, diffusion_rad2_s: float, exposure_s: float, rng: np.random.Generator
) -> NDArray[np.complex128]:
    """Average a unit vector that turns and diffuses over exposures, shape (_PATHS,)."""
    if exposure_s == 0.0:
        return np.ones(_PATHS, np.complex128)
    part_s = exposure_s / _PARTS
    steps = rng.normal(0.0, np.sqrt(2.0 * max(diffusion_rad2_s, 0.0) * part_s), (_PATHS, _PARTS))
    angle = np.cumsum(steps + omega_rad_s * part_s, axis=1)
    mean: NDArray[np.complex128] = np.exp(1j * angle).mean(axis=1)
    return mean
