"""Processes that race for one folder, are killed while they hold it, or come from elsewhere."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rotortrack import locks
from rotortrack.errors import LockedError
from rotortrack.locks import lock_owner, locked

if os.name != "posix":
    pytest.skip("these tests kill in the POSIX way", allow_module_level=True)

NO_FLOCK = """
import errno, fcntl
def refuse(*_):
    raise OSError(errno.ENOLCK, "no locks")
fcntl.flock = refuse
"""

RACE = """
import os, random, sys, time
from pathlib import Path
from rotortrack.errors import LockedError
from rotortrack.locks import locked
folder, seed, rounds = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
shuffle = random.Random(seed)
held = refused = 0
print("ready", flush=True)
input()
for _ in range(rounds):
    try:
        with locked(folder, f"racer {seed}"):
            # Only an exclusive holder finds the mark absent and makes it.
            os.close(os.open(folder / "mark", os.O_CREAT | os.O_EXCL))
            with (folder / "ledger").open("a") as ledger:
                ledger.write(f"{seed} in\\n")
                ledger.flush()
                time.sleep(shuffle.random() * 0.002)
                ledger.write(f"{seed} out\\n")
            os.unlink(folder / "mark")
        held += 1
    except LockedError:
        refused += 1
        time.sleep(shuffle.random() * 0.002)
print(held, refused)
"""

HOLD = """
import sys
from pathlib import Path
from rotortrack.locks import locked
with locked(Path(sys.argv[1]), "run"):
    print("held", flush=True)
    input()
"""

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start() -> Iterator[Start]:
    """Start Python on some code and wait for its first line."""
    running: list[subprocess.Popen[str]] = []

    def go(code: str, *arguments: object) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        return process

    yield go
    for process in running:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture(params=["", NO_FLOCK], ids=["flock", "names"])
def before(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Give what processes run first, so that they and this one have the system's locks or not."""
    if request.param:
        monkeypatch.setattr(locks, "_try_lock", lambda *_, **__: None)
    return str(request.param)


def first_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_of_eight_processes_one_holds_the_folder_at_a_time(
    start: Start, tmp_path: Path, before: str
) -> None:
    racers = [start(before + RACE, tmp_path, seed, 60) for seed in range(8)]
    assert [first_line(racer) for racer in racers] == ["ready"] * 8
    for racer in racers:
        assert racer.stdin is not None
        racer.stdin.write("\n")
        racer.stdin.flush()
    counts = []
    for racer in racers:
        out, err = racer.communicate(timeout=120)
        assert racer.returncode == 0, err
        counts.append([int(word) for word in out.split()])
    held = sum(count[0] for count in counts)
    assert held + sum(count[1] for count in counts) == 8 * 60
    assert held >= 8
    lines = (tmp_path / "ledger").read_text().splitlines()
    assert len(lines) == 2 * held
    for entered, left in zip(lines[::2], lines[1::2], strict=True):
        assert entered.split() == [left.split()[0], "in"]
        assert left.endswith("out")
    assert [path.name for path in tmp_path.iterdir()] == ["ledger"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_lock_of_a_killed_process_is_taken_over(
    start: Start, tmp_path: Path, before: str, number: int
) -> None:
    holder = start(before + HOLD, tmp_path)
    assert first_line(holder) == "held"
    assert f"process {holder.pid} on " in (lock_owner(tmp_path) or "")
    with pytest.raises(LockedError, match=f"process {holder.pid} on "), locked(tmp_path, "motion"):
        pytest.fail("two hold the lock")
    holder.send_signal(number)
    holder.wait(timeout=30)
    assert (tmp_path / "lock").exists()
    assert lock_owner(tmp_path) is None
    successor = start(before + HOLD, tmp_path)
    assert first_line(successor) == "held"
    assert f"process {successor.pid} on " in (lock_owner(tmp_path) or "")
    successor.communicate("\n", timeout=30)
    assert list(tmp_path.iterdir()) == []


def test_of_several_successors_one_takes_a_dead_lock_over(
    start: Start, tmp_path: Path, before: str
) -> None:
    for _ in range(3):
        holder = start(before + HOLD, tmp_path)
        assert first_line(holder) == "held"
        holder.kill()
        holder.wait()
        heirs = [start(before + HOLD, tmp_path) for _ in range(4)]
        winners = [heir for heir in heirs if first_line(heir) == "held"]
        assert len(winners) == 1
        assert f"process {winners[0].pid} on " in (lock_owner(tmp_path) or "")
        for heir in heirs:
            _, err = heir.communicate("\n", timeout=30)
            assert heir in winners or "LockedError" in err
        assert list(tmp_path.iterdir()) == []


def test_a_stopped_process_keeps_its_lock(start: Start, tmp_path: Path) -> None:
    """A laptop that sleeps, or Ctrl-Z: it will go on."""
    holder = start(HOLD, tmp_path)
    assert first_line(holder) == "held"
    holder.send_signal(signal.SIGSTOP)
    time.sleep(0.05)
    try:
        with pytest.raises(LockedError), locked(tmp_path, "motion"):
            pytest.fail("two hold the lock")
    finally:
        holder.send_signal(signal.SIGCONT)
    holder.communicate("\n", timeout=30)
    with locked(tmp_path, "motion"):
        pass


def test_readers_are_never_kept_waiting(start: Start, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    holder = start(HOLD, tmp_path)
    assert first_line(holder) == "held"
    assert (tmp_path / "run.json").read_text() == "{}"
    assert f'"pid": {holder.pid}' in (tmp_path / "lock").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lock", "run.json"]


def test_a_lock_that_the_system_did_not_give_is_respected_where_it_would(
    start: Start, tmp_path: Path
) -> None:
    """The system may be short of locks for one process and not for the next."""
    holder = start(NO_FLOCK + HOLD, tmp_path)
    assert first_line(holder) == "held"
    assert f"process {holder.pid} on " in (lock_owner(tmp_path) or "")
    with pytest.raises(LockedError), locked(tmp_path, "motion"):
        pytest.fail("two hold the lock")
    holder.kill()
    holder.wait()
    with locked(tmp_path, "motion"):
        pass
    assert list(tmp_path.iterdir()) == []
