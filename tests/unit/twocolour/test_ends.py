"""Both ends are joined within a frame and a rotor alone; a rolling shutter's lag is undone."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.flags import FitFlag
from rotortrack.twocolour.ends import Timing, map_second, pair_ends, undo_lag

TIMING = Timing(frame_interval_s=0.002, line_time_s=1e-5, pixel_size_nm=100.0)
ROTORS = pd.DataFrame({"rotor": [0, 1], "x_nm": [1000.0, 4000.0], "y_nm": [1000.0, 1000.0]})


def spots(rows, **columns):
    table = pd.DataFrame(rows, columns=["frame", "x_nm", "y_nm"])
    return table.assign(x_sd_nm=10.0, y_sd_nm=12.0, photons=500.0, fit_flags=0, **columns)


def paired(first, second, reach_nm=600.0):
    places = second[["x_nm", "y_nm"]].to_numpy(float)
    return pair_ends(first, second, places, ROTORS, reach_nm=reach_nm, timing=TIMING)


def test_frames_of_one_colour_are_left_out_and_never_paired_with_others():
    first = spots([(0, 1100, 1000), (1, 1100, 1000), (3, 1100, 1000)], rotor=0)
    second = spots([(1, 900, 1050), (2, 900, 1050), (3, 910, 1050)])
    both = paired(first, second)
    assert both["frame"].tolist() == [1, 3]
    assert both["x2_nm"].tolist() == [900, 910]
    assert (both["x1_nm"] == 1100).all()
    assert both[["x1_sd_nm", "y2_sd_nm"]].iloc[0].tolist() == [10.0, 12.0]


def test_a_spot_belongs_to_the_nearest_rotor_within_reach():
    first = spots([(0, 1100, 1000)], rotor=0)
    first = pd.concat([first, spots([(0, 4100, 1000)], rotor=1)], ignore_index=True)
    second = spots([(0, 3800, 1000), (0, 1300, 1000), (0, 2500, 1000)])
    both = paired(first, second)
    assert both[["rotor", "x2_nm"]].to_numpy().tolist() == [[0, 1300], [1, 3800]]
    assert paired(first, second, reach_nm=100.0).empty


def test_of_several_spots_in_a_frame_the_one_on_the_ring_counts():
    turning = [
        (frame, 1000 + 150 * math.cos(frame), 1000 - 150 * math.sin(frame)) for frame in range(50)
    ]
    first = spots([(frame, 1050, 1000) for frame in range(50)], rotor=0)
    second = spots([*turning, (7, 1400, 1300)])
    both = paired(first, second)
    assert len(both) == 50
    assert both["x2_nm"].tolist() == pytest.approx([x for _, x, _ in turning])


def test_failed_fits_duplicates_and_strangers_take_no_part():
    first = spots([(0, 1100, 1000), (1, 1100, 1000), (2, 1100, 1000), (3, 1100, 1000)], rotor=0)
    first.loc[0, "fit_flags"] = int(FitFlag.DUPLICATE)
    first.loc[1, "rotor"] = -1
    first.loc[2, "fit_flags"] = int(FitFlag.ITERATION_LIMIT)
    second = spots([(frame, 900, 1000) for frame in range(4)])
    assert paired(first, second)["frame"].tolist() == [3]


def test_the_lag_is_that_of_the_rows_as_they_were_seen():
    first = spots([(0, 1100, 1000)], rotor=0)
    second = spots([(0, 900, 4200)])
    places = np.array([[900.0, 1000.0]])
    both = pair_ends(first, second, places, ROTORS, reach_nm=600.0, timing=TIMING)
    assert both["late_s"].iloc[0] == pytest.approx(32 * 1e-5)
    unknown = Timing(0.002, math.nan, 100.0)
    both = pair_ends(first, second, places, ROTORS, reach_nm=600.0, timing=unknown)
    assert math.isnan(both["late_s"].iloc[0])


@given(
    st.floats(-300, 300),
    st.floats(0, 2e-3),
    st.floats(0, 2 * math.pi),
    st.floats(1, 400),
)
def test_an_end_is_turned_back_to_when_the_other_was_exposed(omega, late, angle, radius):
    pivot = (500.0, -200.0)

    def at(time_s):
        turned = angle + omega * time_s
        return pivot[0] + radius * math.cos(turned), pivot[1] - radius * math.sin(turned)

    seen = at(late)
    x, y, extra = undo_lag(
        np.array([seen[0]]), np.array([seen[1]]), np.array([late]),
        pivot_nm=pivot, omega_rad_s=omega, diffusion_rad2_s=3.0,
    )  # fmt: skip
    assert (x[0], y[0]) == pytest.approx(at(0.0), abs=1e-9 * radius + 1e-9)
    assert extra[0] == pytest.approx(radius**2 * 3.0 * late)


def test_an_unknown_lag_or_speed_changes_nothing():
    x, y, extra = undo_lag(
        np.array([1.0]), np.array([2.0]), np.array([math.nan]),
        pivot_nm=(0.0, 0.0), omega_rad_s=math.nan, diffusion_rad2_s=math.nan,
    )  # fmt: skip
    assert (x[0], y[0], extra[0]) == (1.0, 2.0, 0.0)


class _Shifted:
    """A registration that shifts alone."""

    def to_first(self, points):
        return points + np.array([10.0, -5.0])


def test_drift_is_subtracted_on_the_first_colour():
    second = spots([(0, 0, 0), (4, 0, 0), (9, 0, 0)])
    drift = pd.DataFrame({"frame": [2, 3, 4], "dx_nm": [0.0, 1.0, 2.0], "dy_nm": [0.0, 0.0, 3.0]})
    places = map_second(second, _Shifted(), drift)
    assert places.tolist() == [[10, -5], [8, -8], [8, -8]]
    assert map_second(second, _Shifted(), drift.iloc[:0]).tolist() == [[10, -5]] * 3
