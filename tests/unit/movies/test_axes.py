"""Frames are picked from planes by a stated rule, by the description, or as the user says."""

from __future__ import annotations

import itertools
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from rotortrack.errors import ConfigurationError, MetadataWarning, MovieError, SalvageWarning
from rotortrack.movies.options import MovieOptions, parse_axes
from rotortrack.movies.tiff import open_movie

PLANES = np.random.default_rng(9).integers(90, 400, (24, 8, 9)).astype(np.uint16)


def write(path: Path, lengths: dict[str, int], **options: Any) -> np.ndarray:
    """Write PLANES with named axes; give them in that shape."""
    stack = PLANES[: np.prod([*lengths.values()])].reshape(*lengths.values(), 8, 9)
    axes = "".join(lengths) + "YX"
    tifffile.imwrite(
        path, stack, photometric="minisblack", **{"metadata": {"axes": axes}, **options}
    )
    return stack


def cut_behind(path: Path, planes: int) -> None:
    """Cut a file of plain pixels a few bytes behind a plane."""
    with tifffile.TiffFile(path) as tif:
        pixels = tif.pages.first.dataoffsets[0]
    os.truncate(path, pixels + planes * PLANES[0].nbytes + 10)


def picked(stack: np.ndarray, lengths: dict[str, int], **picks: int) -> np.ndarray:
    return stack[tuple(picks.get(axis, slice(None)) for axis in lengths)]


