"""Planes, candidates, fits and uncertainties against what the ThunderSTORM plugin itself gave."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import tifffile
from scipy.optimize import linear_sum_assignment

from rotortrack.cameras.camera import Camera
from rotortrack.localise.engine import localise_all
from rotortrack.localise.options import LocaliseOptions
from rotortrack.localise.precision import thunderstorm_uncertainty
from rotortrack.localise.wavelet import bspline_taps, wavelet_planes
from rotortrack.movies.tiff import open_movie

PIXEL_SIZE_NM = 108.3
CAMERA = Camera(offset_adu=100.0, gain_e_per_adu=1 / 2.2, read_noise_e=0.0)


PLUGIN = {
    "threshold": "std(Wave.F1)",
    "shift_negative_frames": True,
    "clip_at_border": False,
    "correct_bias": False,
    "max_emitters": 1,
}
"""Where the plugin's way is not the default."""


@pytest.fixture(scope="module")
def folder(reference_data):
    return reference_data("thunderstorm")


def test_wavelet_planes_agree_border_included(folder):
    with open_movie(folder / "movie.tif") as movie:
        frames = movie.frames(0, 5).astype(np.float32) - 100
    taps = bspline_taps(3, 2.0).astype(np.float32)
    plugin = {name: tifffile.imread(folder / f"wavelet_{name}.tif") for name in ("F", "F1")}
    for index, frame in enumerate(frames):
        planes = wavelet_planes(frame, taps)
        for ours, theirs in ((planes.f, plugin["F"][index]), (planes.f1, plugin["F1"][index])):
            assert np.abs(ours - theirs).max() <= 1e-4 * np.ptp(theirs)


def plugin_table(folder, method):
    table = pd.read_csv(folder / f"{method}.csv")
    table["frame"] = table["frame"].astype(int) - 1
    return table


def differences(folder, method, **options):
    """Absolute x and y differences (nm) of spots paired frame by frame, and both tables' sizes."""
    theirs = plugin_table(folder, method)
    with open_movie(folder / "movie.tif") as movie:
        ours = localise_all(
            movie,
            CAMERA,
            LocaliseOptions(method=method, **PLUGIN, **options),
            pixel_size_nm=PIXEL_SIZE_NM,
        )
    pairs = []
    for frame in range(60):
        a = theirs.loc[theirs["frame"] == frame, ["x [nm]", "y [nm]"]].to_numpy()
        b = ours.loc[ours["frame"] == frame, ["x_nm", "y_nm"]].to_numpy()
        assert len(a) == len(b)
        distance = np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1))
        first, second = linear_sum_assignment(np.minimum(distance, 100.0))
        pairs.append(np.abs(a[first] - b[second]))
    return np.concatenate(pairs)


@pytest.mark.parametrize("method", ["wlsq", "lsq"])
def test_least_squares_give_the_same_spots_within_a_hundredth_nanometre(folder, method):
    delta = differences(folder, method)
    assert len(delta) == 588
    assert np.median(delta) <= 0.01
    assert np.percentile(delta, 99) <= 0.1


def test_likelihood_gives_the_same_spots_within_a_tenth_nanometre(folder):
    delta = differences(folder, "mle")
    assert len(delta) == 588
    assert np.median(delta) <= 0.1
    assert np.percentile(delta, 99) <= 0.1


@pytest.mark.parametrize("method", ["wlsq", "lsq", "mle"])
def test_uncertainty_formula_gives_the_plugins_column(folder, method):
    table = plugin_table(folder, method)
    ours = thunderstorm_uncertainty(
        "2016",
        method,
        sigma_nm=table["sigma [nm]"].to_numpy(),
        photons=table["intensity [photon]"].to_numpy(),
        background_sd=table["bkgstd [photon]"].to_numpy(),
        pixel_size_nm=PIXEL_SIZE_NM,
    )
    np.testing.assert_allclose(ours, table["uncertainty_xy [nm]"], rtol=1e-6)


def test_2014_formula_gives_the_column_of_an_em_camera_table(reference_data):
    # The table says nothing of its camera; an EM gain and 160 nm pixels are what its numbers show.
    table = pd.read_csv(reference_data("pmhc") / "thunderstorm.csv")
    ours = thunderstorm_uncertainty(
        "2014",
        "mle",
        sigma_nm=table["sigma [nm]"].to_numpy(),
        photons=table["intensity [photon]"].to_numpy(),
        background_sd=table["bkgstd [photon]"].to_numpy(),
        pixel_size_nm=160.0,
        excess_noise=2.0,
    )
    np.testing.assert_allclose(ours, table["uncertainty [nm]"], rtol=1e-6)


def test_every_other_column_agrees_too(folder):
    theirs = plugin_table(folder, "wlsq")
    with open_movie(folder / "movie.tif") as movie:
        ours = localise_all(
            movie,
            CAMERA,
            LocaliseOptions(method="wlsq", uncertainty="thunderstorm-2016", **PLUGIN),
            pixel_size_nm=PIXEL_SIZE_NM,
        )
    theirs = theirs.sort_values(["frame", "x [nm]", "y [nm]"])
    ours = ours.sort_values(["frame", "x_nm", "y_nm"])
    for column, plugin, tolerance in (
        ("photons", "intensity [photon]", 1e-4),
        ("background", "offset [photon]", 1e-4),
        ("background_sd", "bkgstd [photon]", 1e-4),
        ("sigma_nm", "sigma [nm]", 1e-4),
        ("uncertainty_nm", "uncertainty_xy [nm]", 1e-4),
    ):
        ratio = ours[column].to_numpy() / theirs[plugin].to_numpy()
        assert np.percentile(np.abs(ratio - 1), 99) <= tolerance, column
