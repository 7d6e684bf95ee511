"""Damaged, foreign and malicious table files: one sentence and nothing half-written."""

from __future__ import annotations

import gzip
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from rotortrack.errors import TableError
from rotortrack.exchange.csv import read_csv
from rotortrack.exchange.tables import (
    TableInfo,
    convert,
    read_info,
    read_localisations,
    write_localisations,
)
from rotortrack.tables import ROTORS

ENDINGS = ["parquet", "csv", "csv.gz", "hdf5"]
SPOTS = pd.DataFrame(
    {"frame": np.arange(9000), "x_nm": np.linspace(0, 9e3, 9000) ** 1.1, "y_nm": np.ones(9000)}
)


class Bomb:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (str(self.trace),)


def refused(path: Path, match: str = ".", **options: float) -> None:
    with pytest.raises(TableError, match=match) as caught:
        read_localisations(path, **options)
    assert caught.value.exit_code == 3
    sentence = str(caught.value)
    assert path.stem.split(".")[0] in sentence
    assert "\n" not in sentence
    assert len(sentence) < 700


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(
    "content",
    [b"", b"just a note\n", b"\0" * 4096, bytes(range(256)) * 64, b'"' * 9999, b"PAR1" * 20],
    ids=["empty", "text", "zeros", "bytes", "quotes", "magic"],
)
def test_another_kind_of_file_renamed_is_refused(
    tmp_path: Path, ending: str, content: bytes
) -> None:
    path = tmp_path / f"table.{ending}"
    path.write_bytes(content)
    refused(path, **({"pixel_size_nm": 100.0} if ending == "hdf5" else {}))


