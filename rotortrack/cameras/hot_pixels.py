"""Which pixels are noisier than the sensor's others.

Read noise of scientific cameras is nearly lognormal over pixels, with a tail of noisy ones above.
The half below the median knows nothing of that tail, so it tells the width of the ordinary pixels.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIGNIFICANT_SD = 4.0
LEAST_RATIO = 2.0

_WIDEST = 1e6
_LOWER_SD = 0.15865525393145707
"""Share of a normal distribution below the mean less one standard deviation."""


def hot_pixels_of(read_noise_e: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Mark hot pixels by their read noise.

    A pixel is hot where its read noise is above that of :func:`hot_limit_e`.

    Parameters
    ----------
    read_noise_e
        (y, x) electrons rms; the unit does not matter.
    """
    return np.asarray(read_noise_e) > hot_limit_e(read_noise_e)


def hot_limit_e(read_noise_e: NDArray[np.floating[Any]]) -> float:
    """Give the read noise above which a pixel is hot, in the unit of the map.

    The median times exp(4 s), at least twice the median; s is the distance in log read noise from
    the median down to the quantile that lies one standard deviation below it. Of lognormal noise 3
    pixels in 100 000 are beyond. Pixels without noise or number have no part in it.
    """
    values = np.asarray(read_noise_e, np.float64)
    some = values[(values > 0) & np.isfinite(values)]
    if not some.size:
        return math.inf
    low, median = map(float, np.quantile(some, [_LOWER_SD, 0.5]))
    return median * max(LEAST_RATIO, math.pow(min(median / low, _WIDEST), SIGNIFICANT_SD))
