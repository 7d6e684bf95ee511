"""Whether positions trace two rings instead of one, as two rotors in one pore do."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e, i1e

Values = NDArray[np.float64]

_MOST = 3000
_FEWEST = 50
_ROUNDS = 60
_BACKGROUND = 0.02
_LEAST_SHARE = 0.1
_LEAST_APART = 2.0


def two_rings(x: Values, y: Values, circle: tuple[float, float, float]) -> float:
    """Evidence of two rings: difference of the information criteria of one and two, or 0.

    Distances from the centre, less what an ellipse or a shifted centre explains, are a mixture of
    one or two Rice distributions of common noise, and of background that is even over the disc.
    Rings count as two from 2 noises apart and with a tenth of the positions each: less may be
    noise that is not normal.

    Parameters
    ----------
    x, y
        Positions of one rotor, shape (n,); of more than 3000 an even part is taken.
    circle
        Centre and radius.

    Returns
    -------
    Evidence, >= 0; nan for fewer than 50 positions.
    """
    thin = max(1, -(-x.size // _MOST))
    dx, dy = x[::thin] - circle[0], y[::thin] - circle[1]
    r = np.hypot(dx, dy) / circle[2]
    inside = r < 2.0
    r, phi = r[inside], np.arctan2(dy[inside], dx[inside])
    if r.size < _FEWEST:
        return math.nan
    waves = np.stack([np.ones_like(phi), *(f(k * phi) for k in (1, 2) for f in (np.cos, np.sin))])
    found = np.linalg.lstsq(waves.T, r, rcond=None)[0]
    r = np.maximum(r - found[1:] @ waves[1:], 1e-3)
    spread = float(np.std(r))
    if not spread > 0.0:
        return 0.0
    low, high = np.quantile(r, [0.25, 0.75])
    one, _, _, _ = _mixture(r, np.array([float(np.median(r))]), spread)
    two, radii, shares, noise = _mixture(r, np.array([low, high]), 0.5 * spread)
    apart = abs(radii[1] - radii[0]) > _LEAST_APART * noise
    if not apart or shares.min() < _LEAST_SHARE:
        return 0.0
    return max(0.0, 2.0 * (two - one) - 2.0 * math.log(r.size))


def _mixture(r: Values, radii: Values, noise: float) -> tuple[float, Values, Values, float]:
    """Maximise the likelihood of rings of common noise and background by expectation."""
    shares = np.full(radii.size, (1.0 - _BACKGROUND) / radii.size)
    # Even over the disc of the distances that are looked at.
    disc = 0.5 * r
    value = -math.inf
    for _ in range(_ROUNDS):
        k = r * radii[:, np.newaxis] / noise**2
        exponent = k - (r**2 + radii[:, np.newaxis] ** 2) / (2.0 * noise**2)
        scaled = i0e(k)
        density = shares[:, np.newaxis] * r / noise**2 * np.exp(exponent) * scaled
        total = density.sum(axis=0) + max(1.0 - shares.sum(), 0.0) * disc
        value = float(np.log(total).sum())
        member = density / total
        weight = member.sum(axis=1)
        if weight.min() < 1.0:
            break
        ratio = i1e(k) / scaled
        radii = (member * r * ratio).sum(axis=1) / weight
        left = r**2 + radii[:, np.newaxis] ** 2 - 2.0 * r * radii[:, np.newaxis] * ratio
        noise = math.sqrt(max(0.5 * float((member * left).sum() / weight.sum()), 1e-12))
        shares = weight / r.size
    return value, radii, shares, noise
