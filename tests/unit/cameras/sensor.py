"""A simulated sCMOS sensor of which everything is known, written with numpy alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """True maps (y, x): counts of the dark, electrons per count, electrons rms."""

    offset: Floats
    gain: Floats
    read: Floats
    hot: NDArray[np.bool_]

    def film(
        self,
        light: float,
        frames: int,
        rng: np.random.Generator,
        *,
        flicker: float = 0.0,
        largest: int = 65535,
    ) -> NDArray[np.uint16]:
        """Expose to light (electrons in the middle of the field) that flickers by a share of it."""
        size = self.offset.shape
        y, x = (np.linspace(-1, 1, side) for side in size)
        uneven = 1 - 0.15 * (y[:, None] ** 2 + x**2)
        level = 1 + flicker * rng.normal(size=(frames, 1, 1))
        electrons = rng.poisson(light * uneven * level, (frames, *size))
        electrons = electrons + rng.normal(size=(frames, *size)) * self.read
        counts = np.rint(electrons / self.gain + self.offset)
        return np.clip(counts, 0, largest).astype(np.uint16)


def sensor(
    size: tuple[int, int] = (64, 80),
    *,
    seed: int = 0,
    pixel_spread: float = 0.01,
    column_spread: float = 0.0,
    hot: float = 0.01,
    gain: float = 0.46,
) -> Sensor:
    """Draw a sensor: read noise lognormal about 1.2 electrons, hot pixels of 5 to 12."""
    rng = np.random.default_rng(seed)
    read = np.exp(rng.normal(np.log(1.2), 0.22, size))
    is_hot = rng.random(size) < hot
    read[is_hot] = rng.uniform(5, 12, is_hot.sum())
    apart = rng.normal(0, pixel_spread, size) + rng.normal(0, column_spread, (1, size[1]))
    return Sensor(100 + rng.normal(0, 1.5, size), gain * (1 + apart), read, is_hot)
