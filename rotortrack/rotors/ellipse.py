"""Whether a rotor's ring is seen as an ellipse, as one that is tilted is."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

_LEAST_RESULTANT = 0.2


def axis_ratio(x: Values, y: Values, circle: tuple[float, float, float]) -> tuple[float, float]:
    """Short over long axis of a ring, and its standard deviation.

    The distances from the centre are fitted by ``R + c cos 2 phi + d sin 2 phi``, centre and radius
    free. Noise blurs the directions, which flattens the waves by ``exp(-2 s^2 / R^2)``, and adds to
    their amplitude; both are taken off.

    Parameters
    ----------
    x, y
        Positions all around the ring, shape (n,).
    circle
        Centre and radius.

    Returns
    -------
    Ratio in (0, 1] and standard deviation; nan where the noise leaves nothing to see.
    """
    dx, dy = x - circle[0], y - circle[1]
    phi = np.arctan2(dy, dx)
    left = np.hypot(dx, dy) - circle[2]
    waves = np.stack([np.ones_like(phi), *(f(k * phi) for k in (1, 2) for f in (np.cos, np.sin))])
    normal = waves @ waves.T
    freedom = left.size - len(waves)
    if freedom <= 0 or np.linalg.cond(normal) > 1e8:
        return math.nan, math.nan
    inverse = np.linalg.inv(normal)
    found = inverse @ (waves @ left)
    variance = float(np.sum((left - found @ waves) ** 2)) / freedom
    resultant = math.exp(-2.0 * variance / circle[2] ** 2)
    if resultant < _LEAST_RESULTANT:
        return math.nan, math.nan
    error = 0.5 * variance * (inverse[3, 3] + inverse[4, 4])
    amplitude = math.sqrt(max(float(found[3:] @ found[3:]) - error, 0.0)) / resultant
    flat = amplitude / circle[2]
    return (1.0 - flat) / (1.0 + flat), 2.0 * math.sqrt(error) / resultant / circle[2]
