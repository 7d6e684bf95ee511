"""Small valid files of every kind that is read: the seeds of the fuzz corpus.

Every seed is the same to the byte at each call, so that a damaged copy can be made again from its
kind and number alone.
"""

from __future__ import annotations

import dataclasses
import functools
import gzip
import io
import json
import re
import struct
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import tifffile

from rotortrack.errors import RotortrackWarning
from rotortrack.exchange.tables import TableInfo, write_localisations

FRAMES = np.random.default_rng(5).integers(90, 130, (12, 20, 24)).astype(np.uint16)
# Spots, so that reading whole seeds compiles all kernels, and damaged ones are timed without it.
FRAMES[:, 8:11, 9:12] += 400
FRAMES[:, 9, 10] += 800
INTERVAL_S = 0.002
PIXEL_NM = 100.0


@dataclass(frozen=True)
class Seed:
    """A valid input.

    Attributes
    ----------
    files
        Content by name; the first is what the reader is given (all of them for a `series`).
    reads
        Which reader takes it: `movie`, `series`, `table`, `rotors`, `maps`, `config` or `run`.
    frames
        What a movie shows.
    checked
        Whether damage to its data is always noticed, as they have checksums.
    """

    files: dict[str, bytes]
    reads: str
    frames: np.ndarray | None = None
    checked: bool = False

    @property
    def first(self) -> str:
        """Name of the file that the reader is given."""
        return next(iter(self.files))


def _movie(
    frames: np.ndarray = FRAMES, *, apart: bool = False, **options: Any
) -> Callable[[], Seed]:
    def make() -> Seed:
        stream = io.BytesIO()
        common = {"photometric": "minisblack", **options}
        writer_options = {
            name: common.pop(name)
            for name in ("bigtiff", "ome", "imagej", "byteorder")
            if name in common
        }
        with tifffile.TiffWriter(stream, **writer_options) as writer:
            for part in frames if apart else [frames]:
                writer.write(part, contiguous=not apart, **common)
        files = {"movie.tif": _without_chance(stream.getvalue())}
        return Seed(files, "movie", frames, checked=options.get("compression") == "zlib")

    return make


def _without_chance(content: bytes) -> bytes:
    """Replace the random identifiers of OME-XML by fixed ones of the same length."""
    return re.sub(rb"urn:uuid:[0-9a-f-]{36}", b"urn:uuid:" + b"0" * 36, content)


def micromanager(frames: np.ndarray = FRAMES) -> Seed:
    """Write what Micro-Manager 1.4 and 2 write: header of indices, IndexMap, JSON in tag 51123."""
    summary = json.dumps(
        {
            **{"PixelSize_um": 0.1, "Interval_ms": 2.0, "Frames": len(frames), "Slices": 1},
            **{"Channels": 1, "Positions": 1, "Width": frames.shape[2], "Height": frames.shape[1]},
            **{"Prefix": "movie", "MicroManagerVersion": "2.0.0"},
        }
    ).encode()
    head = 40 + len(summary)
    body = bytearray()
    index = bytearray()
    for number, frame in enumerate(frames):
        place = head + len(body)
        index += struct.pack("<5I", 0, 0, number, 0, place)
        values = {
            "ElapsedTime-ms": 2.0 * number,
            "Exposure-ms": 1.5,
            "PixelSizeUm": 0.1,
            "FrameIndex": number,
            "ROI": "0-0-24-20",
            "Camera": "Andor",
        }
        text = json.dumps(values).encode() + b"\0"
        fields = 11
        after = place + 2 + 12 * fields + 4
        pixels = after + len(text)
        entries = [
            *[(256, 4, 1, frame.shape[1]), (257, 4, 1, frame.shape[0]), (258, 3, 1, 16)],
            *[(259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, pixels), (277, 3, 1, 1)],
            *[(278, 4, 1, frame.shape[0]), (279, 4, 1, frame.nbytes), (339, 3, 1, 1)],
            (51123, 2, len(text), after),
        ]
        following = pixels + frame.nbytes if number + 1 < len(frames) else 0
        body += struct.pack("<H", fields)
        body += b"".join(struct.pack("<HHII", *entry) for entry in entries)
        body += struct.pack("<I", following) + text + frame.tobytes()
    end = head + len(body)
    header = b"II*\0" + struct.pack("<I", head)
    header += struct.pack("<6I", 54773648, end, 483765892, 0, 99384722, 0)
    header += struct.pack("<2I", 2355492, len(summary)) + summary
    content = header + bytes(body) + struct.pack("<2I", 3453623, len(frames)) + bytes(index)
    return Seed({"movie_MMStack.tif": content}, "movie", frames)


