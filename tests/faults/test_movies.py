"""Broken and unsuitable movie files end in one sentence: file, reason, remedy."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
import types
import warnings
from pathlib import Path

import numpy as np
import pytest
import tifffile

from rotortrack.errors import MetadataWarning, MovieError, RotortrackWarning, SalvageWarning
from rotortrack.movies import layout
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.select import select
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


def refusal(path: Path, options: MovieOptions | None = None) -> str:
    """Open and read all; give the sentence of the error, which must name the file."""
    with pytest.raises(MovieError) as caught, open_movie(path, options) as movie:
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


@pytest.mark.parametrize("cut", [0.25, 0.6, 0.9])
@pytest.mark.parametrize("form", [*WRITERS, "pages"])
def test_whole_frames_of_a_cut_file_are_salvaged_and_flagged(
    form: str, cut: float, tmp_path: Path
) -> None:
    path = tmp_path / "movie.tif"
    content = write(path, form)
    path.write_bytes(content[: int(cut * len(content))])
    assert "--salvage" in refusal(path)
    with pytest.warns(SalvageWarning, match=r"cut short: .* are used") as caught:
        movie = open_movie(path, MovieOptions(salvage=True))
    with movie:
        readable = movie.shape[0]
        np.testing.assert_array_equal(movie.frames(0, readable), FRAMES[:readable])
        assert movie.missing_frames > 0
        assert f"{readable} are used" in str(caught[0].message)
        assert select(movie, frames=(0, 1)).missing_frames == movie.missing_frames
        if form not in ("zlib", "pages"):
            assert readable + movie.missing_frames == 40
        if form != "zlib":
            assert abs(readable - cut * 40) <= 2
        with movie.reopen() as again:
            assert again.missing_frames == movie.missing_frames


def test_whole_file_is_the_same_with_salvage(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    write(path, "plain")
    with open_movie(path, MovieOptions(salvage=True)) as movie:
        assert (movie.shape[0], movie.missing_frames) == (40, 0)


@pytest.mark.parametrize("form", ["plain", "imagej", "pages"])
def test_nothing_can_be_salvaged_before_the_end_of_the_first_frame(
    form: str, tmp_path: Path
) -> None:
    path = tmp_path / "movie.tif"
    content = write(path, form)
    with tifffile.TiffFile(path) as tif:
        pixels = tif.pages.first.dataoffsets[0]
    path.write_bytes(content[: pixels + FRAMES[0].nbytes - 1])
    sentence = refusal(path, MovieOptions(salvage=True))
    assert ", 0 can be read" in sentence
    assert "--salvage" not in sentence


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
        with pytest.raises(MovieError, match=r"frame 17 .*--frames 0 17 reads what is before"):
            movie.frames(10, 20)


def test_what_is_no_movie_is_named(tmp_path: Path) -> None:
    assert "does not exist" in refusal(tmp_path / "none.tif")
    assert f"is a folder: name its files in their order, such as $(ls -v {tmp_path}/*.tif)" in (
        refusal(tmp_path)
    )
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


STACK = np.zeros((2, 5, 8, 9), np.uint16)
UNSUITABLE: dict[str, tuple[np.ndarray, dict[str, object], str]] = {
    "colour": (np.zeros((4, 8, 9, 3), np.uint8), {"photometric": "rgb"}, "3 samples a pixel"),
    "colour planes": (
        np.zeros((3, 8, 9), np.uint8),
        {"photometric": "rgb", "planarconfig": "separate"},
        "3 samples a pixel",
    ),
    "interleaved channels": (
        np.zeros((4, 8, 9, 2), np.uint16),
        {"planarconfig": "contig", "metadata": None, "extrasamples": [0]},
        "2 samples a pixel",
    ),
    "imagej channels": (
        STACK,
        {"imagej": True, "metadata": {"axes": "TCYX"}},
        "(T = 2, C = 5): choose with --channel",
    ),
    "ome slices": (
        STACK,
        {"ome": True, "metadata": {"axes": "TZYX"}},
        "(T = 2, Z = 5): choose with --z-slice",
    ),
    "channels first": (
        STACK,
        {"metadata": {"axes": "CTYX"}},
        "(C = 2, T = 5): choose with --channel",
    ),
    "slices of channels": (
        STACK,
        {"metadata": {"axes": "ZCYX"}},
        "(Z = 2, C = 5): choose with --z-slice or --channel",
    ),
    "three axes": (
        STACK.repeat(3, 0).reshape(2, 3, 5, 8, 9),
        {"metadata": {"axes": "TZCYX"}},
        "(T = 2, Z = 3, C = 5): choose with --z-slice and --channel",
    ),
    "axes without names": (STACK, {}, "(axis 0 = 2, axis 1 = 5): say what they are with --axes"),
    "time in the pages": (STACK[0], {"metadata": {"axes": "XYT"}}, "as XYT"),
    "rows and columns swapped": (STACK[0], {"metadata": {"axes": "TXY"}}, "as TXY"),
    **{
        f"numbers of {kind}": (
            np.zeros((3, 8, 9), kind),
            {},
            f"{kind} pixels: save it as one of uint8, uint16, uint32, int16, int32",
        )
        for kind in ("complex64", "complex128", "bool", "int8", "float16", "uint64", "int64")
    },
}


@pytest.mark.parametrize("case", UNSUITABLE)
def test_unsuitable_pictures_are_named_with_a_remedy(case: str, tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    pixels, options, reason = UNSUITABLE[case]
    tifffile.imwrite(path, pixels, **{"photometric": "minisblack", **options})
    assert reason in refusal(path)


def test_pages_of_different_size_are_not_one_movie(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    with tifffile.TiffWriter(path) as writer:
        for height in (16, 16, 17):
            writer.write(np.zeros((height, 20), np.uint16), metadata=None)
    assert "page 2 has 20 x 17 pixels, the first 20 x 16" in refusal(path)


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


@pytest.mark.parametrize("kind", [NameError, AssertionError, AttributeError])
def test_our_own_slips_are_not_blamed_on_the_file(
    kind: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "movie.tif"
    write(path, "plain")

    def slip(*_args: object, **_kwargs: object) -> None:
        raise kind("a slip")

    # As if the slip stood in the package itself.
    code = slip.__code__.replace(co_filename=layout.__file__)
    slip = types.FunctionType(code, slip.__globals__, closure=slip.__closure__)
    monkeypatch.setattr(layout, "read_directories", slip)
    with pytest.raises(kind, match="a slip"):
        open_movie(path)
