"""Broken and unsuitable movie files end in one sentence: file, reason, remedy."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import tifffile

from rotortrack.errors import MetadataWarning, MovieError, RotortrackWarning
from rotortrack.movies.tiff import open_movie

FRAMES = np.random.default_rng(5).integers(90, 400, (40, 64, 64)).astype(np.uint16)
WRITERS = {
    "plain": {},
    "bare": {"metadata": None},
    "bigtiff": {"bigtiff": True},
    "imagej": {"imagej": True, "metadata": {"axes": "TYX"}},
    "ome": {"ome": True, "metadata": {"axes": "TYX"}},
    "zlib": {"compression": "zlib"},
}


def write(path: Path, form: str) -> bytes:
    if form == "pages":
        with tifffile.TiffWriter(path) as writer:
            for frame in FRAMES:
                writer.write(frame, contiguous=False)
    else:
        tifffile.imwrite(path, FRAMES, **WRITERS[form])
    return path.read_bytes()


def refusal(path: Path) -> str:
    """Open and read all; give the sentence of the error, which must name the file."""
    with pytest.raises(MovieError) as caught, open_movie(path) as movie:
        movie.frames(0, movie.shape[0])
    sentence = str(caught.value)
    assert str(path) in sentence
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize("cut", [0.25, 0.6, 0.9])
@pytest.mark.parametrize("form", [*WRITERS, "pages"])
def test_cut_file_names_declared_and_readable_frames(form: str, cut: float, tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    content = write(path, form)
    path.write_bytes(content[: int(cut * len(content))])
    sentence = refusal(path)
    declared, readable = (
        int(word) for word in sentence.replace(";", " ").replace(",", " ").split() if word.isdigit()
    )
    if form in ("zlib", "pages"):
        # A page whose pixels are cut off may still tell of the next one, and of no more.
        assert abs(readable - cut * 40) <= 2 or form == "zlib"
        assert declared in (readable + 1, readable + 2, 40)
    else:
        assert declared == 40
        assert abs(readable - cut * 40) <= 1


@pytest.mark.parametrize("form", ["imagej", "ome", "plain"])
def test_lost_directories_behind_whole_pixels_are_said_and_the_frames_used(
    form: str, tmp_path: Path
) -> None:
    path = tmp_path / "movie.tif"
    content = write(path, form)
    with tifffile.TiffFile(path) as tif:
        pixels_end = tif.pages.first.dataoffsets[0] + FRAMES.nbytes
    path.write_bytes(content[: pixels_end + 10])
    with pytest.warns(MetadataWarning, match="lost the directories"), open_movie(path) as movie:
        np.testing.assert_array_equal(movie.frames(0, 40), FRAMES)


def test_imagej_file_of_one_directory_that_is_cut_says_so(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    tifffile.imwrite(path, FRAMES[0], metadata=None, description="ImageJ=1.54f\nimages=40\n")
    with tifffile.TiffFile(path) as tif:
        (pixels,) = tif.pages.first.dataoffsets
    os.truncate(path, pixels + FRAMES.nbytes)
    with open_movie(path) as movie:
        assert movie.shape == FRAMES.shape
    os.truncate(path, pixels + FRAMES.nbytes * 3 // 4)
    assert "40 frames are declared by its ImageJ description, 30 can be read" in refusal(path)


def test_file_that_shrinks_while_it_is_read_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    content = write(path, "plain")
    with open_movie(path) as movie:
        os.truncate(path, len(content) // 2)
        with pytest.raises(MovieError, match=r"ends in frame (19|20)\b"):
            movie.frames(0, 40)


def test_damaged_compressed_frame_is_named_and_others_are_read(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    write(path, "zlib")
    with tifffile.TiffFile(path) as tif:
        place = tif.pages[17].dataoffsets[0]
    with path.open("r+b") as file:
        file.seek(place + 500)
        file.write(b"\xff" * 8)
    with open_movie(path) as movie:
        np.testing.assert_array_equal(movie.frames(0, 17), FRAMES[:17])
        with pytest.raises(MovieError, match="frame 17"):
            movie.frames(10, 20)


def test_what_is_no_movie_is_named(tmp_path: Path) -> None:
    assert "does not exist" in refusal(tmp_path / "none.tif")
    assert "is a folder" in refusal(tmp_path)
    fifo = tmp_path / "fifo.tif"
    os.mkfifo(fifo)
    assert "not a regular file" in refusal(fifo)
    for name, content, reason in [
        ("empty", b"", "is empty"),
        ("text", b"x,y\n1,2\n", "not a TIFF file"),
        ("short", b"II*", "not a TIFF file"),
        ("header", b"II*\0\x08\0\0\0", "damaged"),
        ("nothing", b"II*\0\0\0\0\0", "damaged"),
    ]:
        path = tmp_path / f"{name}.tif"
        path.write_bytes(content)
        assert reason in refusal(path)


def test_unreadable_file_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "movie.tif"
    write(path, "plain")

    def denied(*_arguments: object, **_options: object) -> None:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", denied)
        assert "Permission denied" in refusal(path)


def test_unsuitable_pictures_are_named_with_their_axes(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    tifffile.imwrite(path, np.zeros((4, 8, 9, 3), np.uint8), photometric="rgb")
    assert "colour image (3 samples a pixel)" in refusal(path)
    stack = np.zeros((2, 5, 8, 9), np.uint16)
    for options, axes in [
        ({"imagej": True, "metadata": {"axes": "TCYX"}}, "C = 5, T = 2"),
        ({"ome": True, "metadata": {"axes": "TZYX"}}, "Z = 5, T = 2"),
        ({"metadata": {"axes": "CTYX"}}, "C = 2, T = 5"),
        ({}, "axis 0 = 2, axis 1 = 5"),
    ]:
        tifffile.imwrite(path, stack, photometric="minisblack", **options)
        assert axes in refusal(path)
    for kind in (complex, bool, np.int8, np.uint64):
        tifffile.imwrite(path, np.zeros((3, 8, 9), kind), photometric="minisblack")
        assert "pixels: save it as one of uint8" in refusal(path)


def test_pages_of_different_size_are_not_one_movie(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    with tifffile.TiffWriter(path) as writer:
        for height in (16, 16, 17):
            writer.write(np.zeros((height, 20), np.uint16), metadata=None)
    assert "page 2 has 20 x 17 pixels, the first 20 x 16" in refusal(path)


def test_part_of_a_set_of_files_is_not_taken_for_the_movie(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    planes = "".join(
        f'<TiffData IFD="0"><UUID FileName="{name}.tif">u</UUID></TiffData>' for name in "ab"
    )
    text = (
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        f'<Pixels SizeX="9" SizeY="8" SizeC="1" SizeZ="1" SizeT="2">{planes}</Pixels></Image></OME>'
    )
    tifffile.imwrite(path, np.zeros((8, 9), np.uint16), metadata=None, description=text)
    assert "one of 2 files of a movie of 2 frames" in refusal(path)


def test_chain_of_pages_that_bites_its_tail_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    write(path, "pages")
    with tifffile.TiffFile(path) as tif:
        first, last = tif.pages.first.offset, tif.pages[39].offset
    with path.open("r+b") as file:
        file.seek(last)
        tags = int.from_bytes(file.read(2), "little")
        file.seek(last + 2 + 12 * tags)
        file.write(first.to_bytes(4, "little"))
    assert "points back to an earlier page" in refusal(path)


@pytest.mark.parametrize("compression", ["lzw", "zstd"])
def test_missing_codec_names_the_extra_and_nothing_is_printed(
    compression: str, tmp_path: Path
) -> None:
    path = tmp_path / "movie.tif"
    tifffile.imwrite(path, FRAMES[:2], compression=compression)
    program = """
