"""How a point of light spreads over pixels: the Gaussian integrated over each square pixel.

Written apart from the fitter's model on purpose: a truth rendered with the fitter's own arithmetic
would hide the fitter's mistakes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

REACH_SIGMA = 5.5
"""How far a spot is drawn: beyond it lie 4e-8 of the light per side."""


def pixel_fractions(
    position_px: NDArray[np.float64], first_px: NDArray[np.int64], count: int, sigma_px: float
) -> NDArray[np.float64]:
    """Return the fraction of a one-dimensional Gaussian's light that falls in each pixel of a row.

    fraction_j = Phi((first + j + 1 - x) / sigma) - Phi((first + j - x) / sigma)

    Parameters
    ----------
    position_px
        Centres x, shape (...), in pixels from the outer edge of pixel 0.
    first_px
        First pixel of each row, of a shape that broadcasts to that of `position_px`.
    count
        Number of pixels in the row.
    sigma_px
        Standard deviation of the Gaussian, pixels.

    Returns
    -------
    Fractions, shape (..., count).
    """
    edges = np.arange(count + 1) - (position_px - first_px)[..., np.newaxis]
    edges /= sigma_px
    return np.diff(ndtr(edges), axis=-1)


def window_size(radius_px: float, sigma_px: float) -> int:
    """Return the odd width of a window that holds a spot within `radius_px` of its middle."""
    return 2 * int(np.ceil(radius_px + REACH_SIGMA * sigma_px)) + 1


def window_corner(centre_px: NDArray[np.float64], size: int) -> NDArray[np.int64]:
    """Return the first pixel of a window of odd `size` around each centre."""
    return np.floor(centre_px).astype(np.int64) - size // 2


def spot_images(
    x_px: NDArray[np.float64],
    y_px: NDArray[np.float64],
    corner_x: NDArray[np.int64],
    corner_y: NDArray[np.int64],
    size: int,
    sigma_px: float,
) -> NDArray[np.float64]:
    """Render windows that hold one photon each, spread evenly over the places of a moving spot.

    The Gaussian separates, so a window is the mean over places of column fractions times row
    fractions: one small matrix product a frame.

    Parameters
    ----------
    x_px, y_px
        Places that the spot visits during each exposure, shape (frames, places), pixels from the
        outer corner of pixel (0, 0).
    corner_x, corner_y
        First column and row of each window, shape (frames,).
    size
        Width and height of the windows.
    sigma_px
        Width of the spot, pixels.

    Returns
    -------
    Windows, shape (frames, size, size), rows first.
    """
    columns = pixel_fractions(x_px, corner_x[:, np.newaxis], size, sigma_px)
    rows = pixel_fractions(y_px, corner_y[:, np.newaxis], size, sigma_px)
    windows: NDArray[np.float64] = np.matmul(np.swapaxes(rows, 1, 2), columns)
    windows /= x_px.shape[1]
    return windows


def add_windows(
    frames: NDArray[np.float64],
    windows: NDArray[np.float64],
    corner_x: NDArray[np.int64],
    corner_y: NDArray[np.int64],
) -> None:
    """Add one window to each frame in place; what lies outside the frame is lost.

    Frames that share a corner (all of them, unless the field drifts) are added at once.

    Parameters
    ----------
    frames
        Shape (frames, height, width).
    windows
        Shape (frames, size, size).
    corner_x, corner_y
        First column and row of each window, shape (frames,).
    """
    height, width = frames.shape[1:]
    size = windows.shape[1]
    corners, group = np.unique(np.stack([corner_y, corner_x]), axis=1, return_inverse=True)
    for number, (top, left) in enumerate(corners.T):
        y0, y1 = max(top, 0), min(top + size, height)
        x0, x1 = max(left, 0), min(left + size, width)
        if y0 >= y1 or x0 >= x1:
            continue
        part = windows[:, y0 - top : y1 - top, x0 - left : x1 - left]
        if corners.shape[1] == 1:
            frames[:, y0:y1, x0:x1] += part
        else:
            chosen = np.flatnonzero(group.ravel() == number)
            frames[chosen, y0:y1, x0:x1] += part[chosen]
