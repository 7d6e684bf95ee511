import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack import tables
from rotortrack.errors import TableError
from rotortrack.flags import FitFlag
from rotortrack.motion.angles import angle, angle_sd, build_tracks, step

# A hand-drawn spot that turns counter-clockwise as one looks at it: right, top, left, bottom.
PICTURES = [
    ["...", "..#", "..."],
    [".#.", "...", "..."],
    ["...", "#..", "..."],
    ["...", "...", ".#."],
]


def rotors_table(**columns):
    return pd.DataFrame({"rotor": [0], "x_nm": [0.0], "y_nm": [0.0], "radius_nm": [10.0]} | columns)


def spots(theta, frame=None, rotor=0, radius=10.0, **columns):
    theta = np.asarray(theta, float)
    frame = np.arange(theta.size) if frame is None else frame
    return pd.DataFrame(
        {
            "frame": frame,
            "x_nm": radius * np.cos(theta),
            "y_nm": -radius * np.sin(theta),
            "rotor": rotor,
            "fit_flags": 0,
        }
        | columns
    )


def tracks_of(localisations, rotors=None, gap_mode="drop"):
    rotors = rotors_table() if rotors is None else rotors
    return build_tracks(localisations, rotors, frame_interval_s=0.5, gap_mode=gap_mode)


def test_a_drawn_spot_that_turns_counter_clockwise_has_positive_steps():
    row, column = np.array(
        [np.argwhere([[c == "#" for c in line] for line in picture])[0] for picture in PICTURES]
    ).T
    theta = angle(column + 0.5, row + 0.5, np.float64(1.5), np.float64(1.5))
    np.testing.assert_allclose(np.rad2deg(step(theta[:-1], theta[1:])), [90, 90, 90])
    np.testing.assert_allclose(np.rad2deg(step(theta[1:], theta[:-1])), [-90, -90, -90])


@pytest.mark.parametrize(("start", "end"), [(0.0, np.pi), (np.pi, 0.0), (0.0, -np.pi)])
def test_a_step_of_exactly_half_a_turn_is_counter_clockwise(start, end):
    assert step(np.float64(start), np.float64(end)) == np.pi


def test_a_step_just_above_half_a_turn_is_clockwise():
    assert step(np.float64(0.0), np.nextafter(np.pi, 4.0)) == pytest.approx(-np.pi)


@given(st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi))
def test_a_step_leads_to_the_next_angle_and_lies_within_half_a_turn(start, end):
    found = step(np.float64(start), np.float64(end))
    assert -np.pi < found <= np.pi
    assert np.exp(1j * (start + found)) == pytest.approx(np.exp(1j * end), abs=1e-12)


def test_angle_sd_takes_the_error_along_the_tangent():
    # At 0 degrees the spot moves along y, at 90 degrees along x.
    sd = angle_sd(
        np.array([0.0, np.pi / 2, np.pi / 4]), *np.full((2, 3), [[3.0], [4.0]]), np.ones(3), 10.0
    )
    np.testing.assert_allclose(sd, [0.4, 0.3, np.sqrt(12.5) / 10.0])


def test_angle_sd_falls_back_to_the_uncertainty():
    table = tracks_of(spots([0.0, 1.0], uncertainty_nm=[2.0, np.nan]))
    np.testing.assert_allclose(table["theta_sd_rad"], [0.2, np.nan])


def test_dropped_gaps_have_no_step_but_the_cumulative_angle_goes_on():
    localisations = spots([3.0, 3.3, 3.6, 3.8], frame=[4, 5, 8, 9])
    table = tracks_of(localisations)
    np.testing.assert_allclose(table["step_rad"], [np.nan, 0.3, np.nan, 0.2], atol=1e-12)
    np.testing.assert_allclose(table["cumulative_rad"], [0.0, 0.3, 0.6, 0.8], atol=1e-12)
    np.testing.assert_allclose(table["time_s"], [2.0, 2.5, 4.0, 4.5])
    bridged = tracks_of(localisations, gap_mode="bridge")
    np.testing.assert_allclose(bridged["step_rad"], [np.nan, 0.3, 0.3, 0.2], atol=1e-12)


def test_rotors_are_kept_apart_and_sorted():
    localisations = pd.concat(
        [spots([0.5, 0.1], frame=[7, 6], rotor=3), spots([1.0, 1.2], rotor=1)], ignore_index=True
    ).sample(frac=1.0, random_state=1)
    rotors = rotors_table(rotor=[3, 1], x_nm=0.0, y_nm=0.0, radius_nm=10.0)
    table = tracks_of(localisations, rotors)
    assert table["rotor"].tolist() == [1, 1, 3, 3]
    assert table["frame"].tolist() == [0, 1, 6, 7]
    np.testing.assert_allclose(table["step_rad"], [np.nan, 0.2, np.nan, 0.4], atol=1e-12)
    np.testing.assert_allclose(table["cumulative_rad"], [0.0, 0.2, 0.0, 0.4], atol=1e-12)


def test_duplicates_lone_spots_and_rotors_without_a_circle_are_left_out():
    localisations = pd.concat(
        [
            spots([0.0, 2.0], frame=[0, 0], fit_flags=[0, int(FitFlag.DUPLICATE)]),
            spots([0.0], rotor=-1),
            spots([0.0], rotor=5),
        ]
    )
    rotors = rotors_table(rotor=[0, 5], x_nm=0.0, y_nm=0.0, radius_nm=[10.0, np.nan])
    table = tracks_of(localisations, rotors)
    assert table[["rotor", "theta_rad"]].to_numpy().tolist() == [[0, 0.0]]


def test_unflagged_duplicates_are_an_error():
    with pytest.raises(TableError, match="rotor 0 has several localisations in frame 2"):
        tracks_of(spots([0.0, 1.0], frame=[2, 2]))


def test_localisations_without_rotors_are_an_error():
    with pytest.raises(TableError, match="cluster them first"):
        tracks_of(spots([0.0]).drop(columns="rotor"))


def test_empty_tables_give_an_empty_table_with_all_columns():
    table = tracks_of(tables.empty(tables.LOCALISATIONS), tables.empty(tables.ROTORS))
    assert table.empty
    assert {name: str(table[name].dtype) for name in table} == tables.TRACKS.dtypes
