"""Tables that claim more than they hold, or would exhaust memory, time or the terminal."""

from __future__ import annotations

import gzip
import inspect
import os
import time
import tracemalloc
import warnings
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rotortrack.errors import ResourceError, TableError, TableWarning
from rotortrack.exchange import limits
from rotortrack.exchange.tables import TableInfo, convert, read_localisations, write_localisations

ENDINGS = ["parquet", "csv", "csv.gz", "hdf5"]
SPOTS = pd.DataFrame(
    {"frame": np.arange(9000), "x_nm": np.linspace(0, 9e3, 9000) ** 1.1, "y_nm": np.ones(9000)}
)


def refused(path: Path, match: str, **options: float) -> None:
    with pytest.raises(TableError, match=match) as caught:
        read_localisations(path, **options)
    sentence = str(caught.value)
    assert path.stem.split(".")[0] in sentence
    assert sentence.isprintable()
    assert len(sentence) < 700


def test_a_gzip_bomb_is_stopped_before_it_fills_the_memory(tmp_path: Path) -> None:
    path = tmp_path / "table.csv.gz"
    with gzip.open(path, "wb", compresslevel=9) as stream:
        stream.write(b"frame,x [nm],y [nm]\n")
        for _ in range(50):
            stream.write(b"1,2,3\n" * 1_000_000)
    tracemalloc.start()
    refused(path, "expands to more than 200 times its size.*gunzip")
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_an_orderly_table_that_packs_well_is_read(tmp_path: Path) -> None:
    path = tmp_path / "table.csv.gz"
    rows = "".join(f"{n},{100 * n}.5,{n % 7}.25\n" for n in range(1, 200_000))
    path.write_bytes(gzip.compress(f"frame,x [nm],y [nm]\n{rows}".encode(), 9))
    assert len(read_localisations(path)) == 199_999


def test_a_parquet_table_that_declares_absurd_rows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    # Run lengths pack ten million equal rows of one page into a few hundred bytes.
    rows = 10_000_000
    same = pa.array(np.zeros(rows, np.int32)).dictionary_encode()
    table = pa.table({"frame": same, "x_nm": same, "y_nm": same})
    sizes = {"row_group_size": rows, "data_page_size": 1 << 30}
    if "max_rows_per_page" in inspect.signature(pq.ParquetWriter).parameters:
        sizes["max_rows_per_page"] = rows
    pq.write_table(table, path, compression="zstd", **sizes)
    assert path.stat().st_size < 10_000
    refused(path, "declares 10,000,000 rows in .* cannot hold them")
    with pytest.raises(TableError, match="cannot hold them"):
        convert(path, tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_table_larger_than_the_memory_is_a_resource_error_but_converts(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"table.{ending}"
    write_localisations(path, SPOTS, TableInfo(100.0))
    monkeypatch.setattr(limits, "memory_bytes", lambda: 100_000)
    with pytest.raises(ResourceError, match=r"9,000 rows.*GB of memory.*use a part") as caught:
        read_localisations(path)
    assert caught.value.exit_code == 7
    assert convert(path, tmp_path / "out.parquet", pixel_size_nm=100) == 9000
    monkeypatch.setattr(limits, "memory_bytes", lambda: None)
    assert len(read_localisations(path)) == 9000


def test_an_hdf5_chunk_larger_than_memory_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.hdf5"
    kind = np.dtype([("frame", "u4"), ("x", "f4"), ("y", "f4")])
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "locs", (30_000_000,), kind, chunks=(30_000_000,), compression="gzip", data=None
        )
        file["locs"].id.write_direct_chunk((0,), os.urandom(1_000_000))
    refused(path, "chunks of 30000000 rows", pixel_size_nm=100)


@pytest.mark.parametrize(
    "text",
    [
        "Pixelsize: 1" + ":1" * 40_000,
        "Pixelsize: 1" + ":1" * 40_000 + ".5",
        "Pixelsize: !!int 1" + ":1" * 40_000,
        "Pixelsize: 0x" + "f" * 80_000,
        "Pixelsize: !!int ''",
        "Pixelsize: !!float ''",
        "Pixelsize: !!bool maybe",
        "Pixelsize: !!timestamp today",
        "? [a, b]\n: 1",
        "? " * 20_000,
        "[" * 200 + "a, " * 20_000,
        "a: &a [*a]\nPixelsize: *b",
    ],
)
def test_yaml_made_to_exhaust_or_confuse_the_parser_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "table.hdf5"
    write_localisations(path, SPOTS, TableInfo(100.0))
    path.with_suffix(".yaml").write_text(text)
    refused(path, "cannot be read as plain YAML")


def test_a_sidecar_too_large_for_one_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "table.hdf5"
    write_localisations(path, SPOTS, TableInfo(100.0))
    with path.with_suffix(".yaml").open("wb") as file:
        file.truncate(10**9)
    refused(path, "larger than 500 kB.*--pixel-size-nm")


@pytest.mark.parametrize("ending", ENDINGS)
def test_names_that_are_not_utf8_are_written_and_read(tmp_path: Path, ending: str) -> None:
    folder = tmp_path / os.fsdecode(b"folder-\xff")
    path = folder / os.fsdecode(b"table-\xfe." + ending.encode())
    write_localisations(path, SPOTS, TableInfo(100.0))
    assert len(read_localisations(path)) == 9000
    assert convert(path, path.with_name(os.fsdecode(b"\xfd.parquet")), pixel_size_nm=100) == 9000
    path.write_bytes(b"broken")
    with pytest.raises(TableError) as caught:
        read_localisations(path, pixel_size_nm=100)
    assert "\n" not in str(caught.value)


def test_control_codes_and_floods_of_names_stay_out_of_sentences(tmp_path: Path) -> None:
    names = [f"\x1b[31mred\n{n}" + "x" * 500 for n in range(300)]
    parquet, csv, hdf5_path = (tmp_path / f"table.{end}" for end in ("parquet", "csv", "hdf5"))
    pq.write_table(pa.table({name: [1] for name in names}), parquet)
    csv.write_text("frame,x [nm],y [nm]," + ",".join(n.replace("\n", "") for n in names) + "\n")
    with h5py.File(hdf5_path, "w") as file:
        for name in names:
            file[name] = 1
    refused(parquet, "lacks")
    with pytest.warns(TableWarning, match="were left out") as caught:
        read_localisations(csv)
    assert str(caught[0].message).isprintable()
    assert len(str(caught[0].message)) < 1000
    refused(hdf5_path, "it holds", pixel_size_nm=100)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(
    "cases", [60, pytest.param(1500, marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_any_cut_or_changed_bytes_are_refused_or_read_with_plain_sentences(
    tmp_path: Path, ending: str, cases: int
) -> None:
    path = tmp_path / f"table.{ending}"
    write_localisations(path, SPOTS.head(300), TableInfo(100.0))
    whole = np.frombuffer(path.read_bytes(), np.uint8)
    rng = np.random.default_rng(5)
    refusals = 0
    for _ in range(cases):
        damaged = whole.copy()
        damaged[rng.integers(0, len(whole), 2)] ^= rng.integers(1, 256, 2, dtype=np.uint8)
        path.write_bytes(damaged.tobytes()[: rng.integers(1, 2 * len(whole))])
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TableWarning)
            try:
                assert len(read_localisations(path)) <= 302
            except TableError as error:
                refusals += 1
                sentence = str(error)
                assert sentence.isprintable(), sentence
        assert time.perf_counter() - start < 5
    assert refusals > cases / 5