import sys
sys.modules["imagecodecs"] = None
from pathlib import Path
from rotortrack.errors import MovieError
from rotortrack.movies.tiff import open_movie
try:
    open_movie(Path(sys.argv[1]))
except MovieError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=True
    )
    assert "rotortrack[codecs]" in done.stdout
    assert done.stderr == ""


def test_complaints_of_tifffile_do_not_reach_the_terminal(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "movie.tif"
    content = write(path, "imagej")
    path.write_bytes(content[: len(content) // 2])
    refusal(path)
    captured = capfd.readouterr()
    assert (captured.out, captured.err) == ("", "")


@pytest.mark.parametrize("form", [*WRITERS, "pages"])
def test_flipped_bytes_end_in_a_movie_error_or_in_frames_within_5_s(
    form: str, tmp_path: Path
) -> None:
    path = tmp_path / "movie.tif"
    content = write(path, form)
    with tifffile.TiffFile(path) as tif:
        offsets = [page.offset for page in itertools.islice(tif.pages, 3)]
    # Half of the flips hit the header and directories, where they do most harm.
    tags = np.concatenate([[0], offsets])[:, np.newaxis] + np.arange(200)
    tags = tags[tags < len(content)]
    rng = np.random.default_rng(6)
    ends = {"error": 0, "frames": 0}
    for case in range(25):
        broken = bytearray(content)
        places = rng.integers(0, len(content), 3) if case % 2 else rng.choice(tags, 3)
        for place in places:
            broken[place] ^= int(rng.integers(1, 256))
        path.write_bytes(broken)
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RotortrackWarning)
            try:
                with open_movie(path) as movie:
                    for first in range(0, movie.shape[0], 20):
                        movie.frames(first, min(first + 20, movie.shape[0]))
                ends["frames"] += 1
            except MovieError:
                ends["error"] += 1
        assert time.perf_counter() - start < 5.0
    assert ends["error"] > 0
    # Almost any flip in compressed pixels is noticed, none in plain ones.
    assert ends["frames"] > 0 or form == "zlib"
