"""How emitters are imaged: their photons in pixels.

Written apart from the fitter's model on purpose: a truth rendered with the fitter's own arithmetic
would hide the fitter's mistakes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.simulate.film.options import PsfOptions

Floats = NDArray[np.float64]

REACH_SIGMA = 5.5
"""How far a Gaussian is drawn: beyond it lie 4e-8 of the light per side."""


@dataclass(frozen=True)
class Spots:
    """One emitter in one block of n frames.

    Attributes
    ----------
    x_nm, y_nm
        Places during the parts of each exposure, from the outer corner of pixel (0, 0), shape
        (n, parts), or (1, parts) where every frame is the same.
    photons
        Photons a frame, spread evenly over the parts, shape (n,) or (1,).
    """

    x_nm: Floats
    y_nm: Floats
    photons: Floats


class Optics:
    """A microscope and its point spread function.

    Parameters
    ----------
    psf
        Shape of a spot; None for the Gaussian of :class:`PsfOptions`.
    pixel_size_nm
        Size of a pixel in the specimen.
    sigma_ratio
        Factor of the spot's width.
    """

    def __init__(
        self, psf: PsfOptions | None, pixel_size_nm: float, sigma_ratio: float = 1.0
    ) -> None:
        psf = psf or PsfOptions()
        self._pixel_nm = pixel_size_nm
        self._widths_px = tuple(
            width * sigma_ratio / pixel_size_nm for width in gaussian_widths_nm(psf)
        )
        self._table: Floats | None = None
        if psf.model == "airy":
            from rotortrack.simulate.film.airy import airy_table

            self._table = airy_table(
                psf.wavelength_nm * sigma_ratio, psf.numerical_aperture, pixel_size_nm
            )

    def add(self, images: Floats, spots: Spots) -> None:
        """Add an emitter's light to images in place; what falls outside is lost.

        Parameters
        ----------
        images
            Photons, shape (n, h, w), C-contiguous.
        spots
            The emitter.
        """
        x_px, y_px = (
            np.ascontiguousarray(places) / self._pixel_nm for places in (spots.x_nm, spots.y_nm)
        )
        photons = np.ascontiguousarray(spots.photons, np.float64)
        if self._table is None:
            add_gaussian(images, x_px, y_px, photons, *self._widths_px)
        else:
            from rotortrack.simulate.film.airy import STEPS, add_tabulated

            add_tabulated(images, x_px, y_px, photons, self._table, STEPS)


def gaussian_widths_nm(psf: PsfOptions) -> tuple[float, float]:
    """Give sigma_x and sigma_y of a spot, nm.

    sigma(z) = sigma sqrt(1 + (z / depth)^2), with z counted from the focus of x, half of
    `astigmatism_nm` above that of y, and from the focus of y as much below.
    """
    half = 0.5 * psf.astigmatism_nm
    return (
        psf.sigma_nm * math.hypot(1.0, (psf.defocus_nm - half) / psf.depth_nm),
        psf.sigma_nm * math.hypot(1.0, (psf.defocus_nm + half) / psf.depth_nm),
    )


@kernel
def add_gaussian(
    images: Floats, x_px: Floats, y_px: Floats, photons: Floats, sigma_x: float, sigma_y: float
) -> None:
    """Add an emitter as a Gaussian integrated over every pixel.

    Parameters
    ----------
    images
        Photons, shape (n, h, w).
    x_px, y_px
        Places, shape (n, parts) or (1, parts), pixels from the outer corner of pixel (0, 0).
    photons
        Photons a frame, shape (n,) or (1,).
    sigma_x, sigma_y
        Widths, pixels.
    """
    n, height, width = images.shape
    parts = x_px.shape[1]
    reach_x = math.ceil(REACH_SIGMA * sigma_x)
    reach_y = math.ceil(REACH_SIGMA * sigma_y)
    columns = np.empty(2 * reach_x + 1)
    rows = np.empty(2 * reach_y + 1)
    for frame in range(n):
        light = photons[frame if photons.shape[0] > 1 else 0] / parts
        if light == 0.0:
            continue
        place = frame if x_px.shape[0] > 1 else 0
        for part in range(parts):
            left = math.floor(x_px[place, part]) - reach_x
            top = math.floor(y_px[place, part]) - reach_y
            if left >= width or top >= height or left + 2 * reach_x < 0 or top + 2 * reach_y < 0:
                continue
            fill_fractions(columns, left - x_px[place, part], sigma_x)
            fill_fractions(rows, top - y_px[place, part], sigma_y)
            for i in range(max(0, -top), min(rows.size, height - top)):
                share = light * rows[i]
                for j in range(max(0, -left), min(columns.size, width - left)):
                    images[frame, top + i, left + j] += share * columns[j]


@kernel
def fill_fractions(fractions: Floats, first: float, sigma: float) -> None:
    """Fill the part of a Gaussian about 0 in each of a row of pixels.

    Parameters
    ----------
    fractions
        Filled, shape (pixels,).
    first
        Edge of the first pixel.
    sigma
        Width, pixels.
    """
    scale = 1.0 / (sigma * math.sqrt(2.0))
    before = math.erf(first * scale)
    for pixel in range(fractions.size):
        after = math.erf((first + pixel + 1) * scale)
        fractions[pixel] = 0.5 * (after - before)
        before = after
