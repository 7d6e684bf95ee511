"""Where lane fits start: one linear step from a template, corrected for the width of the spot."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

DEGREE: Final = 6

_NARROWEST_OF_TEMPLATE = 0.55
_WIDEST_OF_TEMPLATE = 2.2

WIDTH_OF_WINDOW: Final = 0.19
"""A template wider than this part of its window tells narrow spots badly from background."""


@dataclass(frozen=True)
class Template:
    """A linear estimate of the five parameters, and how it answers to spots of other widths.

    Attributes
    ----------
    filters
        (5, pixel) float32: their products with a window are photons times x, y, 1, then the
        background, then photons times the excess of sigma.
    curves
        (4, DEGREE + 1) float32 polynomials in z = q / (1 + |q|), q = fifth / third product: sigma;
        photons, x and y by their products; and background by the third product, subtracted.
    range
        Least and largest q for which the curves hold.
    """

    filters: NDArray[np.float32]
    curves: NDArray[np.float32]
    range: tuple[float, float]


@functools.lru_cache(maxsize=16)
def template(radius: int, sigma_px: float, free_sigma: bool) -> Template:
    """Make the template of a window size.

    Parameters
    ----------
    radius
        Windows are 2 * radius + 1 pixels wide.
    sigma_px
        Expected or fixed width of spots, pixels.
    free_sigma
        Whether the width is fitted.
    """
    size = 2 * radius + 1
    sigma = min(sigma_px, WIDTH_OF_WINDOW * size) if free_sigma else sigma_px
    slopes = _slopes(size, sigma)
    # As if a tenth of the peak were background: between the two limits of bright and dim spots.
    weights = 1.0 / (slopes[2] / slopes[2].max() + 0.1)
    used = slopes if free_sigma else slopes[:4]
    filters = np.zeros((5, size * size))
    filters[: len(used)] = np.linalg.solve((used * weights) @ used.T, used * weights)
    curves = np.zeros((4, DEGREE + 1))
    if not free_sigma:
        curves[:3, 0] = sigma, 1.0, 1.0
        return Template(filters.astype(np.float32), curves.astype(np.float32), (0.0, 0.0))
    widths = sigma * np.geomspace(_NARROWEST_OF_TEMPLATE, _WIDEST_OF_TEMPLATE, 200)
    answers = []
    for width in widths:
        spot = _slopes(size, width)
        _, _, photons, background, excess = filters @ spot[2]
        shift = filters[0] @ spot[0]
        answers.append((excess / photons, photons, shift, background))
    ratio, photons, shift, background = np.array(answers).T
    # The answer turns back for widths that the window cannot tell apart: keep the branch around
    # the template's own.
    middle = int(np.argmin(np.abs(ratio)))
    falls = (np.diff(ratio) <= 0.0) | (photons[1:] < 0.2)
    low = middle - int(np.argmax(np.append(falls[:middle][::-1], True)))
    high = middle + int(np.argmax(np.append(falls[middle:], True)))
    kept = slice(low, high + 1)
    z = (ratio / (1.0 + np.abs(ratio)))[kept]
    targets = (widths, 1.0 / photons, 1.0 / shift, background / photons)
    for curve, target in zip(curves, targets, strict=True):
        curve[:] = np.polynomial.Polynomial.fit(z, target[kept], DEGREE).convert().coef
    return Template(
        filters.astype(np.float32), curves.astype(np.float32), (ratio[low], ratio[high])
    )


def _slopes(size: int, sigma: float) -> NDArray[np.float64]:
    """Give the slopes of a centred spot of one photon by x, y, photons, background and sigma."""
    edges = (np.arange(size + 1) - 0.5 * size) / sigma
    bell = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi) / sigma
    g = np.diff([0.5 * math.erf(edge / math.sqrt(2.0)) for edge in edges])
    by_x = -np.diff(bell)
    by_sigma = -np.diff(edges * bell)
    return np.array(
        [
            np.outer(g, by_x),
            np.outer(by_x, g),
            np.outer(g, g),
            np.ones((size, size)),
            np.outer(by_sigma, g) + np.outer(g, by_sigma),
        ]
    ).reshape(5, -1)
