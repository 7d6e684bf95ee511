"""The density filter against the rows that the ThunderSTORM plugin keeps."""

import pandas as pd
import pytest

from rotortrack.corrections.density import dense_enough
from rotortrack.corrections.options import DensityOptions


@pytest.mark.parametrize("radius_nm", [25, 50])
def test_the_same_rows_are_kept_as_by_the_plugin(reference_data, radius_nm):
    plugin = pd.read_csv(reference_data("thunderstorm") / "table_density.csv.gz")
    table = plugin.rename(columns={"x [nm]": "x_nm", "y [nm]": "y_nm"})
    kept = dense_enough(table, DensityOptions(radius_nm=radius_nm, min_neighbours=15))
    expected = plugin[f"kept_radius_{radius_nm}"].to_numpy(dtype=bool)
    assert 0 < expected.sum() < expected.size
    assert (kept == expected).all()
