"""One writer for each folder, whatever lies under the lock's name."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rotortrack import locks
from rotortrack.errors import LockedError, ResourceError
from rotortrack.locks import is_running, lock_owner, locked

fcntl = pytest.importorskip("fcntl", reason="these tests hold locks in the POSIX way")

GONE = 2**31 - 2
LINE = {
    "host": locks.HOST,
    "pid": GONE,
    "task": "run",
    "started": "2026-03-04T05:06:07+00:00",
    "token": "0123456789abcdef",
}


def leave(folder: Path, **changes: object) -> None:
    """Put a lock file there as a process that was killed leaves it."""
    (folder / "lock").write_text(json.dumps({**LINE, **changes}))


def refusal(folder: Path) -> str:
    with pytest.raises(LockedError) as caught, locked(folder, "motion"):
        pytest.fail("two hold the lock")
    sentence = str(caught.value)
    assert str(folder) in sentence
    assert "\n" not in sentence
    return sentence


@pytest.fixture
def no_flock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Be on a file system without locks."""

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)


@pytest.fixture(params=["flock", "names"])
def either(request: pytest.FixtureRequest) -> str:
    """Test with and without the system's locks."""
    if request.param == "names":
        request.getfixturevalue("no_flock")
    return str(request.param)


@pytest.mark.usefixtures("either")
def test_the_lock_tells_its_owner_and_goes_with_the_block(tmp_path: Path) -> None:
    assert lock_owner(tmp_path) is None
    with locked(tmp_path, "run"):
        said = json.loads((tmp_path / "lock").read_text())
        assert (said["host"], said["pid"], said["task"]) == (locks.HOST, os.getpid(), "run")
        owner = lock_owner(tmp_path)
        assert owner is not None
        assert owner.startswith(f"process {os.getpid()} on {locks.HOST} (run since 20")
    assert list(tmp_path.iterdir()) == []
    assert lock_owner(tmp_path) is None


@pytest.mark.usefixtures("either")
def test_a_second_writer_is_told_who_and_what_to_do(tmp_path: Path) -> None:
    with locked(tmp_path, "run"):
        sentence = refusal(tmp_path)
        assert f"process {os.getpid()} on {locks.HOST} (run since" in sentence
        assert "wait" in sentence
        assert "-o" in sentence
        assert (tmp_path / "lock").exists()
    with locked(tmp_path, "motion"):
        pass


@pytest.mark.usefixtures("either")
@pytest.mark.parametrize("error", [ValueError("boom"), KeyboardInterrupt(), MemoryError()])
def test_the_lock_goes_when_the_work_fails(tmp_path: Path, error: BaseException) -> None:
    def fail() -> None:
        with locked(tmp_path, "run"):
            raise error

    with pytest.raises(type(error)):
        fail()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("either")