@pytest.mark.parametrize("ending", ["parquet", "csv.gz", "hdf5"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_file_cut_short_is_refused(tmp_path: Path, ending: str, share: float) -> None:
    path = tmp_path / f"table.{ending}"
    write_localisations(path, SPOTS, TableInfo(100.0))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refused(path)


@pytest.mark.parametrize("ending", ["parquet", "hdf5"])
def test_flipped_bytes_raise_one_error_or_read_rows(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"table.{ending}"
    write_localisations(path, SPOTS, TableInfo(100.0))
    whole = np.frombuffer(path.read_bytes(), np.uint8)
    rng = np.random.default_rng(11)
    failures = 0
    for _ in range(60):
        damaged = whole.copy()
        damaged[rng.integers(0, len(whole), 3)] ^= rng.integers(1, 256, 3, dtype=np.uint8)
        path.write_bytes(damaged.tobytes())
        try:
            read_localisations(path)
        except TableError:
            failures += 1
    # Checksums of pages and chunks catch what would else be read as other numbers.
    assert failures >= 50


def test_what_is_not_a_file_is_refused_without_waiting(tmp_path: Path) -> None:
    refused(tmp_path / "absent.parquet", "does not exist")
    for ending in ENDINGS:
        folder = tmp_path / f"folder.{ending}"
        folder.mkdir()
        refused(folder, "is not a file")
        pipe = tmp_path / f"pipe.{ending}"
        os.mkfifo(pipe)
        refused(pipe, "is not a file")
        with pytest.raises(TableError, match="is not a file"):
            read_info(pipe)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_pickle_is_never_loaded(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"table.{ending}"
    path.write_bytes(pickle.dumps(Bomb(tmp_path / "trace")))
    refused(path, **({"pixel_size_nm": 100.0} if ending == "hdf5" else {}))
    assert not (tmp_path / "trace").exists()


def test_pickled_cells_in_an_hdf5_table_are_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "table.hdf5"
    pickled = np.void(pickle.dumps(Bomb(tmp_path / "trace")))
    rows = np.zeros(2, [("frame", "u4"), ("x", "f4"), ("y", "f4"), ("o", pickled.dtype)])
    rows["o"] = pickled
    with h5py.File(path, "w") as file:
        file["locs"] = rows
    assert list(read_localisations(path, pixel_size_nm=100).columns) == ["frame", "x_nm", "y_nm"]
    assert not (tmp_path / "trace").exists()


def hdf5(path: Path, **datasets: object) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            file[name] = values
    return path


def test_hdf5_without_a_fitting_table_says_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "table.hdf5"
    size = {"pixel_size_nm": 100.0}
    refused(hdf5(path), "it holds nothing", **size)
    refused(hdf5(path, clusters=np.zeros(3)), "it holds 'clusters'", **size)
    refused(hdf5(path, locs=np.zeros(3)), "no named columns", **size)
    refused(hdf5(path, locs=np.zeros(3, [("frame", "u4"), ("x", "f4")])), "lacks y", **size)
    text = np.zeros(3, [("frame", "u4"), ("x", "S4"), ("y", "f4")])
    refused(hdf5(path, locs=text), r"column\(s\) x of locs are not numbers", **size)
    frames = np.array([(0.5, 1, 1)], [("frame", "f4"), ("x", "f4"), ("y", "f4")])
    refused(hdf5(path, locs=frames), "not whole numbers", **size)
    refused(hdf5(path, locs=h5py.SoftLink("/locs")), "no Picasso table", **size)


def test_hdf5_may_not_reach_into_other_files(tmp_path: Path) -> None:
    rows = np.zeros(3, [("frame", "u4"), ("x", "f4"), ("y", "f4")])
    hdf5(tmp_path / "secret.hdf5", locs=rows)
    path = hdf5(tmp_path / "table.hdf5", locs=h5py.ExternalLink("secret.hdf5", "/locs"))
    refused(path, "no Picasso table", pixel_size_nm=100)
    with h5py.File(path, "w") as file:
        file.create_dataset("locs", (3,), rows.dtype, external=[("secret.hdf5", 0, 36)])
    refused(path, "lies in other files", pixel_size_nm=100)


def test_hdf5_that_declares_rows_it_does_not_hold_is_refused_before_reading(
    tmp_path: Path,
) -> None:
    path = tmp_path / "table.hdf5"
    kind = np.dtype([("frame", "u4"), ("x", "f4"), ("y", "f4")])
    with h5py.File(path, "w") as file:
        file.create_dataset("locs", (10**12,), kind, chunks=(1000,))
    refused(path, "declares 1000000000000 rows", pixel_size_nm=100)


@pytest.mark.parametrize(
    "text",
    [
        "!!python/object/apply:os.mkdir [{trace}]",
        "Pixelsize: !!python/object/apply:os.mkdir [{trace}]",
        "a: &a {{x: 1}}\nb:\n  <<: [*a, *a]\nPixelsize: 100",
        "[" * 2000,
        "a: [1",
        "\x00",
        "Pixelsize: " + "9" * 5000,
    ],
    ids=["tag", "nested tag", "merge", "deep", "open", "nul", "long integer"],
)
def test_a_sidecar_that_is_not_plain_yaml_is_refused_unexecuted(tmp_path: Path, text: str) -> None:
    path = tmp_path / "table.hdf5"
    write_localisations(path, SPOTS, TableInfo(100.0))
    path.with_suffix(".yaml").write_text(
        text.format(trace=tmp_path / "trace") if "{" in text else text
    )
    refused(path, "cannot be read as plain YAML")
    with pytest.raises(TableError, match="cannot be read as plain YAML"):
        read_info(path)
    assert not (tmp_path / "trace").exists()


def test_a_sidecar_of_references_to_references_stays_small(tmp_path: Path) -> None:
    path = tmp_path / "table.hdf5"
    write_localisations(path, SPOTS, TableInfo(100.0))
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    path.with_suffix(".yaml").write_text("\n".join([*levels, "Pixelsize: 100"]))
    assert convert(path, tmp_path / "out.parquet") == 9000
    assert (tmp_path / "out.parquet").stat().st_size < 1e6


def test_metadata_of_a_foreign_parquet_that_is_no_json_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    write_localisations(path, SPOTS, TableInfo())
    for claim in (b"{", b"[1]", b"\xff", b"[" * 100_000):
        table = pq.read_table(path).replace_schema_metadata({b"rotortrack": claim})
        pq.write_table(table, path)
        with pytest.raises(TableError):
            read_info(path)


def test_a_csv_of_nothing_but_bad_rows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("frame,x [nm],y [nm]\n" + "1,2,5,3,5\n" * 1000)
    refused(path, r"1000 row\(s\) .* only 0 can be read")


def test_a_damaged_gzip_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.csv.gz"
    packed = bytearray(gzip.compress(b"frame,x [nm],y [nm]\n" + os.urandom(9000)))
    packed[500:540] = bytes(40)
    path.write_bytes(packed)
    refused(path)


def test_a_rotor_table_that_is_no_csv_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rotors.csv"
    path.write_bytes(bytes(range(256)) * 10)
    with pytest.raises(TableError, match="rotors"):
        read_csv(path, ROTORS)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_full_disk_is_a_resource_error_and_leaves_nothing(tmp_path: Path, ending: str) -> None:
    program = f"""
import resource, signal
from pathlib import Path
import numpy as np
from rotortrack.errors import ResourceError
from rotortrack.exchange.tables import TableInfo, open_writer
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
noise = np.random.default_rng(0).uniform(size=200_000)
try:
    with open_writer(Path({str(tmp_path)!r}) / "table.{ending}", TableInfo(100.0)) as writer:
        for _ in range(3):
            writer.append({{"frame": np.arange(200_000), "x_nm": noise, "y_nm": noise}})
except ResourceError as error:
    print(error, error.exit_code)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "cannot be written" in done.stdout, done.stderr
    assert done.stdout.strip().endswith(" 7")
    assert list(tmp_path.iterdir()) == []
