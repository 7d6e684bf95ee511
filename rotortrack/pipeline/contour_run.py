"""From an image of an atomic force microscope to a table of rods, a summary and a picture."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rotortrack.afm.image import HeightImage, read_image
from rotortrack.afm.tables import CONTOURS
from rotortrack.afm.trace import Traced, trace_rods
from rotortrack.errors import ContourWarning, UsageError
from rotortrack.exchange import csv, parquet
from rotortrack.files import atomic_path
from rotortrack.pipeline.identity import identify, refuse_changed, sha256_of
from rotortrack.pipeline.localise_run import Progress, silent
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record
from rotortrack.settings import Layer, resolve

_USES = ("movie.pixel_size_nm", "contour")
_ENDINGS = (".parquet", ".csv")


@dataclass(frozen=True)
class Contours:
    """What was found, the numbers that sum it up, and where it was written."""

    traced: Traced
    summary: dict[str, Any]
    files: dict[str, Path]


def trace_image(
    path: Path,
    target: Path,
    layers: list[Layer],
    *,
    draw: Callable[[Path, Traced], None],
    progress: Progress = silent,
) -> Contours:
    """Trace the rods in an image file.

    Parameters
    ----------
    path, target
        The image, and the table of rods (.csv or .parquet). Beside it lie `NAME-summary.json` and
        the picture `NAME.png`.
    layers
        What the user gave; the pixel size may also come from the image.
    draw
        Called with the path and what was found to draw the picture.
    progress
        Shows stages.

    Raises
    ------
    UsageError
        The target has another ending, is the input, or would replace a table of a run.
    ConfigurationError
        The pixel size is not known.
    ImageError, MovieError
        The image cannot be used.
    """
    files = _targets(path, target)
    first = resolve(SECTIONS, layers)
    progress("read", 0, 0)
    file = identify(path)
    image = read_image(path, first["movie"])
    known = {} if image.pixel_size_nm is None else {"pixel_size_nm": image.pixel_size_nm}
    settings = resolve(SECTIONS, [Layer(f"file {path.name}", {"movie": known}), *layers])
    settings.require("movie.pixel_size_nm")
    options = settings["contour"]
    record = Record("contour")
    height_nm = image.values * _unit_nm(path, image, options.nm_per_unit)
    progress("trace", 0, 0)
    with record.warnings():
        traced = trace_rods(height_nm, settings["movie"].pixel_size_nm, options)
    record.options(settings, _USES)
    record.inputs([file], target.parent, [sha256_of(file)])
    kept = int((traced.rods["verdict"] == "kept").sum())
    record.count(rods=kept, refused=len(traced.rods) - kept)
    refuse_changed([file])
    progress("write", 0, 0)
    summary = summarise(traced)
    with (
        atomic_path(files["summary"]) as beside,
        atomic_path(files["figure"]) as figure,
    ):
        # All or none: what comes last needs no further file.
        told = {**summary, "provenance": record.provenance}
        beside.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        draw(figure, traced)
        if target.suffix.lower() == ".csv":
            csv.write_csv(target, traced.rods)
        else:
            parquet.write_table(target, traced.rods, CONTOURS, record.provenance)
    return Contours(traced, summary, files)


def summarise(traced: Traced) -> dict[str, Any]:
    """Give the numbers that others build on; None for what is not known, or infinite."""
    kept = traced.rods[traced.rods["verdict"] == "kept"]
    scale, stiff = traced.scale, traced.persistence
    numbers: dict[str, float | int | None] = {
        "rods": len(kept),
        "refused": len(traced.rods) - len(kept),
        "contour_nm": kept["contour_nm"].mean(),
        "contour_sd_nm": kept["contour_nm"].std(),
        "end_to_end_nm": kept["end_to_end_nm"].mean(),
        "end_to_end_sd_nm": kept["end_to_end_nm"].std(),
        "height_nm": kept["height_nm"].median(),
        "width_nm": traced.width_nm,
        "noise_nm": traced.noise_nm,
        "smooth_nm": traced.smooth_nm,
        "pixel_size_nm": traced.pixel_size_nm,
        "scale": scale.factor if scale else None,
        "scale_sd": scale.sd if scale else None,
        "persistence_nm": stiff.persistence_nm if stiff else None,
        "persistence_ci_low_nm": stiff.ci_low_nm if stiff else None,
        "persistence_ci_high_nm": stiff.ci_high_nm if stiff else None,
        "persistence_by_tangents_nm": stiff.by_tangents_nm if stiff else None,
        "persistence_by_end_to_end_nm": stiff.by_end_to_end_nm if stiff else None,
        "turns": stiff.turns if stiff else 0,
        "segment_nm": stiff.segment_nm if stiff else None,
        "noise_share": stiff.noise_share if stiff else None,
    }
    plain = {
        name: value if value is not None and math.isfinite(value) else None
        for name, value in numbers.items()
    }
    only_limit = stiff.is_limit if stiff else None
    return {**plain, "persistence_is_lower_limit": only_limit, "reasons": traced.refused}


def _unit_nm(path: Path, image: HeightImage, given: float | None) -> float:
    """Choose what one unit of the data is: given, by the file, or a nanometre."""
    if given is not None:
        return given
    if image.nm_per_unit is not None:
        return image.nm_per_unit
    warnings.warn(
        f"{path} does not tell the unit of its heights, which is taken for 1 nm; lengths do not "
        "depend on it: give --nm-per-unit",
        ContourWarning,
        stacklevel=3,
    )
    return 1.0


def _targets(path: Path, target: Path) -> dict[str, Path]:
    """Name the files that are written."""
    if target.suffix.lower() not in _ENDINGS:
        raise UsageError(f"{target} has no known ending: rods are written as .csv or .parquet")
    if (target.parent / "run.json").is_file():
        raise UsageError(
            f"{target.parent} is a run folder, whose tables must not be replaced: choose another "
            "folder with -o"
        )
    files = {
        "rods": target,
        "summary": target.with_name(f"{target.stem}-summary.json"),
        "figure": target.with_name(f"{target.stem}.png"),
    }
    for made in files.values():
        if made.absolute() == path.absolute():
            raise UsageError(f"{made} is the input: choose another name with -o")
    return files
