"""Spots of mobile particles linked into tracks by trackpy."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import InputError, LinkWarning

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_ADAPTIVE_STEP = 0.9
_ADAPTIVE_STOP = 0.1


@dataclass(frozen=True)
class Links:
    """Which particle each spot belongs to.

    Attributes
    ----------
    particle
        Number of each spot's particle, from 0 in order of first appearance, shape (n,).
    adaptive
        Whether the range was made smaller where spots crowd.
    """

    particle: Integers
    adaptive: bool


def link(
    frame: Integers, x_nm: Floats, y_nm: Floats, *, search_range_nm: float, memory_frames: int
) -> Links:
    """Link spots into particles so that the squares of all steps add to the least sum.

    Where more than 15 spots lie within each other's range, it shrinks there, down to a tenth.

    Parameters
    ----------
    frame, x_nm, y_nm
        Spots in any order, shape (n,), finite.
    search_range_nm
        Longest step.
    memory_frames
        Frames that a particle may be missing. The range does not grow with the gap.

    Raises
    ------
    InputError
        Spots crowd even within a tenth of the range.

    Warns
    -----
    LinkWarning
        The range had to shrink somewhere.

    Notes
    -----
    The Crocker-Grier algorithm (J. Colloid Interface Sci. 179, 298 (1996)) as trackpy has it. Its
    iterator over arrays is called, not its functions on tables, which sort pandas tables in ways
    that newer versions of pandas refuse.
    """
    if frame.size == 0:
        return Links(np.empty(0, np.int64), adaptive=False)
    order = np.lexsort((x_nm, y_nm, frame))
    levels = _Levels(frame[order], np.stack([y_nm, x_nm], axis=1)[order], memory_frames)
    with _quiet_trackpy() as trackpy:
        try:
            numbers, adaptive = _run(trackpy, levels, search_range_nm, memory_frames)
        except trackpy.SubnetOversizeException as error:
            raise InputError(
                f"spots are too dense to be linked over {search_range_nm:g} nm: give a smaller "
                "--search-range-nm, or keep fewer spots"
            ) from error
    if adaptive:
        warnings.warn(
            f"where spots crowd, particles were followed less far than {search_range_nm:g} nm, "
            "which may lose fast ones: give a smaller --search-range-nm if tracks look wrong",
            LinkWarning,
            stacklevel=2,
        )
    particle = np.empty(frame.size, np.int64)
    particle[order] = numbers
    return Links(particle, adaptive)


@dataclass(frozen=True)
class _Levels:
    """Spots frame by frame, as trackpy asks for them; frames without spots count for memory."""

    frame: Integers
    place: Floats
    memory: int

    def __iter__(self) -> Iterator[tuple[int, Floats]]:
        numbers, starts = np.unique(self.frame, return_index=True)
        before = int(numbers[0])
        for number, place in zip(numbers, np.split(self.place, starts[1:]), strict=True):
            # Every particle is forgotten after memory + 1 empty frames; more change nothing.
            empty = min(int(number) - before - 1, self.memory + 1)
            for k in range(empty):
                yield before + 1 + k, np.empty((0, 2))
            yield int(number), place
            before = int(number)


def _run(
    trackpy: ModuleType, levels: _Levels, search_range: float, memory: int
) -> tuple[Integers, bool]:
    """Give the spots' particles, numbered in order of first appearance, and whether any crowded."""
    from trackpy.linking.subnetlinker import subnet_linker_recursive

    crowded = False

    def solve(*args: Any, **kwargs: Any) -> Any:
        nonlocal crowded
        try:
            return subnet_linker_recursive(*args, **kwargs)
        except trackpy.SubnetOversizeException:
            crowded = True
            raise

    found = trackpy.link_iter(
        iter(levels),
        search_range,
        memory=memory,
        # Without it trackpy tries groups of up to 30 spots, which may take minutes each.
        adaptive_stop=_ADAPTIVE_STOP * search_range,
        adaptive_step=_ADAPTIVE_STEP,
        link_strategy=solve,
    )
    numbers = np.concatenate([np.asarray(ids, np.int64) for _, ids in found])
    _, first, place = np.unique(numbers, return_index=True, return_inverse=True)
    rank = np.empty(first.size, np.int64)
    rank[np.argsort(first)] = np.arange(first.size)
    ranked: Integers = rank[place]
    return ranked, crowded


@contextlib.contextmanager
def _quiet_trackpy() -> Iterator[ModuleType]:
    """Import trackpy, keep it from writing a line a frame to stdout, and from what pandas says."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=DeprecationWarning, module=r"trackpy\.")
        warnings.filterwarnings("ignore", category=FutureWarning, module=r"trackpy\.")
        import trackpy

        logger = logging.getLogger("trackpy")
        before = logger.level
        logger.setLevel(logging.WARNING)
        try:
            yield trackpy
        finally:
            logger.setLevel(before)
