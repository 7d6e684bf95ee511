"""Ridges of a levelled image: where something as wide as a rod stands above the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.filters import apply_hysteresis_threshold, sato
from skimage.morphology import skeletonize

Floats = NDArray[np.float64]

_PER_SD = 1.4826
_LOW, _HIGH = 0.35, 0.6
"""Parts of the usual rod's response at which a ridge goes on, and which it must reach somewhere."""


@dataclass(frozen=True)
class Ridges:
    """What was found.

    Attributes
    ----------
    mask
        Pixels of ridges (y, x).
    skeleton
        Their middle lines, one pixel wide.
    response
        Response of the ridge filter.
    """

    mask: NDArray[np.bool_]
    skeleton: NDArray[np.bool_]
    response: Floats


def find_ridges(height: Floats, sigma_px: float, threshold: float) -> Ridges:
    """Find ridges with the filter of Sato et al. (1998) at the width of a rod.

    A ridge starts where the response exceeds both `threshold` standard deviations of its noise and
    0.6 of the response of the usual rod, and goes on to 0.35 of it: so neither the noise of a
    rough image nor faint dirt in a smooth one is traced.

    Parameters
    ----------
    height
        Levelled heights (y, x).
    sigma_px
        Width of a rod, as the standard deviation of its cross section (pixels).
    threshold
        In standard deviations of the response's noise.
    """
    response = np.asarray(sato(height, sigmas=[sigma_px], black_ridges=False), np.float64)
    curvature = ndimage.gaussian_filter(height, sigma_px, order=(0, 2), mode="reflect")
    noise = float(sigma_px**2 * _PER_SD * np.median(np.abs(curvature - np.median(curvature))))
    found = response > max(threshold * noise, 1e-9 * float(np.abs(height).max(initial=0.0)))
    crest = skeletonize(found)
    if not crest.any():
        return Ridges(crest, crest, response)
    usual = float(np.median(response[crest]))
    low = max(threshold * noise, _LOW * usual)
    mask = apply_hysteresis_threshold(response, low, max(low, _HIGH * usual))
    return Ridges(mask, skeletonize(mask), response)


def measured_sigma_px(height: Floats, ridges: Ridges, sigma_px: float) -> float:
    """Measure the width of the usual rod from height and curvature on the crests.

    On a Gaussian crest of width s, blurred to S by the filter's own width f, the curvature across
    is the height over S^2; so S, and s^2 = S^2 - f^2, follow without a profile.
    """
    if not ridges.skeleton.any():
        return sigma_px
    blurred = ndimage.gaussian_filter(height, sigma_px, mode="reflect")[ridges.skeleton]
    bent = ridges.response[ridges.skeleton] / sigma_px**2
    squared = float(np.median(blurred / bent)) - sigma_px**2
    return float(np.sqrt(max(squared, 0.25)))


def centre_noise(
    height: Floats, ridges: Ridges, sigma_px: float, smooth_px: float, grown_px: int
) -> float:
    """Measure on bare ground the noise of a centre line times the height of its rod.

    The displacement of a Gaussian ridge of height A and width s is estimated by 2 sqrt(2) s^2 F/A,
    where F is the image filtered with the derivative of that Gaussian across and smoothed along.
    What F does where no rod is tells its noise, correlations between pixels included.

    Returns
    -------
    float
        Standard deviation of displacement times height (pixel nm).
    """
    # The noise bandwidth of the smoother 1 / (1 + (k l)^4) is that of a Gaussian of 1.06 l.
    along = 1.06 * smooth_px
    ground = ~ndimage.binary_dilation(ridges.mask, iterations=max(grown_px, 1))
    if np.count_nonzero(ground) < 100:
        ground = np.ones_like(ground)
    spread = []
    for order, sigma in (((0, 1), (along, sigma_px)), ((1, 0), (sigma_px, along))):
        filtered = ndimage.gaussian_filter(height, sigma, order=order, mode="reflect")[ground]
        spread.append(_PER_SD * float(np.median(np.abs(filtered))))
    return float(2.0 * np.sqrt(2.0) * sigma_px**2 * np.sqrt(np.mean(np.square(spread))))
