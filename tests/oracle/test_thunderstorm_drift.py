"""Cross-correlation drift against the ThunderSTORM plugin's own, and both against the truth."""

import json

import numpy as np
import pandas as pd
import pytest

from rotortrack.corrections.drift.cross_correlation import estimate_drift
from rotortrack.corrections.drift.drift import apply_drift
from rotortrack.corrections.options import DriftOptions

PIXEL_NM = 108.3
OPTIONS = DriftOptions(bins=10, magnification=5, smoothing=0.25)


def read_localisations(path):
    table = pd.read_csv(path)
    # The plugin's frames start at 1.
    return pd.DataFrame(
        {
            "frame": table["frame"].astype("int64") - 1,
            "x_nm": table["x [nm]"],
            "y_nm": table["y [nm]"],
        }
    )


@pytest.fixture(scope="module")
def folder(reference_data):
    return reference_data("thunderstorm")


@pytest.fixture(scope="module")
def localisations(folder):
    return read_localisations(folder / "table.csv.gz")


@pytest.fixture(scope="module")
def drift(localisations):
    return estimate_drift(localisations, OPTIONS, pixel_size_nm=PIXEL_NM)


def test_bins_agree_with_the_plugin_to_a_thousandth_of_a_pixel(folder, drift):
    plugin = json.loads((folder / "drift.json").read_text())
    assert (drift.bin_frames + 1).tolist() == plugin["driftDataFrame"]
    assert drift.bin_dx_nm / PIXEL_NM == pytest.approx(plugin["driftDataX"], abs=0.001)
    assert drift.bin_dy_nm / PIXEL_NM == pytest.approx(plugin["driftDataY"], abs=0.001)
    assert drift.estimated
    assert drift.bin_used.all()


def test_corrected_positions_agree_with_the_plugin_to_a_tenth_of_a_nanometre(
    folder, localisations, drift
):
    corrected = apply_drift(localisations, drift)
    plugin = read_localisations(folder / "table_drift_corrected.csv.gz")
    assert (corrected["frame"] == plugin["frame"]).all()
    for name in ("x_nm", "y_nm"):
        assert corrected[name].to_numpy() == pytest.approx(plugin[name].to_numpy(), abs=0.1)


def error_per_axis(table, truth):
    """RMS over frames without the constant offset, which no drift estimate can know."""
    error = table[["dx_nm", "dy_nm"]].to_numpy() - truth[["dx_nm", "dy_nm"]].to_numpy()
    return (error - error.mean(axis=0)).std(axis=0)


def test_error_to_the_true_drift_is_no_worse_than_the_plugins(folder, localisations, drift):
    truth = pd.read_csv(folder / "table_drift_truth.csv")
    plugin = read_localisations(folder / "table_drift_corrected.csv.gz")
    subtracted = (localisations - plugin).assign(frame=localisations["frame"])
    subtracted = subtracted.drop_duplicates("frame").set_index("frame")
    plugin_error = error_per_axis(
        subtracted.rename(columns={"x_nm": "dx_nm", "y_nm": "dy_nm"}),
        truth.loc[subtracted.index],
    )
    error = error_per_axis(drift.table, truth)
    assert (error <= plugin_error).all()
    assert (error < 0.6).all()
    sd = np.sqrt(np.mean(drift.table["sd_nm"] ** 2))
    assert 0.4 < np.sqrt(np.mean(error**2)) / sd < 1.4
