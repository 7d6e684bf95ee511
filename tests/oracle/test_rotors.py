"""Rotors in tables that the ThunderSTORM plugin wrote, against the truth of its movie."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rotortrack.motion.screen import screen
from rotortrack.rotors.find import find_rotors


def plugin_table(path):
    table = pd.read_csv(path)
    return pd.DataFrame(
        {
            "frame": table["frame"].astype(int) - 1,
            "x_nm": table["x [nm]"],
            "y_nm": table["y [nm]"],
            "photons": table["intensity [photon]"],
            "uncertainty_nm": table.filter(like="uncertainty").iloc[:, 0],
        }
    )


@pytest.mark.parametrize("method", ["lsq", "wlsq", "mle"])
def test_circles_of_sixty_frames_are_those_of_the_scene(reference_data, method):
    folder = reference_data("thunderstorm")
    truth = pd.read_csv(folder / "truth_rotors.csv")
    rotors = find_rotors(plugin_table(folder / f"{method}.csv")).rotors
    assert len(rotors) == len(truth) == 10
    for true in truth[truth["kind"].isin(["driven", "switching"])].itertuples():
        away = np.hypot(rotors["x_nm"] - true.x_nm, rotors["y_nm"] - true.y_nm)
        found = rotors.loc[away.idxmin()]
        assert away.min() < 6.0
        # Exposures that fill the frame shrink the circle by up to 2 %.
        assert found["radius_nm"] == pytest.approx(true.radius_nm, rel=0.04)


def test_two_thousand_frames_with_background_give_twenty_four_rotors(reference_data):
    table = plugin_table(reference_data("thunderstorm") / "table_drift_corrected.csv.gz")
    found = find_rotors(table)
    rotors = screen(found.localisations, found.rotors, n_frames=2000).rotors
    assert len(rotors) == 24
    assert rotors["n_localisations"].between(900, 1100).all()
    moving = rotors[rotors["circle"] == "fitted"]
    # The table gives 10 nm for every spot, and that is how far they lie from their circles.
    assert moving["residual_sd_nm"].to_numpy() == pytest.approx(10.0, abs=0.6)
    assert set(moving["reason"]) <= {"", "neighbours_too_close"}
    assert set(rotors["reason"]) - set(moving["reason"]) == {"immobile"}
