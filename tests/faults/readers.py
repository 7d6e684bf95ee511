"""Reads damaged files as the commands do, and compares what was read with what is known of it."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import sys
import unicodedata
import warnings
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import tifffile

_MOST_FRAMES = 200
_MOST_BYTES = 256 * 2**20
_SCALE = ("--pixel-size-nm", "100", "--frame-interval-s", "0.002")
_CAMERA = ("--offset-adu", "100", "--gain-e-per-adu", "0.5", "--read-noise-e", "1.5")


def _sibling(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


corpus, damage = _sibling("corpus"), _sibling("damage")


class WrongError(AssertionError):
    """What was read is not what the file held, or a refusal is not fit for a user."""


@dataclass(frozen=True)
class Case:
    """A seed, its files after the damage, the folder in which they lie, and the case's number."""

    seed: Any
    files: dict[str, bytes]
    folder: Path
    number: int

    @property
    def path(self) -> Path:
        """The file that the reader is given."""
        return self.folder / str(self.seed.first)


def through_library(case: Case) -> tuple[str, str]:
    """Call what the commands call; give `read` or `refused`, and what was said.

    Raises
    ------
    WrongError
        Something else was read than the file held, or a sentence is not fit for a user.
    """
    from rotortrack.errors import RotortrackError, RotortrackWarning

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            READERS[case.seed.reads](case)
        except RotortrackError as error:
            _check_sentence(str(error), [*case.seed.files, case.folder.name])
            return "refused", str(error)
    for warning in caught:
        if not issubclass(warning.category, RotortrackWarning):
            raise WrongError(f"{warning.category.__name__}: {warning.message} {warning.filename}")
        _check_sentence(str(warning.message), [""])
    return "read", "; ".join(str(warning.message) for warning in caught)


