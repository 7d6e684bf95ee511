"""What an OME description lists decides how many planes must be there, not what was planned."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import MetadataWarning, MovieError, SalvageWarning
from rotortrack.movies.ome import read_ome
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie

PLANES = np.random.default_rng(6).integers(90, 400, (12, 8, 9)).astype(np.uint16)


def listed(places: Sequence[tuple[int, int, int]], file: str | None = None) -> str:
    """List planes by page, channel and time."""
    uuid = f'<UUID FileName="{file}">urn:uuid:0</UUID>' if file else ""
    return "".join(
        f'<TiffData IFD="{page}" FirstC="{c}" FirstT="{t}" PlaneCount="1">{uuid}</TiffData>'
        for page, c, t in places
    )


def in_order(planes: int, channels: int = 1) -> str:
    return listed([(page, page % channels, page // channels) for page in range(planes)])


def described(*images: tuple[str, str]) -> str:
    """Describe images by their sizes and their list of planes."""
    parts = [
        f'<Image ID="Image:{number}"><Pixels DimensionOrder="XYCZT" Type="uint16" SizeX="9" '
        f'SizeY="8" SizeZ="1" {sizes}>{planes}</Pixels></Image>'
        for number, (sizes, planes) in enumerate(images)
    ]
    return (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
        f"{''.join(parts)}</OME>"
    )


def write(path: Path, text: str, planes: np.ndarray = PLANES) -> Path:
    tifffile.imwrite(path, planes, photometric="minisblack", metadata=None, description=text)
    return path


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(MovieError) as caught:
        open_movie(path, MovieOptions(**options))
    return str(caught.value)


@pytest.mark.parametrize(
    "planes", [in_order(12), '<TiffData IFD="0" PlaneCount="12"/>'], ids=["one by one", "at once"]
)
def test_stopped_recording_is_whole_with_the_planes_that_are_listed(
    planes: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "m.ome.tif", described(('SizeC="1" SizeT="30"', planes)))
    for options in ({}, {"salvage": True}, {"axes": "TYX"}):
        with open_movie(path, MovieOptions(**options)) as movie:
            np.testing.assert_array_equal(movie.frames(0, 12), PLANES)
            assert movie.missing_frames == 0
            assert movie.notes == (
                "12 of the 30 planned frames were recorded, as its description lists",
            )


def test_stopped_recording_of_two_channels_keeps_them_apart(tmp_path: Path) -> None:
    path = write(tmp_path / "m.ome.tif", described(('SizeC="2" SizeT="30"', in_order(12, 2))))
    with open_movie(path, MovieOptions(channel=1)) as movie:
        np.testing.assert_array_equal(movie.frames(0, 6), PLANES[1::2])
        assert "12 of the 60 planned planes were recorded" in movie.notes[0]
    odd = write(
        tmp_path / "n.ome.tif", described(('SizeC="2" SizeT="30"', in_order(11, 2))), PLANES[:11]
    )
    assert "holds 11 planes, but its OME description declares 60" in refusal(odd, channel=1)


def test_stopped_recording_in_several_files_is_whole(tmp_path: Path) -> None:
    paths = [tmp_path / "a.ome.tif", tmp_path / "b.ome.tif"]
    places = [(page, 0, page) for page in range(6)], [(page, 0, 6 + page) for page in range(6)]
    planes = "".join(listed(part, path.name) for part, path in zip(places, paths, strict=True))
    for path, part in zip(paths, np.split(PLANES, 2), strict=True):
        write(path, described(('SizeC="1" SizeT="30"', planes)), part)
    with open_movie(paths[1]) as movie:
        np.testing.assert_array_equal(movie.frames(0, 12), PLANES)
        assert "12 of the 30 planned frames were recorded, as its description lists" in movie.notes


def test_cut_file_of_a_stopped_recording_is_refused_with_what_is_listed(tmp_path: Path) -> None:
    path = write(tmp_path / "m.ome.tif", described(('SizeC="1" SizeT="30"', in_order(12))))
    with tifffile.TiffFile(path) as tif:
        place = tif.pages[9].dataoffsets[0]
    os.truncate(path, place + 10)
    assert "12 frames are declared by its OME description, 9 can be read" in refusal(path)
    with pytest.warns(SalvageWarning, match="cut short"):
        movie = open_movie(path, MovieOptions(salvage=True))
    with movie:
        np.testing.assert_array_equal(movie.frames(0, 9), PLANES[:9])
        assert movie.missing_frames == 3


@pytest.mark.parametrize(
    "planes", ["<TiffData/>", '<TiffData IFD="0"/>', "", in_order(30)], ids=str.strip
)
def test_planes_that_are_planned_and_not_listed_otherwise_must_be_there(
    planes: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "m.ome.tif", described(('SizeC="1" SizeT="30"', planes)))
    assert "30 frames are declared by its OME description, 12 can be read" in refusal(path)


def test_planes_that_share_a_page_are_named_with_a_way_on(tmp_path: Path) -> None:
    # The second channel is recorded at every other time; in between its last page stands in.
    places, page = [], 0
    for time in range(6):
        places.append((page, 0, time))
        page += 1
        places.append((page - 2 if time % 2 else page, 1, time))
        page += time % 2 == 0
    path = write(
        tmp_path / "m.ome.tif", described(('SizeC="2" SizeT="6"', listed(places))), PLANES[:9]
    )
    sentence = refusal(path, channel=0)
    assert "stores fewer planes than its OME description numbers" in sentence
    assert "copy it again" not in sentence
    assert "9 planes as stored with --axes TYX" in sentence
    with pytest.warns(MetadataWarning, match="--axes TYX is used"):
        movie = open_movie(path, MovieOptions(axes="TYX"))
    with movie:
        np.testing.assert_array_equal(movie.frames(0, 9), PLANES[:9])


def test_images_of_unequal_length_are_counted_one_by_one(tmp_path: Path) -> None:
    text = described(
        ('SizeC="1" SizeT="8"', '<TiffData IFD="0" PlaneCount="8"/>'),
        ('SizeC="1" SizeT="4"', '<TiffData IFD="8" PlaneCount="4"/>'),
    )
    sentence = refusal(write(tmp_path / "m.ome.tif", text))
    assert "holds 2 images that are not of one size (of 8, 4 planes)" in sentence
    assert "--axes TYX --frames 0 8" in sentence
    with open_movie(tmp_path / "m.ome.tif", MovieOptions(axes="TYX")) as movie:
        np.testing.assert_array_equal(select(movie, frames=(0, 8)).frames(0, 8), PLANES[:8])
    os.truncate(tmp_path / "m.ome.tif", 1500)
    assert "12 frames are declared by its OME description" in refusal(tmp_path / "m.ome.tif")


@pytest.mark.parametrize(
    ("sizes", "channels"), [('SizeC="1" SizeT="6"', 1), ('SizeC="2" SizeT="3"', 2)]
)
def test_positions_are_picked_by_the_words_of_the_refusal(
    sizes: str, channels: int, tmp_path: Path
) -> None:
    text = described(
        (sizes, '<TiffData IFD="0" PlaneCount="6"/>'), (sizes, '<TiffData IFD="6" PlaneCount="6"/>')
    )
    path = write(tmp_path / "m.ome.tif", text)
    flags = shlex.split(refusal(path).partition(" with ")[2])
    found = dict(zip(flags[::2], flags[1::2], strict=True))
    options = MovieOptions(
        axes=found["--axes"],
        channel=int(found["--channel"]),
        z_slice=int(found["--z-slice"]) if "--z-slice" in found else None,
    )
    with pytest.warns(MetadataWarning, match="description says S = 2"):
        movie = open_movie(path, options)
    with movie:
        np.testing.assert_array_equal(movie.frames(0, movie.shape[0]), PLANES[:6:channels])


@given(blocks=st.lists(st.tuples(st.integers(0, 40), st.integers(1, 9)), min_size=2, max_size=12))
def test_pages_that_are_listed_more_than_once_count_once(blocks: list[tuple[int, int]]) -> None:
    planes = "".join(f'<TiffData IFD="{page}" PlaneCount="{n}"/>' for page, n in blocks)
    ome = read_ome(described(('SizeC="1" SizeT="1000"', planes)))
    assert ome is not None
    pages = {page + step for page, count in blocks for step in range(count)}
    assert ome.images[0].recorded == len(pages)
    assert ome.images[0].shared == (len(pages) < sum(count for _, count in blocks))


def test_absurd_lists_cost_nothing() -> None:
    most = "9" * 12
    planes = f'<TiffData IFD="0" PlaneCount="{most}"/><TiffData IFD="{most}" PlaneCount="{most}"/>'
    times = f'<Plane TheC="0" TheZ="0" TheT="{most}" DeltaT="1"/>'
    ome = read_ome(described((f'SizeC="{most}" SizeT="{most}"', planes + times)))
    assert ome is not None
    assert ome.images[0].recorded == 2 * int(most)
    assert ome.images[0].times_s() is None
