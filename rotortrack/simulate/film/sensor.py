"""The camera of a film: photons to counts, with the noise of every pixel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.camera import Camera, load_maps
from rotortrack.errors import CameraError
from rotortrack.kernels import kernel
from rotortrack.simulate.film.options import (
    ColumnNoiseOptions,
    HotPixelsOptions,
    PixelMapsOptions,
    SensorOptions,
)
from rotortrack.simulate.film.shot_noise import draw_electrons
from rotortrack.simulate.film.streams import Effect, stream

Floats = NDArray[np.float64]


class Sensor:
    """A camera whose every frame has random streams of its own.

    Parameters
    ----------
    options
        Offset, gain, read noise, or a file of maps; quantum efficiency and bits.
    height, width
        Of the frames.
    seed
        Of the film.
    pixel_maps, hot_pixels, column_noise
        Effects; None for those that do not exist.

    Attributes
    ----------
    camera
        What the sensor truly is; maps where pixels differ.

    Raises
    ------
    CameraError
        The file of maps cannot be used, or is smaller than the frames.
    """

    def __init__(
        self,
        options: SensorOptions,
        height: int,
        width: int,
        seed: int,
        *,
        pixel_maps: PixelMapsOptions | None = None,
        hot_pixels: HotPixelsOptions | None = None,
        column_noise: ColumnNoiseOptions | None = None,
    ) -> None:
        self._seed = seed
        self._efficiency = options.quantum_efficiency
        self._column_noise = column_noise
        self._largest = float(2**options.bits - 1)
        shape = (height, width)
        values = _values(options, shape)
        if pixel_maps is not None:
            values = _varied(values, pixel_maps, shape, seed)
        if hot_pixels is not None:
            rng = stream(seed, Effect.HOT_PIXELS)
            hot = rng.random(shape) < hot_pixels.fraction
            noise = np.broadcast_to(values["read_noise_e"], shape)
            values["read_noise_e"] = np.where(hot, hot_pixels.read_noise_e, noise)
            values["hot_pixels"] = hot
        self.camera = Camera(**{"saturation_adu": self._largest, **values})
        self._offset = _full(self.camera.offset_adu, shape)
        self._per_electron = _full(1.0 / np.asarray(self.camera.gain_e_per_adu), shape)
        self._noise = _full(self.camera.read_noise_e, shape)

    def expose(self, photons: Floats, first_frame: int) -> NDArray[np.uint16]:
        """Draw the counts of some frames.

        Parameters
        ----------
        photons
            Expected photons, finite and not negative, shape (n, h, w), C-contiguous.
        first_frame
            Number of the first one: it names their random streams.

        Returns
        -------
        Counts, shape (n, h, w).

        Raises
        ------
        CameraError
            Photons are negative or not finite.
        """
        if self._efficiency is not None:
            photons = photons * self._efficiency
        counts = np.empty(photons.shape, np.uint16)
        electrons = np.empty(photons.shape[1:])
        normal = np.empty(photons.shape[1:], np.float32)
        columns = np.zeros(photons.shape[2])
        for frame, image in enumerate(photons):
            number = first_frame + frame
            try:
                draw_electrons(image, stream(self._seed, Effect.SHOT_NOISE, number), electrons)
            except ValueError as error:
                raise CameraError(f"frame {number}: {error}") from error
            stream(self._seed, Effect.READ_NOISE, number).standard_normal(
                dtype=np.float32, out=normal
            )
            if self._column_noise is not None:
                draws = stream(self._seed, Effect.COLUMN_NOISE, number)
                columns = self._column_noise.sd_adu * draws.standard_normal(columns.size)
            digitise(
                electrons,
                normal,
                self._noise,
                self._per_electron,
                self._offset,
                columns,
                self._largest,
                counts[frame],
            )
        return counts


@kernel
def digitise(
    electrons: Floats,
    normal: NDArray[np.float32],
    noise: Floats,
    per_electron: Floats,
    offset: Floats,
    columns: Floats,
    largest: float,
    counts: NDArray[np.uint16],
) -> None:
    """Make counts of electrons: read noise, gain, offset, whole numbers, saturation.

    Parameters
    ----------
    electrons, normal
        Electrons and standard normal numbers, shape (h, w).
    noise, per_electron, offset
        Read noise, counts an electron, and offset of every pixel, shape (h, w).
    columns
        What is added to each column, ADU, shape (w,).
    largest
        Greatest count.
    counts
        Filled, shape (h, w).
    """
    for row in range(electrons.shape[0]):
        for column in range(electrons.shape[1]):
            read = electrons[row, column] + noise[row, column] * normal[row, column]
            value = read * per_electron[row, column] + offset[row, column] + columns[column]
            counts[row, column] = np.uint16(min(max(np.rint(value), 0.0), largest))


def _values(options: SensorOptions, shape: tuple[int, int]) -> dict[str, Any]:
    names = ("offset_adu", "gain_e_per_adu", "read_noise_e")
    values: dict[str, Any] = {name: getattr(options, name) for name in names}
    if options.camera_maps is None:
        return values
    path = Path(options.camera_maps)
    maps = {name: value for name, value in load_maps(path).items() if name != "saturation_adu"}
    for name, value in maps.items():
        if np.ndim(value) and (value.shape[0] < shape[0] or value.shape[1] < shape[1]):
            raise CameraError(
                f"{path}: {name} has {value.shape[1]} x {value.shape[0]} pixels, fewer than the "
                f"film's {shape[1]} x {shape[0]}: film a smaller field, or name larger maps"
            )
        maps[name] = value[: shape[0], : shape[1]] if np.ndim(value) else value
    return {**values, **maps}


def _varied(
    values: dict[str, Any], options: PixelMapsOptions, shape: tuple[int, int], seed: int
) -> dict[str, Any]:
    """Give every pixel its own offset, gain and read noise; the named ones are the means."""
    draws = stream(seed, Effect.PIXEL_MAPS).standard_normal((3, *shape))
    sd = options.read_noise_sd
    return {
        "offset_adu": values["offset_adu"] + options.offset_sd_adu * draws[0],
        # Bounded, so that no gain is near 0 or negative.
        "gain_e_per_adu": values["gain_e_per_adu"]
        * (1.0 + options.gain_sd * np.clip(draws[1], -4.0, 4.0)),
        "read_noise_e": values["read_noise_e"] * np.exp(sd * draws[2] - 0.5 * sd**2),
    }


def _full(value: Any, shape: tuple[int, int]) -> Floats:
    return np.ascontiguousarray(np.broadcast_to(np.asarray(value, np.float64), shape))
