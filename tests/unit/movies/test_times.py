"""Times that files record: found, checked, and turned into frame numbers and an interval."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile

from rotortrack.errors import MetadataWarning
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie

FRAMES = np.random.default_rng(1).integers(0, 900, (40, 6, 8)).astype(np.uint16)
NUMBERS = np.delete(np.arange(43), [10, 11, 30])
TIMES_MS = 53.0 + 12.5 * NUMBERS


def plain(value_ms):
    return value_ms


def wrapped(value_ms):
    return {"PropType": "Double", "PropVal": value_ms}


def micromanager(path, frames, times_ms, form=plain, key="ElapsedTime-ms", **options):
    """Write pages with Micro-Manager's description of each; no time where it is None."""
    with tifffile.TiffWriter(path, **options) as writer:
        for frame, time_ms in zip(frames, times_ms, strict=True):
            page = {"Camera": "Andor", "Comment": "é" * 40, "Exposure-ms": 10.0}
            if time_ms is not None:
                page[key] = form(time_ms)
            page["Frame"] = 3
            tag = (51123, 2, None, json.dumps(page).encode() + b"\0", True)
            writer.write(frame, contiguous=False, metadata=None, extratags=[tag])


def ome(path, frames, times, unit=None, order=None):
    """Write an OME movie with the time of each plane."""
    plane = {"DeltaT": list(times)}
    if unit is not None:
        plane["DeltaTUnit"] = [unit] * len(times)
    tifffile.imwrite(path, frames, ome=True, metadata={"axes": order or "TYX", "Plane": plane})


@pytest.mark.parametrize("form", [plain, wrapped, str, int])
@pytest.mark.parametrize("options", [{}, {"bigtiff": True}, {"byteorder": ">"}])
def test_micromanagers_times_become_numbers_and_an_interval(tmp_path, form, options):
    path = tmp_path / "film.tif"
    micromanager(path, FRAMES, TIMES_MS, form, **options)
    with open_movie(path) as movie:
        assert movie.numbers.tolist() == NUMBERS.tolist()
        assert movie.times_s == pytest.approx(
            [float(int(t) if form is int else t) / 1e3 for t in TIMES_MS]
        )
        interval = movie.metadata["frame_interval_s"]
        assert interval.value == pytest.approx(0.0125, rel=1e-3)
        assert interval.origin == "file (Micro-Manager elapsed times)"
        assert any("3 frames were dropped at 2 places" in note for note in movie.notes)
        with movie.reopen() as again:
            assert again.numbers.tolist() == NUMBERS.tolist()
        part = select(movie, frames=(5, 20))
        assert part.numbers.tolist() == NUMBERS[5:20].tolist()
        assert part.times_s == pytest.approx(movie.times_s[5:20])


@pytest.mark.parametrize(("unit", "factor"), [(None, 1e-3), ("ms", 1.0), ("s", 1e-3)])
def test_ome_times_become_numbers_and_an_interval(tmp_path, unit, factor):
    path = tmp_path / "film.ome.tif"
    ome(path, FRAMES, TIMES_MS * factor, unit)
    with open_movie(path) as movie:
        assert movie.numbers.tolist() == NUMBERS.tolist()
        interval = movie.metadata["frame_interval_s"]
        assert interval.value == pytest.approx(0.0125, rel=1e-6)
        assert interval.origin == "file (OME times)"


def test_ome_times_are_ordered_by_the_indices_of_their_planes(tmp_path):
    path = tmp_path / "film.ome.tif"
    ome(path, FRAMES, TIMES_MS, "ms")
    with tifffile.TiffFile(path) as tif:
        text = tif.ome_metadata
    head, *planes = text.split("<Plane ")
    tail = planes[-1][planes[-1].index("/>") + 2 :]
    planes[-1] = planes[-1][: planes[-1].index("/>") + 2]
    shuffled = [planes[index] for index in np.random.default_rng(2).permutation(len(planes))]
    tifffile.imwrite(
        path, FRAMES, metadata=None, description="<Plane ".join([head, *shuffled]) + tail
    )
    with open_movie(path) as movie:
        assert movie.numbers.tolist() == NUMBERS.tolist()


def test_a_channel_has_its_own_times(tmp_path):
    path = tmp_path / "film.ome.tif"
    times_ms = np.stack([TIMES_MS, TIMES_MS + 5.0], axis=1).ravel()
    both = np.stack([FRAMES, FRAMES[::-1]], axis=1)
    ome(path, both, times_ms, "ms", "TCYX")
    with open_movie(path, MovieOptions(channel=1)) as movie:
        assert movie.times_s == pytest.approx((TIMES_MS + 5.0) / 1e3)
        assert movie.numbers.tolist() == NUMBERS.tolist()
        assert np.array_equal(movie.frames(0, 40), FRAMES[::-1])


