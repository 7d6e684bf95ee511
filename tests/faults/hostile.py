"""What the tests of hostile input share: calls that are watched, and material."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import tifffile

from rotortrack_cli.main import main

FRAMES = np.random.default_rng(5).integers(90, 130, (6, 20, 24)).astype(np.uint16)
FRAMES[:, 8:11, 9:12] += 400
FRAMES[:, 9, 10] += 800
SCALE = ("--pixel-size-nm", "100", "--frame-interval-s", "0.002")
CAMERA = ("--offset-adu", "100", "--gain-e-per-adu", "0.5", "--read-noise-e", "1.5")
ESCAPES = "\x1b[31mred\x1b]0;title\x07\x1b[2J\x9b1m\u202egnp\x08\x7f"
CANARY = "canary-in-the-coal-mine"
MAPS = ("offset_adu", "gain_e_per_adu", "read_noise_e")
OPENED: list[str] = []
"""Every path that Python opened; a test clears it and looks."""


def _note_opened(event: str, arguments: tuple[object, ...]) -> None:
    if event == "open" and isinstance(arguments[0], str | bytes):
        OPENED.append(os.fsdecode(arguments[0]))


sys.addaudithook(_note_opened)


@contextmanager
def in_time(seconds: int = 20) -> Iterator[None]:
    """Fail what hangs on a pipe or in a loop."""

    def stop(*_arguments: object) -> None:
        pytest.fail(f"longer than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def call(capfd: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Call a command; whatever it says, it says without control characters and as no bug."""
    code = main([str(word) for word in words])
    shown = capfd.readouterr()
    text = shown.out + shown.err
    assert "Traceback" not in text
    assert "this is a bug" not in text
    assert code in (0, 2, 3, 4, 5, 6, 7), text
    odd = {c for c in text if unicodedata.category(c) in ("Cc", "Cf")} - {"\n", "\t"}
    assert not odd, repr(text)
    return code, shown.out, shown.err


def warm(folder: Path) -> None:
    """Compile what a run needs, which takes its time once and is no hang."""
    words = ("run", movie(folder / "warm.tif"), *SCALE, *CAMERA, "-o", folder / "warm", "-q")
    assert main([str(word) for word in words]) == 0


def refused(capfd: pytest.CaptureFixture[str], code: int, *words: object) -> str:
    """Call, assert the exit code and one sentence; give the sentence."""
    ended, _, err = call(capfd, *words)
    sentences = [line for line in err.splitlines() if "warning:" not in line]
    assert ended == code, err
    assert len(sentences) == 1, err
    assert len(sentences[0]) < 2000
    return sentences[0]


def movie(path: Path, **options: object) -> Path:
    tifffile.imwrite(path, FRAMES, photometric="minisblack", **options)
    return path


def limited(program: str, *arguments: object, address_bytes: int = 2**30) -> str:
    """Run a program whose memory may grow by `address_bytes` once rotortrack is imported."""
    head = f"""
import resource, sys, warnings
from pathlib import Path
import numpy, pandas, pyarrow.parquet, pyarrow.csv, tifffile
from rotortrack.movies.tiff import open_movie
from rotortrack.exchange.tables import convert, read_localisations
from rotortrack_cli.main import main
pages = int(Path("/proc/self/statm").read_text().split()[0])
limit = pages * resource.getpagesize() + {address_bytes}
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
"""
    tail = """
grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024
print("grown", grown, "MB")
"""
    done = subprocess.run(
        [sys.executable, "-c", head + program + tail, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "this is a bug" not in done.stderr
    assert int(done.stdout.split()[-2]) < 500
    return done.stdout + done.stderr


def with_maps(folder: Path, maps: object) -> tuple[object, ...]:
    """Give the words of a command that reads camera maps."""
    path = movie(folder / "film.tif")
    return ("localise", path, *SCALE, "--camera-maps", maps, "-o", folder / "l.csv", "--quiet")


_MAPS_WORDS = ("localise", "{folder}/film.tif", *SCALE, "--camera-maps", "{}.npz")
_CONFIG_WORDS = ("localise", "{folder}/film.tif", *SCALE, *CAMERA, "-c", "{}.toml")
READERS: dict[str, tuple[tuple[str, ...], int]] = {
    "info": (("info", "{}.tif"), 3),
    "info csv": (("info", "{}.csv"), 3),
    "info parquet": (("info", "{}.parquet"), 3),
    "info hdf5": (("info", "{}.hdf5", "--pixel-size-nm", "100"), 3),
    "info maps": (("info", "{}.npz"), 3),
    "calibrate": (
        ("calibrate", "{}.tif", "--gain-e-per-adu", "1", "-o", "{folder}/c.npz", "-q"),
        3,
    ),
    "run": (("run", "{}.tif", *SCALE, *CAMERA, "-o", "{folder}/out", "-q"), 3),
    "convert csv": (("convert", "{}.csv", "{folder}/out.parquet", "-q"), 3),
    "convert csv.gz": (("convert", "{}.csv.gz", "{folder}/out.parquet", "-q"), 3),
    "convert parquet": (("convert", "{}.parquet", "{folder}/out.csv", "-q"), 3),
    "convert hdf5": (
        ("convert", "{}.hdf5", "{folder}/out.csv", "-q", "--pixel-size-nm", "100"),
        3,
    ),
    "rotors": (("rotors", "{}.csv", "--frame-interval-s", "1", "-o", "{folder}/out", "-q"), 3),
    "motion": (("motion", "{}", "-q"), 3),
    "maps": ((*_MAPS_WORDS, "-o", "{folder}/l.csv", "-q"), 3),
    "config": ((*_CONFIG_WORDS, "-o", "{folder}/l.csv", "-q"), 4),
}
"""Commands by what they read, and the exit code when it cannot be read."""


def reading(reader: str, folder: Path) -> tuple[list[str], Path, int]:
    """Give the words of a command of READERS, the file that it reads, and its exit code."""
    pattern, code = READERS[reader]
    words = [word.format(folder / "input", folder=folder) for word in pattern]
    (source,) = (Path(word) for word in words if Path(word).name.startswith("input"))
    return words, source, code


def ome(body: str, head: str = "") -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>{head}'
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="24" SizeY="20" '
        f'SizeC="1" SizeZ="1" SizeT="6">{body}</Pixels></Image></OME>'
    )
