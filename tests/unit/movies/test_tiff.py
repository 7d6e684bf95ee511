"""Every usual form of TIFF is read back as it was written."""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from rotortrack.movies.movie import NUMBER_TYPES
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.tiff import open_movie

FRAMES = np.random.default_rng(1).integers(0, 60000, (12, 20, 31)).astype(np.uint16)


def page_by_page(path: Path, frames: np.ndarray, **options: object) -> None:
    big = bool(options.pop("bigtiff", False))
    ome = options.pop("ome", None)
    with tifffile.TiffWriter(path, bigtiff=big, ome=ome) as writer:
        for frame in frames:
            writer.write(frame, contiguous=False, **options)


def thumbnails_between(path: Path, frames: np.ndarray) -> None:
    with tifffile.TiffWriter(path) as writer:
        for frame in frames:
            writer.write(frame[::4, ::4], subfiletype=1, metadata=None)
            writer.write(frame, metadata=None)


def one_strip_by_several_names(path: Path, frames: np.ndarray) -> None:
    page_by_page(path, frames, metadata=None)
    with tifffile.TiffFile(path, mode="r+") as file:
        for page in list(file.pages)[1::2]:
            page.aspage().tags["RowsPerStrip"].overwrite(2**32 - 1, dtype="I")


FORMS: dict[str, Callable[[Path, np.ndarray], None]] = {
    "plain": tifffile.imwrite,
    "plain without description": lambda p, f: tifffile.imwrite(p, f, metadata=None),
    "bigtiff": lambda p, f: tifffile.imwrite(p, f, bigtiff=True),
    "big-endian": lambda p, f: tifffile.imwrite(p, f, byteorder=">"),
    "big-endian bigtiff": lambda p, f: tifffile.imwrite(p, f, byteorder=">", bigtiff=True),
    "imagej": lambda p, f: tifffile.imwrite(p, f, imagej=True, metadata={"axes": "TYX"}),
    "imagej time as z": lambda p, f: tifffile.imwrite(p, f, imagej=True, metadata={"axes": "ZYX"}),
    "ome": lambda p, f: tifffile.imwrite(p, f, ome=True, metadata={"axes": "TYX"}),
    "ome page per write": lambda p, f: page_by_page(p, f, ome=True),
    "page per write": page_by_page,
    "bigtiff page per write": lambda p, f: page_by_page(p, f, bigtiff=True),
    "two stacks": lambda p, f: page_by_page(p, f.reshape(2, 6, 20, 31)),
    "one directory": lambda p, f: tifffile.imwrite(p, f, metadata={"truncated": True}),
    "one strip by several names": one_strip_by_several_names,
    "strips": lambda p, f: tifffile.imwrite(p, f, rowsperstrip=7),
    "tiles": lambda p, f: tifffile.imwrite(p, f, tile=(16, 16)),
    "zlib": lambda p, f: tifffile.imwrite(p, f, compression="zlib"),
    "zlib big-endian strips": lambda p, f: tifffile.imwrite(
        p, f, compression="zlib", byteorder=">", rowsperstrip=7
    ),
    "zlib predictor": lambda p, f: tifffile.imwrite(p, f, compression="zlib", predictor=True),
    "zlib tiles": lambda p, f: tifffile.imwrite(p, f, compression="zlib", tile=(16, 16)),
    "lzw": lambda p, f: tifffile.imwrite(p, f, compression="lzw"),
    "zstd": lambda p, f: tifffile.imwrite(p, f, compression="zstd"),
    "thumbnails": thumbnails_between,
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_read_back_equal(form: str, tmp_path: Path) -> None:
    path = tmp_path / "movie.dat"  # the ending says nothing
    FORMS[form](path, FRAMES)
    with open_movie(path) as movie:
        assert movie.shape == FRAMES.shape
        assert movie.dtype == np.uint16
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES)
        np.testing.assert_array_equal(movie.frames(3, 7), FRAMES[3:7])
        assert movie.frames(5, 5).shape == (0, 20, 31)
        assert movie.frames(0, 1).dtype.isnative


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", NUMBER_TYPES, ids=str)
def test_every_number_type_keeps_its_values(
    kind: np.dtype, order: str, compression: str | None, tmp_path: Path
) -> None:
    if kind.kind == "f":
        frames = np.linspace(-1e3, 1e5, 60).reshape(3, 4, 5).astype(kind)
        frames[1, 2, 3] = np.nan
    else:
        limits = np.iinfo(kind)
        frames = np.linspace(limits.min, limits.max, 60).reshape(3, 4, 5).astype(kind)
    path = tmp_path / "movie.tif"
    tifffile.imwrite(
        path, frames, byteorder=order, compression=compression, photometric="minisblack"
    )
    with open_movie(path) as movie:
        assert movie.dtype == kind
        np.testing.assert_array_equal(movie.frames(0, 3), frames)


