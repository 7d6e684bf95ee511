import numpy as np
import pandas as pd
import pytest

from rotortrack.motion.changepoints import find_switches
from rotortrack.motion.switch_table import switch_table
from rotortrack.motion.tables import SWITCHES, VOLTAGE_SPEEDS
from rotortrack.motion.tracks import used_tracks
from rotortrack.motion.trigger import FrameClock
from rotortrack.motion.voltage import VoltageSteps
from rotortrack.motion.voltage_speeds import (
    speeds_at_steps,
    step_changes,
    step_edges_s,
    voltage_speeds,
)

FRAME_S = 0.002
TIMES = {"frame_interval_s": FRAME_S, "exposure_s": FRAME_S}
N = 4000
SWITCH_S = 3.2
STEPS = VoltageSteps(
    np.array([0.01, 3.25]), np.array([3.21, 8.01]), np.array([0.1, 0.2]), np.array([0.001, 0.001])
)
CLOCK = FrameClock(0.01 + np.arange(N) * FRAME_S, FRAME_S, 0, 0, 0, starts_high=False)


@pytest.fixture(scope="module")
def ends_s():
    return step_edges_s(STEPS, CLOCK, first_edge=0, **TIMES)


def turned(turning, rng, before, after, diffusion=8.0, sigma=0.1):
    frame, theta = turning(rng, N, diffusion=diffusion, sigma=sigma, missing=0.1)
    omega = np.where(np.arange(N) * FRAME_S < SWITCH_S, before, after)
    return frame, np.angle(np.exp(1j * (theta + np.cumsum(omega * FRAME_S)[frame])))


def tables(turning, pairs):
    rng = np.random.default_rng(5)
    tracks = []
    for number, (before, after) in enumerate(pairs):
        frame, theta = turned(turning, rng, before, after)
        tracks.append(pd.DataFrame({"rotor": number, "frame": frame, "theta_rad": theta}))
    rotors = pd.DataFrame({"rotor": range(len(pairs)), "verdict": "kept"})
    return pd.concat(tracks, ignore_index=True), rotors


def test_steps_lie_half_an_exposure_early_on_the_clock_of_frame_starts(ends_s):
    assert ends_s == pytest.approx(np.array([[-0.001, 3.199], [3.239, 7.999]]), abs=1e-9)
    later = step_edges_s(STEPS, CLOCK, first_edge=10, **TIMES)
    assert later == pytest.approx(ends_s - 0.02, abs=1e-9)


def test_speeds_at_each_voltage_have_pulls_of_one(turning, ends_s):
    rng = np.random.default_rng(6)
    pulls = []
    for _ in range(60):
        found, _ = speeds_at_steps(*turned(turning, rng, 15.0, 30.0), ends_s, **TIMES)
        pulls.append((found.omega_rad_s - [15.0, 30.0]) / found.sd_rad_s)
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.2
    assert np.abs(np.mean(pulls, axis=0)).max() < 0.45
    assert found.sd_rad_s == pytest.approx(np.sqrt(16.0 / np.array([3.2, 4.76])), rel=0.15)


def test_the_table_has_a_row_a_rotor_and_step_and_the_line_is_tested(turning, ends_s):
    first = np.linspace(-30.0, 30.0, 8)
    tracks, rotors = tables(turning, [(v, 2.0 * v) for v in first])
    rotors.loc[3, "verdict"] = "refused"
    table = voltage_speeds(tracks, rotors, STEPS, ends_s, **TIMES)
    assert table.columns.tolist() == VOLTAGE_SPEEDS.names
    assert len(table) == 14
    assert 3 not in set(table["rotor"])
    (change,) = step_changes(table)
    assert change.line.n == 7
    assert change.line.ratio == pytest.approx(2.0)
    assert abs(change.line.slope - 2.0) < 4 * change.line.slope_sd
    assert change.line.p_slope > 1e-3
    assert "from 0.1 V to 0.2 V" in change.sentence
    assert step_changes(table[table["step"] == 0]) == []


def test_a_rotor_that_does_not_follow_the_voltage_refutes_the_line(turning, ends_s):
    tracks, rotors = tables(turning, [(v, v) for v in (-40.0, -30.0, 30.0, 40.0, 50.0)])
    (change,) = step_changes(voltage_speeds(tracks, rotors, STEPS, ends_s, **TIMES))
    assert change.line.slope == pytest.approx(1.0, abs=5 * change.line.slope_sd)
    assert change.line.p_slope < 0.01


def test_no_ratio_is_tested_from_zero_volts(turning, ends_s):
    steps = VoltageSteps(STEPS.start_s, STEPS.stop_s, np.array([0.0, 0.2]), STEPS.voltage_sd_v)
    tracks, rotors = tables(turning, [(0.0, 20.0)] * 3)
    assert step_changes(voltage_speeds(tracks, rotors, steps, ends_s, **TIMES)) == []


def test_empty_tables_give_empty_tables(ends_s):
    tracks = pd.DataFrame({"rotor": [], "frame": [], "theta_rad": []}, dtype="float64")
    rotors = pd.DataFrame({"rotor": [], "verdict": []})
    table = voltage_speeds(tracks, rotors, STEPS, ends_s, **TIMES)
    assert len(table) == 0
    assert step_changes(table) == []
    switches = switch_table({}, frame_interval_s=FRAME_S)
    assert switches.columns.tolist() == SWITCHES.names


def test_the_table_of_switches_names_rotor_time_and_speeds(turning):
    tracks, rotors = tables(turning, [(30.0, -30.0), (20.0, 20.0)])
    found = {
        number: find_switches(track.frame, track.theta_rad, **TIMES)
        for number, track in used_tracks(tracks, rotors).items()
    }
    table = switch_table(found, frame_interval_s=FRAME_S)
    assert table["rotor"].tolist() == [0]
    row = table.iloc[0]
    assert row["time_s"] == pytest.approx(SWITCH_S, abs=0.15)
    assert row["time_ci_low_s"] <= row["time_s"] <= row["time_ci_high_s"]
    assert row["reverses"]
    assert row["frame"] == round(row["time_s"] / FRAME_S)
    assert np.deg2rad(row["change_deg_s"]) == pytest.approx(
        row["after_rad_s"] - row["before_rad_s"]
    )
