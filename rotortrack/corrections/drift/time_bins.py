"""Time bins with equal numbers of localisations that never split a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class TimeBins:
    """Consecutive slices of rows that are sorted by frame.

    Attributes
    ----------
    edges
        Shape (bins + 1,): bin b holds the rows ``edges[b]`` to ``edges[b + 1] - 1``.
    centres
        Shape (bins,): mean of the first and the last frame of each bin.
    """

    edges: NDArray[np.int64]
    centres: NDArray[np.float64]

    def __len__(self) -> int:
        return self.centres.size

    def rows(self, index: int) -> slice:
        """Rows of one bin."""
        return slice(int(self.edges[index]), int(self.edges[index + 1]))


def split_into_bins(frames: NDArray[np.int64], bins: int) -> TimeBins:
    """Cut sorted frames into bins of ``len(frames) // bins`` rows, each extended to whole frames.

    The last bin takes the rest. Fewer bins come back when extending leaves no rows for the last
    ones, so that a bin is never empty.

    Parameters
    ----------
    frames
        Shape (n,), ascending, n >= bins >= 1.
    bins
        How many bins are wanted.

    Notes
    -----
    Source: the behaviour of the ThunderSTORM plugin.
    """
    size = frames.size // bins
    edges = [0]
    while len(edges) < bins and edges[-1] + size < frames.size:
        last_frame = frames[edges[-1] + size - 1]
        end = int(np.searchsorted(frames, last_frame, side="right"))
        if end == frames.size:
            break
        edges.append(end)
    edges.append(frames.size)
    bounds = np.asarray(edges, dtype=np.int64)
    centres = (frames[bounds[:-1]] + frames[bounds[1:] - 1]) / 2.0
    return TimeBins(bounds, centres.astype(np.float64))
