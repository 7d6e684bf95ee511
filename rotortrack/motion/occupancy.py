"""Where a rotor dwells, how long it remembers where it was, and how far it strays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LAGS = 48
_RATES = 96
_HARMONICS = 6
_DIRECTIONS = 360
_PLACE_RAD = np.deg2rad(60.0)
_ARRIVED_RAD = np.deg2rad(45.0)


@dataclass(frozen=True)
class Memory:
    """Decay of ``C(t) = mean cos(n (theta(s + t) - theta(s)))`` to its plateau A_n^2.

    Attributes
    ----------
    order
        n.
    amplitude
        A_n = |mean exp(i n theta)| without localisation noise, which lowers all lags alike.
    rate_per_s
        Rate k of the exponential that fits the decay best.
    diffusion_rad2_s
        D that its slope at short lags tells, whatever the rotor does later.
    """

    order: int
    amplitude: float
    rate_per_s: float
    diffusion_rad2_s: float

    @property
    def wander_rad(self) -> float:
        """Standard deviation of a normal distribution with this amplitude."""
        if not self.amplitude > 0.0:
            return math.inf
        return math.sqrt(max(-2.0 * math.log(self.amplitude), 0.0)) / self.order


def memory(frame: Integers, theta_rad: Floats, order: int, frame_interval_s: float) -> Memory:
    """Fit plateau and rate of the decay of a rotor's memory of its direction.

    ``C(t) = a exp(-k t) + A_n^2`` at 48 lags, spread evenly over log t up to a quarter of the
    track. The noise-free amplitude is ``A_n / sqrt(a + A_n^2)`` and, for short times,
    ``a k / (a + A_n^2) = n^2 D``.

    Parameters
    ----------
    frame, theta_rad
        Frames, ascending without repeats, and angles, shape (n,), n > 0.
    order
        Harmonic n: 1 for one dwell place, 2 for two opposite ones.
    frame_interval_s
        Time between frame starts, s.

    Notes
    -----
    Cost: two FFTs of twice the length; 2 ms for 8000 frames.
    """
    row = frame - frame[0]
    span = int(row[-1]) + 1
    if span < 2:
        return Memory(order, math.nan, math.nan, math.nan)
    turns = np.exp(1j * order * theta_rad)
    plateau = float(abs(turns.mean()) ** 2)
    longest = max(span // 4, 1)
    lags = np.unique(np.rint(np.geomspace(1, longest, _LAGS)).astype(np.int64))
    pairs = _products(np.ones(row.size, np.complex128), row, span)[lags]
    lags, pairs = lags[pairs > 0.5], pairs[pairs > 0.5]
    if lags.size == 0:
        return Memory(order, math.nan, math.nan, math.nan)
    excess = _products(turns, row, span)[lags] / pairs - plateau
    lag_s = lags * frame_interval_s
    # A faster decay could not be told from noise: its start would lie far above any lag.
    rates = np.geomspace(0.2 / lag_s[-1], 0.5 / lag_s[0], _RATES)
    decay = np.exp(-rates[:, np.newaxis] * lag_s)
    # For a given rate the best amplitude is linear; the residual falls by share^2 / size.
    share, size = decay @ excess, np.sum(decay**2, axis=1)
    best = int(np.argmax(np.maximum(share, 0.0) ** 2 / size))
    decaying = max(float(share[best] / size[best]), 0.0)
    whole = max(decaying + plateau, 1e-12)
    rate = float(rates[best])
    return Memory(
        order=order,
        amplitude=math.sqrt(plateau / whole),
        rate_per_s=rate,
        diffusion_rad2_s=decaying * rate / whole / order**2,
    )


def brownian_amplitude(order: int, diffusion_rad2_s: float, duration_s: float) -> float:
    """Root mean square of |mean exp(i n theta)| of a rotor that only diffuses.

    ``sqrt(2 (b - 1 + exp(-b))) / b`` with ``b = n^2 D T``, about ``sqrt(2 / (n^2 D T))`` in long
    movies. Rayleigh's test would take all frames as independent and reject nearly every rotor. Its
    square is distributed exponentially: three times this amplitude has a probability of 1e-4.
    """
    decay = order**2 * diffusion_rad2_s * duration_s
    if not decay > 1e-4:
        return 1.0
    return math.sqrt(2.0 * (decay + math.expm1(-decay))) / decay


@dataclass(frozen=True)
class Places:
    """The two directions that a rotor prefers.

    Attributes
    ----------
    first_rad, second_rad
        Highest and second highest peak of the occupancy; nan without a second.
    apart_rad
        Angle between them, in [0, pi].
    shares
        Frames within 60 degrees of each.
    outside
        Frames near neither: 1/3 for a rotor without preference.
    saddle
        Least density on the shorter way between them over that of the second.
    toggles
        Times that it came within 45 degrees of one from within 45 degrees of the other.
    """

    first_rad: float
    second_rad: float
    apart_rad: float
    shares: tuple[float, float]
    outside: float
    saddle: float
    toggles: int


def dwell_places(theta_rad: Floats) -> Places:
    """Find the two most visited directions, by the first six harmonics of the occupancy."""
    orders = np.arange(1, _HARMONICS + 1)
    # Fejer's weights keep the sum of harmonics above zero and without side peaks.
    weights = 1.0 - orders / (_HARMONICS + 1.0)
    waves = np.exp(-1j * orders[:, np.newaxis] * theta_rad).mean(axis=1)
    around = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    density = 1.0 + 2.0 * ((weights * waves) @ np.exp(1j * orders[:, np.newaxis] * around)).real
    peaks = np.flatnonzero((density > np.roll(density, 1)) & (density >= np.roll(density, -1)))
    peaks = peaks[np.argsort(density[peaks])[::-1]]
    if peaks.size < 2:
        return Places(math.nan, math.nan, math.nan, (math.nan, math.nan), math.nan, math.nan, 0)
    first, second = (float(around[peak]) for peak in peaks[:2])
    between = np.rint(np.angle(np.exp(1j * (second - first))) * _DIRECTIONS / (2.0 * np.pi))
    way = peaks[0] + np.arange(abs(int(between)) + 1) * int(np.sign(between))
    saddle = float(density[way % _DIRECTIONS].min() / density[peaks[1]])
    offset = np.stack([_distance(theta_rad, first), _distance(theta_rad, second)])
    near = offset < _PLACE_RAD
    visits = np.full(theta_rad.size, -1)
    visits[offset[0] < _ARRIVED_RAD] = 0
    visits[offset[1] < _ARRIVED_RAD] = 1
    return Places(
        first_rad=first,
        second_rad=second,
        apart_rad=float(_distance(np.array([first]), second)[0]),
        shares=(float(near[0].mean()), float(near[1].mean())),
        outside=float(np.mean(~near.any(axis=0))),
        saddle=saddle,
        toggles=int(np.count_nonzero(np.diff(visits[visits >= 0]))),
    )


def strayed_rad(theta_rad: Floats) -> float:
    """Range of the unwrapped angle, rad, but for the outermost thousandth on either side."""
    low, high = np.quantile(np.unwrap(theta_rad), [0.001, 0.999])
    return float(high - low)


def confinement(range_rad: float, diffusion_rad2_s: float, duration_s: float) -> float:
    """Exponent E of the chance, about exp(-E), that diffusion stays within such a range.

    ``E = pi^2 D T / L^2``: the slowest mode between absorbing walls L apart.
    """
    return math.pi**2 * diffusion_rad2_s * duration_s / max(range_rad, 1e-6) ** 2


def _products(values: NDArray[np.complex128], row: Integers, span: int) -> Floats:
    """Sum ``Re(conj(v[k]) v[k + m])`` over all pairs of frames at every lag m."""
    signal = np.zeros(fft.next_fast_len(2 * span), np.complex128)
    signal[row] = values
    power = np.abs(fft.fft(signal)) ** 2
    return np.asarray(fft.ifft(power).real[:span], np.float64)


def _distance(theta_rad: Floats, place_rad: float) -> Floats:
    apart: Floats = np.abs(np.angle(np.exp(1j * (theta_rad - place_rad))))
    return apart
