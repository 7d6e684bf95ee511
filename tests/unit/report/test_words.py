from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from rotortrack.report import words


@pytest.mark.parametrize(
    ("value", "sd", "expected"),
    [
        (5.0234, 0.0312, "+5.023 ± 0.031 nm"),
        (-5.0234, 1.26, "−5.0 ± 1.3 nm"),
        (1234.5, 56.0, "+1234 ± 56 nm"),
        (0.01234, math.nan, "+0.0123 nm"),
        (0.0, 0.0, "+0 nm"),
        (math.nan, 1.0, "unknown nm"),
        (5.0, math.inf, "+5.00 nm"),
    ],
)
def test_values_are_rounded_to_two_digits_of_their_sd(value, sd, expected):
    assert words.plus_minus(value, sd, "nm", signed=True) == expected


def test_title_has_number_behaviour_and_signed_speed():
    row = {"rotor": 7, "behaviour": "driven_cw", "rev_per_s": -5.02, "omega_sd_rad_s": 0.2}
    assert words.title(row) == "Rotor 7, driven, clockwise: −5.020 ± 0.032 rev/s"
    assert words.title(pd.Series(row)) == words.title(row)


def test_title_of_a_refused_rotor_has_the_reason():
    row = {"rotor": 7, "verdict": "refused", "reason": "partial  arc\n(80 degrees)"}
    assert words.title(row) == "Rotor 7, refused: partial arc (80 degrees)"


@pytest.mark.parametrize("row", [{}, {"rotor": None, "reason": np.nan, "verdict": "refused"}])
def test_missing_values_are_survived(row):
    assert words.title(row).startswith("Rotor")
    assert math.isnan(words.number(row, "rotor"))


def test_speed_falls_back_on_radians():
    speed, sd = words.rev_per_s({"omega_rad_s": 4 * math.pi, "omega_sd_rad_s": math.pi})
    assert (speed, sd) == pytest.approx((2.0, 0.5))


def test_counts_have_thin_spaces_and_number():
    assert words.count(1, "rotor") == "1 rotor"
    assert words.count(12345, "step") == "12\u202f345 steps"
