"""Picasso's tables: the HDF5 dataset ``locs`` and a YAML file of the same stem beside it.

Picasso counts positions in pixels with the integer at a pixel's centre and frames from 0; ours are
nm from the outer corner of pixel (0, 0), so half a pixel is added on reading and taken away on
writing. h5py and pyyaml are optional and loaded only here, when a file is touched.
Layout after the files that Picasso writes (J. Schnitzbauer et al., Nat. Protoc. 12, 1198, 2017).
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError, TableError
from rotortrack.exchange.picasso_yaml import load_optional, pixel_size, write_documents
from rotortrack.exchange.picasso_yaml import read_info as read_info
from rotortrack.exchange.writer import (
    BLOCK_ROWS,
    Columns,
    LocalisationWriter,
    SameColumns,
    TableInfo,
    check_frames,
    empty_columns,
    first_line,
    listed,
    require_file,
    to_dtype,
)
from rotortrack.files import atomic_path
from rotortrack.tables import LOCALISATIONS

_HALF_PIXEL = 0.5
_SIGNALS = {"photons": "photons", "bg": "background"}
_LENGTHS = {"lpx": "x_sd_nm", "lpy": "y_sd_nm"}
_READ = ("frame", "x", "y", "sx", "sy", "group", *_SIGNALS, *_LENGTHS)
_LARGEST_CHUNK_BYTES = 256_000_000
"""A chunk is unpacked as a whole, whatever is wanted of it."""

_MOST_EXPANSION = 2_000
"""Deflate packs at most 1032 to one; more declared than that was never written."""


def read_blocks(path: Path, *, pixel_size_nm: float | None = None) -> Iterator[Columns]:
    """Yield Picasso's localisations block by block in our units; frames stay as they are.

    Parameters
    ----------
    path
        The ``.hdf5`` file; its YAML file gives the pixel size unless `pixel_size_nm` does.
    pixel_size_nm
        Wins over the file's ``Pixelsize``.

    Raises
    ------
    TableError
        The file holds no table ``locs`` with frame, x and y, or the pixel size is unknown.
    ConfigurationError
        h5py or pyyaml is not installed.
    """
    require_file(path)
    h5py = load_optional("h5py")
    size = pixel_size(path, pixel_size_nm)
    try:
        with h5py.File(path, "r") as file:
            table = _dataset(h5py, file, path)
            known = table.fields([name for name in _READ if name in table.dtype.names])
            for start in range(0, max(len(table), 1), BLOCK_ROWS):
                yield _from_picasso(known[start : start + BLOCK_ROWS], size, path)
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, MemoryError) as error:
        raise TableError(
            f"{path} cannot be read as Picasso HDF5 ({first_line(error)}): it is damaged, cut "
            "short or another kind of file; export it again"
        ) from error


@contextlib.contextmanager
def open_writer(path: Path, info: TableInfo) -> Iterator[LocalisationWriter]:
    """Give a writer of Picasso's pair of files; both appear when the block succeeds.

    Positions are float32 pixels, as Picasso has them (a resolution of 0.003 nm at 500 pixels of
    100 nm). The YAML file names the movie's extent; what `info` does not know of it is taken from
    the largest coordinate and frame, as Picasso drops what lies beyond.

    Raises
    ------
    ConfigurationError
        The pixel size is unknown, or h5py or pyyaml is not installed.
    """
    if info.pixel_size_nm is None:
        raise ConfigurationError(
            f"{path} needs the pixel size, as Picasso counts in pixels: give --pixel-size-nm"
        )
    h5py, _ = load_optional("h5py"), load_optional("yaml")
    with atomic_path(path) as temporary, _Disk(temporary, "w+") as disk:
        with h5py.File(disk, "w") as file:
            writer = _Writer(path, file, info.pixel_size_nm, disk)
            yield writer
            if writer.dataset is None:
                writer.append(empty_columns())
        disk.check()
        # The YAML file appears first, so that a new table never stands without its pixel size.
        with atomic_path(path.with_suffix(".yaml")) as sidecar:
            write_documents(
                sidecar,
                info,
                frames=writer.frames,
                width_px=writer.width_px,
                height_px=writer.height_px,
            )


def _from_picasso(rows: NDArray[Any], pixel_size_nm: float, path: Path) -> Columns:
    fields = set(rows.dtype.names or ())
    columns: dict[str, NDArray[Any]] = {}
    for axis in ("x", "y"):
        pixels = rows[axis].astype(np.float64) + _HALF_PIXEL
        columns[f"{axis}_nm"] = pixels * pixel_size_nm
    with np.errstate(invalid="ignore"):
        columns["frame"] = rows["frame"].astype(np.int64)
    if (columns["frame"] != rows["frame"]).any():
        raise TableError(f"{path}: the dataset locs holds frames that are not whole numbers")
    check_frames(columns["frame"], path)
    for field, name in _SIGNALS.items():
        if field in fields:
            columns[name] = to_dtype(rows[field], "float32")
    if {"sx", "sy"} <= fields:
        # One width stands for both axes here; the geometric mean keeps the spot's area.
        with np.errstate(invalid="ignore"):
            width = np.sqrt(rows["sx"].astype(np.float64) * rows["sy"])
        columns["sigma_nm"] = to_dtype(width * pixel_size_nm, "float32")
    for field, name in _LENGTHS.items():
        if field in fields:
            columns[name] = to_dtype(rows[field].astype(np.float64) * pixel_size_nm, "float32")
    if {"lpx", "lpy"} <= fields:
        square = rows["lpx"].astype(np.float64) ** 2 + rows["lpy"].astype(np.float64) ** 2
        columns["uncertainty_nm"] = to_dtype(np.sqrt(square / 2) * pixel_size_nm, "float32")
    if "group" in fields:
        columns["rotor"] = rows["group"].astype(np.int64)
    return {name: columns[name] for name in LOCALISATIONS.names if name in columns}


def _to_picasso(columns: Columns, pixel_size_nm: float) -> dict[str, NDArray[Any]]:
    """Give Picasso's fields in its order; an uncertainty without axes stands for both."""
    fields: dict[str, NDArray[Any]] = {"frame": columns["frame"].astype(np.uint32)}
    for axis in ("x", "y"):
        fields[axis] = columns[f"{axis}_nm"] / pixel_size_nm - _HALF_PIXEL
    sources = {
        "photons": columns.get("photons"),
        "sx": columns.get("sigma_nm"),
        "sy": columns.get("sigma_nm"),
        "bg": columns.get("background"),
        "lpx": columns.get("x_sd_nm", columns.get("uncertainty_nm")),
        "lpy": columns.get("y_sd_nm", columns.get("uncertainty_nm")),
    }
    for field, values in sources.items():
        if values is not None:
            fields[field] = values if field in _SIGNALS else values / pixel_size_nm
    if "rotor" in columns:
        fields["group"] = columns["rotor"].astype(np.int32)
    return fields