def forge_single_directory(path: Path, frames: int, shape: tuple[int, int]) -> int:
    """Write a sparse ImageJ file with one directory; return where the pixels begin."""
    tifffile.imwrite(
        path,
        np.zeros(shape, np.uint16),
        metadata=None,
        description=f"ImageJ=1.54f\nimages={frames}\nframes={frames}\n",
    )
    with tifffile.TiffFile(path) as tif:
        (offset,) = tif.pages.first.dataoffsets
    with path.open("r+b") as file:
        file.truncate(offset + frames * shape[0] * shape[1] * 2)
    return offset


def test_imagej_file_above_4_gb_with_one_directory_is_read_to_its_last_frame(
    tmp_path: Path,
) -> None:
    path, shape, count = tmp_path / "large.tif", (512, 512), 9000
    size = shape[0] * shape[1] * 2
    offset = forge_single_directory(path, count, shape)
    marks = {
        number: np.random.default_rng(number).integers(0, 65535, shape).astype("<u2")
        for number in (0, 8192, count - 1)
    }
    with path.open("r+b") as file:
        for number, pixels in marks.items():
            file.seek(offset + number * size)
            file.write(pixels.tobytes())
    assert path.stat().st_size > 2**32
    with open_movie(path) as movie:
        assert movie.shape == (count, *shape)
        for number, pixels in marks.items():
            np.testing.assert_array_equal(movie.frames(number, number + 1)[0], pixels)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc")
def test_reading_blocks_of_a_1_gb_movie_takes_no_memory_of_its_size(tmp_path: Path) -> None:
    path = tmp_path / "large.tif"
    forge_single_directory(path, 2100, (512, 512))
    program = """
import re, sys
from pathlib import Path
from rotortrack.movies.tiff import open_movie
# The high-water mark of this program; getrusage would count the test runner that started it.
def peak(): return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
with open_movie(Path(sys.argv[1])) as movie:
    before = peak()
    total = sum(int(movie.frames(i, i + 50).sum()) for i in range(0, movie.shape[0], 50))
print(total, peak() - before, peak())
"""
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=True
    )
    total, growth_kb, peak_kb = map(int, done.stdout.split())
    assert total == 0
    assert growth_kb < 100_000  # a block is 26 MB; the file 1100 MB
    assert peak_kb < 500_000


@pytest.mark.parametrize("form", ["page per write", "zlib"])
def test_each_worker_with_a_handle_of_its_own_reads_the_right_pixels(
    form: str, tmp_path: Path
) -> None:
    frames = np.random.default_rng(2).integers(0, 60000, (60, 40, 40)).astype(np.uint16)
    path = tmp_path / "movie.tif"
    FORMS[form](path, frames)
    with open_movie(path) as movie:

        def read(seed: int) -> bool:
            with movie.reopen() as own:
                return all(
                    np.array_equal(own.frames(i, i + 3), frames[i : i + 3])
                    for i in np.random.default_rng(seed).integers(0, 57, 40).tolist()
                )

        with ThreadPoolExecutor(4) as pool:
            assert all(pool.map(read, range(8)))
        # The workers closed their handles, not this one.
        np.testing.assert_array_equal(movie.frames(59, 60)[0], frames[59])


