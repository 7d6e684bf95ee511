"""numpy to Arrow without pandas, and Arrow to a schema."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from rotortrack.errors import TableError
from rotortrack.exchange.arrow import fit, number_array
from rotortrack.tables import TRACKS

TRACK = {"rotor": [0], "frame": [1], "x_nm": [1.0], "y_nm": [2.0]}


@pytest.mark.parametrize(
    "values",
    [
        np.arange(5),
        np.arange(10, dtype=np.float32)[::2],
        np.arange(5, dtype=">f8"),
        np.array([True, False, False, True, True, False, True, True, True]),
        np.array([np.nan, -np.inf, 5e-324]),
        np.empty(0, np.int32),
        np.empty(0, bool),
        np.arange(3, dtype=np.uint8),
    ],
    ids=["int64", "strided", "big-endian", "bool", "special", "empty", "no-bool", "uint8"],
)
def test_an_array_of_numbers_means_what_pyarrow_makes_of_its_list(
    values: NDArray[np.generic],
) -> None:
    array = number_array(values)
    array.validate(full=True)
    kind = pa.from_numpy_dtype(values.dtype.newbyteorder("="))
    assert array.equals(pa.array(values.tolist(), kind)) or np.isnan(values).any()
    np.testing.assert_array_equal(array.to_numpy(zero_copy_only=False), values)


def test_an_empty_truth_value_is_refused_rather_than_taken_for_one() -> None:
    table = pa.table({**TRACK, "used": pa.array([None], pa.bool_())})
    with pytest.raises(TableError, match="column used has empty cells"):
        fit(table, TRACKS, Path("tracks.parquet"))


def test_an_empty_number_is_nan_and_a_large_frame_is_not_rounded() -> None:
    table = pa.table({**TRACK, "frame": [2**53 + 1], "step_rad": pa.array([None], pa.float32())})
    fitted = fit(table, TRACKS, Path("tracks.parquet"))
    assert fitted["frame"].to_pylist() == [2**53 + 1]
    assert np.isnan(fitted["step_rad"].to_pylist()).all()
    assert fitted["step_rad"].type == pa.float64()


def test_missing_columns_are_named_beside_those_there() -> None:
    with pytest.raises(TableError, match=r"column\(s\) rotor, y_nm.* 'frame', 'x_nm'"):
        fit(pa.table({"frame": [1], "x_nm": [1.0]}), TRACKS, Path("tracks.parquet"))
