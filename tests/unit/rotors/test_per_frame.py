"""One localisation per rotor and frame."""

from __future__ import annotations

import numpy as np
import pandas as pd

from rotortrack.flags import FitFlag
from rotortrack.rotors.per_frame import duplicates, flag_duplicates, is_duplicate


def table(**columns):
    n = len(columns["rotor"])
    plain = {"frame": np.zeros(n, int), "x_nm": np.zeros(n), "y_nm": np.zeros(n)}
    return pd.DataFrame(plain | columns)


def test_the_spot_nearest_to_the_circle_is_kept():
    marked = duplicates(table(rotor=[0, 0, 0]), np.array([5.0, 1.0, 3.0]))
    assert list(marked) == [True, False, True]


def test_a_converged_fit_goes_before_a_nearer_one_that_failed():
    flags = np.array([FitFlag.SINGULAR, 0], np.int32)
    marked = duplicates(table(rotor=[0, 0], fit_flags=flags), np.array([0.0, 9.0]))
    assert list(marked) == [True, False]


def test_equally_near_spots_are_told_apart_by_brightness_then_position():
    assert list(duplicates(table(rotor=[0, 0], photons=[100.0, 200.0]), np.zeros(2))) == [
        True,
        False,
    ]
    assert list(duplicates(table(rotor=[0, 0], y_nm=[4.0, 2.0]), np.zeros(2))) == [True, False]


def test_other_frames_other_rotors_and_no_rotor_are_no_duplicates():
    spots = table(rotor=[0, 0, 1, -1, -1], frame=[0, 1, 0, 0, 0])
    assert not duplicates(spots, np.zeros(5)).any()


def test_flag_is_set_and_cleared_and_other_bits_stay():
    flags = np.array([FitFlag.SATURATED, FitFlag.DUPLICATE | FitFlag.SATURATED], np.int32)
    flagged = flag_duplicates(table(rotor=[0, 0], fit_flags=flags), np.array([True, False]))
    assert list(is_duplicate(flagged)) == [True, False]
    assert np.all(flagged["fit_flags"] & int(FitFlag.SATURATED))
    assert flagged["fit_flags"].dtype == np.int32


def test_absent_flags_are_created():
    spots = table(rotor=[0, 0])
    assert not is_duplicate(spots).any()
    assert list(is_duplicate(flag_duplicates(spots, np.array([False, True])))) == [False, True]
    assert "fit_flags" not in spots
