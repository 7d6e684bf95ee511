"""Whole processes as a user starts them, each measured from outside: time, CPU time, peak memory.

Used by engine.py. Imports the standard library alone, since a child's peak is never below the size
of the process that started it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

CAMERA_FLAGS = (
    *("--pixel-size-nm", "108.3", "--offset-adu", "100"),
    *("--gain-e-per-adu", "0.45", "--read-noise-e", "1.6"),
)
OURS = (sys.executable, "-c", "import sys; from rotortrack_cli.main import main; sys.exit(main())")


@contextlib.contextmanager
def alone(lock: Path | None) -> Iterator[None]:
    """Wait until no other holder of the same lock file measures; no lock, no wait."""
    if lock is None:
        yield
        return
    with lock.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def measured(words: Sequence[object], lock: Path | None) -> dict[str, float]:
    """Run a command to its end: seconds, CPU seconds (user and system), peak resident memory."""
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    with alone(lock):
        start = time.perf_counter()
        process = subprocess.Popen(
            [str(word) for word in words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=environment,
        )
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
    if code := os.waitstatus_to_exitcode(status):
        raise RuntimeError(f"{words[0]} ended with {code}: {said.decode()[-2000:]}")
    return {
        "wall_s": seconds,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_mb": usage.ru_maxrss / 1024,
    }


def answer(words: Sequence[object], lock: Path | None = None) -> Any:
    """Run a script of this folder on one thread and read the line of JSON that it prints last."""
    environment = {**os.environ, **ONE_THREAD, "QT_QPA_PLATFORM": "offscreen"}
    with alone(lock):
        done = subprocess.run(
            [str(word) for word in words], capture_output=True, text=True, env=environment
        )
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, words))}: {done.stderr[-2000:]}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def localise_words(movie: Path, out: Path, *more: object) -> list[object]:
    """Localise a movie of the even camera by our command line, defaults untouched."""
    return [*OURS, "localise", movie, "-o", out, *CAMERA_FLAGS, "--quiet", *more]


def peer_commands(peers: Path, folder: Path, out: Path) -> Mapping[str, list[object]]:
    """Give the command of each other program on the bright film, from file to table.

    Picasso's searches with four fifths of the processors and fits on one; the others use one
    thread. Picasso takes whole nanometres for its pixel size. trackpy has no command of its own.
    """
    movie = folder / "bright.tif"
    camera = out / "smappy-camera.yaml"
    camera.write_text(
        "conversion: 0.45\noffset: 100.0\npixelsize_um: 0.1083\nread_noise_e: 1.6\nem_on: false\n"
    )
    picasso = [
        *(peers / "bin" / "picasso", "localize", movie, "-b", 7, "-g", 700, "-d", 0),
        *("-bl", 100, "-s", 0.45, "-ga", 1, "-px", 108),
    ]
    return {
        "picasso-mle": [*picasso, "-a", "mle-spherical"],
        "picasso-lsq": [*picasso, "-a", "lq-spherical"],
        "smappy": [
            *(peers / "bin" / "smappy-fit", movie, out / "smappy.hdf5", "--roisize", 7),
            *("--threads", 1, "--raw-frames", 0, "--camera", camera),
        ],
        "trackpy": [
            *(peers / "bin" / "python", HERE / "peers.py", "whole", "trackpy"),
            *(folder, "bright", out / "trackpy.csv"),
        ],
    }
