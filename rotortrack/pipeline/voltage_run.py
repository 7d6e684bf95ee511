"""A recorded trace of camera trigger and voltage, held against the rotors of a run."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import InputError, TableError, TraceWarning
from rotortrack.exchange.csv import read_csv
from rotortrack.motion.tables import TRACE, VOLTAGES
from rotortrack.motion.trigger import FrameClock, frame_clock, rising_edges
from rotortrack.motion.voltage import FrameVoltages, frame_voltages, voltage_steps
from rotortrack.motion.voltage_speeds import (
    StepChange,
    step_changes,
    step_edges_s,
    voltage_speeds,
)
from rotortrack.settings import Settings
from rotortrack.tables import conform

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

_MOST_OFF = 1e-3
"""Clocks of cameras and of data acquisition agree to 1e-4; more is a wrong frame interval."""


@dataclass(frozen=True)
class Voltages:
    """What a trace tells of a run: tables, and sentences for its notes."""

    voltages: pd.DataFrame
    speeds: pd.DataFrame
    changes: list[StepChange]
    notes: list[str]


def read_trace(path: Path) -> tuple[Floats, Floats, Floats]:
    """Read times (s), trigger (V) and voltage (V) from a table with these columns.

    Any dialect that spreadsheets and acquisition programs write is understood: comma, semicolon or
    tab, decimal commas, gzip by ending.

    Raises
    ------
    TableError
        It is no such table, a value is missing, or times do not ascend.
    """
    table = read_csv(path, TRACE)
    columns = [table[name].to_numpy(np.float64) for name in TRACE.names]
    if len(table) < 2:
        raise TableError(f"{path} holds {len(table)} sample(s): export the whole trace")
    for name, values in zip(TRACE.names, columns, strict=True):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise TableError(
                f"{path}: {name} has no value in sample {bad[0] + 1}; export the trace again, or "
                "remove such rows"
            )
    back = np.flatnonzero(np.diff(columns[0]) <= 0.0)
    if back.size:
        raise TableError(
            f"{path}: time_s does not ascend after sample {back[0] + 1} "
            f"({columns[0][back[0]]:.9g} s): export the trace in order, with more digits"
        )
    return columns[0], columns[1], columns[2]


def measure_voltages(
    path: Path,
    tracks: pd.DataFrame,
    rotors: pd.DataFrame,
    settings: Settings,
    *,
    n_frames: int,
) -> Voltages:
    """Give every frame its voltage and every rotor its speed at each voltage.

    Parameters
    ----------
    path
        The trace.
    tracks, rotors
        Tables of the run, measured.
    settings
        `movie.frame_interval_s`, `movie.exposure_s` (absent: fills the interval), `motion`.
    n_frames
        Frames of the movie from frame 0 to the last one that was looked at.

    Raises
    ------
    TableError
        The trace cannot be read.
    InputError
        Its trigger has no edges at a common pace, or the voltage is never constant.

    Warns
    -----
    TraceWarning
        Edges are missing, too many or of another pace than the frames.
    """
    interval_s = settings["movie"].frame_interval_s
    exposure_s = settings["movie"].exposure_s or interval_s
    options = settings["motion"]
    time_s, trigger_v, voltage_v = read_trace(path)
    try:
        clock = frame_clock(rising_edges(time_s, trigger_v))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    first = options.daq_first_edge
    notes = [_report(path, clock, interval_s, n_frames, first)]
    steps = voltage_steps(time_s, voltage_v, min_step_s=options.voltage_min_s)
    if not len(steps):
        raise InputError(
            f"{path}: voltage_v is nowhere constant for {options.voltage_min_s:g} s: record steps, "
            "or set motion.voltage_min_s"
        )
    times = {"frame_interval_s": interval_s, "exposure_s": exposure_s}
    of_frames = frame_voltages(
        time_s,
        voltage_v,
        clock,
        steps,
        n_frames=n_frames,
        first_edge=first,
        exposure_s=exposure_s * clock.period_s / interval_s,
    )
    ends_s = step_edges_s(steps, clock, first_edge=first, **times)
    within = (ends_s[:, 1] > 0.0) & (ends_s[:, 0] < n_frames * interval_s)
    if not within.any():
        raise InputError(
            f"{path} shows no constant voltage while the movie was recorded: check "
            "motion.daq_first_edge"
        )
    speeds = voltage_speeds(tracks, rotors, steps, ends_s, **times)
    changes = step_changes(speeds)
    notes += [change.sentence for change in changes]
    return Voltages(_table(of_frames), speeds, changes, notes)


def _report(
    path: Path, clock: FrameClock, interval_s: float, n_frames: int, first_edge: int
) -> str:
    """Warn of what does not fit, and say in one sentence what was understood."""
    doubts = []
    edges = clock.time_s.size - first_edge
    ppm = clock.ppm_off(interval_s)
    if abs(ppm) > 1e6 * _MOST_OFF:
        doubts.append(
            f"its trigger has a period of {1e3 * clock.period_s:.6g} ms, yet frame_interval_s is "
            f"{1e3 * interval_s:.6g} ms, so all speeds are off by {abs(ppm) * 1e-4:.2g} %: correct "
            "frame_interval_s, unless the trigger is not this movie's"
        )
    if clock.missed:
        doubts.append(f"{clock.missed} trigger edge(s) are missing and were filled in")
    if clock.extra:
        doubts.append(f"{clock.extra} trigger edge(s) between frames were left out")
    if clock.pauses:
        doubts.append(
            f"the trigger pauses {clock.pauses} time(s), which frame numbers do not show: speeds "
            "across such a pause are wrong"
        )
    if clock.starts_high:
        doubts.append("it begins within an exposure, which was taken for frame 0")
    if edges < n_frames:
        doubts.append(
            f"it has {max(edges, 0)} trigger edges for {n_frames} frames, so the last "
            f"{n_frames - max(edges, 0)} have no voltage; if the first edges are the ones missing, "
            "all voltages are late"
        )
    elif edges > n_frames:
        doubts.append(
            f"it has {edges} trigger edges for {n_frames} frames; the first was taken for frame 0: "
            "if the camera ran before, give motion.daq_first_edge"
        )
    for doubt in doubts:
        warnings.warn(f"{path}: {doubt}", TraceWarning, stacklevel=3)
    return (
        f"{clock.time_s.size} exposures were found in {path.name}, {1e3 * clock.period_s:.6g} ms "
        f"apart ({ppm:+.0f} ppm)"
    )


def _table(found: FrameVoltages) -> pd.DataFrame:
    import pandas as pd

    return conform(
        pd.DataFrame(
            {
                "frame": np.arange(found.step.size),
                "exposure_start_s": found.start_s,
                "voltage_v": found.mean_v,
                "voltage_min_v": found.min_v,
                "voltage_max_v": found.max_v,
                "transition": found.transition,
                "step": found.step,
            }
        ),
        VOLTAGES,
        "voltages",
    )
