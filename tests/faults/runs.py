"""Commands in processes of their own that are killed or run out of disk at a chosen moment."""

from __future__ import annotations

import csv
import dataclasses
import functools
import json
import random
import shutil
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

FRAMES = 260
PART_PIXELS = 48 * 64 * 64
"""Parts of 64 frames, so that a short film has several."""

SCALE = ("--pixel-size-nm", "108.3", "--frame-interval-s", "0.002", "--exposure-s", "0.002")
CAMERA = ("--offset-adu", "100", "--gain-e-per-adu", "1", "--read-noise-e", "1")
QUICK = ("--no-figures", "--workers", "1", "--quiet")
Words = Callable[[Path], Sequence[object]]
"""A command on a folder."""

MARK = ".rotortrack-part-"
PATIENCE_S = 120


@dataclasses.dataclass(frozen=True)
class Fault:
    """What happens to a command, and when.

    Attributes
    ----------
    act
        `count` nothing, `signal` a signal is sent, `enospc` a change of the disk fails, `full` all
        further ones fail too.
    at
        Before which change within the folder (0 is the first), unless `function` is given.
    within
        Only changes of files within this folder count.
    signal
        For `signal`; SIGKILL unless told.
    function
        `module:name`, before whose call the signal is sent.
    largest_bytes
        Limit on the size of files.
    """

    act: str = "count"
    at: int = -1
    within: str = ""
    signal: int = signal.SIGKILL
    function: str = ""
    largest_bytes: int = -1


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a command ended; `code` is negative for a signal, `changes` lists what it did on disk."""

    code: int
    out: str
    err: str
    changes: list[str]


class Server:
    """Starts commands in forked processes, one at a time."""

    def __init__(self, scratch: Path) -> None:
        self._scratch = scratch
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("forks.py")), str(scratch)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __call__(self, *words: object, fault: Fault | None = None) -> Ended:
        """Run a command to its end."""
        order = {
            "words": [str(word) for word in words],
            "fault": dataclasses.asdict(fault or Fault()),
        }
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(order), file=self._process.stdin, flush=True)
        return Ended(**json.loads(self._process.stdout.readline()))

    def close(self) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait(timeout=60)
        self._process.stdout.close()


def make_movie(path: Path, frames: int = FRAMES, shape_px: tuple[int, int] = (48, 64)) -> Path:
    """Write a film of four rotors."""
    import numpy as np

    from rotortrack.cameras.camera import Camera
    from rotortrack.movies.write import write_movie
    from rotortrack.simulate.ideal_examples import example_scene
    from rotortrack.simulate.ideal_film import film

    camera = Camera(offset_adu=100.0, gain_e_per_adu=1.0, read_noise_e=1.0)
    kinds = ("driven_ccw", "driven_cw", "brownian", "stuck")
    rng = np.random.default_rng(1)
    scene = example_scene(kinds, rng=rng, shape_px=shape_px, n_frames=frames)
    made = film(scene, camera, np.random.default_rng(2))
    write_movie(path, made.blocks(), shape=made.shape)
    return path


def run_words(movie: Path, target: Path, *more: object) -> tuple[object, ...]:
    return ("run", movie, *SCALE, *CAMERA, "-o", target, *more)


def results(folder: Path) -> dict[str, bytes]:
    """Give the bytes of everything that must not depend on how often a run was stopped."""
    endings = {".parquet", ".csv", ".png"}
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if (path.suffix in endings or path.name == "config.resolved.toml")
        and "parts" not in path.relative_to(folder).parts
    }


def different(folder: Path, other: Path) -> list[str]:
    """Name the results in which two run folders differ."""
    ours, theirs = results(folder), results(other)
    return sorted(
        name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name)
    )


def check_whole(folder: Path) -> list[str]:
    """Read every file that has its final name; fail on a torn one, and give all names."""
    import pyarrow.parquet as pq
    from PIL import Image

    def parquet(path: Path) -> None:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            file.read()

    def image(path: Path) -> None:
        with Image.open(path) as picture:
            picture.load()

    def lines(path: Path) -> None:
        text = path.read_text()
        assert text.endswith("\n") or not text
        for line in text.splitlines():
            assert json.loads(line)["event"]

    def table(path: Path) -> None:
        assert path.read_bytes().endswith(b"\n")
        with path.open(newline="") as stream:
            assert len({len(row) for row in csv.reader(stream, strict=True)}) == 1

    readers: dict[str, Callable[[Path], object]] = {
        ".parquet": parquet,
        ".png": image,
        ".json": lambda path: json.loads(path.read_text()),
        ".jsonl": lines,
        ".csv": table,
        ".toml": lambda path: tomllib.loads(path.read_text()),
    }
    names = []
    for path in sorted(folder.rglob("*")):
        if path.is_dir() or MARK in path.name or path.name == "lock":
            continue
        names.append(path.relative_to(folder).as_posix())
        try:
            readers[path.suffix](path)
        except Exception as error:
            raise AssertionError(f"{path} is torn: {error}") from error
    return names


def leftovers(folder: Path) -> list[str]:
    """Name what only a process at work may have in a run folder."""
    return [
        path.relative_to(folder).as_posix()
        for path in sorted(folder.rglob("*"))
        if MARK in path.name or path.name in ("lock", "commit") or path.name.startswith("lock-")
    ]


def some(moments: Sequence[int], step: int, seed: int) -> list[int]:
    """Choose one of each `step`; 1 chooses all."""
    chance = random.Random(seed)
    return [chance.choice(moments[start : start + step]) for start in range(0, len(moments), step)]


class Bench:
    """A movie and, beside it, undisturbed runs of it to which disturbed ones are compared.

    All lie side by side, as tables name their input as seen from the run folder.
    """

    def __init__(self, root: Path, server: Server) -> None:
        self.root = root
        self.server = server
        self.movie = make_movie(root / "movie.tif")
        self.whole = self.made("whole", self.run)

    @functools.cached_property
    def changed(self) -> Path:
        return self.made("changed", self.run_changed)

    @functools.cached_property
    def rotors(self) -> Path:
        return self.made("rotors", self.run_rotors)

    @functools.cached_property
    def moved(self) -> Path:
        self.copy(self.rotors, "moved")
        return self.made("moved", self.run_motion)

    def made(self, name: str, words: Words) -> Path:
        self.must_work(*words(self.root / name))
        return self.root / name

    def run(self, folder: Path, *more: object, movie: Path | None = None) -> Sequence[object]:
        return run_words(movie or self.movie, folder, *QUICK, *more)

    def run_changed(self, folder: Path) -> Sequence[object]:
        return self.run(folder, "--set", "circle.method=taubin")

    def run_drawing(self, folder: Path) -> Sequence[object]:
        return [word for word in self.run(folder) if word != "--no-figures"]

    def run_rotors(self, folder: Path) -> Sequence[object]:
        table = self.whole / "localisations.parquet"
        return ("rotors", table, "--frame-interval-s", "0.002", "-o", folder, "--quiet")

    def run_motion(self, folder: Path) -> Sequence[object]:
        return ("motion", folder, "--no-figures", "--quiet")

    def must_work(self, *words: object) -> str:
        ended = self.server(*words)
        assert ended.code == 0, ended.err
        return ended.out

    def must_fail(self, code: int, *words: object, fault: Fault | None = None) -> str:
        """Expect an exit code, and give the one sentence that tells why."""
        return self.sentence(self.server(*words, fault=fault), code)

    def sentence(self, ended: Ended, code: int) -> str:
        """Expect that a command has failed with one sentence."""
        assert ended.code == code, ended.err
        said = [line for line in ended.err.splitlines() if ": warning: " not in line]
        assert len(said) == 1, said
        return said[0]

    def copy(self, folder: Path, name: str) -> Path:
        target = self.root / name
        shutil.rmtree(target, ignore_errors=True)
        return Path(shutil.copytree(folder, target))

    def changes(self, words: Words, before: Path | None = None) -> list[str]:
        """List the changes that a command makes, in a new folder or in one like another."""
        folder = self.root / "counted"
        shutil.rmtree(folder, ignore_errors=True)
        if before is not None:
            self.copy(before, "counted")
        return self.changes_in(folder, *words(folder))

    def changes_in(self, folder: Path, *words: object) -> list[str]:
        """Run a command and list its changes within a folder."""
        ended = self.server(*words, fault=Fault(within=str(folder)))
        assert ended.code == 0, ended.err
        return ended.changes

    def stopped(self, words: Words, folder: Path, moment: int, number: int) -> Ended:
        """Send a signal to a command before a change of the disk."""
        return self.server(*words(folder), fault=Fault("signal", moment, str(folder), number))

    def killed(self, name: str, change: str) -> Path:
        """Make a run that was killed before a change."""
        folder = self.root / name
        shutil.rmtree(folder, ignore_errors=True)
        moment = next(i for i, word in enumerate(self.changes(self.run)) if change in word)
        assert self.stopped(self.run, folder, moment, signal.SIGKILL).code == -signal.SIGKILL
        return folder

    def must_end_like(self, expected: Path, words: Words, folder: Path) -> None:
        """Give a command again, and expect the results of one that was never disturbed."""
        self.must_work(*words(folder))
        assert different(folder, expected) == []
        assert leftovers(folder) == []
        check_whole(folder)
        manifest = json.loads((folder / "run.json").read_text())
        assert manifest["state"] == "complete"
        assert "unfinished" not in manifest
