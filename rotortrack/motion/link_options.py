"""Options of the linking of mobile particles."""

from __future__ import annotations

from dataclasses import dataclass

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class LinkOptions(Options):
    """How spots of mobile particles become tracks.

    Examples
    --------
    >>> import rotortrack as rt
    >>> type(rt.LinkOptions()).__name__
    'LinkOptions'
    """

    search_range_nm: float | None = option(
        None,
        "farthest that a particle is followed from frame to frame, nm (absent: chosen from the "
        "distances to the nearest spots of the next frame, and told)",
        gt=0,
    )
    memory_frames: int = option(
        2, "frames in a row that a particle may be missing and stay the same", ge=0, le=1000
    )
    min_frames: int = option(10, "particles that were seen in fewer frames are left out", ge=3)
