"""The second colour of a run: its localisations, and the end-to-end distances that they allow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotortrack.corrections.density import dense_enough
from rotortrack.corrections.quality import passes_quality
from rotortrack.errors import ConfigurationError
from rotortrack.pipeline.colours import both_colours
from rotortrack.pipeline.identity import Identity, describe, identify, sha256_of
from rotortrack.pipeline.localise_run import OpenedMovie, opened
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record
from rotortrack.settings import Layer, Settings, read_content, resolve
from rotortrack.twocolour.ends import Timing, map_second
from rotortrack.twocolour.measure import Field, measure_ends
from rotortrack.twocolour.registration import Registration, read_registration

if TYPE_CHECKING:
    import pandas as pd

ENDS = ("end_to_end", "end_to_end_rotors")
"""Tables of end-to-end distances, made anew whenever the motion is."""

SECOND_USES = ("channels", "ends")
"""Sections that a run depends on only where it has a second colour."""


@dataclass(frozen=True)
class SecondColour:
    """The second colour's movie, and how it lies on the first.

    Attributes
    ----------
    source
        Its movie, with the settings and the camera of its pixels.
    files
        Its files, which may be those of the first.
    registration, registration_file
        The map onto the first colour, and its file.
    """

    source: OpenedMovie
    files: list[Identity]
    registration: Registration
    registration_file: Identity

    @property
    def registration_text(self) -> str:
        """The file's text, for a copy in the run folder."""
        return read_content(self.registration_file.path).decode()


@contextmanager
def opened_colours(
    paths: Path | Sequence[Path], layers: list[Layer], *required: str
) -> Iterator[tuple[OpenedMovie, SecondColour | None]]:
    """Open a movie, and its second colour where `[channels]` names one.

    Raises
    ------
    ConfigurationError
        As :func:`rotortrack.pipeline.colours.both_colours`; or there is no registration.
    RegistrationError
        The registration is none, or was made for other parts of the sensor.
    MovieError, CameraError
        As the parts raise them.
    """
    options = resolve(SECTIONS, layers)["channels"]
    if not options.named:
        with opened(paths, layers, *required) as source:
            yield source, None
        return
    if options.registration is None:
        raise ConfigurationError(
            "channels.registration says how the second colour lies on the first: give --channels "
            "CHANNELS.json, made by `rotortrack register`"
        )
    file = identify(Path(options.registration))
    registration = read_registration(file.path)
    with both_colours(paths, layers, *required) as (first, second):
        pixel_size_nm = first.settings["movie"].pixel_size_nm
        registration.check_regions(first.region, second.region, pixel_size_nm=pixel_size_nm)
        files = [identify(path) for path in second.movie.paths]
        yield first, SecondColour(second, files, registration, file)


def record_second(record: Record, second: SecondColour, folder: Path) -> None:
    """Name the second colour's files in the manifest."""
    record.content["registration"] = describe(
        second.registration_file, folder, sha256_of(second.registration_file)
    )
    record.content["second_inputs"] = [
        describe(file, folder, sha256_of(file))
        for file in second.files
        if second.source.settings["channels"].second_movie is not None
    ]


def ends_of(
    tables: Mapping[str, pd.DataFrame],
    registration: Registration,
    settings: Settings,
    record: Record,
) -> dict[str, pd.DataFrame]:
    """Measure the end-to-end distances of a run's rotors.

    Parameters
    ----------
    tables
        localisations (with rotors, drift subtracted), second_localisations (as seen), drift and
        rotors.
    registration
        How the second colour lies on the first.
    settings
        Of the run.
    record
        Takes notes and counts.

    Returns
    -------
    dict
        Tables end_to_end and end_to_end_rotors.
    """
    movie, channels = settings["movie"], settings["channels"]
    seen = tables["second_localisations"]
    precise = seen[passes_quality(seen, settings["quality"])]
    places = map_second(precise, registration, tables["drift"])
    trusted = dense_enough(
        precise.assign(x_nm=places[:, 0], y_nm=places[:, 1]), settings["density"]
    )
    line_time_s = math.nan if channels.line_time_s is None else channels.line_time_s
    measured = measure_ends(
        tables["localisations"],
        precise[trusted],
        places[trusted],
        tables["rotors"],
        registration,
        settings["ends"],
        timing=Timing(
            frame_interval_s=movie.frame_interval_s,
            line_time_s=line_time_s,
            pixel_size_nm=movie.pixel_size_nm,
            exposure_s=movie.exposure_s or movie.frame_interval_s,
        ),
    )
    notes = list(measured.notes)
    if math.isnan(line_time_s) and channels.split == "top-bottom":
        notes.append(
            "one colour lies below the other, and a rolling shutter exposes it later: give "
            "--line-time-s (0 where all rows are exposed together) to have that corrected"
        )
    for sentence in notes:
        # A command on the same folder takes over what the one before it noted.
        if sentence not in record.content["notes"]:
            record.note(sentence)
    record.count(
        rotors_with_both_ends=len(measured.rotors), frames_with_both_ends=len(measured.frames)
    )
    record.content["end_to_end"] = _plain(measured.field)
    return {"end_to_end": measured.frames, "end_to_end_rotors": measured.rotors}


def _plain(field: Field) -> dict[str, Any]:
    """Give what all rotors together tell, for the manifest."""
    values = vars(field)
    return {
        name: (None if isinstance(value, float) and not math.isfinite(value) else value)
        for name, value in values.items()
    }