def _check_sentence(text: str, names: Sequence[str]) -> None:
    odd = [c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Cs")]
    if odd:
        raise WrongError(f"control characters {odd[:5]!r} in {text!r}")
    if len(text) > 2000:
        raise WrongError(f"{len(text)} characters: {text[:300]}...")
    if not any(name in text for name in names):
        raise WrongError(f"no file is named: {text}")


def _read_movie(case: Case) -> None:
    from rotortrack.movies.options import MovieOptions
    from rotortrack.movies.tiff import open_movie

    paths: Path | list[Path] = case.path
    if case.seed.reads == "series":
        paths = [case.folder / name for name in case.seed.files]
    salvage = case.number % 4 == 3
    with open_movie(paths, MovieOptions(salvage=salvage)) as movie:
        frames, height, width = movie.shape
        assert min(movie.shape) > 0
        size = height * width * movie.dtype.itemsize
        most = min(frames, _MOST_FRAMES, max(1, _MOST_BYTES // size))
        step = max(1, 2**24 // size)
        blocks = [movie.frames(i, min(i + step, most)) for i in range(0, most, step)]
        missing = movie.missing_frames
    compare_movie(case, np.concatenate(blocks), frames, missing)


def compare_movie(case: Case, found: np.ndarray, frames: int, missing: int) -> None:
    """Compare pixels wherever the damage left what they must be beyond doubt.

    That is so where a file was only cut short, or where nothing but pixels and texts was changed:
    the pixels then are those that lie in the places where they lay.

    Parameters
    ----------
    case
        The case.
    found
        The first frames as they were read.
    frames, missing
        How many frames were declared readable, and how many not.

    Raises
    ------
    WrongError
        Other pixels or another number of frames.
    """
    expected = case.seed.frames if case.seed.checked else _expected_frames(case)
    if expected is None or not _is_beyond_doubt(case):
        return
    is_cut = all(whole.startswith(case.files[name]) for name, whole in case.seed.files.items())
    # Where no description counts the frames, a page that is cut off tells of no more than itself;
    # a description that was changed may declare any number.
    if (
        frames > len(expected)
        or (frames < len(expected) and not missing)
        or (is_cut and frames + missing > len(expected))
    ):
        raise WrongError(f"{frames} frames read, {missing} missing, of {len(expected)}")
    if not np.array_equal(found, expected[: len(found)], equal_nan=found.dtype.kind == "f"):
        raise WrongError(f"other pixels, {found.dtype} {found.shape}")


def _is_beyond_doubt(case: Case) -> bool:
    for name, whole in case.seed.files.items():
        content = case.files.get(name)
        if content is None:
            return False
        if whole.startswith(content):
            continue
        if len(content) < len(whole):
            return False
        touched = _differ(content[: len(whole)], whole)
        if len(case.seed.files) > 1 and np.any(touched & ~damage.pixel_bytes(whole)):
            # The texts of a set tell which files belong together, and in which order.
            return False
        if np.any(touched & ~damage.pixel_bytes(whole) & ~damage.free_bytes(whole)):
            return False
    return True


def _expected_frames(case: Case) -> np.ndarray | None:
    """Read the pixels as they are now through the structure as it was, by tifffile alone."""
    parts = []
    for name, whole in case.seed.files.items():
        content = case.files.get(name, b"")
        if len(content) < len(whole):
            content = whole
        pixels = damage.pixel_bytes(whole)
        mixed = np.where(pixels, _bytes(content)[: len(whole)], _bytes(whole))
        try:
            parts.append(frames_of(mixed.tobytes()))
        except Exception:  # noqa: BLE001 - compressed data that tifffile gives up on
            return None
    return np.concatenate(parts)


def _bytes(content: bytes) -> np.ndarray:
    return np.frombuffer(content, np.uint8)


def _differ(first: bytes, second: bytes) -> np.ndarray:
    return _bytes(first) != _bytes(second)


def frames_of(content: bytes) -> np.ndarray:
    """Read all pages by tifffile."""
    with tifffile.TiffFile(io.BytesIO(content)) as tif:
        return np.stack([page.asarray() for page in tif.pages])


def _read_table(case: Case) -> None:
    from rotortrack.exchange.tables import convert, read_info, read_localisations

    read_info(case.path)
    table = read_localisations(case.path, pixel_size_nm=100.0 if case.number % 2 else None)
    other = case.folder / ("out.csv" if case.number % 4 < 2 else "out.parquet")
    assert convert(case.path, other, pixel_size_nm=100.0) == len(table)
    whole = case.seed.files[case.seed.first]
    if _may_differ(case, case.files[case.seed.first], whole):
        return
    (case.folder / "whole").mkdir()
    (case.folder / "whole" / case.path.name).write_bytes(whole)
    if not table.equals(read_localisations(case.folder / "whole" / case.path.name)):
        raise WrongError("other numbers in spite of checksums")


def _may_differ(case: Case, content: bytes, whole: bytes) -> bool:
    """Whether a table that could be read may hold other numbers than the seed."""
    if content == whole:
        return "hdf5" in case.path.name
    if case.seed.checked:
        return _unpacked(content) not in (None, _unpacked(whole))
    if case.path.suffix != ".parquet" or len(content) != len(whole):
        return True
    footer = int.from_bytes(whole[-8:-4], "little") + 8
    return bool(_differ(content, whole)[-footer:].any())


def _unpacked(content: bytes) -> bytes | None:
    """Unpack all members of a gzip file; None where one is damaged or cut short."""
    parts = []
    while content.startswith(b"\x1f\x8b"):
        unpacker = zlib.decompressobj(31)
        try:
            parts.append(unpacker.decompress(content))
        except zlib.error:
            return None
        if not unpacker.eof:
            return None
        content = unpacker.unused_data
    return b"".join(parts)


def _read_rotors(case: Case) -> None:
    from rotortrack.exchange.csv import read_csv
    from rotortrack.tables import ROTORS

    read_csv(case.path, ROTORS)


def _read_maps(case: Case) -> None:
    from rotortrack.cameras.camera import camera_from_options
    from rotortrack.cameras.options import CameraOptions

    given = {} if case.number % 2 else {"gain_e_per_adu": 0.5}
    camera = camera_from_options(CameraOptions(camera_maps=str(case.path), **given))
    camera.to_photons(np.zeros(np.shape(camera.offset_adu) or (4, 4), np.uint16))


def _read_config(case: Case) -> None:
    from rotortrack.exchange.thunderstorm_protocol import is_protocol, read_protocol
    from rotortrack.pipeline.presets import SECTIONS
    from rotortrack.settings import Layer, parse_toml, read_content, resolve

    content = read_content(case.path)
    if is_protocol(content):
        protocol = read_protocol(content, case.path)
        for sentence in protocol.left_out:
            _check_sentence(sentence, [""])
        values = protocol.values
    else:
        values = parse_toml(content, case.path)
    resolve(SECTIONS, [Layer(f"config {case.path}", values)])


def _read_run(case: Case) -> None:
    from rotortrack.pipeline.presets import SECTIONS
    from rotortrack.pipeline.provenance import Record
    from rotortrack.pipeline.store import RunFolder
    from rotortrack.settings import resolve

    run = RunFolder.open(case.folder)
    resolve(SECTIONS, Record("motion").continue_from(run.read_manifest()))
    for name in ("localisations", "rotors", "drift"):
        run.read(name)


READERS: dict[str, Callable[[Case], None]] = {
    "movie": _read_movie,
    "series": _read_movie,
    "table": _read_table,
    "rotors": _read_rotors,
    "maps": _read_maps,
    "config": _read_config,
    "run": _read_run,
}


def through_command(task: str, case: Case) -> tuple[str, str]:
    """Call a command as a user would; give `read`, `refused` or `traceback`, and what it printed.

    Raises
    ------
    WrongError
        It printed control characters, or left half-written files behind.
    """
    from rotortrack_cli.main import main

    source, out, camera = case.path, case.folder / "out", _CAMERA
    given = {"maps": ("--camera-maps",), "config": (*_CAMERA, "-c")}.get(case.seed.reads)
    if given and not task.startswith("info"):
        camera = (*given, str(source))
        source = case.folder / "whole.tif"
        source.write_bytes(corpus.seed_of("plain").files["movie.tif"])
    if case.seed.reads == "run":
        source = case.folder
    words = {
        "info": ("info", source),
        "info --json": ("info", source, "--json"),
        "localise": ("localise", source, *_SCALE, *camera, "--workers", "1", "-o", f"{out}.csv"),
        "run": ("run", source, *_SCALE, *camera, "--no-figures", "--workers", "1", "-o", out),
        "convert": ("convert", source, f"{out}.parquet", "--pixel-size-nm", "100"),
        "rotors": ("rotors", source, *_SCALE, "-o", out),
        "motion": ("motion", source, "--no-figures"),
    }[task]
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(shown):
        code = main([str(word) for word in words])
    text = shown.getvalue()
    if code not in (0, 2, 3, 4, 5, 6, 7) or "Traceback" in text or "this is a bug" in text:
        return "traceback", f"exit {code}: {text}"
    _check_sentence(text.replace("\n", " ").replace("\t", " ")[:2000], [""])
    left = [path.name for path in case.folder.rglob("*rotortrack-part-*")]
    if left:
        raise WrongError(f"left behind: {left}")
    return ("refused" if code else "read"), text
