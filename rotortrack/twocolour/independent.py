"""How many independent distances the frames of a rod that breathes slowly are worth."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_DOUBTFUL_SD = 2.0


def independent_distances(lengths_nm: Floats, noise_nm: Floats) -> float:
    """Count the independent distances among frames.

    Parameters
    ----------
    lengths_nm, noise_nm
        Measured lengths and the noise of their vectors per axis, (frames,), nm.

    Returns
    -------
    Between 1 and the number of frames.

    Notes
    -----
    Squared lengths covary from frame to frame by their true distances alone. The covariances are
    summed over lags up to the first that is less than twice its standard deviation were there none
    (Geyer's positive sequence, Statistical Science 7, 473, 1992, with a bound for noise).
    The covariance at lag 0, which holds noise, is replaced by one on the line through lags 1 and 2.
    """
    n = lengths_nm.size
    squares = lengths_nm**2 - 2.0 * noise_nm**2
    squares -= squares.mean()
    padded = np.fft.rfft(squares, 1 << (2 * n - 1).bit_length())
    covariance = np.fft.irfft(np.abs(padded) ** 2)[:n] / np.arange(n, 0, -1)
    least = _DOUBTFUL_SD * covariance[0] / math.sqrt(n)
    weak = np.flatnonzero(covariance[1:] < least)
    kept = covariance[1 : 1 + (int(weak[0]) if weak.size else n - 1)]
    if kept.size == 0:
        return float(n)
    at_once = 2.0 * kept[0] - kept[1] if kept.size > 1 else kept[0]
    lags = np.arange(1, kept.size + 1)
    together = 1.0 + 2.0 * float(np.sum((1.0 - lags / n) * kept)) / min(at_once, covariance[0])
    return float(np.clip(n / together, 1.0, n))
