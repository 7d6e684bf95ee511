"""Reads damaged files by the hundred in a child process and judges what came of each.

A case is a task (`library` or a command), a kind of seed and a number; `python fuzzer.py library
zlib 17` repeats one and says what happened.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib.util
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import FrameType

import numpy as np

LIMIT_S = 5.0
LIMIT_BYTES = 500 * 2**20
_ADDRESS_BYTES = 3 * 2**30


_SPEC = importlib.util.spec_from_file_location("readers", Path(__file__).with_name("readers.py"))
readers = importlib.util.module_from_spec(_SPEC)
sys.modules["readers"] = readers
_SPEC.loader.exec_module(readers)
corpus, damage = readers.corpus, readers.damage


@dataclass(frozen=True)
class Outcome:
    """What came of one case.

    Attributes
    ----------
    task, kind, number
        The case.
    way
        How the file was damaged.
    end
        `read`, `refused`, or what went wrong.
    text
        The refusal, or the details of what went wrong.
    seconds, grown_bytes
        Time taken, and peak memory of the child so far beyond that of reading the whole seeds.
    """

    task: str
    kind: str
    number: int
    way: str = ""
    end: str = "lost"
    text: str = ""
    seconds: float = 0.0
    grown_bytes: int = 0

    @property
    def is_fault(self) -> bool:
        """Whether the program may not end so."""
        return self.end not in ("read", "refused")


class TooSlowError(BaseException):
    """The time of a case is over; nothing but the judge catches it."""


def damaged(kind: str, number: int) -> tuple[str, dict[str, bytes]]:
    """Make the files of a case; number 0 is the whole seed."""
    seed = corpus.seed_of(kind)
    files = dict(seed.files)
    if number == 0:
        return "none", files
    rng = np.random.default_rng([number, *kind.encode()])
    names = list(files)
    name = names[rng.integers(len(names))] if rng.random() < 0.5 else names[0]
    if len(names) > 1 and rng.random() < 0.03:
        del files[name]
        return f"loss of {name}", files
    way, files[name] = damage.damage(name, files[name], rng)
    return f"{way} in {name}", files


def judge(task: str, kind: str, number: int, folder: Path) -> Outcome:
    """Make the files of a case in `folder`, read them, and judge how that ended."""
    outcome = Outcome(task, kind, number)
    way, files = damaged(kind, number)
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    case = readers.Case(corpus.seed_of(kind), files, folder, number)
    start = time.perf_counter()
    try:
        with _time_limit() if number else contextlib.nullcontext():
            if task == "library":
                end, text = readers.through_library(case)
            else:
                end, text = readers.through_command(task, case)
    except TooSlowError:
        end, text = "too slow", traceback.format_exc(limit=-6)
    except readers.WrongError as error:
        end, text = "wrong", str(error)
    except Exception:  # noqa: BLE001 - whatever it is, it is a fault
        end, text = "traceback", traceback.format_exc(limit=-6)
    seconds = time.perf_counter() - start
    if number and seconds > LIMIT_S:
        end = "too slow"
    return replace(outcome, way=way, end=end, text=text, seconds=seconds)


@contextlib.contextmanager
def _time_limit() -> Iterator[None]:
    """Raise after the limit, and end the process soon after if that does not help."""

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise TooSlowError

    faulthandler.dump_traceback_later(2 * LIMIT_S, exit=True)
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        faulthandler.cancel_dump_traceback_later()


def main() -> None:
    """Judge the cases given on stdin as JSON lines, one line of JSON each."""
    results = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    cases = [json.loads(line) for line in sys.stdin]
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        for task, kind in dict.fromkeys((task, kind) for task, kind, _ in cases):
            # Everything is loaded and compiled before time and memory are measured.
            with _folder(Path(name)) as folder:
                results.write(json.dumps(asdict(judge(task, kind, 0, folder))) + "\n")
        used = _status("VmSize:")
        resource.setrlimit(resource.RLIMIT_AS, (used + _ADDRESS_BYTES,) * 2)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for task, kind, number in cases:
            results.write(json.dumps([task, kind, number]) + "\n")
            with _folder(Path(name)) as folder:
                outcome = judge(task, kind, number, folder)
            grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
            results.write(json.dumps(asdict(replace(outcome, grown_bytes=grown))) + "\n")


@contextlib.contextmanager
def _folder(parent: Path) -> Iterator[Path]:
    folder = parent / "case"
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def _status(key: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024
    raise KeyError(key)


def run_cases(cases: Sequence[tuple[str, str, int]]) -> tuple[list[Outcome], list[Outcome]]:
    """Judge cases in child processes; a child that dies is a fault of its case.

    Returns
    -------
    list of Outcome, list of Outcome
        Those of the whole seeds, and those of the cases.
    """
    whole: dict[tuple[str, str], Outcome] = {}
    outcomes: list[Outcome] = []
    while len(outcomes) < len(cases):
        rest = cases[len(outcomes) :]
        text = "".join(json.dumps(case) + "\n" for case in rest)
        done = subprocess.run(
            [sys.executable, __file__], input=text, capture_output=True, text=True, check=False
        )
        begun = None
        for line in map(json.loads, done.stdout.splitlines()):
            if isinstance(line, list):
                begun = Outcome(*line)
                continue
            outcome = Outcome(**line)
            if outcome.number == 0:
                whole[outcome.task, outcome.kind] = outcome
            else:
                outcomes.append(outcome)
                begun = None
        if begun is not None:
            lost = f"the process ended with {done.returncode}: {done.stderr[-3000:]}"
            outcomes.append(replace(begun, way=damaged(begun.kind, begun.number)[0], text=lost))
        elif len(outcomes) < len(cases):
            raise RuntimeError(f"the child gave up: {done.stderr[-3000:]}")
    return [*whole.values()], outcomes


if __name__ == "__main__":
    if len(sys.argv) == 4:
        print(*run_cases([(sys.argv[1], sys.argv[2], int(sys.argv[3]))])[1], sep="\n")
    else:
        main()