def test_several_files_are_numbered_as_one_recording(tmp_path):
    paths = [tmp_path / f"film{number}.tif" for number in range(2)]
    micromanager(paths[0], FRAMES[:15], TIMES_MS[:15])
    micromanager(paths[1], FRAMES[15:], TIMES_MS[15:])
    with open_movie(paths) as movie:
        assert movie.numbers.tolist() == NUMBERS.tolist()
        assert movie.metadata["frame_interval_s"].value == pytest.approx(0.0125, rel=1e-6)


@pytest.mark.parametrize("broken", [None, "soon", float("nan"), float("inf"), "1e999"])
def test_a_single_missing_time_leaves_none_and_is_said(tmp_path, broken):
    path = tmp_path / "film.tif"
    micromanager(path, FRAMES, [*TIMES_MS[:20], broken, *TIMES_MS[21:]], lambda value: value)
    with pytest.warns(MetadataWarning, match=r"1 of 40 frames of .*film\.tif tell no time, so no"):
        movie = open_movie(path)
    with movie:
        assert movie.times_s is None
        assert movie.numbers is None
        assert "frame_interval_s" not in movie.metadata


def test_frames_that_are_not_used_need_no_times(tmp_path):
    path = tmp_path / "film.tif"
    micromanager(path, FRAMES[:8], [None, 10.0, None, 20.0, None, 30.0, None, 40.0])
    with open_movie(path, MovieOptions(axes="TC2YX", channel=1)) as movie:
        assert movie.times_s == pytest.approx([0.01, 0.02, 0.03, 0.04])


def test_planes_without_times_in_an_ome_description_are_counted(tmp_path):
    path = tmp_path / "film.ome.tif"
    ome(path, FRAMES, TIMES_MS / 1e3)
    path.write_bytes(path.read_bytes().replace(b"DeltaT=", b"Unused=", 10))
    with pytest.warns(MetadataWarning, match=r"10 of 40 frames of .*film\.ome\.tif tell no time"):
        movie = open_movie(path)
    with movie:
        assert movie.times_s is None


def test_a_file_without_times_among_others_is_said(tmp_path):
    paths = [tmp_path / f"film{number}.tif" for number in range(2)]
    micromanager(paths[0], FRAMES[:15], TIMES_MS[:15])
    micromanager(paths[1], FRAMES[15:], [None] * 25)
    with pytest.warns(MetadataWarning, match="25 of 40 frames of .* tell no time"):
        movie = open_movie(paths)
    with movie:
        assert movie.times_s is None


def test_times_that_are_all_the_same_say_nothing(tmp_path):
    path = tmp_path / "film.tif"
    micromanager(path, FRAMES, [0.0] * 40)
    with open_movie(path) as movie:
        assert movie.times_s is None


def test_times_that_go_back_are_not_used_and_said(tmp_path):
    path = tmp_path / "film.tif"
    micromanager(path, FRAMES, [*TIMES_MS[20:], *TIMES_MS[:20]])
    with pytest.warns(MetadataWarning, match=r"film\.tif go back by"):
        movie = open_movie(path)
    with movie:
        assert movie.times_s is None
        assert movie.numbers is None


def test_a_few_frames_have_times_but_no_measured_interval(tmp_path):
    path = tmp_path / "film.tif"
    micromanager(path, FRAMES[:5], TIMES_MS[:5])
    with open_movie(path) as movie:
        assert len(movie.times_s) == 5
        assert movie.numbers is None
        assert "frame_interval_s" not in movie.metadata


def test_a_measured_interval_wins_over_a_wish(tmp_path):
    path = tmp_path / "film.ome.tif"
    plane = {"DeltaT": list(TIMES_MS / 1e3)}
    metadata = {"axes": "TYX", "Plane": plane, "TimeIncrement": 0.01, "TimeIncrementUnit": "s"}
    tifffile.imwrite(path, FRAMES, ome=True, metadata=metadata)
    with pytest.warns(MetadataWarning, match=r"0\.01 by file \(OME\) but 0\.0125 by"):
        movie = open_movie(path)
    with movie:
        assert movie.metadata["frame_interval_s"].value == pytest.approx(0.0125)


def test_pages_that_share_one_huge_description_are_not_searched(tmp_path):
    path = tmp_path / "film.tif"
    micromanager(path, FRAMES, TIMES_MS)
    with tifffile.TiffFile(path) as tif:
        tags = [page.tags[51123] for page in tif.pages]
        places = [(tag.offset, tag.valueoffset) for tag in tags]
    data = bytearray(path.read_bytes())
    for offset, _ in places:
        data[offset + 4 : offset + 8] = (len(data) - places[0][1]).to_bytes(4, "little")
        data[offset + 8 : offset + 12] = places[0][1].to_bytes(4, "little")
    path.write_bytes(data)
    with open_movie(path) as movie:
        assert movie.times_s is None
