"""Sets of files that are not one recording in its order end in one sentence."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from rotortrack.errors import MetadataWarning, MovieError, SalvageWarning
from rotortrack.movies.movie import Movie
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie

FRAMES = np.random.default_rng(8).integers(90, 400, (12, 16, 20)).astype(np.uint16)
SALVAGE = MovieOptions(salvage=True)


def write_parts(
    folder: Path, *names: str, frames: np.ndarray = FRAMES, **options: Any
) -> list[Path]:
    """Spread frames evenly over files."""
    paths = [folder / name for name in names]
    for path, part in zip(paths, np.split(frames, len(names)), strict=True):
        tifffile.imwrite(path, part, photometric="minisblack", **options)
    return paths


def ome_text(*files: tuple[str, int], frames: int = 12, order: str = "XYCZT") -> str:
    """Describe frames that are spread over files (name, frames)."""
    planes, first = [], 0
    for name, count in files:
        planes += [
            f'<TiffData IFD="{page}" FirstT="{first + page}" PlaneCount="1">'
            f'<UUID FileName="{name}">urn:uuid:0</UUID></TiffData>'
            for page in range(count)
        ]
        first += count
    return (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
        f'<Image ID="Image:0"><Pixels DimensionOrder="{order}" SizeX="20" SizeY="16" SizeC="1" '
        f'SizeZ="1" SizeT="{frames}" Type="uint16">{"".join(planes)}</Pixels></Image></OME>'
    )


def write_ome(folder: Path, *names: str) -> list[Path]:
    count = len(FRAMES) // len(names)
    text = ome_text(*((name, count) for name in names))
    return write_parts(folder, *names, metadata=None, description=text)


def refusal(paths: Any, options: MovieOptions | None = None) -> str:
    with pytest.raises(MovieError) as caught:
        open_movie(paths, options)
    sentence = str(caught.value)
    assert "\n" not in sentence
    return sentence


def salvaged(paths: Any, reason: str) -> Movie:
    with pytest.warns(SalvageWarning, match=reason):
        return open_movie(paths, SALVAGE)


def test_same_file_twice_is_refused_by_any_name(tmp_path: Path) -> None:
    one, two = write_parts(tmp_path, "one.tif", "two.tif")
    assert f"{one} is given twice" in refusal([one, two, one])
    link, hard = tmp_path / "link.tif", tmp_path / "hard.tif"
    link.symlink_to(one)
    os.link(one, hard)
    for other in (link, hard, tmp_path / "." / "sub" / ".." / "one.tif"):
        (tmp_path / "sub").mkdir(exist_ok=True)
        assert "is the same file as" in refusal([one, other]) or other == one
    copy = tmp_path / "three.tif"
    shutil.copy2(one, copy)
    assert f"{copy} is a copy of {one}" in refusal([one, two, copy])


def test_equal_single_frames_are_no_copies(tmp_path: Path) -> None:
    dark = np.full((3, 16, 20), 100, np.uint16)
    paths = write_parts(tmp_path, "f1.tif", "f2.tif", "f3.tif", frames=dark)
    with open_movie(paths) as movie:
        assert movie.shape == (3, 16, 20)


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (np.zeros((3, 16, 21), np.uint16), "21 x 16 pixels, uint16, but"),
        (np.zeros((3, 16, 20), np.int16), "20 x 16 pixels, int16, but"),
    ],
)
def test_file_of_another_size_or_type_is_named(
    other: np.ndarray, reason: str, tmp_path: Path
) -> None:
    (one,) = write_parts(tmp_path, "a.tif")
    (two,) = write_parts(tmp_path, "b.tif", frames=other)
    sentence = refusal([one, two])
    assert str(two) in sentence
    assert reason in sentence


@pytest.mark.parametrize(
    ("names", "wrong"),
    [
        (("m_1.tif", "m_10.tif", "m_2.tif"), ("m_2.tif", "m_10.tif", "m_*.tif")),
        (("m_2.tif", "m_1.tif", "m_3.tif"), ("m_1.tif", "m_2.tif", "m_*.tif")),
        (("run3_t07.tif", "run3_t06.tif"), ("run3_t06.tif", "run3_t07.tif", "run3_t*.tif")),
    ],
)
def test_names_out_of_order_are_refused_with_the_remedy(
    names: tuple[str, ...], wrong: tuple[str, str, str], tmp_path: Path
) -> None:
    paths = write_parts(tmp_path, *names)
    sentence = refusal(paths)
    behind, before, pattern = wrong
    assert f"{tmp_path / behind} is given behind {tmp_path / before}" in sentence
    assert f"$(ls -v {tmp_path / pattern})" in sentence


@pytest.mark.parametrize(
    "names",
    [("b.tif", "a.tif"), ("c2_t1.tif", "c1_t2.tif"), ("x1.tif", "y0.tif"), ("1.tif", "02.tif")],
)
def test_names_that_tell_no_order_are_taken_as_given(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    with open_movie(write_parts(tmp_path, *names)) as movie:
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES)


def test_missing_file_of_a_list_is_named(tmp_path: Path) -> None:
    one, two = write_parts(tmp_path, "a.tif", "b.tif")
    two.unlink()
    assert f"{two} does not exist" in refusal([one, two])
    assert "no movie file" in refusal([])


@pytest.mark.parametrize("opened", [0, 2])
def test_missing_member_of_an_ome_set_is_named_or_salvaged(opened: int, tmp_path: Path) -> None:
    paths = write_ome(tmp_path, "a.ome.tif", "b.ome.tif", "c.ome.tif")
    paths[1].unlink()
    sentence = refusal(paths[opened])
    assert f"{paths[1]} is missing, file 2 of 3" in sentence
    assert "--salvage" in sentence
    with salvaged(paths[opened], r"b\.ome\.tif is missing") as movie:
        np.testing.assert_array_equal(movie.frames(0, movie.shape[0]), FRAMES[:4])
        assert movie.missing_frames == 8


def test_set_without_its_first_file_cannot_be_salvaged(tmp_path: Path) -> None:
    paths = write_ome(tmp_path, "a.ome.tif", "b.ome.tif")
    paths[0].unlink()
    assert f"{paths[0]} is missing" in refusal(paths[1], SALVAGE)


def test_cut_member_of_a_set_ends_what_is_salvaged(tmp_path: Path) -> None:
    paths = write_ome(tmp_path, "a.ome.tif", "b.ome.tif", "c.ome.tif")
    os.truncate(paths[1], paths[1].stat().st_size * 3 // 4)
    sentence = refusal(paths[2])
    assert f"{paths[1]} is cut short: 4 frames are declared by its OME description" in sentence
    with salvaged(paths[2], "cut short") as movie:
        readable = movie.shape[0]
        assert 5 <= readable <= 7
        np.testing.assert_array_equal(movie.frames(0, readable), FRAMES[:readable])
        assert movie.missing_frames == 12 - readable


def test_cut_file_of_a_list_ends_what_is_salvaged(tmp_path: Path) -> None:
    paths = write_parts(tmp_path, "a.tif", "b.tif", "c.tif")
    os.truncate(paths[1], paths[1].stat().st_size // 2)
    assert str(paths[1]) in refusal(paths)
    with salvaged(paths, "cut short") as movie:
        readable = movie.shape[0]
        assert 5 <= readable <= 6
        np.testing.assert_array_equal(movie.frames(0, readable), FRAMES[:readable])
        assert movie.missing_frames == 12 - readable


def test_missing_member_of_a_micromanager_set_is_named_by_its_number(tmp_path: Path) -> None:
    names = ("x_MMStack_Pos0.ome.tif", "x_MMStack_Pos0_1.ome.tif", "x_MMStack_Pos0_2.ome.tif")
    paths = write_parts(tmp_path, *names)
    paths[1].unlink()
    for path in (paths[0], paths[2]):
        assert f"{paths[1]} is missing, file 2 of 3" in refusal(path)
    with salvaged(paths[0], "is missing") as movie:
        assert movie.shape[0] == 4
        assert movie.missing_frames > 0


def test_missing_file_that_describes_the_others_is_named(tmp_path: Path) -> None:
    text = (
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
        '<BinaryOnly MetadataFile="first.ome.tif" UUID="urn:uuid:0"/></OME>'
    )
    (path,) = write_parts(tmp_path, "second.ome.tif", metadata=None, description=text)
    assert f"{tmp_path / 'first.ome.tif'} describes, which is missing" in refusal(path)
    with pytest.warns(MetadataWarning, match="planes of this file alone.*; put it back into"):
        movie = open_movie(path, MovieOptions(axes="TYX"))
    with movie:
        np.testing.assert_array_equal(movie.frames(0, movie.shape[0]), FRAMES)


def test_position_file_that_describes_itself_is_read_without_the_first(
    reference_data: Callable[[str], Path],
) -> None:
    path = reference_data("two_colour_beads") / "map" / "Pos000_006.ome.tif"
    with pytest.warns(MetadataWarning, match="the 2 planes of this file alone are used"):
        movie = open_movie(path, MovieOptions(channel=1))
    with movie:
        np.testing.assert_array_equal(movie.frames(0, 1)[0], tifffile.imread(path, key=1))


def test_given_files_are_held_against_the_set(tmp_path: Path) -> None:
    a, b, c = write_ome(tmp_path, "a.ome.tif", "b.ome.tif", "c.ome.tif")
    assert "c.ome.tif is not given" in refusal([a, b])
    assert f"{c} is given where b.ome.tif follows" in refusal([a, c, b])
    (other,) = write_parts(tmp_path, "other.tif")
    assert f"{other} is not one of the 3 files" in refusal([a, b, c, other])
    with open_movie([a, b, c]) as movie:
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES)


def test_renamed_member_of_a_set_is_not_taken_for_the_movie(tmp_path: Path) -> None:
    a, b = write_ome(tmp_path, "a.ome.tif", "b.ome.tif")
    new, newer = a.rename(tmp_path / "new.tif"), b.rename(tmp_path / "newer.tif")
    assert "is one of 2 files of a movie and was renamed" in refusal(new)
    with open_movie([new, newer]) as movie:
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES)
    with pytest.warns(MetadataWarning, match="--axes TYX is used"):
        movie = open_movie(new, MovieOptions(axes="TYX"))
    with movie:
        np.testing.assert_array_equal(movie.frames(0, 6), FRAMES[:6])


@pytest.mark.parametrize(
    "name",
    ["../b.tif", "/etc/b.tif", "sub/b.tif", "..", ".", "C:b.tif", "sub\\b.tif", "\\\\host\\b.tif"],
)
def test_names_that_lead_out_of_the_folder_are_refused(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "movies"
    (folder / "sub").mkdir(parents=True)
    for outside in (tmp_path / "b.tif", folder / "sub" / "b.tif"):
        tifffile.imwrite(outside, FRAMES)
    text = ome_text(("a.tif", 12), (name, 12), frames=24)
    (path,) = write_parts(folder, "a.tif", metadata=None, description=text)
    assert f"whose file {name!r} is not in its own folder" in refusal(path)


def test_link_that_leads_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "movies"
    folder.mkdir()
    a, b = write_ome(folder, "a.ome.tif", "b.ome.tif")
    b.rename(tmp_path / "b.ome.tif")
    b.symlink_to(tmp_path / "b.ome.tif")
    assert "whose file 'b.ome.tif' is not in its own folder" in refusal(a)
    with open_movie([a, b]) as movie:  # named by the user
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES)


def test_terminal_codes_in_names_do_not_reach_the_sentence(tmp_path: Path) -> None:
    text = ome_text(("a.tif", 12), ("../\u009b31m\u202eb.tif", 12), frames=24)
    (path,) = write_parts(tmp_path, "a.tif", metadata=None, description=text.encode())
    assert "'../31mb.tif'" in refusal(path)


def test_planes_in_another_order_than_their_numbers_are_refused(tmp_path: Path) -> None:
    text = ome_text(("a.tif", 12)).replace('FirstT="3"', 'FirstT="4"', 1)
    (path,) = write_parts(tmp_path, "a.tif", metadata=None, description=text)
    assert "in another order than its OME description numbers them" in refusal(path)
    with pytest.warns(MetadataWarning, match="--axes TYX is used"):
        movie = open_movie(path, MovieOptions(axes="TYX"))
    with movie:
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES)


def write_timed(path: Path, frames: np.ndarray, start_ms: float) -> Path:
    """Write frames 10 ms apart with Micro-Manager's times."""
    with tifffile.TiffWriter(path) as writer:
        for index, frame in enumerate(frames):
            tag = json.dumps({"ElapsedTime-ms": start_ms + 10.0 * index})
            writer.write(
                frame, metadata=None, contiguous=False, extratags=[(51123, 2, None, tag, True)]
            )
    return path


