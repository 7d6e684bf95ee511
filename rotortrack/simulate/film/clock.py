"""When each frame of a film is exposed."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Clock:
    """Frame k gathers light from k * frame_interval_s on; an exposure of 0 is an instant.

    Attributes
    ----------
    n_frames
        Frame periods, those of dropped frames included: motion goes on while they are lost.
    frame_interval_s, exposure_s
        From frame to frame; for how long light is gathered.
    line_time_s
        Row j begins j * line_time_s later; 0 for a global shutter.
    """

    n_frames: int
    frame_interval_s: float
    exposure_s: float
    line_time_s: float = 0.0

    @property
    def trigger_s(self) -> float:
        """How long the camera's trigger is high: the exposure, at most half of the interval."""
        return min(self.exposure_s or math.inf, 0.5 * self.frame_interval_s)

    @property
    def duration_s(self) -> float:
        """From the first frame to the end of the last frame's period."""
        return self.n_frames * self.frame_interval_s
