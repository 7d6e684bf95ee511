"""A file appears whole under its name, or not at all."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rotortrack.errors import ResourceError
from rotortrack.files import atomic_path, write_text


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


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)
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
