"""What is known of a recording as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.movies.metadata import Metadata


@dataclass(frozen=True)
class Facts:
    """What is known of a recording; the attributes are those of a movie."""

    metadata: Metadata
    notes: tuple[str, ...] = ()
    missing_frames: int = 0
    times_s: NDArray[np.float64] | None = None
    numbers: NDArray[np.int64] | None = None
