"""Native tables: what goes in comes out, and what the file says about itself."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rotortrack.errors import TableError
from rotortrack.exchange import parquet
from rotortrack.exchange.tables import Columns, TableInfo, open_writer, read_info
from rotortrack.tables import DRIFT, LOCALISATIONS, ROTORS, TRACKS, empty


def some_rotors() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "rotor": [0, 1, 2],
            "x_nm": [1.5, np.nan, -0.0],
            "y_nm": [1e-300, np.inf, 3.0],
            "verdict": ["kept", "refused", "refused"],
            "reason": ["", "arc covers 90 deg, less than 180", "größer"],
            "msd_at_bound": [True, False, True],
            "note": ["a", "b", "c"],
        }
    )


def test_rotors_with_text_and_truth_values_come_back_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "rotors.parquet"
    parquet.write_table(path, some_rotors(), ROTORS, {"seed": 3})
    back = parquet.read_table(path, ROTORS)
    pd.testing.assert_frame_equal(back, some_rotors(), check_like=True, check_dtype=False)
    assert list(back.columns) == [n for n in ROTORS.names if n in back.columns] + ["note"]
    assert back["msd_at_bound"].dtype == bool
    assert back["x_nm"].dtype == np.float64


@pytest.mark.parametrize("schema", [LOCALISATIONS, TRACKS, ROTORS, DRIFT])
def test_an_empty_table_keeps_its_columns_and_types(tmp_path: Path, schema: object) -> None:
    path = tmp_path / "t.parquet"
    parquet.write_table(path, empty(schema), schema, {})
    back = parquet.read_table(path, schema)
    pd.testing.assert_frame_equal(back, empty(schema))


def test_units_and_provenance_lie_in_the_schema_metadata(tmp_path: Path) -> None:
    path = tmp_path / "rotors.parquet"
    parquet.write_table(path, some_rotors(), ROTORS, {"seed": np.int64(3), "from": Path("a.tif")})
    metadata = parquet.read_metadata(path)
    assert metadata["table"] == "rotors"
    assert metadata["units"]["omega_rad_s"] == "rad/s"
    assert metadata["provenance"] == {"seed": 3, "from": "a.tif"}


def test_small_appends_become_full_row_groups_and_the_same_bytes(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    rows = 300_000
    columns = {
        "frame": np.arange(rows),
        "x_nm": rng.uniform(0, 1e4, rows),
        "y_nm": rng.uniform(0, 1e4, rows),
        "photons": rng.uniform(0, 1e4, rows).astype(np.float32),
    }
    files = []
    for block in (rows, 999):
        path = tmp_path / f"{block}.parquet"
        with open_writer(path, TableInfo()) as writer:
            for start in range(0, rows, block):
                writer.append({n: v[start : start + block] for n, v in columns.items()})
        files.append(path.read_bytes())
    assert files[0] == files[1]
    groups = pq.ParquetFile(path).metadata
    assert [groups.row_group(i).num_rows for i in range(3)] == [131_072, 131_072, 37_856]
    column = groups.row_group(0).column(1)
    assert column.compression == "ZSTD"
    assert "BYTE_STREAM_SPLIT" in column.encodings


def test_a_block_may_be_reused_by_the_caller_after_append(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    block = {"frame": np.arange(3), "x_nm": np.ones(3), "y_nm": np.ones(3)}
    with open_writer(path, TableInfo()) as writer:
        writer.append(block)
        block["x_nm"][:] = 99
    assert parquet.read_table(path, LOCALISATIONS)["x_nm"].tolist() == [1, 1, 1]


def test_writing_loads_no_pandas(tmp_path: Path) -> None:
    program = f"""
import sys
from pathlib import Path
import numpy as np
from rotortrack.exchange.tables import TableInfo, open_writer
with open_writer(Path({str(tmp_path / "t.parquet")!r}), TableInfo(108.3)) as writer:
    writer.append({{"frame": np.arange(4), "x_nm": np.zeros(4), "y_nm": np.zeros(4)}})
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)
    assert read_info(tmp_path / "t.parquet").pixel_size_nm == 108.3


def test_a_table_of_another_program_is_accepted_if_its_columns_fit(tmp_path: Path) -> None:
    path = tmp_path / "foreign.parquet"
    table = pd.DataFrame(
        {"y_nm": [2, 3], "frame": [0.0, 7.0], "x_nm": ["1.5", "2.5"], "chi2": [None, 2.0]}
    )
    table.set_index("y_nm").reset_index().to_parquet(path)
    back = parquet.read_table(path, LOCALISATIONS)
    assert back["frame"].tolist() == [0, 7]
    assert back["frame"].dtype == np.int64
    assert back["x_nm"].tolist() == [1.5, 2.5]
    assert back["y_nm"].dtype == np.float64
    assert np.isnan(back["chi2"][0])
    assert read_info(path) == TableInfo()


@pytest.mark.parametrize(
    ("column", "values", "sentence"),
    [
        ("frame", [0.5, 1.0], "cannot be read as int64"),
        ("frame", [None, 1], "has empty cells"),
        ("frame", [-1, 1], "negative"),
        ("x_nm", ["a", "b"], "cannot be read as float64"),
    ],
)
def test_values_that_do_not_fit_are_refused_by_column(
    tmp_path: Path, column: str, values: list[object], sentence: str
) -> None:
    path = tmp_path / "foreign.parquet"
    columns = {"frame": [0, 1], "x_nm": [1.0, 2.0], "y_nm": [1.0, 2.0]} | {column: values}
    pq.write_table(pa.table(columns), path)
    with pytest.raises(TableError, match=sentence):
        parquet.read_table(path, LOCALISATIONS)


def test_nested_columns_of_another_program_are_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "foreign.parquet"
    pq.write_table(pa.table({"frame": [0], "x_nm": [1.0], "y_nm": [1.0], "l": [[1, 2]]}), path)
    assert list(parquet.read_table(path, LOCALISATIONS).columns) == ["frame", "x_nm", "y_nm"]
    assert list(next(parquet.read_blocks(path))) == ["frame", "x_nm", "y_nm"]


def test_blocks_must_all_have_the_columns_of_the_first(tmp_path: Path) -> None:
    first = {"frame": np.arange(2), "x_nm": np.zeros(2), "y_nm": np.zeros(2)}

    def write(*blocks: Columns) -> None:
        with open_writer(tmp_path / "t.parquet", TableInfo()) as writer:
            for block in blocks:
                writer.append(block)

    for second in ({**first, "chi2": np.zeros(2)}, {**first, "x_nm": np.zeros(3)}):
        with pytest.raises(TableError, match="block"):
            write(first, second)
    with pytest.raises(TableError, match="lack y_nm"):
        write({"frame": np.arange(2), "x_nm": np.zeros(2)})
    assert list(tmp_path.iterdir()) == []


def test_metadata_that_claims_nonsense_is_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    claim = (
        b'{"movie": {"pixel_size_nm": -5, "frames": "many", "width_px": 1e400}, "provenance": 3}'
    )
    table = pa.table({"frame": [0], "x_nm": [1.0], "y_nm": [1.0]})
    pq.write_table(table.replace_schema_metadata({b"rotortrack": claim}), path)
    assert read_info(path) == TableInfo()
