"""How mean-square displacements at overlapping lags vary together.

A coordinate that drifts with v, diffuses with D, is averaged over an exposure t_e and read with a
noise of sigma has displacements over k frames of variance

    s(k) = 2 D (k dt - t_e / 3) + 2 sigma^2,   s(0) = 0,

and two of them, m frames long from frame i and n frames long from frame i + d, share

    c(d) = (s(m - d) + s(n + d) - s(m - n - d) - s(d)) / 2.

Squares of such Gaussian numbers with means v m dt and v n dt have the covariance
``2 c^2 + 4 v^2 m n dt^2 c``; a mean-square displacement averages it over all pairs of pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Mover:
    """Drift, diffusion and noise of one coordinate (rad here; nm and nm^2 serve as well).

    Attributes
    ----------
    drift
        v, rad/s. Its sign does not matter.
    diffusion
        D, rad^2/s.
    noise_variance
        sigma^2 of one reading, rad^2.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    """

    drift: float
    diffusion: float
    noise_variance: float
    frame_interval_s: float
    exposure_s: float

    def variance(self, lag: Integers) -> Floats:
        """Variance of a displacement over some frames, s(k)."""
        blurred = np.abs(lag) * self.frame_interval_s - self.exposure_s / 3.0
        value = 2.0 * self.diffusion * blurred + 2.0 * self.noise_variance
        return np.where(lag == 0, 0.0, value)

    def shared(self, first: int, second: int, shift: Integers) -> Floats:
        """Covariance c(d) of two displacements, the second starting `shift` frames later."""
        return 0.5 * (
            self.variance(first - shift)
            + self.variance(second + shift)
            - self.variance(first - second - shift)
            - self.variance(shift)
        )


class Overlaps:
    """Counts of pairs of pairs of frames, by lags and shift.

    Parameters
    ----------
    seen
        Whether each frame was seen, shape (n_frames,).
    """

    def __init__(self, seen: NDArray[np.bool_]) -> None:
        self._seen = seen
        self._whole = bool(seen.all())
        self._length = fft.next_fast_len(2 * seen.size, real=True)
        self._spectra: dict[int, NDArray[np.complex128]] = {}
        self._alike: dict[int, Floats] = {}

    def pairs(self, lag: int) -> int:
        """Pairs of seen frames at a lag."""
        return int(np.count_nonzero(self._seen[lag:] & self._seen[:-lag]))

    def count(self, first: int, second: int) -> tuple[Integers, Floats]:
        """List shifts with overlap, -second to first, and how many pairs of pairs have each.

        Pairs that do not overlap vary apart, so that their number is of no account.
        """
        shift = np.arange(-second, first + 1)
        if self._whole:
            n = self._seen.size
            stop = np.minimum(n - first, n - second - shift)
            return shift, np.maximum(stop - np.maximum(0, -shift), 0).astype(np.float64)
        if first == second:
            return shift, self._of_one_lag(first)[np.abs(shift)]
        both = np.conj(self._spectrum(first)) * self._spectrum(second)
        return shift, np.rint(fft.irfft(both, self._length)[shift])

    def _of_one_lag(self, lag: int) -> Floats:
        if lag not in self._alike:
            spectrum = self._spectrum(lag)
            power = spectrum.real**2 + spectrum.imag**2
            self._alike[lag] = np.rint(fft.irfft(power, self._length)[: lag + 1])
        return self._alike[lag]

    def _spectrum(self, lag: int) -> NDArray[np.complex128]:
        if lag not in self._spectra:
            both = (self._seen[lag:] & self._seen[:-lag]).astype(np.float64)
            self._spectra[lag] = fft.rfft(both, self._length)
        return self._spectra[lag]


def covariance(mover: Mover, lags: Integers, seen: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Covariance of the mean-square displacement at some lags, ``C_0 + v^2 C_1``.

    Returns
    -------
    still, drifting
        C_0 (rad^4) and C_1 (rad^2 s^2), shape (n_lags, n_lags). For a sum over independent
        coordinates of one D, C_0 counts once for each and C_1 takes the square of the speed.

    Notes
    -----
    Cost: the sum of lags over all pairs of them; with gaps an FFT of 2 N for each pair besides.
    """
    overlaps = Overlaps(seen)
    pairs = [overlaps.pairs(int(lag)) for lag in lags]
    tau = lags * mover.frame_interval_s
    still = np.zeros((lags.size, lags.size))
    drifting = np.zeros_like(still)
    for i, first in enumerate(lags.tolist()):
        for j, second in enumerate(lags[: i + 1].tolist()):
            shift, count = overlaps.count(first, second)
            shared = mover.shared(first, second, shift)
            each = pairs[i] * pairs[j]
            still[i, j] = still[j, i] = 2.0 * (count @ shared**2) / each
            drifting[i, j] = drifting[j, i] = 4.0 * tau[i] * tau[j] * (count @ shared) / each
    return still, drifting


def angle_sd(mover: Mover, lags: Integers, overlaps: Overlaps) -> tuple[Floats, Floats]:
    """Give the standard deviation of an angle's MSD and its number of independent measurements.

    That number is how many independent squares of displacements would have the same mean error.
    Both nan where no pair has the lag.
    """
    sd, independent = np.full((2, lags.size), np.nan)
    for i, lag in enumerate(lags.tolist()):
        pairs = overlaps.pairs(lag)
        if not pairs:
            continue
        shift, count = overlaps.count(lag, lag)
        shared = mover.shared(lag, lag, shift)
        moved = (mover.drift * lag * mover.frame_interval_s) ** 2
        variance = count @ (2.0 * shared**2 + 4.0 * moved * shared) / pairs**2
        alone = mover.variance(np.array(lag))
        sd[i] = np.sqrt(variance)
        if variance > 0:
            independent[i] = min((2.0 * alone**2 + 4.0 * moved * alone) / variance, pairs)
    return sd, independent


def circle_sd(mover: Mover, radius_nm: float, lags: Integers, overlaps: Overlaps) -> Floats:
    """Give the standard deviation (nm^2) of the xy-MSD of a point on a circle turning like `mover`.

    The squared displacement is ``2 R^2 (1 - cos turn)``, whose covariance follows from that of
    the turns, ``exp(-s) ((exp(c) - 1) + cos(2 v tau) (exp(-c) - 1)) / 2`` for the cosines.
    Noise along the radius, which adds little beside this, is left out.
    """
    sd = np.full(lags.size, np.nan)
    for i, lag in enumerate(lags.tolist()):
        pairs = overlaps.pairs(lag)
        if not pairs:
            continue
        shift, count = overlaps.count(lag, lag)
        shared = mover.shared(lag, lag, shift)
        alone = mover.variance(np.array(lag))
        turned = np.cos(2.0 * mover.drift * lag * mover.frame_interval_s)
        # c never exceeds s, so that neither exponential overflows.
        cosines = 0.5 * (
            np.exp(shared - alone)
            - np.exp(-alone)
            + turned * (np.exp(-shared - alone) - np.exp(-alone))
        )
        sd[i] = 2.0 * radius_nm**2 * np.sqrt(max(count @ cosines, 0.0)) / pairs
    return sd