def ome_set() -> Seed:
    """Write one movie over two files that name each other in their OME-XML."""
    half = len(FRAMES) // 2
    height, width = FRAMES.shape[1:]
    planes = "".join(
        f'<TiffData FirstT="{first}" FirstC="0" FirstZ="0" IFD="0" PlaneCount="{half}">'
        f'<UUID FileName="set_{number}.ome.tif">urn:uuid:{number}</UUID></TiffData>'
        for number, first in enumerate((0, half))
    )
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        f'<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="{width}" '
        f'SizeY="{height}" SizeC="1" SizeZ="1" SizeT="{len(FRAMES)}" PhysicalSizeX="0.1" '
        f'PhysicalSizeY="0.1" TimeIncrement="0.002">{planes}</Pixels></Image></OME>'
    )
    files = {}
    for number, part in enumerate(np.split(FRAMES, 2)):
        stream = io.BytesIO()
        with tifffile.TiffWriter(stream) as writer:
            for index, frame in enumerate(part):
                description = None if index else text
                writer.write(frame, contiguous=False, metadata=None, description=description)
        files[f"set_{number}.ome.tif"] = stream.getvalue()
    return Seed(files, "movie", frames=FRAMES)


def series() -> Seed:
    """Write one recording over two files that do not know of each other."""
    files = {}
    for number, part in enumerate(np.split(FRAMES, 2)):
        stream = io.BytesIO()
        tifffile.imwrite(stream, part, photometric="minisblack")
        files[f"series_{number}.tif"] = stream.getvalue()
    return Seed(files, "series", frames=FRAMES)


def spots(rows: int = 400) -> pd.DataFrame:
    """Give localisations on a ring, so that a rotor is found in them."""
    rng = np.random.default_rng(3)
    angle = np.cumsum(rng.normal(0.3, 0.2, rows))
    return pd.DataFrame(
        {
            "frame": np.arange(rows),
            "x_nm": 1000 + 40 * np.cos(angle) + rng.normal(0, 4, rows),
            "y_nm": 1000 + 40 * np.sin(angle) + rng.normal(0, 4, rows),
            "sigma_nm": rng.normal(130, 5, rows),
            "photons": rng.normal(900, 30, rows),
            "background": rng.normal(9, 1, rows),
            "uncertainty_nm": rng.normal(6, 0.5, rows),
        }
    )


def _table(name: str, *, checked: bool = False) -> Callable[[], Seed]:
    def make() -> Seed:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            info = TableInfo(PIXEL_NM, 400, 64, 64, INTERVAL_S, {"by": "seed"})
            write_localisations(path, spots(), info)
            files = {name: path.read_bytes()}
            if path.with_suffix(".yaml").is_file():
                files[path.with_suffix(".yaml").name] = path.with_suffix(".yaml").read_bytes()
        return Seed(files, "table", checked=checked)

    return make


def dialect() -> Seed:
    """Write a table as a spreadsheet with a decimal comma does."""
    text = spots().assign(frame=range(1, 401)).round(3).to_csv(sep=";", decimal=",", index=False)
    for name in ("x_nm", "y_nm", "sigma_nm", "uncertainty_nm"):
        text = text.replace(name, name.replace("_nm", " [nm]"))
    text = text.replace("photons", "intensity [photon]").replace("background", "offset [photon]")
    return Seed({"dialect.csv": b"\xef\xbb\xbf" + text.encode()}, "table")


