"""Two colours registered onto each other by films of beads."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.corrections.quality import passes_quality
from rotortrack.errors import InputError
from rotortrack.exchange.tables import read_localisations, write_localisations
from rotortrack.localise.engine import localise
from rotortrack.pipeline.colours import both_colours
from rotortrack.pipeline.localise_run import OpenedMovie, Progress, silent
from rotortrack.pipeline.table_runs import settings_for_table
from rotortrack.settings import Layer, Settings
from rotortrack.twocolour.register import register_beads
from rotortrack.twocolour.registration import Region, Registration, read_registration

if TYPE_CHECKING:
    import pandas as pd

_IMAGE_FRAMES = 50

_NO_CAMERA = Layer(
    "register",
    {
        "camera": {"offset_adu": 0.0, "gain_e_per_adu": 1.0, "read_noise_e": 1.0},
        # Of their errors alone the scale depends on the gain.
        "localise": {"method": "wlsq", "max_emitters": 1},
    },
)


@dataclass(frozen=True)
class BeadFilm:
    """One film of beads, localised in both colours.

    Attributes
    ----------
    first, second
        Precise spots of each colour, on the whole sensor.
    regions
        The parts of the sensor that show the colours.
    images
        Mean image of each colour, in counts, (height, width).
    settings
        By which it was localised.
    """

    first: pd.DataFrame
    second: pd.DataFrame
    regions: tuple[Region, Region]
    images: tuple[NDArray[np.float64], NDArray[np.float64]]
    settings: Settings


@dataclass(frozen=True)
class Registered:
    """A registration, and the images of its first film."""

    registration: Registration
    images: tuple[NDArray[np.float64], NDArray[np.float64]]


def register_movies(
    paths: Sequence[Path],
    seconds: Sequence[Path],
    layers: list[Layer],
    *,
    workers: int | None = None,
    progress: Progress = silent,
) -> Registered:
    """Register the second colour onto the first by films of beads.

    Parameters
    ----------
    paths
        One film of beads, or one a stage position.
    seconds
        The second colour's own films, as many; none where both colours are in one file.
    layers
        What the user gave; the camera need not be known.
    workers, progress
        As everywhere.

    Raises
    ------
    InputError
        Films of the second colour are missing, or a colour shows no bead.
    RegistrationError
        The beads do not tell how to map one colour onto the other.
    MovieError, ConfigurationError
        As the parts raise them.
    """
    if seconds and len(seconds) != len(paths):
        raise InputError(
            f"{len(paths)} films of the first colour and {len(seconds)} of the second: give "
            "--second once for each film of beads"
        )
    films = []
    for number, path in enumerate(paths):
        progress("beads", number, len(paths))
        other = seconds[number] if seconds else None
        films.append(localise_beads(path, other, layers, workers=workers))
    one = films[0]
    for path, film in zip(paths, films, strict=True):
        if film.regions != one.regions:
            raise InputError(
                f"{paths[0]} and {path} show different parts of the sensor: give films of one part"
            )
    registration = register_beads(
        [film.first for film in films],
        [film.second for film in films],
        one.settings["register"],
        pixel_size_nm=one.settings["movie"].pixel_size_nm,
        regions=one.regions,
    )
    progress("beads", len(paths), len(paths))
    return Registered(registration, one.images)


def localise_beads(
    path: Path, second: Path | None, layers: list[Layer], *, workers: int | None = None
) -> BeadFilm:
    """Localise the beads of one film in both colours.

    Parameters
    ----------
    path, second
        The film, and the second colour's own where it has one.
    layers
        What the user gave; a camera that they do not name is taken for one whose counts are
        photons.
    workers
        As everywhere.

    Raises
    ------
    InputError
        A colour shows no bead.
    MovieError, ConfigurationError
        As the parts raise them.
    """
    known = any("camera" in layer.values for layer in layers)
    own = list(layers) if known else [_NO_CAMERA, *layers]
    if second is not None:
        own.append(Layer("--second", {"channels": {"second_movie": str(second)}}))
    with both_colours(path, own, "movie.pixel_size_nm") as sources:
        return BeadFilm(
            _localised(sources[0], path, "first", workers),
            _localised(sources[1], path, "second", workers),
            (sources[0].region, sources[1].region),
            (_mean_image(sources[0]), _mean_image(sources[1])),
            sources[0].settings,
        )


def apply_registration(registration: Path, table: Path, target: Path) -> int:
    """Map a table of the second colour onto the first; give the number of its rows."""
    mapping = read_registration(registration)
    _, info = settings_for_table(table, [])
    spots = read_localisations(table, pixel_size_nm=mapping.pixel_size_nm)
    places = mapping.to_first(spots[["x_nm", "y_nm"]].to_numpy(np.float64))
    spots = spots.assign(x_nm=places[:, 0], y_nm=places[:, 1])
    info = dataclasses.replace(
        info, provenance={**info.provenance, "registered_by": registration.name}
    )
    write_localisations(target, spots, info)
    return len(spots)


def _localised(source: OpenedMovie, path: Path, name: str, workers: int | None) -> pd.DataFrame:
    import pandas as pd

    blocks = [
        block.columns
        for block in localise(
            source.movie,
            source.camera,
            source.settings["localise"],
            pixel_size_nm=source.settings["movie"].pixel_size_nm,
            workers=workers,
        )
    ]
    spots = pd.DataFrame(
        {key: np.concatenate([block[key] for block in blocks]) for key in blocks[0]}
    )
    precise = spots[passes_quality(spots, source.settings["quality"])].reset_index(drop=True)
    if precise.empty:
        raise InputError(
            f"the {name} colour of {path} shows no bead: look at the film, or say where the "
            "colours are"
        )
    return precise


def _mean_image(source: OpenedMovie) -> NDArray[np.float64]:
    count = min(_IMAGE_FRAMES, source.movie.shape[0])
    mean: NDArray[np.float64] = source.movie.frames(0, count).mean(axis=0, dtype=np.float64)
    return mean
