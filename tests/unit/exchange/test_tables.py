"""The choice of a format by its ending, and conversion between formats."""

from __future__ import annotations

import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import ConfigurationError, TableError
from rotortrack.exchange.tables import (
    Columns,
    TableInfo,
    convert,
    open_writer,
    read_blocks,
    read_info,
    read_localisations,
    write_localisations,
)

ENDINGS = ["parquet", "csv", "csv.gz", "hdf5", "h5"]
INFO = TableInfo(
    pixel_size_nm=108.3,
    frames=700,
    height_px=64,
    width_px=96,
    frame_interval_s=0.002,
    provenance={"method": "mle"},
)


def block(rows: int, seed: int = 1) -> Columns:
    rng = np.random.default_rng(seed)
    return {
        "frame": np.sort(rng.integers(0, 700, rows)),
        "x_nm": rng.uniform(0, 9000, rows),
        "y_nm": rng.uniform(0, 6000, rows),
        "photons": rng.uniform(100, 2000, rows).astype(np.float32),
        "sigma_nm": rng.uniform(100, 200, rows).astype(np.float32),
        "uncertainty_nm": rng.uniform(3, 9, rows).astype(np.float32),
    }


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_ending_gives_the_table_back(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"locs.{ending.upper() if ending == 'csv' else ending}"
    table = pd.DataFrame(dict(block(500)))
    write_localisations(path, table, INFO)
    back = read_localisations(path)
    pd.testing.assert_frame_equal(back[list(table)], table, rtol=1e-6, atol=5e-4)


@pytest.mark.parametrize("name", ["locs.txt", "locs", "locs.gz", "locs.parquet.bak", ".csvx"])
def test_an_unknown_ending_is_refused_with_the_known_ones(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("frame,x [nm],y [nm]\n1,1,1\n")
    for call in (read_localisations, read_info, lambda p: open_writer(p, INFO)):
        with pytest.raises(TableError, match=r"\.parquet, \.csv .*\.hdf5"):
            call(path)


@pytest.mark.parametrize("ending", ["parquet", "hdf5"])
def test_a_file_tells_what_it_knows_of_its_movie(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"locs.{ending}"
    write_localisations(path, pd.DataFrame(dict(block(5))), INFO)
    info = read_info(path)
    for name in ("pixel_size_nm", "frames", "height_px", "width_px", "frame_interval_s"):
        assert getattr(info, name) == getattr(INFO, name)
    if ending == "parquet":
        assert info.provenance == INFO.provenance


def test_a_csv_table_knows_nothing_of_its_movie(tmp_path: Path) -> None:
    write_localisations(tmp_path / "l.csv", pd.DataFrame(dict(block(5))), INFO)
    assert read_info(tmp_path / "l.csv") == TableInfo()


def test_a_chain_of_conversions_keeps_rows_order_and_numbers(tmp_path: Path) -> None:
    first = tmp_path / "a.parquet"
    write_localisations(first, pd.DataFrame(dict(block(3000))), INFO)
    assert convert(first, tmp_path / "b.csv") == 3000
    assert convert(tmp_path / "b.csv", tmp_path / "c.parquet") == 3000
    pd.testing.assert_frame_equal(
        read_localisations(tmp_path / "c.parquet"), read_localisations(first)
    )
    assert convert(first, tmp_path / "d.hdf5") == 3000
    assert convert(tmp_path / "d.hdf5", tmp_path / "e.parquet") == 3000
    info = read_info(tmp_path / "e.parquet")
    assert (info.pixel_size_nm, info.frames, info.frame_interval_s) == (108.3, 700, 0.002)
    assert info.provenance["converted_from"] == "d.hdf5"
    back = read_localisations(tmp_path / "e.parquet")
    pd.testing.assert_frame_equal(
        back[list(block(0))], read_localisations(first), rtol=1e-6, atol=5e-4
    )


def test_a_conversion_that_needs_the_pixel_size_takes_it_or_asks_for_it(tmp_path: Path) -> None:
    write_localisations(tmp_path / "a.csv", pd.DataFrame(dict(block(5))), INFO)
    with pytest.raises(ConfigurationError, match="--pixel-size-nm"):
        convert(tmp_path / "a.csv", tmp_path / "b.hdf5")
    assert not (tmp_path / "b.hdf5").exists()
    convert(tmp_path / "a.csv", tmp_path / "b.hdf5", pixel_size_nm=90)
    assert read_info(tmp_path / "b.hdf5").pixel_size_nm == 90


def test_a_file_converted_onto_itself_survives(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    write_localisations(path, pd.DataFrame(dict(block(50))), INFO)
    before = read_localisations(path)
    assert convert(path, path) == 50
    pd.testing.assert_frame_equal(read_localisations(path), before)


def test_an_empty_table_converts_to_every_ending(tmp_path: Path) -> None:
    write_localisations(tmp_path / "a.parquet", pd.DataFrame(dict(block(0))), INFO)
    for ending in ENDINGS:
        target = tmp_path / f"b.{ending}"
        assert convert(tmp_path / "a.parquet", target) == 0
        assert len(read_localisations(target)) == 0


@pytest.mark.parametrize("ending", ["parquet", "csv", "hdf5"])
def test_an_interrupted_writer_leaves_the_old_file(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"locs.{ending}"
    write_localisations(path, pd.DataFrame(dict(block(5))), INFO)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}

    def stop_half_way() -> None:
        with open_writer(path, INFO) as writer:
            writer.append(block(400_000))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop_half_way()
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("ending", ["parquet", "csv", "hdf5"])
def test_memory_of_a_writer_does_not_grow_with_the_rows(tmp_path: Path, ending: str) -> None:
    import pyarrow as pa

    one = block(10_000)
    peaks = []
    for blocks in (14, 56):
        tracemalloc.start()
        arrow_before = pa.total_allocated_bytes()
        with open_writer(tmp_path / f"{blocks}.{ending}", INFO) as writer:
            for _ in range(blocks):
                writer.append(one)
            held = pa.total_allocated_bytes() - arrow_before
        peaks.append(tracemalloc.get_traced_memory()[1] + held)
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] + 1e6


@pytest.mark.parametrize("ending", ["parquet", "hdf5"])
def test_blocks_of_a_file_make_up_the_table(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"locs.{ending}"
    write_localisations(path, pd.DataFrame(dict(block(200_000))), INFO)
    blocks = list(read_blocks(path))
    assert [len(columns["frame"]) for columns in blocks] == [131_072, 68_928]
    table = read_localisations(path)
    for name in blocks[0]:
        joined = np.concatenate([columns[name] for columns in blocks])
        np.testing.assert_array_equal(joined, table[name])
        assert joined.dtype == table[name].dtype


def test_two_files_are_written_at_once_from_two_threads(tmp_path: Path) -> None:
    def write(name: str, seed: int) -> None:
        write_localisations(tmp_path / name, pd.DataFrame(dict(block(20_000, seed))), INFO)

    threads = [threading.Thread(target=write, args=(f"{i}.parquet", i)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in range(4):
        back = read_localisations(tmp_path / f"{i}.parquet")
        np.testing.assert_array_equal(back["x_nm"], block(20_000, i)["x_nm"])