def foreign_hdf5() -> Seed:
    """Write Picasso's pair in the newest HDF5 layout, compressed."""
    rows = np.zeros(200, [("frame", "u4"), ("x", "f4"), ("y", "f4"), ("photons", "f4")])
    rows["frame"] = np.arange(200)
    stream = io.BytesIO()
    with h5py.File(stream, "w", libver="latest") as file:
        file.create_dataset("locs", data=rows, compression="gzip", chunks=(50,))
    sidecar = b"Frames: 200\nHeight: 64\nWidth: 64\n---\nPixelsize: 100\nBox Size: 7\n"
    return Seed({"locs.hdf5": stream.getvalue(), "locs.yaml": sidecar}, "table")


def maps() -> Seed:
    """Save camera maps of the size of the frames."""
    rng = np.random.default_rng(2)
    size = FRAMES.shape[1:]
    stream = io.BytesIO()
    np.savez(
        stream,
        offset_adu=rng.normal(100, 2, size),
        gain_e_per_adu=rng.uniform(0.4, 0.6, size),
        read_noise_e=rng.uniform(1, 2, size).astype(np.float32),
    )
    return Seed({"camera.npz": _without_times(stream.getvalue())}, "maps")


def _without_times(content: bytes) -> bytes:
    """Pack a zip archive anew with the time stamp of its format's beginning."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(stream, "w") as new:
        for name in old.namelist():
            new.writestr(zipfile.ZipInfo(name), old.read(name))
    return stream.getvalue()


CONFIG = b"""# a microscope
[movie]
pixel_size_nm = 108.0
frame_interval_s = 0.002
region = [0, 0, 20, 16]

[camera]
offset_adu = 100.0
gain_e_per_adu = 0.5
read_noise_e = 1.5

[localise]
wavelet_order = 3
threshold = "std(Wave.F1)"
method = "wlsq"

[drift]
method = "none"
"""


def config() -> Seed:
    """Write a configuration file."""
    return Seed({"run.toml": CONFIG}, "config")


PROTOCOL = {
    "version": "ThunderSTORM (dev-2016-09-10-b1)",
    "imageInfo": {"title": "film.tif", "roiBounds": {"x": 0, "y": 0, "width": 24, "height": 20}},
    "cameraSettings": {
        **{"offset": 100.0, "isEmGain": True, "photons2ADU": 4.5, "gain": 300.0},
        **{"pixelSize": 108.0, "quantumEfficiency": 0.9},
    },
    "analysisFilter": {"name": "Wavelet filter (B-Spline)", "scale": 2.0, "order": 3},
    "analysisDetector": {
        **{"name": "Local maximum", "connectivity": 8, "threshold": "2*std(Wave.F1)"},
    },
    "analysisEstimator": {
        **{"name": "PSF: Integrated Gaussian", "fittingRadius": 3, "initialSigma": 1.6},
        **{"method": "Weighted Least squares", "fullImageFitting": False},
        "crowdedField": {"mfaEnabled": False},
    },
    "postProcessing": [
        [
            {"name": "Filter", "options": "formula=[uncertainty_xy < 50 & intensity > 100]"},
            {"name": "Drift", "options": "method=[Cross correlation] steps=5 magnification=5.0"},
            {"name": "Density filter", "options": "radius=50.0 neighbors=15 dimensions=2D"},
        ]
    ],
}


def protocol() -> Seed:
    """Write the protocol of the plugin's later builds."""
    return Seed({"table-protocol.json": json.dumps(PROTOCOL, indent=1).encode()}, "config")


def early_protocol() -> Seed:
    """Write the protocol of release 1.3: its name, and JSON values under headings."""
    parts = [PROTOCOL[f"analysis{name}"] for name in ("Filter", "Detector", "Estimator")]
    text = "ThunderSTORM (1.3)\n\nInput:\n{}\n\nCamera settings:\n{}\n\nAnalysis:\n{}\n\n"
    text += "Post-processing:\n{}\n"
    values = [PROTOCOL["imageInfo"], PROTOCOL["cameraSettings"], parts, PROTOCOL["postProcessing"]]
    pieces = [json.dumps(value, indent=1) for value in values]
    pieces[2] = "\n".join(json.dumps(part) for part in parts)
    return Seed({"table-protocol.json": text.format(*pieces).encode()}, "config")


