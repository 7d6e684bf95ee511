"""The schemas, and tables that are made to fit them without silent losses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import TableError
from rotortrack.tables import (
    DRIFT,
    LOCALISATIONS,
    ROTORS,
    TRACKS,
    Schema,
    conform,
    empty,
    schema_metadata,
)

SCHEMAS = [LOCALISATIONS, ROTORS, TRACKS, DRIFT]


def localisations(**columns: object) -> pd.DataFrame:
    return pd.DataFrame({"frame": [0, 1], "x_nm": [1.0, 2.0], "y_nm": [3.0, 4.0], **columns})


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.name)
def test_an_empty_table_has_every_column_and_conforms(schema: Schema) -> None:
    table = empty(schema)
    assert list(table.columns) == schema.names
    assert len(table) == 0
    pd.testing.assert_frame_equal(conform(table, schema, "empty"), table)


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.name)
def test_the_unit_of_a_column_is_in_its_name(schema: Schema) -> None:
    endings = {
        "nm": "_nm",
        "s": "_s",
        "rad": "_rad",
        "deg": "_deg",
        "rad/s": "_rad_s",
        "deg/s": "_deg_s",
        "rad^2/s": "_rad2_s",
        "1/s": "_per_s",
    }
    for column in schema.columns:
        assert column.meaning
        if column.unit in endings:
            assert column.name.endswith(endings[column.unit])


def test_columns_are_ordered_converted_and_strangers_kept_last() -> None:
    table = localisations(mine=["a", "b"], photons=[1, 2])[
        ["mine", "photons", "y_nm", "x_nm", "frame"]
    ]
    made = conform(table.astype({"frame": float}), LOCALISATIONS, "mine.csv")
    assert list(made.columns) == ["frame", "x_nm", "y_nm", "photons", "mine"]
    assert made["frame"].dtype == np.int64
    assert made["photons"].dtype == np.float32
    assert made["mine"].tolist() == ["a", "b"]


def test_the_table_given_is_left_alone() -> None:
    table = localisations(photons=[1, 2])
    before = table.copy()
    made = conform(table, LOCALISATIONS, "mine.csv")
    made["x_nm"] = 0.0
    pd.testing.assert_frame_equal(table, before)


def test_missing_columns_are_all_named_with_those_that_are_there() -> None:
    with pytest.raises(TableError, match=r"mine\.csv lacks .* x_nm, y_nm: it has frame"):
        conform(localisations()[["frame"]], LOCALISATIONS, "mine.csv")
    with pytest.raises(TableError, match="it has none"):
        conform(pd.DataFrame(), LOCALISATIONS, "mine.csv")


@pytest.mark.parametrize(
    ("column", "values", "part"),
    [
        ("frame", [0, 1.5], "1.5 is not a whole number"),
        ("frame", [0, np.nan], "nan is not a whole number"),
        ("frame", [0, np.inf], "inf is not a whole number"),
        ("frame", [0, 1e30], "too large"),
        ("frame", ["0", "one"], "one"),
        ("fit_flags", [0, 2**31], "too large"),
        ("photons", ["many", "few"], "many"),
    ],
)
def test_values_that_do_not_fit_are_refused_by_name(
    column: str, values: list[Any], part: str
) -> None:
    with pytest.raises(TableError, match=f"mine.csv: column {column} .*{part}"):
        conform(localisations().assign(**{column: values}), LOCALISATIONS, "mine.csv")


@pytest.mark.parametrize("values", [["0", "12"], [0.0, 12.0], np.array([0, 12], np.uint16)])
def test_whole_numbers_of_any_kind_are_frames(values: Any) -> None:
    made = conform(localisations().assign(frame=values), LOCALISATIONS, "mine.csv")
    assert made["frame"].tolist() == [0, 12]
    assert made["frame"].dtype == np.int64


@pytest.mark.parametrize("values", [[True, False], [1, 0], ["True", "False"], ["true", "false"]])
def test_truths_from_a_text_file_keep_their_meaning(values: list[object]) -> None:
    table = pd.DataFrame({"rotor": 0, "frame": [0, 1], "x_nm": 0.0, "y_nm": 0.0, "used": values})
    made = conform(table, TRACKS, "tracks.csv")
    assert made["used"].dtype == bool
    assert made["used"].tolist() == [True, False]


@pytest.mark.parametrize("values", [[True, None], ["yes", "no"], [2, 0]])
def test_what_is_neither_true_nor_false_is_refused(values: list[object]) -> None:
    table = pd.DataFrame({"rotor": 0, "frame": [0, 1], "x_nm": 0.0, "y_nm": 0.0, "used": values})
    with pytest.raises(TableError, match="neither true nor false"):
        conform(table, TRACKS, "tracks.csv")


def test_a_column_that_comes_twice_is_refused() -> None:
    table = pd.concat([localisations(), localisations()[["x_nm"]]], axis=1)
    with pytest.raises(TableError, match="x_nm more than once"):
        conform(table, LOCALISATIONS, "mine.csv")


def test_a_file_records_the_units_of_its_columns() -> None:
    metadata = schema_metadata(DRIFT, {"command": "drift"})
    assert metadata["table"] == "drift"
    assert metadata["units"] == {"frame": "", "dx_nm": "nm", "dy_nm": "nm", "sd_nm": "nm"}
    assert metadata["provenance"] == {"command": "drift"}
