"""What is in a table of localisations, or in a file of camera maps."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras.camera import MASKS, load_maps
from rotortrack.cameras.hot_pixels import hot_pixels_of
from rotortrack.cameras.maps import read_provenance
from rotortrack.exchange.tables import TableInfo, read_blocks, read_info
from rotortrack.tables import LOCALISATIONS

_OUTLIER_SD = 8.0
_NORMAL_MAD = 1.4826


@dataclass(frozen=True)
class ColumnReport:
    """One column of a table: its unit, and the range of its finite values (NaN without any)."""

    name: str
    unit: str
    meaning: str
    least: float
    largest: float
    missing: int


@dataclass(frozen=True)
class TableReport:
    """What is in a table of localisations.

    Attributes
    ----------
    path
        The file.
    rows, frames_with_rows
        Localisations, and different frames among them.
    columns
        Those that are known, in our units.
    info
        What the file records beside its rows.
    """

    path: Path
    rows: int
    frames_with_rows: int
    columns: tuple[ColumnReport, ...]
    info: TableInfo

    def as_dict(self) -> dict[str, Any]:
        """Give everything as plain values."""
        return {"kind": "table", **dataclasses.asdict(self)}


@dataclass(frozen=True)
class MapReport:
    """One array of a camera: shape, range, and the pixels far from all others.

    Attributes
    ----------
    name, shape
        Shape is empty for one number that holds for all pixels.
    median, least, largest
        Over pixels.
    outliers
        Pixels further than eight robust standard deviations above the median.
    """

    name: str
    shape: tuple[int, ...]
    median: float
    least: float
    largest: float
    outliers: int


@dataclass(frozen=True)
class MapsReport:
    """What is in a file of camera maps.

    Attributes
    ----------
    path
        The file.
    arrays
        Its numbers and maps.
    hot_pixels, dead_pixels
        How many the analysis takes as such; None where there is no map to tell.
    provenance
        How the maps were made, as far as the file says.
    """

    path: Path
    arrays: tuple[MapReport, ...]
    hot_pixels: int | None
    dead_pixels: int | None
    provenance: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Give everything as plain values, the arrays by name."""
        arrays = {report.name: dataclasses.asdict(report) for report in self.arrays}
        for report in arrays.values():
            del report["name"]
        return {
            "kind": "camera maps",
            "file": self.path,
            "arrays": arrays,
            "hot_pixels": self.hot_pixels,
            "dead_pixels": self.dead_pixels,
            "provenance": self.provenance,
        }


def describe_table(path: Path, *, pixel_size_nm: float | None = None) -> TableReport:
    """Look through a table of localisations, block by block.

    Parameters
    ----------
    path
        The file; its ending tells the format.
    pixel_size_nm
        Side of a pixel, where the file counts in pixels and does not say it.

    Raises
    ------
    TableError, ConfigurationError
        As :func:`rotortrack.exchange.tables.read_localisations`.
    """
    info = read_info(path)
    rows = 0
    frames = np.empty(0, np.int64)
    ranges: dict[str, _Range] = {}
    for block in read_blocks(path, pixel_size_nm=pixel_size_nm):
        rows += len(block["frame"])
        frames = np.union1d(frames, block["frame"])
        for name, values in block.items():
            ranges.setdefault(name, _Range()).add(values)
    columns = tuple(
        ColumnReport(column.name, column.unit, column.meaning, *ranges[column.name].limits)
        for column in LOCALISATIONS.columns
        if column.name in ranges
    )
    return TableReport(path, rows, len(frames), columns, info)


def describe_maps(path: Path) -> MapsReport:
    """Look at the arrays of a camera.

    Raises
    ------
    CameraError
        The file cannot be read as camera maps.
    """
    maps = load_maps(path)
    masks = {name: int(maps.pop(name).sum()) for name in MASKS if name in maps}
    if "hot_pixels" not in masks and np.ndim(maps.get("read_noise_e", 0.0)) == 2:
        masks["hot_pixels"] = int(hot_pixels_of(maps["read_noise_e"]).sum())
    return MapsReport(
        path,
        tuple(_map_report(name, np.asarray(values)) for name, values in maps.items()),
        masks.get("hot_pixels"),
        masks.get("dead_pixels"),
        read_provenance(path),
    )


class _Range:
    """Least and largest finite value, and how many are not finite."""

    def __init__(self) -> None:
        self.least = math.inf
        self.largest = -math.inf
        self.missing = 0

    @property
    def limits(self) -> tuple[float, float, int]:
        known = self.least <= self.largest
        return (
            self.least if known else math.nan,
            self.largest if known else math.nan,
            self.missing,
        )

    def add(self, values: NDArray[Any]) -> None:
        finite = values[np.isfinite(values)]
        self.missing += len(values) - len(finite)
        if len(finite):
            self.least = min(self.least, float(finite.min()))
            self.largest = max(self.largest, float(finite.max()))


def _map_report(name: str, values: NDArray[np.float64]) -> MapReport:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return MapReport(name, values.shape, math.nan, math.nan, math.nan, 0)
    median = float(np.median(finite))
    # Maps of whole numbers may have more than half of their pixels at the median.
    sd = _NORMAL_MAD * float(np.median(np.abs(finite - median))) or float(finite.std())
    return MapReport(
        name,
        values.shape,
        median,
        float(finite.min()),
        float(finite.max()),
        int(np.sum(finite > median + _OUTLIER_SD * sd)),
    )
