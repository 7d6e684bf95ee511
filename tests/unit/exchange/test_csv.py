"""Plain CSV of our own tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import TableError
from rotortrack.exchange.csv import read_csv, write_csv
from rotortrack.tables import DRIFT, ROTORS, empty


def rotors(reasons: list[str]) -> pd.DataFrame:
    rows = len(reasons)
    return pd.DataFrame(
        {
            "rotor": np.arange(rows),
            "x_nm": np.full(rows, 0.1),
            "y_nm": np.full(rows, 1 / 3),
            "reason": pd.array(reasons, dtype="str"),
        }
    )


@pytest.mark.parametrize("cell", ['=cmd|"/C calc"!A0', "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"])
def test_a_text_cell_cannot_start_a_formula(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "rotors.csv"
    write_csv(path, rotors([cell]))
    assert path.read_bytes().split(b",", 6)[-1].startswith(b"\"'")
    assert read_csv(path, ROTORS)["reason"].tolist() == [cell]


def test_a_column_name_cannot_start_a_formula(tmp_path: Path) -> None:
    write_csv(tmp_path / "t.csv", pd.DataFrame({"=1+1": [1]}))
    assert (tmp_path / "t.csv").read_text() == "'=1+1\n1\n"


def test_negative_numbers_stay_numbers_and_lines_end_plainly(tmp_path: Path) -> None:
    path = tmp_path / "drift.csv"
    drift = pd.DataFrame({"frame": [0], "dx_nm": [-1.5], "dy_nm": [0.1], "sd_nm": [np.nan]})
    write_csv(path, drift)
    assert path.read_bytes() == b"frame,dx_nm,dy_nm,sd_nm\n0,-1.5,0.1,\n"
    pd.testing.assert_frame_equal(read_csv(path, DRIFT), drift)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(allow_nan=True, width=64),
            st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0\r")),
            st.booleans(),
        ),
        max_size=8,
    )
)
def test_any_table_comes_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, str, bool]]
) -> None:
    path = tmp_path_factory.mktemp("csv") / "rotors.csv"
    table = rotors([text for _, text, _ in rows])
    table["radius_nm"] = np.array([number for number, _, _ in rows], dtype=np.float64)
    table["msd_at_bound"] = np.array([truth for _, _, truth in rows], dtype=bool)
    write_csv(path, table)
    back = read_csv(path, ROTORS)
    np.testing.assert_array_equal(back["radius_nm"], table["radius_nm"])
    assert back["reason"].tolist() == table["reason"].tolist()
    assert back["msd_at_bound"].tolist() == table["msd_at_bound"].tolist()


def test_a_table_without_rows_keeps_its_columns(tmp_path: Path) -> None:
    write_csv(tmp_path / "t.csv", empty(ROTORS))
    back = read_csv(tmp_path / "t.csv", ROTORS)
    pd.testing.assert_frame_equal(back, empty(ROTORS))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("frame,dx_nm\n0,1\n", "lacks the drift column"),
        ("frame,dx_nm,dy_nm\n0.5,1,1\n", "frame cannot be read as int64"),
        ("frame,dx_nm,dy_nm\n,1,1\n", "frame has empty cells"),
        ("frame,dx_nm,dy_nm\n0,one,1\n", "invalid value 'one'"),
        ("", "cannot be read as a CSV"),
        ("frame,dx_nm,dy_nm\n0,1,1\n0,1,1,1,1,1\n", "cannot be read as a CSV"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "drift.csv"
    path.write_text(text)
    with pytest.raises(TableError, match=sentence):
        read_csv(path, DRIFT)