def rotors_table() -> Seed:
    """Write the table of rotors that users edit in a spreadsheet."""
    return Seed({"rotors.csv": run_folder().files["rotors.csv"]}, "rotors")


@functools.cache
def run_folder() -> Seed:
    """Make a run folder from localisations."""
    from rotortrack.pipeline.folder_runs import rotors_from_table
    from rotortrack.settings import Layer

    with tempfile.TemporaryDirectory() as folder:
        table, target = Path(folder) / "localisations.csv", Path(folder) / "run"
        write_localisations(table, spots(), TableInfo(PIXEL_NM))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RotortrackWarning)
            layer = Layer("flag", {"movie": {"frame_interval_s": INTERVAL_S}})
            rotors_from_table(table, [layer], target)
        files = {
            path.relative_to(target).as_posix(): path.read_bytes()
            for path in sorted(target.rglob("*"))
            if path.is_file()
        }
    text = files.pop("run.json").decode()
    # The clock's part of a manifest would make another seed each time.
    text = re.sub(r'("(?:input|rotors|modified_ns)": )[0-9][0-9.e-]*', r"\g<1>25", text)
    return Seed({"run.json": text.encode(), **files}, "run")


def _zipped(name: str, seed: Callable[[], Seed]) -> Callable[[], Seed]:
    def make() -> Seed:
        plain = seed()
        packed = gzip.compress(plain.files[plain.first], 4, mtime=0)
        return dataclasses.replace(plain, files={name: packed}, checked=True)

    return make


SEEDS: dict[str, Callable[[], Seed]] = {
    "plain": _movie(),
    "bare": _movie(metadata=None),
    "bigtiff": _movie(bigtiff=True),
    "big-endian": _movie(byteorder=">"),
    "big-endian bigtiff": _movie(byteorder=">", bigtiff=True, apart=True),
    "imagej": _movie(imagej=True, resolution=(10, 10), metadata={"axes": "TYX", "unit": "um"}),
    "imagej float": _movie(FRAMES.astype(np.float32), imagej=True, metadata={"axes": "TYX"}),
    "ome": _movie(ome=True, metadata={"axes": "TYX", "PhysicalSizeX": 0.1, "TimeIncrement": 0.002}),
    "micro-manager": micromanager,
    "int16": _movie(FRAMES.astype(np.int16) - 200, metadata=None, apart=True),
    "uint8": _movie((FRAMES // 2).astype(np.uint8)),
    "float64": _movie(FRAMES.astype(np.float64)),
    "pages": _movie(apart=True),
    "strips": _movie(rowsperstrip=7, metadata=None, apart=True),
    "tiles": _movie(tile=(16, 16)),
    "zlib": _movie(compression="zlib"),
    "zlib tiles": _movie(compression="zlib", tile=(16, 16), predictor=True),
    "lzw": _movie(compression="lzw"),
    "zstd": _movie(compression="zstd"),
    "ome set": ome_set,
    "series": series,
    "parquet": _table("localisations.parquet"),
    "csv": _table("localisations.csv"),
    "csv.gz": _zipped("localisations.csv.gz", _table("localisations.csv")),
    "csv dialect": dialect,
    "picasso": _table("localisations.hdf5"),
    "picasso latest": foreign_hdf5,
    "rotors": rotors_table,
    "camera maps": maps,
    "config": config,
    "protocol": protocol,
    "early protocol": early_protocol,
    "run folder": run_folder,
}
"""Seeds by kind; each is made when it is called."""


@functools.cache
def seed_of(kind: str) -> Seed:
    """Make the seed of a kind once a process."""
    return SEEDS[kind]()
