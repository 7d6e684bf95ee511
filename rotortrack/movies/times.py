"""The times of frames as files record them, and what follows from them for a recording."""

from __future__ import annotations

import contextlib
import dataclasses
import re
import warnings

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import MetadataWarning
from rotortrack.movies.facts import Facts
from rotortrack.movies.handle import Handle
from rotortrack.movies.metadata import collect, merge
from rotortrack.movies.timing import FEWEST_TIMED_FRAMES, number_frames, told

MM_ORIGIN = "file (Micro-Manager elapsed times)"
OME_ORIGIN = "file (OME times)"

# Two frames may be written in the other order; a clock that was set back says nothing any more.
_FARTHEST_BACK = 5.0

# A plain number in version 1.4 and most of version 2, {"PropVal": 0.11} in version 2 gamma.
_ELAPSED = re.compile(
    rb'"ElapsedTime-ms"\s*:\s*(?:\{[^{}]{0,200}?"PropVal"\s*:\s*)?"?([-+.\deE]{1,40})[\s",}]'
)


def read_elapsed_s(handle: Handle, texts: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """Read when each page was received, from Micro-Manager's descriptions of the pages.

    The number is searched for in the bytes: reading 100 000 descriptions as JSON takes a minute.

    Parameters
    ----------
    handle
        The open file.
    texts
        Place and length in bytes of each description, shape (page, 2).

    Returns
    -------
    ndarray or None
        Times in s, shape (page,), NaN where a page has none; None where no page has one, or
        descriptions overlap.
    """
    if not len(texts) or int(texts[:, 1].sum()) > handle.stored:
        return None
    times_ms = np.full(len(texts), np.nan)
    for page, (place, size) in enumerate(texts.tolist()):
        found = _ELAPSED.search(handle.read(size, place))
        with contextlib.suppress(ValueError):
            times_ms[page] = float(found[1]) if found else np.nan
    times_ms[~np.isfinite(times_ms)] = np.nan
    return None if np.isnan(times_ms).all() else times_ms / 1e3


def with_times(facts: Facts, times_s: NDArray[np.float64] | None, name: str, origin: str) -> Facts:
    """Add the times of the frames, their numbers, and the interval that follows from them.

    Parameters
    ----------
    facts
        What else is known; an interval that a program was set to is a wish, 0 for "as fast as
        possible" or shorter than the exposure, and gives way to the measured one.
    times_s
        Time of each frame, NaN where a frame has none, or None where none has one.
    name, origin
        The movie, and where the times come from, for the user.

    Warns
    -----
    MetadataWarning
        Some frames have no time, the times go back, follow no common interval, or contradict the
        interval that the file names.
    """
    untimed = 0 if times_s is None else int(np.isnan(times_s).sum())
    if times_s is None or len(times_s) < 2 or untimed == len(times_s):
        return facts
    if untimed:
        warnings.warn(
            f"{untimed} of {len(times_s)} frames of {name} tell no time, so no times are used and "
            "dropped frames are not told: check how the frames were put together",
            MetadataWarning,
            stacklevel=2,
        )
        return facts
    if not np.ptp(times_s):
        return facts
    mean_s = float(times_s[-1] - times_s[0]) / (len(times_s) - 1)
    back_s = float(np.max(np.maximum.accumulate(times_s) - times_s))
    if back_s > _FARTHEST_BACK * mean_s:
        warnings.warn(
            f"the times of the frames of {name} go back by {back_s:.4g} s, so none of them are "
            "used and dropped frames are not told: check how the frames were put together",
            MetadataWarning,
            stacklevel=2,
        )
        return facts
    facts = dataclasses.replace(facts, times_s=times_s)
    if len(times_s) < FEWEST_TIMED_FRAMES:
        return facts
    found = number_frames(times_s)
    note = told(found, name)
    return dataclasses.replace(
        facts,
        metadata=merge(facts.metadata, collect(origin, frame_interval_s=found.interval_s)),
        notes=facts.notes if note is None else (*facts.notes, note),
        numbers=found.numbers if found.dropped else None,
    )
