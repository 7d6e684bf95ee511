"""Light that stands: the laser's profile, the background; and the laser's flicker."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import BackgroundOptions, FlickerOptions, LaserOptions
from rotortrack.simulate.film.streams import Effect, stream
from rotortrack.simulate.film.wander import Streams, Wobble

Floats = NDArray[np.float64]


def laser_at(
    options: LaserOptions,
    shape_px: tuple[int, int],
    pixel_size_nm: float,
    x_nm: Floats,
    y_nm: Floats,
) -> Floats:
    """Give the laser's light at some places, 1 in its middle: exp(-2 r^2 / waist^2)."""
    centre = options.centre_nm
    if centre is None:
        centre = (0.5 * shape_px[1] * pixel_size_nm, 0.5 * shape_px[0] * pixel_size_nm)
    square = (x_nm - centre[0]) ** 2 + (y_nm - centre[1]) ** 2
    light: Floats = np.exp(-2.0 * square / options.waist_nm**2)
    return light


def laser_map(options: LaserOptions, shape_px: tuple[int, int], pixel_size_nm: float) -> Floats:
    """Give the laser's light in the middle of every pixel, shape `shape_px`."""
    y_nm, x_nm = ((index + 0.5) * pixel_size_nm for index in np.ogrid[: shape_px[0], : shape_px[1]])
    return laser_at(options, shape_px, pixel_size_nm, x_nm, y_nm)


def background_image(
    options: BackgroundOptions, shape_px: tuple[int, int], pixel_size_nm: float, seed: int
) -> Floats:
    """Give the background of every pixel, photons a frame, shape `shape_px`.

    The texture is a Gaussian random field whose correlation at distance r is
    exp(-r^2 / (2 length^2)).

    Raises
    ------
    ConfigurationError
        Gradient and texture make some pixels negative.
    """
    height, width = shape_px
    relative = np.ones(shape_px)
    across, down = options.gradient
    if across or down:
        rows, columns = np.ogrid[:height, :width]
        relative += across * ((columns + 0.5) / width - 0.5) + down * ((rows + 0.5) / height - 0.5)
    if options.texture:
        length_px = options.texture_length_nm / pixel_size_nm
        relative += options.texture * _texture(shape_px, length_px, seed)
    if relative.min() < 0.0:
        raise ConfigurationError(
            f"[background] gradient and texture make {np.mean(relative < 0.0):.1%} of the pixels "
            "negative: lower them"
        )
    return options.photons * relative


class Flicker:
    """The illumination's brightness in each frame, 1 on average.

    Parameters
    ----------
    options
        Relative standard deviation and correlation time.
    clock
        When frames are exposed.
    seed
        Of the film.
    """

    def __init__(self, options: FlickerOptions, clock: Clock, seed: int) -> None:
        self._sd = options.sd
        self._rng = stream(seed, Effect.FLICKER)
        self._slow = None
        if options.time_s and options.sd:
            periods = np.array([clock.frame_interval_s])
            rate = options.sd**2 / options.time_s
            self._slow = Wobble(options.sd, rate, periods, Streams.of(seed, Effect.FLICKER))

    def advance(self, n: int) -> Floats:
        """Give the factors of the next n frames, shape (n,), never negative."""
        if self._slow is None:
            swing = self._sd * self._rng.standard_normal(n)
        else:
            swing = self._slow.advance(n)[:, 0]
        return np.maximum(1.0 + swing, 0.0)


def _texture(shape_px: tuple[int, int], length_px: float, seed: int) -> Floats:
    """Draw a Gaussian random field of mean 0 and variance 1."""
    # Wider than the field by five lengths, as what is filtered is periodic.
    padded = [fft.next_fast_len(side + math.ceil(5.0 * length_px)) for side in shape_px]
    noise = stream(seed, Effect.TEXTURE).standard_normal(padded)
    squares = [
        np.square(2.0 * math.pi * fft.fftfreq(side) * length_px).reshape(shape)
        for side, shape in zip(padded, ((-1, 1), (1, -1)), strict=True)
    ]
    # The square root of the power of a Gaussian correlation of that length.
    filtered = np.exp(-0.25 * (squares[0] + squares[1]))
    filtered /= math.sqrt(float(np.mean(filtered**2)))
    field: Floats = fft.ifft2(fft.fft2(noise) * filtered).real[: shape_px[0], : shape_px[1]]
    return field
