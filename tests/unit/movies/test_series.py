"""Recordings that are spread over files read as one movie."""

from __future__ import annotations

import contextlib
import pickle
import resource
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.movies.options import MovieOptions
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie

FRAMES = np.random.default_rng(4).integers(90, 40000, (24, 16, 20)).astype(np.uint16)


def write_parts(folder: Path, parts: dict[str, np.ndarray], **options: Any) -> list[Path]:
    paths = []
    for name, frames in parts.items():
        paths.append(folder / name)
        tifffile.imwrite(paths[-1], frames, photometric="minisblack", **options)
    return paths


FORMS: dict[str, dict[str, object]] = {
    "plain": {},
    "big-endian": {"byteorder": ">"},
    "imagej": {"imagej": True, "metadata": {"axes": "TYX"}},
    "time as z": {"imagej": True, "metadata": {"axes": "ZYX"}},
    "zlib": {"compression": "zlib"},
}


@pytest.mark.parametrize("form", FORMS)
def test_files_given_together_are_one_recording(form: str, tmp_path: Path) -> None:
    parts = {"a.tif": FRAMES[:3], "b.tif": FRAMES[3:16], "c.tif": FRAMES[16:]}
    paths = write_parts(tmp_path, parts, **FORMS[form])
    with open_movie(paths) as movie:
        assert movie.shape == FRAMES.shape
        assert movie.path == paths[0]
        assert movie.paths == tuple(paths)
        assert "3 files are read as one recording" in movie.notes[0]
        np.testing.assert_array_equal(movie.frames(0, 24), FRAMES)
        for start, stop in [(2, 4), (3, 16), (15, 17), (0, 0), (24, 24), (23, 24)]:
            np.testing.assert_array_equal(movie.frames(start, stop), FRAMES[start:stop])
        with movie.reopen() as again, pickle.loads(pickle.dumps(movie)) as copy:
            np.testing.assert_array_equal(again.frames(1, 20), FRAMES[1:20])
            np.testing.assert_array_equal(copy.frames(1, 20), FRAMES[1:20])
        part = select(movie, (1, 2, 3, 4), (2, 18))
        np.testing.assert_array_equal(part.frames(0, 16), FRAMES[2:18, 2:6, 1:4])
        assert (part.paths, part.notes) == (movie.paths, movie.notes)


