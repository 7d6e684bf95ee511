"""The stage moves: drift from frame to frame, vibration within the exposures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError
from rotortrack.exchange.csv import read_csv
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import DriftOptions, VibrationOptions
from rotortrack.simulate.film.streams import Effect, stream
from rotortrack.tables import DRIFT

Floats = NDArray[np.float64]

_SAME = 1e-9
"""Times closer than this part of a frame interval are one."""


class Stage:
    """Where the stage is, given frame after frame.

    Parameters
    ----------
    drift, vibration
        What it does; None for what does not exist.
    clock
        When frames are exposed.
    seed
        Of the film.

    Raises
    ------
    ConfigurationError, TableError
        The drift's file does not tell every frame, or cannot be read.
    """

    def __init__(
        self,
        drift: DriftOptions | None,
        vibration: VibrationOptions | None,
        clock: Clock,
        seed: int,
    ) -> None:
        self._drift = drift
        self._vibration = vibration
        self._clock = clock
        self._frame = 0
        if drift is not None and drift.walk_nm:
            self._rng = stream(seed, Effect.DRIFT)
        self._walked = np.zeros((1, 2))
        self._table = None
        if drift is not None and drift.table is not None:
            self._table = _read_drift(Path(drift.table), clock.n_frames)

    def advance(self, n: int) -> Floats | None:
        """Give the drift (x, y) in each of the next n frames, nm, shape (n, 2); None without one.

        The walk and the even drift begin with 0 in frame 0.
        """
        first, drift, clock = self._frame, self._drift, self._clock
        self._frame += n
        if drift is None:
            return None
        frames = np.arange(first, first + n)
        even = frames[:, np.newaxis] / max(clock.n_frames - 1, 1)
        moved: Floats = even * np.array(drift.total_nm)
        if any(drift.step_nm):
            # A step at the beginning of a frame is in it, whatever the division makes of it.
            late = frames >= drift.step_s / clock.frame_interval_s - _SAME
            moved += late[:, np.newaxis] * np.array(drift.step_nm)
        if drift.walk_nm:
            steps = drift.walk_nm * self._rng.standard_normal((n, 2))
            path = np.cumsum(np.concatenate([self._walked, steps]), axis=0)
            self._walked = path[-1:]
            moved += path[:-1]
        if self._table is not None:
            moved += self._table[first : first + n]
        return moved

    def vibration_nm(self, times_s: Floats, lasts_s: float = 0.0) -> tuple[Floats, Floats] | None:
        """Give the vibration (x, y), nm, each of the shape of the times; None without one.

        It is a sine that begins at time 0, averaged over a time `lasts_s` about each of the times;
        y points down.
        """
        vibration = self._vibration
        if vibration is None:
            return None
        amplitude_nm = vibration.amplitude_nm * float(np.sinc(vibration.frequency_hz * lasts_s))
        swing = amplitude_nm * np.sin(2.0 * math.pi * vibration.frequency_hz * times_s)
        direction = math.radians(vibration.direction_deg)
        return swing * math.cos(direction), -swing * math.sin(direction)


def _read_drift(path: Path, n_frames: int) -> Floats:
    """Read dx and dy of every frame, shape (n_frames, 2)."""
    table = read_csv(path, DRIFT).set_index("frame")
    twice = table.index[table.index.duplicated()]
    if twice.size:
        raise ConfigurationError(
            f"[drift] table {path} tells frame {twice[0]} twice: give one row a frame"
        )
    missing = np.setdiff1d(np.arange(n_frames), table.index)
    if missing.size:
        raise ConfigurationError(
            f"[drift] table {path} does not tell frame {missing[0]} ({missing.size} of {n_frames} "
            "frames are missing): give one row a frame"
        )
    moved: Floats = table.loc[np.arange(n_frames), ["dx_nm", "dy_nm"]].to_numpy(np.float64)
    unknown = np.flatnonzero(~np.isfinite(moved).all(axis=1))
    if unknown.size:
        raise ConfigurationError(
            f"[drift] table {path} has no finite dx_nm and dy_nm in frame {unknown[0]}: give nm"
        )
    return moved