def test_handle_shared_by_mistake_still_reads_the_right_pixels(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    frames = np.random.default_rng(3).integers(0, 60000, (200, 30, 30)).astype(np.uint16)
    tifffile.imwrite(path, frames)
    with open_movie(path) as movie, ThreadPoolExecutor(4) as pool:
        blocks = pool.map(lambda i: movie.frames(i, i + 1)[0], range(200))
        np.testing.assert_array_equal(np.stack(list(blocks)), frames)


def test_movie_sent_to_another_process_opens_its_file_there(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    tifffile.imwrite(path, FRAMES)
    with open_movie(path) as movie, pickle.loads(pickle.dumps(movie)) as copy:
        np.testing.assert_array_equal(copy.frames(0, 12), movie.frames(0, 12))


def test_real_imagej_stack_with_time_as_slices_is_read(
    reference_data: Callable[[str], Path],
) -> None:
    path = reference_data("stuck_particles") / "stuck.tif"
    with open_movie(path) as movie:
        np.testing.assert_array_equal(movie.frames(0, movie.shape[0]), tifffile.imread(path))


def test_real_micromanager_file_is_read_with_its_metadata(
    reference_data: Callable[[str], Path],
) -> None:
    path = reference_data("two_colour_beads") / "map" / "Pos000_000.ome.tif"
    with open_movie(path) as movie:
        assert movie.shape == (2, 600, 600)
        assert movie.metadata["pixel_size_nm"].value == pytest.approx(110.0)
        assert movie.metadata["pixel_size_nm"].origin == "file (OME)"
        assert movie.metadata["frame_interval_s"].value == pytest.approx(0.5)
        assert movie.metadata["exposure_s"].value == pytest.approx(0.75)
        assert movie.metadata["sensor_region"].value == "300-300-600-600"


def test_bigtiff_above_4_gb_is_read_to_its_last_frame(tmp_path: Path) -> None:
    path, shape, count = tmp_path / "large.tif", (1024, 1024), 2200
    size = shape[0] * shape[1] * 2
    marks = {
        number: np.random.default_rng(number).integers(0, 65535, shape).astype("<u2")
        for number in (0, 2047, 2048, count - 1)
    }
    # One directory behind each frame, as libtiff writes them, and holes instead of dark frames.
    entries = {256: 1024, 257: 1024, 258: 16, 259: 1, 262: 1, 277: 1, 278: 1024, 279: size}
    step = size + 256
    with path.open("wb") as file:
        file.write(struct.pack("<2sHHHQ", b"II", 43, 8, 0, 16 + size))
        for number in range(count):
            start = 16 + number * step
            if number in marks:
                file.seek(start)
                file.write(marks[number].tobytes())
            file.seek(start + size)
            file.write(struct.pack("<Q", len(entries) + 1))
            for tag, value in sorted({**entries, 273: start}.items()):
                file.write(struct.pack("<HHQQ", tag, 16, 1, value))
            following = start + size + step if number < count - 1 else 0
            file.write(struct.pack("<Q", following))
    assert path.stat().st_size > 2**32
    with open_movie(path) as movie:
        assert movie.shape == (count, *shape)
        for number, pixels in marks.items():
            np.testing.assert_array_equal(movie.frames(number, number + 1)[0], pixels)
    with open_movie(path, MovieOptions(axes="TC2YX", channel=1)) as movie:
        np.testing.assert_array_equal(movie.frames(1023, 1024)[0], marks[2047])
        np.testing.assert_array_equal(movie.frames(1099, 1100)[0], marks[count - 1])


@pytest.mark.skipif(not hasattr(os, "preadv"), reason="counts calls of preadv")
@pytest.mark.parametrize(
    ("options", "reads", "size"),
    [({}, 1, 12 * 20 * 31 * 2), ({"axes": "TC2YX", "channel": 1}, 6, 20 * 31 * 2)],
)
def test_plain_frames_are_read_at_once_and_nothing_else_is_read(
    options: dict[str, Any],
    reads: int,
    size: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "movie.tif"
    tifffile.imwrite(path, FRAMES, metadata=None)
    calls = []
    preadv = os.preadv

    def counted(descriptor: int, buffers: list[memoryview], offset: int) -> int:
        calls.append(len(buffers[0]))
        return preadv(descriptor, buffers, offset)

    with open_movie(path, MovieOptions(**options)) as movie:
        monkeypatch.setattr(os, "preadv", counted)
        movie.frames(0, movie.shape[0])
    assert calls == [size] * reads
