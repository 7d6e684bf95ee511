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
    exp(-r^2 / (2 length^2)), and whose variance is that of many fields: one with few lengths may
    have less.

    Raises
    ------
    ConfigurationError
        Gradient and texture make some pixels negative, or the texture is coarser than the field.
    """
    height, width = shape_px
    relative = np.ones(shape_px)
    across, down = options.gradient
    if across or down:
        rows, columns = np.ogrid[:height, :width]
        relative += across * ((columns + 0.5) / width - 0.5) + down * ((rows + 0.5) / height - 0.5)
    if options.texture:
        length_px = options.texture_length_nm / pixel_size_nm
        if length_px > max(shape_px):
            raise ConfigurationError(
                f"[background] texture_length_nm of {options.texture_length_nm:g} is longer than "
                f"the field of {max(shape_px) * pixel_size_nm:.0f} nm: lower it, or use gradient"
            )
        relative += options.texture * _texture(shape_px, length_px, seed)
    if relative.min() < 0.0:
        raise ConfigurationError(
            f"[background] gradient and texture make {np.mean(relative < 0.0):.1%} of the pixels "
            "negative: lower them"
        )
    return options.photons * relative


class Flicker:
    """The illumination's brightness averaged over each exposure, 1 on average.

    Parameters
    ----------
    options
        Relative standard deviation and correlation time: of an Ornstein-Uhlenbeck process, which an
        exposure longer than the time evens out; with time 0 of the average itself, anew in each
        frame.
    clock
        When frames are exposed.
    seed
        Of the film.
    """

    def __init__(self, options: FlickerOptions, clock: Clock, seed: int) -> None:
        self._sd = options.sd
        self._slow = None
        if options.sd and options.time_s:
            dead_s = max(clock.frame_interval_s - clock.exposure_s, 0.0)
            self._slow = Wobble(
                options.sd,
                options.sd**2 / options.time_s,
                np.array([clock.exposure_s, dead_s]),
                Streams.of(seed, Effect.FLICKER),
            )
        elif options.sd:
            self._rng = stream(seed, Effect.FLICKER)

    def advance(self, n: int) -> Floats:
        """Give the factors of the next n frames, shape (n,), never negative."""
        if not self._sd:
            return np.ones(n)
        if self._slow is None:
            swing = self._sd * self._rng.standard_normal(n)
        else:
            swing = self._slow.advance(n)[:, 0]
        return np.maximum(1.0 + swing, 0.0)


def _texture(shape_px: tuple[int, int], length_px: float, seed: int) -> Floats:
    """Draw a Gaussian random field of mean 0 and variance 1."""
    # Wider than the field by five lengths, as what is filtered is periodic.
    padded = [fft.next_fast_len(side + math.ceil(5.0 * length_px), real=True) for side in shape_px]
    down, across = (_amplitudes(side, length_px) for side in padded)
    noise = fft.rfft2(stream(seed, Effect.TEXTURE).standard_normal(padded))
    noise *= down[:, np.newaxis] * across[: noise.shape[1]]
    field: Floats = fft.irfft2(noise, s=padded)[: shape_px[0], : shape_px[1]]
    return field


def _amplitudes(side: int, length_px: float) -> Floats:
    """Give the filter, of each frequency, that makes white noise of variance 1 correlated."""
    lag_px = np.minimum(np.arange(side), side - np.arange(side))
    power = fft.fft(np.exp(-0.5 * (lag_px / length_px) ** 2)).real
    amplitudes: Floats = np.sqrt(np.maximum(power, 0.0))
    return amplitudes
