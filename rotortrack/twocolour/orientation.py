"""How end-to-end axes lie: whether a rotor keeps one, and whether rotors lie along their pores.

An axis has no sense: directions half a turn apart are one, so that all is said of twice the angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_HALF_TURN_DEG = 180.0
_FEWEST = 2
_TELLING = 8.0
_NO_SPREAD = 1e-12


@dataclass(frozen=True)
class Axis:
    """The axis that directions prefer.

    Attributes
    ----------
    axis_deg
        From 0 to 180, counter-clockwise from the right on the displayed image; nan without any.
    order
        Mean of cos 2 (angle - axis): 1 where all keep it, 0 where none is preferred.
    order_p
        Probability of such an order without a preferred axis; nan where fewer than 8 independent
        directions were seen.
    n_independent
        How many independent directions the correlated ones are worth.
    """

    axis_deg: float
    order: float
    order_p: float
    n_independent: float


def preferred_axis(angles_rad: Floats) -> Axis:
    """Find the axis that a rotor's end-to-end vector prefers.

    Parameters
    ----------
    angles_rad
        Directions of the vector, counter-clockwise on the displayed image, in order of frames,
        (frames,).

    Returns
    -------
    Axis

    Notes
    -----
    The probability is Rayleigh's for twice the angle, with as many independent directions as the
    correlation from frame to frame leaves: a rotor that turns slowly seems to prefer wherever it
    was. Of fewer than 8 that number is too uncertain: of free rotors that seem worth less, up to a
    quarter would have a probability below 0.05.
    """
    angles = np.asarray(angles_rad, np.float64)
    doubled = np.exp(2j * angles[np.isfinite(angles)])
    if doubled.size < _FEWEST:
        return Axis(math.nan, math.nan, math.nan, float(doubled.size))
    mean = complex(doubled.mean())
    independent = _independent(doubled)
    return Axis(
        axis_deg=_axis_deg(mean),
        order=abs(mean),
        order_p=rayleigh_p(abs(mean), independent) if independent >= _TELLING else math.nan,
        n_independent=independent,
    )


def rayleigh_p(resultant: float, n: float) -> float:
    """Give the probability of so long a mean of n unit vectors of random direction.

    The series of Zar (Biostatistical Analysis, eq. 27.4), within 0.001 for n of 10 and more.
    """
    if n < 1.0:
        return 1.0
    total = n * min(resultant, 1.0)
    root = math.sqrt(1.0 + 4.0 * n + 4.0 * (n * n - total * total))
    return min(1.0, math.exp(root - (1.0 + 2.0 * n)))


@dataclass(frozen=True)
class Alignment:
    """How the axes of many rotors lie to the long axis of their pores.

    Attributes
    ----------
    alignment
        Mean of cos 2 (axis - pore axis), each rotor's weighted by its order: 1 along, -1 across.
    alignment_p
        Probability of one so far from 0, either way, if axes had no regard to the pores.
    n_rotors
        How many.
    """

    alignment: float
    alignment_p: float
    n_rotors: int


def alignment(axes_deg: Floats, order: Floats, pore_axis_deg: float) -> Alignment:
    """Hold rotors' axes against the long axis of their pores.

    Parameters
    ----------
    axes_deg, order
        As `preferred_axis` gives them, (rotors,).
    pore_axis_deg
        Direction of the pores, counter-clockwise from the right on the displayed image.

    Returns
    -------
    Alignment

    Notes
    -----
    Rotors are the independent ones, not frames. If the axes had no regard to the pores, each term
    order * cos 2 (axis - pore) would have the mean 0 and the variance order^2 / 2; the probability
    is that of a normal sum of them.
    """
    axes, order = np.asarray(axes_deg, np.float64), np.asarray(order, np.float64)
    known = np.isfinite(axes) & np.isfinite(order)
    axes, order = axes[known], order[known]
    weight = float(order.sum())
    if not weight > _NO_SPREAD:
        return Alignment(math.nan, math.nan, int(known.sum()))
    terms = order * np.cos(2.0 * np.deg2rad(axes - pore_axis_deg))
    spread = math.sqrt(0.5 * float(np.sum(order**2)))
    return Alignment(
        alignment=float(terms.sum()) / weight,
        alignment_p=math.erfc(abs(float(terms.sum())) / spread / math.sqrt(2.0)),
        n_rotors=int(known.sum()),
    )


def _axis_deg(mean: complex) -> float:
    return math.degrees(math.atan2(mean.imag, mean.real)) / 2.0 % _HALF_TURN_DEG


def _independent(doubled: NDArray[np.complex128]) -> float:
    """Count what correlated unit vectors are worth, by how long they stray from their mean.

    Where a part k of the correlation is kept from frame to frame, n frames are worth
    n (1 - k) / (1 + k). Its mean subtracted,
    a rotor that hardly turned once would seem to stray for a short time only: the time is taken
    from where the correlation is down by half, and enlarged by what the mean itself took.
    """
    n = doubled.size
    strayed = doubled - doubled.mean()
    variance = float(np.mean(np.abs(strayed) ** 2))
    if not variance > _NO_SPREAD:
        return float(n)
    length = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.fft(strayed, length)) ** 2
    correlation = np.fft.ifft(spectrum).real[:n] / (n - np.arange(n)) / variance
    below = np.flatnonzero(correlation < 0.5)
    half = int(below[0]) if below.size else n
    if half <= 1:
        kept = max(float(correlation[1]), 0.0)
    else:
        before, at = correlation[half - 1], correlation[half]
        time = (half - 1 + (before - 0.5) / (before - at)) / math.log(2.0)
        time /= max(1.0 - 4.0 * time / n, 0.25)
        kept = math.exp(-1.0 / time)
    return max(n * (1.0 - kept) / (1.0 + kept), 1.0)