def test_two_folders_are_two_locks(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    with locked(tmp_path / "a", "run"), locked(tmp_path / "b", "run"):
        assert "run" in refusal(tmp_path / "a")


@pytest.mark.usefixtures("either")
def test_threads_of_one_process_exclude_each_other(tmp_path: Path) -> None:
    inside, most, done = 0, 0, 0

    def work() -> None:
        nonlocal inside, most, done
        for _ in range(20):
            try:
                with locked(tmp_path, "run"):
                    inside += 1
                    most = max(most, inside)
                    done += 1
                    inside -= 1
            except LockedError:
                continue

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    assert done >= 4
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("started", ["2026-03-04T05:06:07+00:00", "2999-01-01T00:00:00", "soon"])
@pytest.mark.usefixtures("either")
def test_the_lock_of_a_dead_process_is_taken_over_whatever_the_clock(
    tmp_path: Path, started: str
) -> None:
    leave(tmp_path, started=started)
    assert lock_owner(tmp_path) is None
    with locked(tmp_path, "motion"):
        assert json.loads((tmp_path / "lock").read_text())["pid"] == os.getpid()
    assert list(tmp_path.iterdir()) == []


def test_a_reused_process_number_keeps_no_dead_lock_alive(tmp_path: Path) -> None:
    leave(tmp_path, pid=os.getppid())
    assert lock_owner(tmp_path) is None
    with locked(tmp_path, "motion"):
        pass


@pytest.mark.usefixtures("no_flock")
def test_without_locks_a_running_process_is_respected(tmp_path: Path) -> None:
    leave(tmp_path, pid=os.getppid())
    assert f"process {os.getppid()}" in (lock_owner(tmp_path) or "")
    assert f"delete {tmp_path / 'lock'}" in refusal(tmp_path)


@pytest.mark.usefixtures("either")
def test_the_lock_of_another_computer_is_respected(tmp_path: Path) -> None:
    leave(tmp_path, host="far-away")
    sentence = refusal(tmp_path)
    assert f"process {GONE} on far-away (run since 2026-03-04" in sentence
    assert f"delete {tmp_path / 'lock'}" in sentence
    assert "far-away" in (lock_owner(tmp_path) or "")
    (tmp_path / "lock").unlink()
    with locked(tmp_path, "motion"):
        pass


GARBAGE = {
    "empty": b"",
    "torn": json.dumps(LINE).encode()[:40],
    "binary": bytes(range(256)),
    "huge": b"[" * 10_000_000,
    "deep": b"[" * 4000,
    "number": b"7",
    "digits": b'{"pid": ' + b"9" * 4000 + b"}",
    "other keys": b'{"pid": 3, "hostname": "x"}',
    "wrong types": json.dumps({**LINE, "host": 5}).encode(),
    "negative": json.dumps({**LINE, "pid": -1}).encode(),
    "true": json.dumps({**LINE, "pid": True}).encode(),
    "path": json.dumps({**LINE, "token": "../../outside"}).encode(),
    "long": json.dumps({**LINE, "host": "h" * 1000}).encode(),
}


@pytest.mark.parametrize("content", GARBAGE.values(), ids=GARBAGE)
def test_a_lock_file_of_anything_else_holds_nobody_up(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "lock").write_bytes(content)
    assert lock_owner(tmp_path) is None
    with locked(tmp_path, "run"):
        assert json.loads((tmp_path / "lock").read_text())["pid"] == os.getpid()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", GARBAGE.values(), ids=GARBAGE)
@pytest.mark.usefixtures("no_flock")
def test_without_locks_anything_else_may_be_somebodys(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "lock").write_bytes(content)
    assert lock_owner(tmp_path) == "another process"
    assert f"delete {tmp_path / 'lock'}" in refusal(tmp_path)
    assert (tmp_path / "lock").read_bytes() == content


@pytest.mark.parametrize("content", [b"", bytes(range(256))])
def test_a_held_lock_that_says_nothing_is_still_held(tmp_path: Path, content: bytes) -> None:
    with locked(tmp_path, "run"):
        (tmp_path / "lock").write_bytes(content)
        assert "another process" in refusal(tmp_path)
        assert lock_owner(tmp_path) == "another process"


@settings(
    deadline=None,
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    changes=st.dictionaries(
        st.sampled_from([*LINE, "more"]),
        st.one_of(st.text(max_size=100), st.integers(), st.none(), st.floats(), st.booleans()),
    ),
    cut=st.integers(0, 400),
)
@pytest.mark.usefixtures("either")
def test_no_lock_file_makes_locking_or_asking_crash(
    tmp_path: Path, changes: dict[str, Any], cut: int
) -> None:
    (tmp_path / "lock").write_text(json.dumps({**LINE, **changes})[:cut])
    owner = lock_owner(tmp_path)
    try:
        with locked(tmp_path, "run"):
            assert owner is None
    except LockedError:
        assert owner is not None
        (tmp_path / "lock").unlink()


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # the path of a socket must be short
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(path.name)
    os.chdir(here)


def make_link(path: Path) -> None:
    path.with_name("precious").write_text("precious")
    path.symlink_to(path.with_name("precious"))


@pytest.mark.parametrize("make", [Path.mkdir, make_pipe, make_socket, make_link])
def test_something_else_of_that_name_is_told_at_once(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "lock")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(ResourceError, match="nothing else has this name"), locked(tmp_path, "run"):
        pytest.fail("there is no lock")
    assert lock_owner(tmp_path) is None
    assert sorted(tmp_path.iterdir()) == before
    assert all(path.read_text() == "precious" for path in before if path.name == "precious")


def test_a_missing_folder_is_a_resource_error(tmp_path: Path) -> None:
    with pytest.raises(ResourceError, match="No such file"), locked(tmp_path / "absent", "run"):
        pytest.fail("there is no folder")
    assert lock_owner(tmp_path / "absent") is None


@pytest.mark.usefixtures("modes_obeyed")
def test_a_folder_without_permission_is_a_resource_error(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(ResourceError, match="Permission denied"), locked(tmp_path, "run"):
            pytest.fail("the folder may not be written")
        assert lock_owner(tmp_path) is None
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.usefixtures("modes_obeyed")
def test_a_dead_lock_that_may_not_be_written_is_replaced(tmp_path: Path) -> None:
    """It is another user's, in a folder that both may write."""
    leave(tmp_path)
    (tmp_path / "lock").chmod(0o444)
    with locked(tmp_path, "run"):
        assert json.loads((tmp_path / "lock").read_text())["pid"] == os.getpid()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("modes_obeyed")
def test_a_held_lock_that_may_not_be_written_is_respected(tmp_path: Path) -> None:
    with locked(tmp_path, "run"):
        (tmp_path / "lock").chmod(0o444)
        assert f"process {os.getpid()}" in refusal(tmp_path)


def test_a_full_disk_leaves_no_lock(tmp_path: Path) -> None:
    script = """
import resource, sys
from pathlib import Path
from rotortrack.errors import ResourceError
from rotortrack.locks import locked
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
try:
    with locked(Path(sys.argv[1]), "run"):
        print("locked")
except ResourceError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert "lock cannot be written" in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_lock_that_its_owner_removes_meanwhile_is_not_held_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file is opened, then its owner removes it and a third makes a new one of its own."""
    really, calls = locks._try_lock, 0
    first = locked(tmp_path, "run")
    third = locked(tmp_path, "drift")

    def try_lock(descriptor: int, **how: bool) -> bool | None:
        nonlocal calls
        calls += 1
        if calls == 1:
            first.__exit__(None, None, None)
            third.__enter__()
        return really(descriptor, **how)

    first.__enter__()
    monkeypatch.setattr(locks, "_try_lock", try_lock)
    assert "(drift since" in refusal(tmp_path)
    third.__exit__(None, None, None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("no_flock")
def test_without_locks_a_late_successor_does_not_replace_an_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have read the dead lock; the earlier one replaces it before the later one acts."""
    leave(tmp_path)
    really, calls = locks._is_respected, 0
    earlier = locked(tmp_path, "drift")

    def is_respected(*what: Any) -> bool:
        nonlocal calls
        calls += 1
        answer = really(*what)
        if calls == 1:
            earlier.__enter__()
        return answer

    monkeypatch.setattr(locks, "_is_respected", is_respected)
    refusal(tmp_path)
    assert "(drift since" in (lock_owner(tmp_path) or "")
    earlier.__exit__(None, None, None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("no_flock")
def test_without_locks_two_successors_do_not_both_replace_a_dead_lock(tmp_path: Path) -> None:
    """The other one is about to: it has made the file that will take the lock's place."""
    leave(tmp_path)
    (tmp_path / f"lock-{LINE['token']}").write_text("")
    refusal(tmp_path)
    assert json.loads((tmp_path / "lock").read_text()) == LINE


def test_a_lock_that_the_user_deleted_is_not_taken_from_its_new_owner(tmp_path: Path) -> None:
    with locked(tmp_path, "run"):
        (tmp_path / "lock").unlink()
        with locked(tmp_path, "motion"):
            pass
        leave(tmp_path)
    assert json.loads((tmp_path / "lock").read_text()) == LINE


def test_a_deleted_folder_does_no_harm(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    with locked(folder, "run"):
        (folder / "lock").unlink()
        folder.rmdir()
    assert list(tmp_path.iterdir()) == []


def test_asking_who_the_owner_is_holds_nobody_up(tmp_path: Path) -> None:
    """The question itself locks for an instant."""
    leave(tmp_path)
    over = threading.Event()

    def ask() -> None:
        while not over.wait(0.001):
            lock_owner(tmp_path)

    asking = [threading.Thread(target=ask) for _ in range(2)]
    for thread in asking:
        thread.start()
    try:
        for _ in range(100):
            with locked(tmp_path, "run"):
                pass
            leave(tmp_path)
    finally:
        over.set()
        for thread in asking:
            thread.join()


def test_no_process_that_is_started_meanwhile_inherits_the_lock(tmp_path: Path) -> None:
    with locked(tmp_path, "run"):
        sleeper = subprocess.Popen(
            [sys.executable, "-c", "input()"], stdin=subprocess.PIPE, close_fds=False
        )
    try:
        with locked(tmp_path, "motion"):
            pass
    finally:
        sleeper.communicate(b"\n")


def test_running_processes_are_told_from_others() -> None:
    assert is_running(os.getpid())
    assert is_running(1)  # another user's, unless this is root
    assert not is_running(GONE)
    assert not is_running(10**30)
    gone = multiprocessing.get_context("spawn").Process(target=os.getpid)
    gone.start()
    gone.join()
    assert gone.pid is not None
    assert not is_running(gone.pid)
