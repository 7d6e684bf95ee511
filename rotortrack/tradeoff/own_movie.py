"""What spots and drift of a user's movie are like, for the questions that can be asked about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import MovieError
from rotortrack.tradeoff.point import Progress
from rotortrack.tradeoff.questions.drift import Field
from rotortrack.tradeoff.questions.localiser import Spots

if TYPE_CHECKING:
    from rotortrack.pipeline.localise_run import OpenedMovie

SPANS: Final = 8
SPAN_FRAMES: Final = 64
LEAST_SPOTS: Final = 50
QUANTILES: Final = {"faint": 0.1, "usual": 0.5, "bright": 0.9}
MOST_SPOTS: Final = 500_000
"""Localisations of a made-up field; more would take the question beyond its time."""

_SAME_PLACE_NM: Final = 250.0
_LEAST_OF_A_ROTOR: Final = 5


@dataclass(frozen=True)
class Measured:
    """What some frames of a movie hold.

    Attributes
    ----------
    frames, seen_frames
        Frames of the movie, and those that were localised.
    photons
        Photons of a spot by name of the quantile.
    background, sigma_px, uncertainty_nm
        Medians: photons of the background in a pixel, width, and uncertainty of a position.
    spots_per_frame, rotors
        Spots of a frame, and places in which spots were seen often.
    side_nm, pixel_size_nm
        Side of a square as large as the field, and of a pixel.
    read_noise_e, gain_e_per_adu
        Of the camera, the median of its pixels.
    """

    frames: int
    seen_frames: int
    photons: Mapping[str, float]
    background: float
    sigma_px: float
    uncertainty_nm: float
    spots_per_frame: float
    rotors: int
    side_nm: float
    pixel_size_nm: float
    read_noise_e: float
    gain_e_per_adu: float

    @property
    def sentence(self) -> str:
        """What was measured, in words."""
        faint, usual, bright = (self.photons[name] for name in QUANTILES)
        return (
            f"{self.seen_frames} of {self.frames} frames: {self.spots_per_frame:.1f} spots a frame "
            f"at {self.rotors} places; {usual:.0f} photons (a tenth below {faint:.0f}, a tenth "
            f"above {bright:.0f}) on a background of {self.background:.1f} a pixel, width "
            f"{self.sigma_px:.2f} pixels, uncertainty {self.uncertainty_nm:.1f} nm"
        )


def measure(
    source: OpenedMovie, *, workers: int | None = None, progress: Progress | None = None
) -> Measured:
    """Localise some frames, spread over the movie, and tell what is in them.

    Raises
    ------
    MovieError
        There are too few spots to tell.
    """
    from rotortrack.localise.engine import localise
    from rotortrack.rotors.cluster import cluster

    frames, height, width = source.movie.shape
    pixel_nm = float(source.settings["movie"].pixel_size_nm)
    spans = spread(frames)
    columns: list[dict[str, NDArray[Any]]] = []
    total = sum(stop - start for start, stop in spans)
    done = 0
    for block in localise(
        source.movie,
        source.camera,
        source.settings["localise"],
        pixel_size_nm=pixel_nm,
        workers=workers,
        spans=spans,
    ):
        columns.append(block.columns)
        done += block.stop - block.start
        if progress is not None:
            progress("localise", done, total)
    found = {
        name: np.concatenate([part[name] for part in columns])
        for name in ("x_nm", "y_nm", "photons", "background", "sigma_nm", "uncertainty_nm")
    }
    count = found["x_nm"].size
    if count < LEAST_SPOTS:
        raise MovieError(
            f"{source.movie.path or 'the movie'} has {count} spots in {total} of its frames, too "
            "few to tell what they are like: lower the threshold by --set localise.threshold=..., "
            "or give a movie with more spots"
        )
    places = cluster(found["x_nm"], found["y_nm"], _SAME_PLACE_NM)
    often = np.bincount(places[places >= 0]) >= _LEAST_OF_A_ROTOR
    middle = {name: float(np.nanmedian(values)) for name, values in found.items()}
    return Measured(
        frames=frames,
        seen_frames=total,
        photons={
            name: float(np.nanquantile(found["photons"], part)) for name, part in QUANTILES.items()
        },
        background=max(middle["background"], 0.0),
        sigma_px=middle["sigma_nm"] / pixel_nm,
        uncertainty_nm=middle["uncertainty_nm"],
        spots_per_frame=count / total,
        rotors=max(int(np.count_nonzero(often)), 1),
        side_nm=pixel_nm * float(np.sqrt(height * width)),
        pixel_size_nm=pixel_nm,
        read_noise_e=float(np.median(source.camera.read_noise_e)),
        gain_e_per_adu=float(np.median(source.camera.gain_e_per_adu)),
    )


def spread(frames: int) -> list[tuple[int, int]]:
    """Give ranges of frames spread evenly over a movie, or the whole of a short one."""
    if frames <= SPANS * SPAN_FRAMES:
        return [(0, frames)]
    starts = np.linspace(0, frames - SPAN_FRAMES, SPANS).astype(int).tolist()
    return [(start, start + SPAN_FRAMES) for start in starts]


def groups(measured: Measured) -> dict[str, dict[str, Any]]:
    """Give the situations to ask about by question."""
    spots = {
        f"{name}: {photons:.0f} photons": Spots(
            photons,
            background=measured.background,
            sigma_px=measured.sigma_px,
            pixel_size_nm=measured.pixel_size_nm,
            read_noise_e=measured.read_noise_e,
            gain_e_per_adu=measured.gain_e_per_adu,
        )
        for name, photons in measured.photons.items()
    }
    frames = int(min(measured.frames, max(MOST_SPOTS / measured.spots_per_frame, 100.0)))
    seen = min(measured.spots_per_frame, float(measured.rotors))
    field = Field(
        rotors=measured.rotors,
        spots_per_frame=seen,
        frames=frames,
        noise_nm=measured.uncertainty_nm,
        side_nm=measured.side_nm,
        pixel_size_nm=measured.pixel_size_nm,
    )
    name = f"{frames} frames, {seen:.1f} spots a frame"
    return {"localiser": spots, "drift": {name: field}}
