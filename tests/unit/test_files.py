"""A file appears whole under its name, or not at all."""

from __future__ import annotations

import errno
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack import files
from rotortrack.errors import ResourceError
from rotortrack.files import TEMPORARY_MARK, atomic_path, make_folder, sweep, write_text

DAY_S = 86_400.0


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_file_appears_on_success_with_its_folders(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "table.csv"
    with atomic_path(path) as temporary:
        temporary.write_text("new")
        assert not path.exists()
        assert temporary.parent == path.parent
        assert temporary.suffix == ".csv"
    assert path.read_text() == "new"
    assert names(path.parent) == ["table.csv"]


@pytest.mark.parametrize("error", [ValueError("boom"), KeyboardInterrupt(), MemoryError()])
def test_a_failing_block_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: BaseException
) -> None:
    path = tmp_path / "table.csv"
    path.write_text("old")

    def write_half() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(type(error)):
        write_half()
    assert path.read_text() == "old"
    assert names(tmp_path) == ["table.csv"]


def test_two_writers_of_one_name_do_not_share_a_temporary_file(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    with atomic_path(path) as first, atomic_path(path) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"
    assert names(tmp_path) == ["table.csv"]


def test_a_file_in_place_of_the_folder_is_a_resource_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    with pytest.raises(ResourceError, match=r"table\.csv cannot be written"):
        write_text(tmp_path / "file" / "table.csv", "new")
    with pytest.raises(ResourceError, match="cannot be written"):
        write_text(tmp_path / "file" / "deeper" / "table.csv", "new")
    assert names(tmp_path) == ["file"]


def test_a_folder_in_place_of_the_file_is_a_resource_error(tmp_path: Path) -> None:
    (tmp_path / "table.csv").mkdir()
    with pytest.raises(ResourceError, match="cannot be written"):
        write_text(tmp_path / "table.csv", "new")
    assert names(tmp_path) == ["table.csv"]


@pytest.mark.usefixtures("modes_obeyed")
def test_a_folder_without_permission_is_a_resource_error(tmp_path: Path) -> None:
    folder = tmp_path / "closed"
    folder.mkdir()
    folder.chmod(0o500)
    with pytest.raises(ResourceError, match="cannot be written"):
        write_text(folder / "table.csv", "new")


def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    pytest.importorskip("resource", reason="file size limits exist on POSIX only")
    path = tmp_path / "table.csv"
    path.write_text("old")
    script = """
import resource, sys
from pathlib import Path
from rotortrack.errors import ResourceError
from rotortrack.files import write_text
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    write_text(Path(sys.argv[1]), "x" * 100_000)
except ResourceError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
    )
    assert "cannot be written" in done.stdout
    assert path.read_text() == "old"
    assert names(tmp_path) == ["table.csv"]


def test_a_failure_about_another_file_keeps_its_name(tmp_path: Path) -> None:
    """A source that cannot be read is not blamed on the target."""
    source = tmp_path / "source"
    error = PermissionError(errno.EACCES, "Permission denied", str(source))
    with pytest.raises(PermissionError) as caught, atomic_path(tmp_path / "target"):
        raise error
    assert caught.value.filename == str(source)


def test_text_is_utf8_whatever_the_locale(tmp_path: Path) -> None:
    write_text(tmp_path / "note.txt", "5 µm → λ\n")
    assert (tmp_path / "note.txt").read_bytes() == "5 µm → λ\n".encode()


def test_a_link_is_replaced_and_what_it_points_to_left_alone(tmp_path: Path) -> None:
    outside, inside = tmp_path / "outside", tmp_path / "inside"
    outside.mkdir()
    inside.mkdir()
    (outside / "mine").write_text("precious")
    (inside / "table.csv").symlink_to(outside / "mine")
    (inside / "dangling.csv").symlink_to(tmp_path / "nowhere")
    write_text(inside / "table.csv", "new")
    write_text(inside / "dangling.csv", "new")
    assert (outside / "mine").read_text() == "precious"
    assert [path.is_symlink() for path in sorted(inside.iterdir())] == [False, False]
    assert names(inside) == ["dangling.csv", "table.csv"]
    assert not (tmp_path / "nowhere").exists()


def test_a_folder_that_is_a_link_is_written_into(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real", target_is_directory=True)
    write_text(tmp_path / "link" / "table.csv", "new")
    assert names(tmp_path / "real") == ["table.csv"]


def test_a_folder_in_place_of_the_file_is_said_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "table.csv").mkdir()
    with pytest.raises(ResourceError, match="directory"), atomic_path(tmp_path / "table.csv"):
        pytest.fail("the work was begun")


def test_a_folder_that_vanishes_meanwhile_is_a_resource_error(tmp_path: Path) -> None:
    folder = tmp_path / "results"

    def write() -> None:
        with atomic_path(folder / "table.csv") as temporary:
            shutil.rmtree(folder)
            temporary.write_text("new")

    with pytest.raises(ResourceError, match=r"table\.csv cannot be written"):
        write()


@pytest.mark.parametrize("name", ["x" * 250 + ".csv", "µ" * 120 + ".parquet", ".hidden", "a.b.c"])
def test_any_name_that_the_system_takes_can_be_written(tmp_path: Path, name: str) -> None:
    write_text(tmp_path / name, "new")
    assert names(tmp_path) == [name]


def leave_behind(path: Path) -> None:
    """Be killed in the middle of a write."""
    with atomic_path(path) as temporary:
        temporary.write_text("half")
        os.kill(os.getpid(), signal.SIGKILL)


def test_sweep_removes_what_a_killed_process_left(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    killed = context.Process(target=leave_behind, args=(tmp_path / "table.parquet",))
    killed.start()
    killed.join()
    (tmp_path / "other.csv").write_text("mine")
    (leftover,) = (path for path in tmp_path.iterdir() if TEMPORARY_MARK in path.name)
    assert leftover.suffix == ".parquet"
    assert sweep(tmp_path) == 1
    assert names(tmp_path) == ["other.csv"]
    assert sweep(tmp_path) == 0


def test_sweep_leaves_a_write_under_way_alone(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "table.csv") as temporary:
        temporary.write_text("new")
        os.utime(temporary, (0, 0))
        assert sweep(tmp_path) == 0
    assert (tmp_path / "table.csv").read_text() == "new"


HERE = files._HOST_MARK
RUNNING, GONE = os.getppid(), 2**31 - 2


@pytest.mark.parametrize(
    ("host", "pid", "days", "swept"),
    [
        (HERE, GONE, 0, True),
        (HERE, GONE, -400, True),
        (HERE, RUNNING, 0, False),
        (HERE, RUNNING, -400, False),
        (HERE, RUNNING, 4, True),
        (HERE, os.getpid(), 0, True),
        (HERE, 10**9 * 9, 0, True),
        ("00000000", GONE, 2.9, False),
        ("00000000", GONE, -400, False),
        ("00000000", RUNNING, 3.1, True),
    ],
    ids=[
        "gone",
        "gone, clock wrong",
        "runs",
        "runs, clock wrong",
        "runs, old",
        "own",
        "no such",
        "elsewhere, young",
        "elsewhere, clock wrong",
        "elsewhere, old",
    ],
)
def test_sweep_goes_by_process_here_and_by_age_elsewhere(
    tmp_path: Path, host: str, pid: int, days: float, swept: bool
) -> None:
    """A clock that was set back makes files look younger, which never costs a live write."""
    path = tmp_path / f"table{TEMPORARY_MARK}{host}-{pid}-0123abcd-7.csv"
    path.write_text("half")
    then = time.time() - days * DAY_S
    os.utime(path, (then, then))
    assert sweep(tmp_path) == int(swept)
    assert path.exists() is not swept


def test_sweep_touches_files_of_its_own_folder_only(tmp_path: Path) -> None:
    mark = f"{TEMPORARY_MARK}{HERE}-{GONE}-0123abcd-0"
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / f"a{mark}.csv").write_text("half")
    (tmp_path / f"folder{mark}").mkdir()
    (tmp_path / "mine").write_text("mine")
    (tmp_path / f"link{mark}.csv").symlink_to(tmp_path / "mine")
    before = names(tmp_path)
    assert sweep(tmp_path) == 0
    assert names(tmp_path) == before
    assert names(tmp_path / "folder") == [f"a{mark}.csv"]


@pytest.mark.usefixtures("modes_obeyed")
def test_sweep_never_fails(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert sweep(tmp_path / "absent") == 0
    assert sweep(tmp_path / "file") == 0
    closed = tmp_path / "closed"
    closed.mkdir()
    leftover = closed / f"a{TEMPORARY_MARK}{HERE}-{GONE}-0123abcd-0.csv"
    leftover.write_text("half")
    closed.chmod(0o500)
    assert sweep(closed) == 0
    assert leftover.exists()
    closed.chmod(0)
    assert sweep(closed) == 0
    closed.chmod(0o700)


@settings(deadline=None, max_examples=200)
@given(name=st.text("ab0.-\n µ", min_size=1))
def test_a_name_that_is_not_of_this_form_is_never_swept(name: str) -> None:
    assert files._LEFTOVER.fullmatch(name) is None
    assert files._LEFTOVER.fullmatch(f"{name}{TEMPORARY_MARK}{name}") is None
    own = files._temporary(Path("folder") / f"x{name}").name
    assert files._LEFTOVER.fullmatch(own) is not None


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ResourceError, match=r"cannot be made a folder .* with -o"):
        make_folder(tmp_path / "file" / "below")
