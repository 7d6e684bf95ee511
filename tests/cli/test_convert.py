"""`rotortrack convert` from one format to another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

HEADER = '"id","frame","x [nm]","y [nm]","sigma [nm]","intensity [photon]"\n'


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "locs.csv"
    path.write_text(HEADER + "1,1,100.5,200.25,130.0,900\n2,3,150.5,250.25,131.0,950\n")
    return path


def test_csv_becomes_parquet_and_says_so(call: Any, table: Path, tmp_path: Path) -> None:
    target = tmp_path / "locs.parquet"
    outcome = call("convert", table, target, "--quiet")
    assert outcome.code == 0, outcome.err
    assert outcome.out == f"2 localisations written to {target}\n"

    import pandas as pd

    written = pd.read_parquet(target)
    assert written["frame"].tolist() == [0, 2]
    assert written["x_nm"].tolist() == [100.5, 150.5]


def test_json_names_the_output(call: Any, table: Path, tmp_path: Path) -> None:
    target = tmp_path / "locs.parquet"
    outcome = call("convert", table, target, "--quiet", "--json")
    assert outcome.json["localisations"] == 2
    assert outcome.json["output"] == str(target)


def test_a_missing_or_unknown_file_is_one_sentence_and_writes_nothing(
    call: Any, table: Path, tmp_path: Path
) -> None:
    target = tmp_path / "out.parquet"
    outcome = call("convert", tmp_path / "absent.csv", target)
    assert outcome.code == 3, outcome.err
    assert "absent.csv" in outcome.err
    outcome = call("convert", table, tmp_path / "out.xyz")
    assert outcome.code in (2, 3), outcome.err
    assert ".xyz" in outcome.err
    (tmp_path / "text.csv").write_text("not a table\n")
    outcome = call("convert", tmp_path / "text.csv", target)
    assert outcome.code == 3, outcome.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["locs.csv", "text.csv"]


def test_a_target_that_cannot_be_written_is_7(call: Any, table: Path) -> None:
    outcome = call("convert", table, table / "below-a-file.parquet")
    assert outcome.code == 7, outcome.err
    assert outcome.err.count("\n") == 1