@given(data=st.data())
def test_any_split_and_any_picked_planes_equal_slicing(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    cuts = sorted(data.draw(st.sets(st.integers(1, 23), max_size=5)))
    channels = data.draw(st.sampled_from([1, 2, 4]))
    slices = data.draw(st.sampled_from([1, 3]))
    order = data.draw(st.permutations("TCZ"))
    channel = data.draw(st.integers(0, channels - 1))
    z_slice = data.draw(st.integers(0, slices - 1))
    lengths = {"T": 24 // (channels * slices), "C": channels, "Z": slices}
    folder = tmp_path_factory.mktemp("split")
    pieces = np.split(FRAMES, cuts)
    paths = write_parts(folder, {f"{i}.tif": piece for i, piece in enumerate(pieces)})
    stated = {"C": str(channels), "Z": str(slices), "T": ""}
    axes = "".join(axis + stated[axis] for axis in order) + "YX"
    expected = FRAMES.reshape(*(lengths[axis] for axis in order), 16, 20)
    picks = {"C": channel, "Z": z_slice, "T": slice(None)}
    expected = expected[tuple(picks[axis] for axis in order)]
    options = MovieOptions(axes=axes, channel=channel, z_slice=z_slice)
    with open_movie(paths, options) as movie:
        assert movie.shape == expected.shape
        np.testing.assert_array_equal(movie.frames(0, len(expected)), expected)


def ome_text(*files: tuple[str, int], pixels: str = 'SizeC="1" SizeT="24"') -> str:
    """Describe planes that are spread over files (name, planes)."""
    planes, first = [], 0
    for name, count in files:
        planes += [
            f'<TiffData IFD="{page}" FirstT="{first + page}" PlaneCount="1">'
            f'<UUID FileName="{name}">urn:uuid:0</UUID></TiffData>'
            for page in range(count)
        ]
        first += count
    return (
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        f'<Pixels DimensionOrder="XYCZT" SizeX="20" SizeY="16" SizeZ="1" {pixels} '
        f'PhysicalSizeX="0.1" PhysicalSizeY="0.1" Type="uint16">{"".join(planes)}</Pixels>'
        "</Image></OME>"
    )


# The names do not sort in the order of the frames.
SET = {"z.ome.tif": FRAMES[:10], "b.ome.tif": FRAMES[10:20], "m.ome.tif": FRAMES[20:]}


def described_everywhere(folder: Path) -> list[Path]:
    text = ome_text(*((name, len(frames)) for name, frames in SET.items()))
    return write_parts(folder, SET, metadata=None, description=text)


def described_in_the_first_file(folder: Path) -> list[Path]:
    paths = described_everywhere(folder)
    text = (
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
        '<BinaryOnly MetadataFile="z.ome.tif" UUID="urn:uuid:0"/></OME>'
    )
    rest = {name: frames for name, frames in SET.items() if name != "z.ome.tif"}
    write_parts(folder, rest, metadata=None, description=text)
    return paths


def described_out_of_order(folder: Path) -> list[Path]:
    text = ome_text(*((name, len(frames)) for name, frames in SET.items()))
    head, planes, tail = text.partition('<TiffData IFD="0" FirstT="10"')
    tail = planes + tail
    early = head[head.index("<TiffData") :]
    text = head[: head.index("<TiffData")] + tail.replace("</Pixels>", early + "</Pixels>")
    return write_parts(folder, SET, metadata=None, description=text)


def named_by_micromanager(folder: Path, stem: str = "x_MMStack_Pos0") -> list[Path]:
    # More than ten files, so that the order of names is not that of numbers.
    parts = {f"{stem}{f'_{i}' if i else ''}.ome.tif": FRAMES[2 * i : 2 * i + 2] for i in range(12)}
    text = "ImageJ=1.54f\nimages=24\nframes=24\nhyperstack=true\n"
    return write_parts(folder, parts, metadata=None, description=text)


def named_by_ndtiff(folder: Path, stem: str) -> list[Path]:
    parts = {f"{stem}{f'_{i}' if i else ''}.tif": FRAMES[2 * i : 2 * i + 2] for i in range(12)}
    return write_parts(folder, parts, metadata=None)


SETS: dict[str, Callable[[Path], list[Path]]] = {
    "described everywhere": described_everywhere,
    "described in the first file": described_in_the_first_file,
    "described out of order": described_out_of_order,
    "named by micromanager": named_by_micromanager,
    "named without position": lambda folder: named_by_micromanager(folder, "x_MMStack"),
    "position called by a number": lambda folder: named_by_micromanager(folder, "x_MMStack_1"),
    "named by ndtiff": lambda folder: named_by_ndtiff(folder, "run 2_NDTiffStack"),
    "named by ndtiff alone": lambda folder: named_by_ndtiff(folder, "NDTiffStack"),
}


@pytest.mark.parametrize("opened", [0, 1, -1])
@pytest.mark.parametrize("form", SETS)
def test_any_file_of_a_set_opens_the_whole_recording(
    form: str, opened: int, tmp_path: Path
) -> None:
    paths = SETS[form](tmp_path)
    with open_movie(paths[opened]) as movie:
        assert movie.paths == tuple(paths)
        np.testing.assert_array_equal(movie.frames(0, 24), FRAMES)
        assert f"{len(paths)} files are read as one recording" in movie.notes[0]
        if "described" in form:
            assert movie.metadata["pixel_size_nm"].value == pytest.approx(100.0)
    with open_movie(paths) as movie:
        np.testing.assert_array_equal(movie.frames(0, 24), FRAMES)


def test_channel_of_a_set_is_picked_across_its_files(tmp_path: Path) -> None:
    parts = {"a.ome.tif": FRAMES[:9], "b.ome.tif": FRAMES[9:]}
    planes = "".join(
        f'<TiffData IFD="{n if n < 9 else n - 9}" FirstC="{n % 2}" FirstT="{n // 2}">'
        f'<UUID FileName="{"a" if n < 9 else "b"}.ome.tif">u</UUID></TiffData>'
        for n in range(24)
    )
    text = ome_text(pixels='SizeC="2" SizeT="12"').replace("</Pixels>", planes + "</Pixels>")
    paths = write_parts(tmp_path, parts, metadata=None, description=text)
    with open_movie(paths[1], MovieOptions(channel=1)) as movie:
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES[1::2])


def test_positions_in_files_of_their_own_are_not_joined(tmp_path: Path) -> None:
    names = ("x_MMStack_1-Pos000_000.ome.tif", "x_MMStack_1-Pos000_001.ome.tif")
    images = "".join(
        ome_text((name, 12), pixels='SizeC="1" SizeT="12"').partition('06">')[2][: -len("</OME>")]
        for name in names
    )
    text = f'<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">{images}</OME>'
    parts = dict(zip(names, np.split(FRAMES, 2), strict=True))
    for path, frames in zip(
        write_parts(tmp_path, parts, metadata=None, description=text),
        np.split(FRAMES, 2),
        strict=True,
    ):
        with open_movie(path) as movie:
            np.testing.assert_array_equal(movie.frames(0, 12), frames)


def test_positions_are_not_joined_by_their_names_either(tmp_path: Path) -> None:
    names = ("x_MMStack_1-Pos000_000.ome.tif", "x_MMStack_1-Pos000_001.ome.tif")
    parts = dict(zip(names, np.split(FRAMES, 2), strict=True))
    for path in write_parts(tmp_path, parts):
        with open_movie(path) as movie:
            assert movie.paths == (path,)


@contextlib.contextmanager
def few_files_may_be_open(count: int):
    """Limit the number of open files of this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    held = len([*Path("/proc/self/fd").iterdir()])
    resource.setrlimit(resource.RLIMIT_NOFILE, (held + count, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs Linux's /proc")
def test_thousands_of_files_of_one_frame_need_few_open_files(tmp_path: Path) -> None:
    frames = np.arange(2000 * 6 * 8, dtype=np.uint32).reshape(2000, 6, 8)
    parts = {f"f{number:04d}.tif": frame for number, frame in enumerate(frames)}
    paths = write_parts(tmp_path, parts)
    with few_files_may_be_open(40), open_movie(paths) as movie, ThreadPoolExecutor(4) as pool:

        def read(worker: int) -> bool:
            with movie.reopen() as own:
                return all(
                    np.array_equal(own.frames(start, start + 50), frames[start : start + 50])
                    for start in range(50 * worker, 2000, 200)
                )

        assert all(pool.map(read, range(4)))
        # A movie shared by mistake keeps files open for no other thread to close.
        blocks = pool.map(lambda i: movie.frames(i, i + 1)[0], range(0, 2000, 7))
        np.testing.assert_array_equal(np.stack(list(blocks)), frames[::7])


def test_closed_series_may_be_closed_again_and_releases_its_files(tmp_path: Path) -> None:
    paths = write_parts(tmp_path, {"a.tif": FRAMES[:12], "b.tif": FRAMES[12:]})
    movie = open_movie(paths)
    movie.frames(0, 24)
    movie.close()
    movie.close()
