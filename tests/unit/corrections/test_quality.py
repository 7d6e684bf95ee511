import numpy as np
import pandas as pd
import pytest

from rotortrack.corrections.options import QualityOptions
from rotortrack.corrections.quality import passes_quality
from rotortrack.errors import TableError


def test_uncertainty_must_be_strictly_below_the_bound_and_a_number():
    table = pd.DataFrame({"uncertainty_nm": [49.9, 50.0, 50.1, np.nan, 0.0, np.inf]})
    passed = passes_quality(table, QualityOptions(max_uncertainty_nm=50.0))
    assert passed.tolist() == [True, False, False, False, True, False]
    assert passed.dtype == np.bool_


def test_float32_uncertainty_is_compared_with_the_bound_itself():
    table = pd.DataFrame({"uncertainty_nm": np.array([0.1, 12.5], dtype=np.float32)})
    # float32(0.1) is slightly more than 0.1
    assert passes_quality(table, QualityOptions(max_uncertainty_nm=0.1)).tolist() == [False, False]


def test_empty_table_passes_nothing():
    assert passes_quality(pd.DataFrame({"uncertainty_nm": []}), QualityOptions()).shape == (0,)


def test_table_without_uncertainty_names_both_remedies():
    table = pd.DataFrame({"frame": [0], "x_nm": [1.0], "y_nm": [1.0]})
    with pytest.raises(TableError, match=r"uncertainty_nm.*localise the movie again.*leave"):
        passes_quality(table, QualityOptions())
