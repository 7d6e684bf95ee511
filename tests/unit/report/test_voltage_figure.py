from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rotortrack.motion.tables import SWITCHES, VOLTAGE_SPEEDS, VOLTAGES
from rotortrack.report.draw import draw_run
from rotortrack.report.figures import cumulative_angle, voltage
from rotortrack.tables import empty

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import FRAME_INTERVAL_S, clipped, make_run, overlaps


def made_up(rotors, levels=(0.1, 0.2), seed=0, fast=1.0):
    rng = np.random.default_rng(seed)
    rows = [
        {
            "rotor": rotor, "step": step, "voltage_v": level,
            "omega_rad_s": fast * (base * level / 0.1 + rng.normal(0, 2)),
            "omega_sd_rad_s": 2.0 * fast,
        }
        for rotor, base in enumerate(rng.normal(0, 20, rotors))
        for step, level in enumerate(levels)
    ]  # fmt: skip
    n = 4000
    frame = np.arange(n)
    step = frame * len(levels) // n
    volts = pd.DataFrame(
        {"frame": frame, "voltage_v": np.array(levels)[step], "transition": frame % 2000 < 30}
    )
    return pd.DataFrame(rows, columns=VOLTAGE_SPEEDS.names), volts


@pytest.mark.parametrize(
    ("rotors", "levels", "fast"),
    [
        *((40, (0.1, 0.2), 1.0), (90, (0.1, 0.2), 100.0), (3, (-0.1, 0.1, 0.2), 1.0)),
        *((2, (0.1, 0.2), 1.0), (5, (0.1,), 1.0), (4, (0.0, 1.2), 0.01)),
    ],
)  # fmt: skip
def test_nothing_overlaps_whatever_the_rotors_and_voltages(rotors, levels, fast):
    figure = voltage.figure(*made_up(rotors, levels, fast=fast), frame_interval_s=FRAME_INTERVAL_S)
    assert overlaps(figure) == []
    assert clipped(figure) == []


def test_empty_tables_say_so():
    figure = voltage.figure(
        empty(VOLTAGE_SPEEDS), empty(VOLTAGES), frame_interval_s=FRAME_INTERVAL_S
    )
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert "no frame has a voltage" in texts
    assert overlaps(figure) == []


def some_switches(times):
    rows = [
        {
            "rotor": 0, "time_s": time, "time_ci_low_s": time - 0.2, "time_ci_high_s": time + 0.1,
            "before_rad_s": 10.0, "after_rad_s": -10.0,
        }
        for time in times
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=SWITCHES.names)


def test_switches_are_marked_on_the_cumulative_angle():
    _, rotor, track = make_run(1, 4000).of(0)
    plain, marked = (
        cumulative_angle.figure(
            track, rotor, frame_interval_s=FRAME_INTERVAL_S, switches=some_switches(times)
        )
        for times in ([], [2.0, 5.0])
    )
    count = [len(figure.axes[0].collections) for figure in (plain, marked)]
    assert count[1] > count[0]
    (segments,) = (
        collection.get_segments()
        for collection in marked.axes[0].collections
        if collection.get_label().startswith("switch")
    )
    assert [segment[0][0] for segment in segments] == [2.0, 5.0]
    assert overlaps(marked) == []


def test_a_run_with_a_trace_has_the_figure(tmp_path):
    run = make_run(3, 200)
    speeds, volts = made_up(3)
    written = draw_run(
        tmp_path, rotors=run.rotors, tracks=run.tracks, localisations=run.localisations,
        drift=run.drift, frame_interval_s=FRAME_INTERVAL_S, voltages=volts, voltage_speeds=speeds,
        switches=some_switches([0.1]), max_sheets=1,
    )  # fmt: skip
    assert [path.stem for path in written[-3:]] == ["voltage", "voltage_angles", "rotor-000"]
