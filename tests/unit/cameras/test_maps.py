"""Camera maps that come from anybody."""

from __future__ import annotations

import io
import os
import pickle
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotortrack.cameras.camera import camera_from_options
from rotortrack.cameras.maps import read_arrays, read_provenance, write_maps
from rotortrack.cameras.options import CameraOptions
from rotortrack.errors import CameraError

NAMES = ("offset_adu", "gain_e_per_adu", "read_noise_e")


class Bomb:
    """Leaves a folder behind when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (str(self.trace),)


def archive(path: Path, content: bytes, name: str = "offset_adu.npy") -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(name, content)
    return path


def array(header: str, data: bytes = b"") -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x02\x00" + len(text).to_bytes(4, "little") + text + data


def refused(path: Path) -> str:
    with pytest.raises(CameraError) as caught:
        read_arrays(path, NAMES)
    sentence = str(caught.value)
    assert str(path) in sentence
    assert sentence.isprintable()
    return sentence


def test_arrays_by_name_come_back_as_float64(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    for save in (np.savez, np.savez_compressed):
        save(path, offset_adu=np.float32([[1, 2]]), gain_e_per_adu=np.int16(3), other=["text"])
        maps = read_arrays(path, NAMES)
        assert list(maps) == ["offset_adu", "gain_e_per_adu"]
        assert maps["offset_adu"].dtype == np.float64
        assert maps["offset_adu"].tolist() == [[1, 2]]
        assert maps["gain_e_per_adu"] == 3


def test_a_pickle_is_never_loaded(tmp_path: Path) -> None:
    path, trace = tmp_path / "camera.npz", tmp_path / "trace"
    objects = io.BytesIO()
    np.save(objects, np.array([Bomb(trace)], dtype=object), allow_pickle=True)
    archive(path, objects.getvalue())
    refused(path)
    archive(path, pickle.dumps(Bomb(trace)))
    refused(path)
    path.write_bytes(pickle.dumps(Bomb(trace)))
    refused(path)
    assert not trace.exists()


def test_what_an_array_declares_is_weighed_before_it_is_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file,
        file.open("offset_adu.npy", "w", force_zip64=True) as stream,
    ):
        for _ in range(60):
            stream.write(bytes(10_000_000))
    assert path.stat().st_size < 1e6
    tracemalloc.start()
    assert "more than a map of 64 megapixels: cut it" in refused(path)
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    "content",
    [
        array("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }"),
        array("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }"),
        array("{'descr': '<f8', 'fortran_order': False, 'shape': (9, 9), }", b"\0" * 8),
        array("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", b"\0" * 8),
        array("{'descr': '|V9', 'fortran_order': False, 'shape': (1,), }", b"\0" * 9),
        array("(" * 5000),
        array("9" * 5000),
        array("\x1b[31m"),
        b"",
        b"\x93NUMPY\x09\x00",
    ],
)
def test_an_array_that_is_none_is_refused(tmp_path: Path, content: bytes) -> None:
    refused(archive(tmp_path / "camera.npz", content))


def test_what_is_no_file_is_refused_without_waiting(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.npz"
    os.mkfifo(pipe)
    assert "is not a file" in refused(pipe)
    assert "is not a file" in refused(tmp_path)
    assert "cannot be read" in refused(tmp_path / "absent.npz")


def test_any_changed_byte_or_cut_reads_or_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    rng = np.random.default_rng(12)
    np.savez(path, **{name: rng.uniform(1, 2, (9, 9)) for name in NAMES})
    whole = path.read_bytes()
    read = 0
    for _ in range(400):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged[: rng.integers(len(whole) // 2, 2 * len(whole))])
        try:
            maps = read_arrays(path, NAMES)
        except CameraError:
            continue
        read += 1
        # The archive's checksums leave only damage outside the arrays.
        assert all(value.min() >= 1 and value.max() <= 2 for value in maps.values())
    assert read < 200


def test_impossible_values_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    good = np.ones((4, 5))
    for bad in (1e200, np.nan, -1.0, 0.0):
        wrong = good.copy()
        wrong[2, 3] = bad
        np.savez(path, offset_adu=good, gain_e_per_adu=wrong, read_noise_e=good)
        with pytest.raises(CameraError, match=r"camera\.npz: gain_e_per_adu is .* row 2, column 3"):
            camera_from_options(CameraOptions(camera_maps=str(path)))


def test_written_maps_and_how_they_were_made_come_back(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    made = {"command": "calibrate", "inputs": [{"path": "dårk.tif"}]}
    write_maps(path, {"offset_adu": values, "hot_pixels": values > 4}, made)
    found = read_arrays(path, ("offset_adu", "hot_pixels"), masks=("hot_pixels",))
    np.testing.assert_array_equal(found["offset_adu"], values)
    assert found["hot_pixels"].tolist() == [[0, 0, 0], [0, 0, 1]]
    assert read_provenance(path) == made
    assert list(tmp_path.iterdir()) == [path]
    before = path.read_bytes()
    write_maps(path, {"offset_adu": values, "hot_pixels": values > 4}, made)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "text", ["", "[1]", "{", "[" * 50_000, '{"a":' * 5000, "1e999", "NaN", "\ud800"]
)
def test_a_record_that_is_none_says_nothing(tmp_path: Path, text: str) -> None:
    path = tmp_path / "camera.npz"
    np.savez(path, provenance=np.array(text))
    assert read_provenance(path) == {}
    np.savez(path, provenance=np.array(["a" * 2_000_000] * 2))
    assert read_provenance(path) == {}
    np.savez(path, offset_adu=1.0)
    assert read_provenance(path) == {}


def test_a_record_that_is_a_pickle_is_not_loaded(tmp_path: Path) -> None:
    path, trace = tmp_path / "camera.npz", tmp_path / "trace"
    objects = io.BytesIO()
    np.save(objects, np.array([Bomb(trace)], dtype=object), allow_pickle=True)
    archive(path, objects.getvalue(), "provenance.npy")
    assert read_provenance(path) == {}
    assert not trace.exists()
