"""`rotortrack motion RUN --daq TRACE` on the sample movie, whose voltage is made up."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rotortrack_cli.main import main

ROTORS = Path(__file__).parents[2] / "sample_data" / "rotors"
FRAMES, FRAME_S, LEAD_S, SWITCH_S = 1600, 0.002, 0.0151, 1.6


def call(*words):
    return main([str(word) for word in words])


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    folder = tmp_path_factory.mktemp("daq") / "run"
    words = ("-c", ROTORS / "config.toml", "--no-figures", "-q")
    assert call("run", ROTORS / "movie.tif", *words, "-o", folder) == 0
    return folder


@pytest.fixture
def run_folder(base, tmp_path):
    return Path(shutil.copytree(base, tmp_path / "run"))


def write_trace(path, *, edges=FRAMES, period_s=FRAME_S, separator=",", missing=()):
    """100 mV, then 200 mV from SWITCH_S of the movie on."""
    rng = np.random.default_rng(1)
    starts = np.delete(LEAD_S + period_s * np.arange(edges), list(missing))
    time_s = np.arange(round((starts[-1] + 0.05) * 1e4)) / 1e4
    trigger = np.zeros(time_s.size)
    for start in starts:
        trigger[slice(*np.searchsorted(time_s, [start, start + 0.001]))] = 3.3
    table = pd.DataFrame(
        {
            "time_s": time_s,
            "trigger_v": np.round(trigger + rng.normal(0, 0.02, time_s.size), 4),
            "voltage_v": np.where(time_s < LEAD_S + SWITCH_S, 0.1, 0.2),
        }
    )
    table.to_csv(path, index=False, sep=separator, decimal="," if separator == ";" else ".")
    return path


def test_the_trace_of_the_sample_gives_both_voltages_their_speeds(run_folder, capfd):
    assert call("motion", run_folder, "--daq", ROTORS / "daq.csv", "--no-figures") == 0
    assert "from 0.05 V to 0.1 V" in capfd.readouterr().out.replace("\n" + " " * 18, " ")
    voltages = pd.read_parquet(run_folder / "voltages.parquet")
    assert voltages["frame"].tolist() == list(range(FRAMES))
    assert voltages["voltage_v"].iloc[[0, -1]].tolist() == pytest.approx([0.05, 0.1], abs=4e-4)


@pytest.mark.parametrize("separator", [",", ";"])
def test_frames_get_voltages_and_rotors_speeds_at_each(run_folder, tmp_path, capfd, separator):
    trace = write_trace(tmp_path / "trace.csv", separator=separator)
    assert call("motion", run_folder, "--daq", trace) == 0
    assert "from 0.1 V to 0.2 V" in capfd.readouterr().out.replace("\n" + " " * 18, " ")
    voltages = pd.read_parquet(run_folder / "voltages.parquet")
    assert voltages["frame"].tolist() == list(range(FRAMES))
    assert voltages["voltage_v"].iloc[[0, -1]].tolist() == pytest.approx([0.1, 0.2])
    changed = voltages.loc[voltages["transition"], "frame"]
    assert set(changed) <= {798, 799, 800, 801}
    speeds = pd.read_csv(run_folder / "voltage_speeds.csv")
    rotors = pd.read_csv(run_folder / "rotors.csv").set_index("rotor")
    kept = rotors.index[rotors["verdict"] == "kept"]
    assert speeds.groupby("rotor").size().to_dict() == dict.fromkeys(kept, 2)
    # The sample's driven rotors turn half as fast before the switch.
    truth = pd.read_csv(ROTORS / "truth" / "rotors.csv")
    driven = 0
    for number, pair in speeds.groupby("rotor"):
        found = rotors.loc[number]
        away_nm = np.hypot(truth["x_nm"] - found["x_nm"], truth["y_nm"] - found["y_nm"])
        rotor = truth.loc[away_nm.idxmin()]
        if rotor["motion"] == "driven":
            expected = rotor["omega_rad_s"] * np.array([0.5, 1.0])
            away = (pair["omega_rad_s"] - expected) / pair["omega_sd_rad_s"]
            assert np.abs(away).max() < 3.5
            driven += 1
    assert driven == 5
    assert (run_folder / "figures" / "voltage.png").read_bytes().startswith(b"\x89PNG")
    manifest = json.loads((run_folder / "run.json").read_text())
    assert {"voltages", "voltage_speeds", "switches"} <= set(manifest["tables"])
    assert manifest["trace"]["path"].endswith("trace.csv")


def test_tables_of_a_trace_go_when_motion_is_measured_without_one(run_folder, tmp_path):
    trace = write_trace(tmp_path / "trace.csv")
    assert call("motion", run_folder, "--daq", trace, "--no-figures", "-q") == 0
    assert call("motion", run_folder, "--no-figures", "-q") == 0
    assert not (run_folder / "voltages.parquet").exists()
    assert "trace" not in json.loads((run_folder / "run.json").read_text())


def test_a_run_with_a_trace_can_be_reproduced(run_folder, tmp_path, capfd):
    trace = write_trace(tmp_path / "trace.csv")
    assert call("motion", run_folder, "--daq", trace, "--no-figures", "-q") == 0
    movie = ROTORS / "movie.tif"
    assert call("run", movie, "--reproduce", run_folder, "-o", tmp_path / "again") == 0
    assert "voltage_speeds: 14 rows, identical" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"missing": (3, 700)}, "2 trigger edge(s) are missing"),
        ({"edges": FRAMES + 40}, "1640 trigger edges for 1600 frames"),
        ({"edges": FRAMES - 40}, "1560 trigger edges for 1600 frames"),
        ({"period_s": 0.0022}, "correct frame_interval_s"),
    ],
)
def test_what_does_not_fit_is_said(run_folder, tmp_path, capfd, options, sentence):
    trace = write_trace(tmp_path / "trace.csv", **options)
    assert call("motion", run_folder, "--daq", trace, "--no-figures") == 0
    assert sentence in " ".join(capfd.readouterr().err.split())


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("time_s,trigger_v\n0,1\n", "lacks the trace column(s) voltage_v"),
        ("time_s,trigger_v,voltage_v\n0,1,0.1\n", "export the whole trace"),
        ("time_s,trigger_v,voltage_v\n0,1,0.1\n0,1,0.1\n", "does not ascend after sample 1"),
        ("time_s,trigger_v,voltage_v\n0,1,0.1\n1,,0.1\n", "trigger_v has no value in sample 2"),
        ("time_s,trigger_v,voltage_v\n0,5,0.1\n1,5,0.1\n", "exposure output"),
        ("", "empty"),
    ],
)
def test_a_trace_that_cannot_be_used_is_one_sentence(
    run_folder, tmp_path, capfd, content, sentence
):
    trace = tmp_path / "trace.csv"
    trace.write_text(content)
    before = (run_folder / "rotors.parquet").read_bytes()
    assert call("motion", run_folder, "--daq", trace, "--no-figures", "-q") == 3
    shown = capfd.readouterr().err
    assert sentence in shown
    assert "trace.csv" in shown
    assert "Traceback" not in shown
    assert (run_folder / "rotors.parquet").read_bytes() == before


def test_a_trace_that_is_not_there_is_named(run_folder, tmp_path, capfd):
    assert call("motion", run_folder, "--daq", tmp_path / "no.csv", "--no-figures", "-q") == 3
    assert "no.csv" in capfd.readouterr().err
