"""Files made to exhaust a machine are refused within seconds and within bounded memory."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile

from rotortrack.errors import MovieError
from rotortrack.movies.codecs import deflate_again
from rotortrack.movies.ome import read_ome
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.tiff import open_movie

PROGRAM = """
import re, sys, warnings
from pathlib import Path
warnings.simplefilter("ignore")
if sys.argv[2] == "no codecs":
    sys.modules["imagecodecs"] = None
from rotortrack.errors import MovieError
from rotortrack.movies.tiff import open_movie
def peak(): return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
before = peak()
try:
    with open_movie(Path(sys.argv[1])) as movie:
        movie.frames(0, 1)
    end = "frames"
except MovieError as error:
    end = str(error).replace(chr(10), "|")
print(peak() - before, end)
"""


def entry(tag: int, kind: int, count: int, value: int) -> bytes:
    return struct.pack("<HHII", tag, kind, count, value)


def directory(
    *entries: bytes, width: int = 8, height: int = 8, strip: int = 8, following: int = 0
) -> bytes:
    """Make one directory of a page of 8-bit pixels whose one strip lies at `strip`."""
    tags = {
        256: entry(256, 4, 1, width),
        257: entry(257, 4, 1, height),
        258: entry(258, 3, 1, 8),
        259: entry(259, 3, 1, 1),
        262: entry(262, 3, 1, 1),
        273: entry(273, 4, 1, strip),
        277: entry(277, 3, 1, 1),
        278: entry(278, 4, 1, height),
        279: entry(279, 4, 1, width * height),
    }
    tags |= {struct.unpack_from("<H", other)[0]: other for other in entries}
    body = b"".join(tags[tag] for tag in sorted(tags))
    return struct.pack("<H", len(tags)) + body + struct.pack("<I", following)


def tiff(*parts: bytes) -> bytes:
    return b"II*\0" + struct.pack("<I", 8) + b"".join(parts)


def sparse(path: Path, content: bytes, size: int) -> None:
    path.write_bytes(content)
    os.truncate(path, size)


def long_text(path: Path) -> None:
    sparse(path, tiff(directory(entry(270, 2, 2**31, 4096))), 2**31 + 8192)


def long_json(path: Path) -> None:
    sparse(path, tiff(directory(entry(51123, 2, 2**28, 4096))), 2**31)


def many_strips(path: Path) -> None:
    count = 2**27
    fields = (entry(273, 4, count, 4096), entry(279, 4, count, 4096), entry(278, 4, 1, 1))
    sparse(path, tiff(directory(*fields)), 2**31)


def many_metamorph_planes(path: Path) -> None:
    fields = [entry(tag, 5, 2**28, 4096) for tag in (33628, 33629)]
    sparse(path, tiff(directory(*fields)), 2**32 - 1)


def million_tiny_frames(path: Path) -> None:
    text = b"ImageJ=1.54f\nimages=4000000000\nframes=4000000000\n\0"
    page = directory(entry(270, 2, len(text), 200), width=1, height=1, strip=400)
    sparse(path, tiff(page).ljust(200, b"\0") + text, 2**32 + 400)


def overlapping_pages(path: Path) -> None:
    """Chain directories of 256 tags that begin 12 bytes apart.

    Each cell of 12 bytes begins with the place of a next directory and ends with the number of tags
    of the one that begins there; the places are no tags that matter.
    """
    pages, tags = 5000, 256
    places = 8 + 12 * np.arange(1, pages + 1)
    cells = [struct.pack("<IHIH", 0, 0, 0, tags)] * tags
    cells += [struct.pack("<IHIH", place, 0, 0, tags) for place in places]
    path.write_bytes(tiff(struct.pack("<H", tags), *cells))


def shared_strip_lists(path: Path) -> None:
    """Let thousands of pages share one list of a million strips."""
    count, pages = 2**20, 5000
    size = len(directory())
    fields = (entry(273, 4, count, 2**22), entry(279, 4, count, 2**22), entry(278, 4, 1, 1))
    chain = b"".join(
        directory(*fields, height=count, following=8 + (i + 1) * size if i < pages - 1 else 0)
        for i in range(pages)
    )
    sparse(path, tiff(chain), 2**40)


def huge_frame(path: Path) -> None:
    side = 2**16 - 1
    sparse(path, tiff(directory(width=side, height=side)), 2**32)


def huge_tiles(path: Path) -> None:
    fields = [entry(259, 3, 1, 8), entry(322, 4, 1, 2**16), entry(323, 4, 1, 2**16)]
    fields += [entry(324, 4, 1, 400), entry(325, 4, 1, 2000)]
    sparse(path, tiff(directory(*fields)), 4000)


def long_summary(path: Path) -> None:
    """Let Micro-Manager's header claim settings of 4 GB."""
    head = struct.pack("<8I", 54773648, 0, 483765892, 0, 99384722, 0, 2355492, 2**32 - 1)
    text = b"<OME>x</OME>\0"
    tags = (entry(51123, 2, 4, 0x7D7B), entry(270, 2, len(text), 300))
    page = directory(*tags, strip=400)
    content = b"II*\0" + struct.pack("<I", 40) + head + page
    sparse(path, content.ljust(300, b"\0") + text, 2**32 - 1)