def test_files_out_of_order_by_their_times_are_refused(tmp_path: Path) -> None:
    late = write_timed(tmp_path / "a.tif", FRAMES[6:], 5000.0)
    early = write_timed(tmp_path / "b.tif", FRAMES[:6], 100.0)
    sentence = refusal([late, early])
    assert f"{late} was not recorded where it is given" in sentence
    assert "in the order b.tif, a.tif" in sentence
    with open_movie([early, late]) as movie:
        np.testing.assert_array_equal(movie.frames(0, 12), FRAMES)
        assert movie.times_s is not None
        assert movie.times_s[[0, 5, 6, 11]] == pytest.approx([0.1, 0.15, 5.0, 5.05])


def test_times_continue_where_each_file_starts_its_own_clock(tmp_path: Path) -> None:
    one = write_timed(tmp_path / "a.tif", FRAMES[:6], 30.0)
    two = write_timed(tmp_path / "b.tif", FRAMES[6:], 20.0)
    with open_movie([one, two]) as movie:
        assert movie.times_s == pytest.approx(0.03 + 0.01 * np.arange(12))
        assert (
            "the time between a.tif and b.tif is not recorded and is taken as one frame interval"
            in movie.notes
        )
        part = select(movie, frames=(5, 8))
        assert part.times_s == pytest.approx([0.08, 0.09, 0.10])


def test_damaged_frame_is_named_by_its_place_in_the_recording(tmp_path: Path) -> None:
    one, two = write_parts(tmp_path, "a.tif", "b.tif", compression="zlib")
    with tifffile.TiffFile(two) as tif:
        place = tif.pages[2].dataoffsets[0]
    with two.open("r+b") as file:
        file.seek(place + 20)
        file.write(b"\xff" * 8)
    with open_movie([one, two]) as movie:
        np.testing.assert_array_equal(movie.frames(0, 8), FRAMES[:8])
        with pytest.raises(MovieError, match=r"b\.tif .* frame 8 .*--frames 0 8 reads"):
            movie.frames(7, 10)
