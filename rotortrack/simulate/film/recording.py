"""How a film is recorded: frames that are lost, times that are noted, voltages beside it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotortrack.files import atomic_path
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import DroppedOptions, TimestampsOptions, VoltageOptions
from rotortrack.simulate.film.streams import Effect, stream

Floats = NDArray[np.float64]

LEAD_S = 0.05
"""How long the voltage is recorded before the first and after the last frame."""

_TRIGGER_V = 3.3
_TRIGGER_NOISE_V = 0.02
_BLOCK_ROWS = 100_000


def recorded_frames(options: DroppedOptions, clock: Clock, seed: int) -> NDArray[np.bool_]:
    """Tell which frames the camera did not lose, shape (n_frames,); the first is never lost."""
    kept = stream(seed, Effect.DROPPED).random(clock.n_frames) >= options.fraction
    kept[list(options.frames)] = False
    kept[0] = True
    return kept


def noted_times(options: TimestampsOptions | None, clock: Clock, seed: int) -> Floats:
    """Give the times at which the computer notes each frame period, s, shape (n_frames,).

    A frame is received late by the absolute value of a normal number, never early.
    """
    times: Floats = np.arange(clock.n_frames, dtype=np.float64) * clock.frame_interval_s
    if options is not None:
        late = stream(seed, Effect.TIMESTAMPS).standard_normal(clock.n_frames)
        times = times + options.jitter_s * np.abs(late)
    return times


def write_daq(
    path: Path,
    options: VoltageOptions,
    clock: Clock,
    recorded: NDArray[np.bool_] | None,
    seed: int,
) -> None:
    """Write trigger and voltage as `rotortrack motion --daq` reads them.

    The trigger is high during the exposure (half of the frame interval at most, so that it falls
    between frames) of every frame that was not lost, the recording begins `LEAD_S` before the
    first one.

    Parameters
    ----------
    path
        CSV with time_s, trigger_v and voltage_v.
    options, clock
        The voltages and the frames.
    recorded
        Frames that were not lost; None where none was.
    seed
        Of the film.
    """
    rng = stream(seed, Effect.VOLTAGE)
    samples = round((clock.duration_s + 2.0 * LEAD_S) * options.sample_hz)
    # A thousandth of a sample, however long the film is.
    digits = max(0, math.ceil(math.log10(options.sample_hz))) + 3
    starts = np.array(options.times_s)
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write("time_s,trigger_v,voltage_v\n")
        for first in range(0, samples, _BLOCK_ROWS):
            number = np.arange(first, min(first + _BLOCK_ROWS, samples))
            time_s = number / options.sample_hz
            # A sample at the very beginning of a frame is in it, however the times are rounded.
            film_s = (number + 1e-3) / options.sample_hz - LEAD_S
            frame = np.floor(film_s / clock.frame_interval_s).astype(np.int64)
            inside = (frame >= 0) & (frame < clock.n_frames)
            if recorded is not None:
                inside &= recorded[np.clip(frame, 0, clock.n_frames - 1)]
            is_high = inside & (film_s - frame * clock.frame_interval_s < clock.trigger_s)
            step = np.maximum(np.searchsorted(starts, film_s, side="right") - 1, 0)
            voltage_mv = np.array(options.voltages_mv)[step]
            noise = rng.standard_normal((number.size, 2))
            trigger_v = _TRIGGER_V * is_high + _TRIGGER_NOISE_V * noise[:, 0]
            voltage_v = 1e-3 * (voltage_mv + options.noise_mv * noise[:, 1])
            rows = zip(time_s.tolist(), trigger_v.tolist(), voltage_v.tolist(), strict=True)
            file.writelines(f"{t:.{digits}f},{u:.4f},{v:.6f}\n" for t, u, v in rows)