def bomb(path: Path) -> None:
    """Compress 256 MB into one strip of a small page."""
    packed = zlib.compress(bytes(2**28), 1)
    page = directory(
        entry(259, 3, 1, 8),
        entry(279, 4, 1, len(packed)),
        width=1500,
        height=1500,
        strip=400,
    )
    path.write_bytes(tiff(page).ljust(400, b"\0") + packed)


def entity_bomb(path: Path) -> None:
    levels = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12))
    text = f'<?xml version="1.0"?><!DOCTYPE OME [<!ENTITY a0 "aaaa">{levels}]><OME>&a11;</OME>'
    tifffile.imwrite(path, np.zeros((8, 9), np.uint16), metadata=None, description=text)


def crowd_of_images(path: Path) -> None:
    text = "<?xml version='1.0'?><OME>" + "<Image/>" * 2_000_000 + "</OME>"
    tifffile.imwrite(path, np.zeros((8, 9), np.uint16), metadata=None, description=text)


def crowd_of_lines(path: Path) -> None:
    text = "ImageJ=1.54f\n" + "a=1\n" * 10_000_000
    tifffile.imwrite(path, np.zeros((8, 9), np.uint16), metadata=None, description=text)


HOSTILE: dict[str, tuple[Callable[[Path], None], str]] = {
    "text of 2 GB": (long_text, "declares 2147483648 bytes of description (tag 270)"),
    "json of 256 MB": (long_json, "(tag 51123)"),
    "134 million strips": (many_strips, "bytes of description (tag 273)"),
    "268 million metamorph planes": (many_metamorph_planes, "bytes of description (tag 3362"),
    "4 billion frames": (million_tiny_frames, "frames"),
    "overlapping pages": (overlapping_pages, "pages overlap"),
    "shared lists of strips": (shared_strip_lists, "pages overlap"),
    "frame of 4 gigapixels": (huge_frame, "65535 x 65535 pixels, which is not within the 64"),
    "tile of 4 gigapixels": (huge_tiles, "in tiles of 65536 x 65536"),
    "settings of 4 GB": (long_summary, "frames"),
    "deflate bomb": (bomb, "damaged"),
    "entity bomb": (entity_bomb, "frames"),
    "2 million images": (crowd_of_images, "frames"),
    "10 million lines": (crowd_of_lines, "frames"),
}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc")
@pytest.mark.parametrize(
    ("case", "codecs"), [*((case, "codecs") for case in HOSTILE), ("deflate bomb", "no codecs")]
)
def test_hostile_file_costs_seconds_and_200_mb_at_most(
    case: str, codecs: str, tmp_path: Path
) -> None:
    path = tmp_path / "movie.tif"
    write, end = HOSTILE[case]
    write(path)
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path), codecs],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    growth_kb, _, found = done.stdout.strip().partition(" ")
    assert end in found
    assert int(growth_kb) < 200_000
    assert done.stderr == ""
    # Starting Python takes part of it.
    assert time.perf_counter() - start < 8.0


def test_frame_size_limit_is_an_option(tmp_path: Path) -> None:
    path = tmp_path / "movie.tif"
    tifffile.imwrite(path, np.zeros((2, 1000, 1200), np.uint8))
    with open_movie(path, MovieOptions(max_frame_megapixels=1.2)) as movie:
        assert movie.shape == (2, 1000, 1200)
    with pytest.raises(MovieError, match=r"1200 x 1000 pixels.* the 1.1 megapixels .*--max-frame"):
        open_movie(path, MovieOptions(max_frame_megapixels=1.1))


@pytest.mark.parametrize("size", [1, 1000, 100_000])
def test_bounded_inflation_gives_the_same_bytes_or_refuses(size: int) -> None:
    content = np.random.default_rng(size).integers(0, 4, size).astype(np.uint8).tobytes()
    packed = zlib.compress(content)
    assert zlib.decompress(deflate_again(packed, size)) == content
    assert zlib.decompress(deflate_again(packed, size + 1)) == content
    if size > 1:
        with pytest.raises(ValueError, match="holds more"):
            deflate_again(packed, size - 1)
    with pytest.raises(zlib.error):
        deflate_again(b"no deflate data", size)


def test_crowd_of_files_in_a_description_is_not_believed() -> None:
    planes = "".join(f'<TiffData><UUID FileName="{i}"/></TiffData>' for i in range(100_100))
    assert read_ome(f"<OME><Image><Pixels/>{planes}</Image></OME>") is None
