"""Weights that mismatched pairs do not pass (Tukey's biweight, for both coordinates at once)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CUT = 5.5
"""Residuals beyond so many standard deviations weigh nothing: 3 in 10^7 of good pairs do."""

_MEDIAN = math.sqrt(2.0 * math.log(2.0))
"""Median length of a two-dimensional normal deviate."""


def scale_of(residual: Floats, parameters: float = 0.0) -> float:
    """Estimate the standard deviation of a coordinate by the median length of residuals.

    Parameters
    ----------
    residual
        (points, 2).
    parameters
        Of a coordinate, that made the residuals smaller than the errors.
    """
    n = len(residual)
    length = float(np.median(np.hypot(residual[:, 0], residual[:, 1])))
    return length / _MEDIAN * math.sqrt(n / max(n - parameters, 1.0))


def tukey(residual: Floats, scale: float) -> Floats:
    """Weigh residuals, (points, 2), of errors with that standard deviation a coordinate."""
    square = np.sum(residual**2, axis=1) / max(CUT * scale, 1e-12) ** 2
    weights: Floats = np.maximum(1.0 - square, 0.0) ** 2
    return weights


def bounded(residual: Floats, scale: float) -> Floats:
    """Squared length of residuals, no more than that of one at the cut."""
    loss: Floats = np.minimum(np.sum(residual**2, axis=1), (CUT * scale) ** 2)
    return loss
