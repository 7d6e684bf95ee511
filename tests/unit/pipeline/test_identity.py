"""Files are told apart, and hashed as a whole however the hashing is cut up."""

from __future__ import annotations

import hashlib
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import InputError
from rotortrack.pipeline import identity
from rotortrack.pipeline.identity import RunningHash, describe, identify, refuse_changed


@given(
    sizes=st.lists(st.integers(0, 300), min_size=1, max_size=4),
    shares=st.lists(st.floats(0, 1), max_size=6),
)
def test_a_hash_taken_in_pieces_is_the_hash_of_the_file(tmp_path_factory, sizes, shares):
    folder = tmp_path_factory.mktemp("files")
    files = []
    for number, size in enumerate(sizes):
        path = folder / str(number)
        path.write_bytes(bytes((number + i) % 251 for i in range(size)))
        files.append(identify(path))
    running = RunningHash(files)
    for share in shares:
        running.advance(share)
    expected = [hashlib.sha256(file.path.read_bytes()).hexdigest() for file in files]
    assert running.finish() == expected


def test_a_file_beyond_the_edges_is_hashed_in_bounded_chunks(tmp_path, monkeypatch):
    monkeypatch.setattr(identity, "_CHUNK_BYTES", 7)
    path = tmp_path / "movie.tif"
    path.write_bytes(bytes(range(100)))
    running = RunningHash([identify(path)])
    running.advance(0.5)
    assert running.finish() == [hashlib.sha256(path.read_bytes()).hexdigest()]


def test_any_change_of_size_time_or_edges_is_another_file(tmp_path):
    path = tmp_path / "movie.tif"
    path.write_bytes(b"12345")
    first = identify(path)
    refuse_changed([first])
    status = path.stat()
    path.write_bytes(b"12346")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert identify(path).key != first.key
    path.write_bytes(b"12345")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    assert identify(path).key != first.key
    with pytest.raises(InputError, match=r"movie\.tif changed"):
        refuse_changed([first])


def test_a_file_that_shrinks_under_the_hash_is_an_error(tmp_path):
    path = tmp_path / "movie.tif"
    path.write_bytes(bytes(100))
    running = RunningHash([identify(path)])
    path.write_bytes(b"")
    with pytest.raises(InputError, match="shorter"):
        running.finish()


def test_an_input_is_named_from_the_run_folder(tmp_path):
    (tmp_path / "movies").mkdir()
    path = tmp_path / "movies" / "a.tif"
    path.write_bytes(b"12345")
    found = describe(identify(path), tmp_path / "runs" / "one", "abc")
    assert found["path"] == "../../movies/a.tif"
    assert found["bytes"] == 5
    assert found["sha256"] == "abc"
    with pytest.raises(InputError, match=r"none\.tif"):
        identify(tmp_path / "none.tif")
