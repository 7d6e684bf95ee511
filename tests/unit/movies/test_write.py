"""Written movies are whole or absent, and other programs read them."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import tifffile

from rotortrack.errors import MovieError, ResourceError
from rotortrack.movies.tiff import open_movie
from rotortrack.movies.write import write_movie

FRAMES = np.random.default_rng(4).integers(0, 4000, (9, 16, 21)).astype(np.uint16)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("shape", [None, FRAMES.shape])
def test_written_movie_reads_back_equal_with_its_metadata(
    shape: tuple[int, int, int] | None, compression: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "m.tif"
    write_movie(
        path,
        iter([FRAMES[:4], FRAMES[4], FRAMES[5:]]),
        shape=shape,
        pixel_size_nm=108.3,
        frame_interval_s=0.002,
        compression=compression,
    )
    with open_movie(path) as movie:
        np.testing.assert_array_equal(movie.frames(0, 9), FRAMES)
        assert movie.metadata["pixel_size_nm"].value == pytest.approx(108.3, rel=1e-6)
        assert movie.metadata["frame_interval_s"].value == 0.002
    with tifffile.TiffFile(path) as tif:
        assert tif.is_bigtiff == (shape is None)
        np.testing.assert_array_equal(tif.asarray(), FRAMES)
        assert tif.imagej_metadata is not None
        assert tif.imagej_metadata["unit"] == "micron"
        # With a number of images ImageJ would ignore the directories of the pages.
        assert "images" not in tif.imagej_metadata


@pytest.mark.parametrize("kind", ["uint8", "int16", "uint32", "float32", "float64"])
def test_other_number_types_are_kept(kind: str, tmp_path: Path) -> None:
    write_movie(tmp_path / "m.tif", FRAMES.astype(kind))
    with open_movie(tmp_path / "m.tif") as movie:
        assert movie.dtype == np.dtype(kind)
        np.testing.assert_array_equal(movie.frames(0, 9), FRAMES.astype(kind))


def test_announced_size_above_4_gb_makes_a_bigtiff(tmp_path: Path) -> None:
    path = tmp_path / "m.tif"
    seen = []

    def frames() -> Iterator[np.ndarray]:
        yield np.zeros((64, 64), np.uint16)
        (temporary,) = tmp_path.iterdir()
        seen.append(temporary)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_movie(path, frames(), shape=(600_000, 64, 64))
    assert len(seen) == 1
    assert list(tmp_path.iterdir()) == []
    write_movie(path, [np.zeros((1, 2, 2), np.uint8)] * 3, shape=(3, 2, 2))
    assert path.read_bytes()[:4] == b"II*\0"


@pytest.mark.parametrize("name", ["m.ome.tif", "Größe & <größer>.OME.TIFF"])
def test_ome_tiff_tells_sizes_exposure_and_times(name: str, tmp_path: Path) -> None:
    times_s = np.array([0.0001, 0.0021, 0.004, 0.0061, 0.008, 0.01, 0.0122, 0.014, 0.016])
    path = tmp_path / name
    write_movie(
        path,
        iter([FRAMES[:4], FRAMES[4], FRAMES[5:]]),
        shape=FRAMES.shape,
        pixel_size_nm=108.3,
        frame_interval_s=0.002,
        exposure_s=0.0018,
        times_s=times_s,
    )
    with open_movie(path) as movie:
        np.testing.assert_array_equal(movie.frames(0, 9), FRAMES)
        for key, value in (
            ("pixel_size_nm", 108.3),
            ("frame_interval_s", 0.002),
            ("exposure_s", 0.0018),
        ):
            assert movie.metadata[key].value == pytest.approx(value, rel=1e-12)
            assert "OME" in movie.metadata[key].origin
        np.testing.assert_array_equal(movie.times_s, times_s)
    with tifffile.TiffFile(path) as tif:
        assert tif.is_ome
        assert tif.series[0].axes == "TYX"
        np.testing.assert_array_equal(tif.asarray(), FRAMES)
        root = ElementTree.fromstring(tif.ome_metadata)
    scheme = "{http://www.openmicroscopy.org/Schemas/OME/2016-06}"
    (image,) = root.iter(f"{scheme}Image")
    assert image.get("Name") == name
    planes = list(root.iter(f"{scheme}Plane"))
    assert [plane.get("TheT") for plane in planes] == [str(frame) for frame in range(9)]
    assert {plane.get("ExposureTime") for plane in planes} == {"0.0018"}


@pytest.mark.parametrize("kind", ["uint8", "int16", "uint32", "float32", "float64"])
def test_ome_tiff_keeps_number_types(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "m.ome.tif"
    write_movie(path, FRAMES.astype(kind), shape=FRAMES.shape)
    with tifffile.TiffFile(path) as tif:
        assert tif.series[0].dtype == np.dtype(kind)
        np.testing.assert_array_equal(tif.asarray(), FRAMES.astype(kind))
        # What is not known is not told.
        assert "PhysicalSize" not in tif.ome_metadata
        assert "<Plane " not in tif.ome_metadata


def test_ome_tiff_without_shape_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MovieError, match=r"give shape, or a name that ends in \.tif alone"):
        write_movie(tmp_path / "m.ome.tif", FRAMES)
    assert list(tmp_path.iterdir()) == []


def test_frames_of_unequal_size_or_number_leave_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "m.tif"
    path.write_bytes(b"old")
    with pytest.raises(MovieError, match=r"frame 1 is uint16 of shape \(16, 20\)"):
        write_movie(path, [FRAMES[0], FRAMES[1, :, :20]])
    with pytest.raises(MovieError, match="announced"):
        write_movie(path, FRAMES, shape=(10, 16, 21))
    with pytest.raises(MovieError, match="no frames"):
        write_movie(path, [])
    with pytest.raises(MovieError, match="complex"):
        write_movie(path, FRAMES.astype(complex))
    with pytest.raises(MovieError, match="is not a frame"):
        write_movie(path, [np.zeros(4)])
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_full_disk_is_a_resource_error_and_leaves_nothing(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(ResourceError, match=r"m\.tif cannot be written"):
            write_movie(tmp_path / "m.tif", [np.zeros((64, 64), np.uint16)] * 20)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []
