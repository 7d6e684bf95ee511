import numpy as np
import pandas as pd
import pytest

from rotortrack.corrections.drift.drift import Drift, apply_drift, frame_range, no_drift
from rotortrack.errors import TableError
from rotortrack.tables import DRIFT


def drift_of(frames, dx, dy):
    drift = no_drift(pd.DataFrame({"frame": frames, "x_nm": 0.0, "y_nm": 0.0}), "none")
    drift.table["dx_nm"], drift.table["dy_nm"] = dx, dy
    return drift


@pytest.fixture
def table():
    return pd.DataFrame(
        {"frame": [7, 5, 6, 5], "x_nm": [1.0, 2.0, np.nan, 4.0], "y_nm": 0.0, "photons": 9.0},
        index=[3, 3, 0, 8],
    )


def test_drift_is_subtracted_and_rows_index_and_other_columns_stay(table):
    before = table.copy()
    corrected = apply_drift(table, drift_of([5, 6, 7], [0.0, 10.0, 20.0], [1.0, 2.0, 3.0]))
    assert corrected["x_nm"].tolist()[:2] == [-19.0, 2.0]
    assert np.isnan(corrected["x_nm"].iloc[2])
    assert corrected["y_nm"].tolist() == [-3.0, -1.0, -2.0, -1.0]
    assert corrected.index.tolist() == table.index.tolist()
    pd.testing.assert_frame_equal(
        corrected.drop(columns=["x_nm", "y_nm"]), table.drop(columns=["x_nm", "y_nm"])
    )
    pd.testing.assert_frame_equal(table, before)


def test_frames_outside_the_estimate_take_the_nearest_drift(table):
    corrected = apply_drift(table, drift_of([6], [10.0], [0.0]))
    assert corrected["x_nm"].dropna().tolist() == [-9.0, -8.0, -6.0]


def test_zero_drift_changes_no_bit(table):
    drift = no_drift(table, "none")
    pd.testing.assert_frame_equal(apply_drift(table, drift), table)
    assert drift.table["frame"].tolist() == [5, 6, 7]
    assert drift.table["sd_nm"].isna().all()
    assert not drift.estimated


def test_table_has_the_columns_and_types_of_the_schema(table):
    found = no_drift(table, "none").table.dtypes.astype(str).to_dict()
    assert found == DRIFT.dtypes


def test_empty_tables_have_no_frames_and_stay_empty(table):
    nothing = table.iloc[:0]
    drift = no_drift(nothing, "none")
    assert isinstance(drift, Drift)
    assert drift.table.empty
    assert drift.table.dtypes.astype(str).to_dict() == DRIFT.dtypes
    assert apply_drift(nothing, drift).empty
    pd.testing.assert_frame_equal(apply_drift(table, drift), table)


def test_frame_numbers_of_no_movie_are_refused():
    table = pd.DataFrame({"frame": [0, 10**12], "x_nm": 0.0, "y_nm": 0.0})
    with pytest.raises(TableError, match="check the column frame"):
        frame_range(table)
    table = pd.DataFrame({"frame": [0.0, np.nan], "x_nm": 0.0, "y_nm": 0.0})
    with pytest.raises(TableError, match="without a frame number"):
        frame_range(table)


def test_missing_columns_are_named():
    with pytest.raises(TableError, match="x_nm, y_nm"):
        frame_range(pd.DataFrame({"frame": [0]}))
