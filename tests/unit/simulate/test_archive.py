import zipfile

import numpy as np
import pytest

from rotortrack.errors import ArchiveError
from rotortrack.simulate.archive import read_archive, write_archive

DIMENSIONS = {"values": 2}


def written(path, **arrays):
    write_archive(path, {"values": np.arange(6.0).reshape(2, 3), **arrays}, {"kind": "test"})
    return path


def test_what_was_written_is_read(tmp_path):
    arrays, about = read_archive(written(tmp_path / "a.npz"), "a test", DIMENSIONS)
    np.testing.assert_array_equal(arrays["values"], np.arange(6.0).reshape(2, 3))
    assert arrays["values"].flags.c_contiguous
    assert about == {"kind": "test"}


def test_pickled_objects_are_never_loaded(tmp_path):
    path = tmp_path / "evil.npz"
    np.savez(path, values=np.array([[{"a": 1}]], dtype=object), about=np.array("{}"))
    with pytest.raises(ArchiveError, match=r"evil\.npz.*a test"):
        read_archive(path, "a test", DIMENSIONS)


@pytest.mark.parametrize(
    "arrays",
    [
        {},
        {"values": np.zeros(3), "about": np.array("{}")},
        {"values": np.array([["x"]]), "about": np.array("{}")},
        {"values": np.zeros((1, 1)), "about": np.array("[]")},
        {"values": np.zeros((1, 1)), "about": np.array("{")},
        {"values": np.zeros((1, 1), dtype=complex), "about": np.array("{}")},
    ],
)
def test_archives_of_other_things_are_refused(tmp_path, arrays):
    path = tmp_path / "other.npz"
    np.savez(path, **arrays)
    with pytest.raises(ArchiveError, match=r"other\.npz"):
        read_archive(path, "a test", DIMENSIONS)


def test_damaged_missing_and_foreign_files_are_refused(tmp_path):
    whole = written(tmp_path / "a.npz").read_bytes()
    for name, content in {
        "short.npz": whole[: len(whole) // 2],
        "text.npz": b"not an archive",
        "empty.npz": b"",
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ArchiveError, match=name):
            read_archive(tmp_path / name, "a test", DIMENSIONS)
    for path in (tmp_path / "missing.npz", tmp_path):
        with pytest.raises(ArchiveError, match="a test"):
            read_archive(path, "a test", DIMENSIONS)


def test_array_larger_than_memory_is_refused_unread(tmp_path, monkeypatch):
    path = written(tmp_path / "a.npz", values=np.zeros((1000, 1000)))
    assert zipfile.ZipFile(path).getinfo("values.npy").compress_size < 100_000
    monkeypatch.setattr("rotortrack.simulate.archive.LARGEST_BYTES", 1_000_000)
    with pytest.raises(ArchiveError, match="GB"):
        read_archive(path, "a test", DIMENSIONS)