@pytest.mark.parametrize(
    ("lengths", "options", "note"),
    [
        ({"T": 24}, {}, None),
        ({"T": 24}, {"imagej": True}, None),
        ({"Z": 24}, {"imagej": True}, "its 24 z slices are taken as time"),
        ({"Z": 24}, {"ome": True}, "its 24 z slices are taken as time"),
        ({"C": 24}, {}, "its 24 channels are taken as time"),
        ({"Q": 24}, {}, "its 24 planes along Q are taken as time"),
        ({"Z": 24}, {"metadata": None}, None),
        ({"Z": 24}, {"metadata": {}}, None),
    ],
)
def test_the_only_long_axis_is_time_and_another_name_is_noted(
    lengths: dict[str, int], options: dict[str, Any], note: str | None, tmp_path: Path
) -> None:
    write(tmp_path / "m.tif", lengths, **options)
    with open_movie(tmp_path / "m.tif") as movie:
        np.testing.assert_array_equal(movie.frames(0, 24), PLANES)
        assert movie.notes == (() if note is None else (note,))


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize(
    ("lengths", "options"),
    [
        ({"T": 12, "C": 2}, {}),
        ({"C": 2, "T": 12}, {}),
        ({"T": 12, "C": 2}, {"imagej": True}),
        ({"T": 12, "C": 2}, {"ome": True}),
        ({"C": 2, "T": 12}, {"ome": True}),
        ({"T": 4, "Z": 3, "C": 2}, {"imagej": True}),
        ({"Z": 3, "C": 2, "T": 4}, {"ome": True}),
    ],
)
def test_described_channels_and_slices_are_picked(
    lengths: dict[str, int], options: dict[str, Any], compression: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "m.tif"
    if not (compression and options.get("imagej")):
        options = {**options, "compression": compression}
    stack = write(path, lengths, **options)
    for channel, z_slice in itertools.product(range(2), range(lengths.get("Z", 1))):
        picks = {"C": channel, "Z": z_slice}
        chosen = MovieOptions(channel=channel, z_slice=z_slice if "Z" in lengths else None)
        with open_movie(path, chosen) as movie:
            expected = picked(stack, lengths, **picks)
            np.testing.assert_array_equal(movie.frames(0, lengths["T"]), expected)
            with movie.reopen() as again:
                np.testing.assert_array_equal(again.frames(1, 3), expected[1:3])


@pytest.mark.parametrize(
    ("axes", "order", "options"),
    [
        ("TC2YX", {"T": 12, "C": 2}, {"channel": 1}),
        ("T12C2YX", {"T": 12, "C": 2}, {"channel": 0}),
        ("tc2yx", {"T": 12, "C": 2}, {"channel": 1}),
        ("C2TYX", {"C": 2, "T": 12}, {"channel": 1}),
        ("CT12YX", {"C": 2, "T": 12}, {"channel": 1}),
        ("Z3TYX", {"Z": 3, "T": 8}, {"z_slice": 2}),
        ("TZ3C2YX", {"T": 4, "Z": 3, "C": 2}, {"channel": 1, "z_slice": 2}),
        ("TYX", {"T": 24}, {}),
        ("ZYX", {"Z": 24}, {}),
        ("C2ZYX", {"C": 2, "Z": 12}, {"channel": 1}),
    ],
)
def test_given_axes_order_the_planes_of_a_plain_file(
    axes: str, order: dict[str, int], options: dict[str, int], tmp_path: Path
) -> None:
    path = tmp_path / "m.tif"
    stack = write(path, order, metadata=None)
    picks = {"C": options.get("channel"), "Z": options.get("z_slice")}
    expected = picked(stack, order, **{k: v for k, v in picks.items() if v is not None})
    with open_movie(path, MovieOptions(axes=axes, **options)) as movie:
        np.testing.assert_array_equal(movie.frames(0, movie.shape[0]), expected)


def test_lengths_that_are_not_given_come_from_the_description(tmp_path: Path) -> None:
    path = tmp_path / "m.tif"
    stack = write(path, {"T": 12, "C": 2}, imagej=True)
    with open_movie(path, MovieOptions(axes="TCYX", channel=1)) as movie:
        np.testing.assert_array_equal(movie.frames(0, 12), stack[:, 1])


@pytest.mark.parametrize(
    ("lengths", "axes", "expected"),
    [
        ({"T": 12, "C": 2}, "TYX", np.s_[:]),
        ({"T": 12, "C": 2}, "CTYX", np.s_[12:]),
        ({"T": 12, "C": 2}, "TC4YX", np.s_[1::4]),
        ({"T": 24}, "TC2YX", np.s_[1::2]),
    ],
)
def test_given_axes_win_over_the_description_with_a_warning(
    lengths: dict[str, int], axes: str, expected: slice, tmp_path: Path
) -> None:
    path = tmp_path / "m.tif"
    write(path, lengths, imagej=True)
    options = MovieOptions(axes=axes, channel=1 if "C" in axes else None)
    with pytest.warns(MetadataWarning, match=f"--axes {axes} is used, but its ImageJ"):
        movie = open_movie(path, options)
    with movie:
        np.testing.assert_array_equal(movie.frames(0, movie.shape[0]), PLANES[expected])


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "length missing": ({"axes": "TCYX"}, "does not say how long the axis C of --axes TCYX is"),
    "two lengths missing": ({"axes": "TZC2YX"}, "how long the axis Z"),
    "does not divide": ({"axes": "TC5YX"}, "holds 24 planes, which --axes TC5YX with its 5"),
    "another product": ({"axes": "T5C4YX"}, "holds 24 planes, which --axes T5C4YX with its 20"),
    "more than there is": ({"axes": "T50C4YX"}, "holds 24 planes, which --axes T50C4YX"),
    "absurd length": ({"axes": f"TC{10**30}YX"}, "holds 24 planes"),
    "two long axes": ({"axes": "TC2YX"}, "(T = 12, C = 2): choose with --channel"),
    "channel outside": (
        {"axes": "TC2YX", "channel": 2},
        "has 2 channels, counted from 0: --channel 2 is not among them",
    ),
    "no channels known": ({"channel": 1}, "not known to have several channels, but --channel 1"),
    "no slices known": ({"z_slice": 3}, "such as TZ2YX"),
    "not frames": ({"axes": "XYT"}, "stores its pixels as XYT"),
    "columns first": ({"axes": "TXY"}, "save each frame (y, x) as a page"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_axes_that_do_not_fit_are_refused_with_the_reason(case: str, tmp_path: Path) -> None:
    path = tmp_path / "m.tif"
    write(path, {"T": 24}, metadata=None)
    options, reason = REFUSED[case]
    with pytest.raises(MovieError) as caught:
        open_movie(path, MovieOptions(**options))
    assert str(path) in str(caught.value)
    assert reason in str(caught.value)


@pytest.mark.parametrize("text", ["", "TTYX", "T-YX", "T C Y X", "TC0YX", "2TYX", "TCZ", "ÄYX"])
def test_what_names_no_axes_is_a_wrong_option(text: str) -> None:
    with pytest.raises(ConfigurationError, match="axes must name"):
        MovieOptions(axes=text)


def test_axes_are_read_with_their_lengths() -> None:
    assert parse_axes("tC2Z10YX") == {"T": None, "C": 2, "Z": 10, "Y": None, "X": None}


def test_channel_zero_of_a_single_channel_is_all_of_it(tmp_path: Path) -> None:
    write(tmp_path / "m.tif", {"T": 24}, metadata=None)
    with open_movie(tmp_path / "m.tif", MovieOptions(channel=0, z_slice=0)) as movie:
        assert movie.shape[0] == 24


@pytest.mark.parametrize(
    ("axes", "order", "expected"),
    [("TC2YX", {"T": 12, "C": 2}, np.s_[1:18:2]), ("C2T12YX", {"C": 2, "T": 12}, np.s_[12:18])],
)
def test_whole_frames_of_the_picked_channel_are_salvaged(
    axes: str, order: dict[str, int], expected: slice, tmp_path: Path
) -> None:
    path = tmp_path / "m.tif"
    write(path, order, metadata={})
    cut_behind(path, 18)
    options = MovieOptions(axes=axes, channel=1, salvage=True)
    with pytest.warns(SalvageWarning, match="18 are used"):
        movie = open_movie(path, options)
    with movie:
        found = movie.frames(0, movie.shape[0])
        np.testing.assert_array_equal(found, PLANES[expected])
        assert movie.missing_frames == 12 - len(found)


def test_inner_axis_without_length_is_not_guessed_for_a_cut_file(tmp_path: Path) -> None:
    path = tmp_path / "m.tif"
    write(path, {"C": 2, "T": 12}, metadata={})
    cut_behind(path, 18)
    options = MovieOptions(axes="C2TYX", channel=1, salvage=True)
    with (
        pytest.warns(SalvageWarning),
        pytest.raises(MovieError, match="how long the axis T is: give its length"),
    ):
        open_movie(path, options)