class _Disk(io.FileIO):
    """A file that keeps its failures to itself until it is asked.

    HDF5 cannot be closed when the disk is full, and brings the process down with it.
    """

    _failure: OSError | None = None

    def check(self) -> None:
        """Raise what went wrong."""
        if self._failure is not None:
            raise self._failure

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        try:
            while self._failure is None and rest:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self._failure = error
        return memoryview(data).nbytes

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self._failure = self._failure or error
            return size or 0


class _Writer:
    def __init__(self, path: Path, file: Any, pixel_size_nm: float, disk: _Disk) -> None:
        self._file = file
        self._disk = disk
        self._pixel_size_nm = pixel_size_nm
        self._same = SameColumns(path)
        self.dataset: Any = None
        self.frames = self.width_px = self.height_px = 0

    def append(self, columns: Columns) -> None:
        added = self._same.check(columns)
        fields = _to_picasso(columns, self._pixel_size_nm)
        kinds = {"frame": "<u4", "group": "<i4"}
        dtype = np.dtype([(name, kinds.get(name, "<f4")) for name in fields])
        rows = np.empty(added, dtype)
        for name, values in fields.items():
            rows[name] = to_dtype(values, dtype[name].str)
        if self.dataset is None:
            self.dataset = self._file.create_dataset(
                "locs", (0,), dtype, maxshape=(None,), chunks=(16_384,), fletcher32=True
            )
        written = len(self.dataset)
        self.dataset.resize(written + added, axis=0)
        self.dataset[written:] = rows
        self._disk.check()
        self.frames = max(self.frames, _extent(rows["frame"]))
        self.width_px = max(self.width_px, _extent(rows["x"] + _HALF_PIXEL))
        self.height_px = max(self.height_px, _extent(rows["y"] + _HALF_PIXEL))


def _extent(values: NDArray[Any]) -> int:
    """Return the number of pixels or frames that hold the largest finite value."""
    finite = values[np.isfinite(values)]
    return int(np.floor(finite.max())) + 1 if finite.size else 0


def _dataset(h5py: Any, file: Any, path: Path) -> Any:
    """Find the table; only its own numbers are read, never a link to another file or an object."""
    link = file.get("locs", getlink=True) if "locs" in file else None
    table = file["locs"] if isinstance(link, h5py.HardLink) else None
    if not isinstance(table, h5py.Dataset) or table.ndim != 1:
        raise TableError(f"{path} holds no Picasso table named locs: it holds {listed(file)}")
    names = table.dtype.names or ()
    missing = [name for name in ("frame", "x", "y") if name not in names]
    if missing:
        raise TableError(
            f"{path}: the dataset locs lacks {', '.join(missing)}; it has "
            f"{listed(names) if names else 'no named columns'}"
        )
    odd = [name for name in _READ if name in names and table.dtype[name].kind not in "iuf"]
    if odd:
        raise TableError(f"{path}: the column(s) {', '.join(odd)} of locs are not numbers")
    if table.external or table.is_virtual:
        raise TableError(f"{path}: the dataset locs lies in other files; copy it into one file")
    if table.nbytes > _MOST_EXPANSION * max(table.id.get_storage_size(), 4096):
        raise TableError(f"{path}: the dataset locs declares {len(table)} rows but stores fewer")
    if table.chunks and table.chunks[0] * table.dtype.itemsize > _LARGEST_CHUNK_BYTES:
        raise TableError(
            f"{path}: the dataset locs is stored in chunks of {table.chunks[0]} rows, which cannot "
            "be read piece by piece: save it again with smaller chunks"
        )
    return table
