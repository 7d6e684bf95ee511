"""Scans: every point of the grid and every start, each run by itself."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rotortrack.simulate import scan
from rotortrack.simulate.scan import ANGLES, FAILED, phase_diagram, planned_runs, runs_table
from rotortrack.simulate.tables import RUNS

from .rods import scene


def test_the_grid_holds_every_start_at_every_point_once():
    runs = planned_runs(scene(mirrored=True).scan)
    points = {(r.placement, r.mirrored, r.lambda_eff, r.flow_ratio) for r in runs}
    assert len(points) == len(runs) == scene(mirrored=True).scan.runs == 24
    assert [run.number for run in runs] == list(range(24))
    # Starts of one point of the grid follow each other.
    assert len({(run.lambda_eff, run.flow_ratio) for run in runs[:4]}) == 1


def test_a_run_gets_the_values_of_its_point_and_start(rods):
    given = scene({"start": {"height_nm": 9.0}}, mirrored=True)
    run = planned_runs(given.scan)[-1]
    scan.simulate_run(given, None, run)
    ((rod, start, field, thermal),) = rods.calls
    assert (rod.lambda_eff, rod.flow_ratio, rod.n_vertices) == (0.4, 130.0, 5)
    assert (start.offset_x_nm, start.offset_y_nm, start.height_nm) == (40.0, 8.0, 9.0)
    assert start.mirrored
    assert field is None
    assert thermal is None


def test_the_mirror_image_of_a_mirrored_start_is_the_start(rods):
    given = scene({"start": {"mirrored": True}}, mirrored=True)
    for run in planned_runs(given.scan)[:2]:
        scan.simulate_run(given, None, run)
    assert [call[1].mirrored for call in rods.calls] == [True, False]


@pytest.mark.usefixtures("rods")
def test_what_is_kept_of_a_run():
    given = scene()
    results = [scan.simulate_run(given, None, run) for run in planned_runs(given.scan)]
    table = runs_table([result.row for result in results])
    assert list(table.columns) == RUNS.names
    assert {name: str(table[name].dtype) for name in ("run", "mirrored", "rate_rev_s")} == {
        "run": "int64",
        "mirrored": "bool",
        "rate_rev_s": "float64",
    }
    for result in results:
        assert result.shape_nm.shape == (5, 3)
        assert result.time_us.shape == result.turned_rad.shape == (ANGLES,)
        assert result.time_us[0] == 0.0
        assert result.time_us[-1] == result.row["simulated_us"]
        rate = result.row["rate_rev_s"]
        np.testing.assert_allclose(result.turned_rad, rate * result.time_us)
        assert result.seconds > 0.0


@pytest.mark.usefixtures("rods")
def test_a_run_of_few_samples_keeps_its_first_and_last():
    given = scene({"stepping": {"duration_us": 1.0, "sample_us": 0.5}})
    result = scan.simulate_run(given, None, planned_runs(given.scan)[0])
    assert set(result.time_us) == {0.0, 0.5}
    assert np.all(np.diff(result.time_us) >= 0.0)


def test_a_rod_that_cannot_be_integrated_is_a_row_that_says_why(rods):
    rods.broken_at = 0.2
    given = scene()
    results = [scan.simulate_run(given, None, run) for run in planned_runs(given.scan)]
    table = runs_table([result.row for result in results])
    broken = table[table["lambda_eff"] == 0.2]
    assert set(broken["end"]) == {FAILED}
    assert broken["problem"].str.contains("step 7").all()
    assert broken[["rate_rev_s", "end_to_end_nm"]].isna().all(axis=None)
    assert (table[table["lambda_eff"] != 0.2]["problem"] == "").all()


def test_noise_of_a_run_is_its_own_and_stays_when_the_grid_grows(rods):
    noisy = {"thermal": {"seed": 3}}
    small, wide = scene(noisy), scene(noisy, lambda_eff=[0.05, 0.1, 0.2, 0.4], mirrored=True)
    seeds = []
    for given in (small, wide):
        rods.calls.clear()
        points = [
            (run.placement, run.mirrored, run.lambda_eff, run.flow_ratio)
            for run in planned_runs(given.scan)
            if scan.simulate_run(given, None, run)
        ]
        own = [call[3].seed for call in rods.calls]
        assert len(set(own)) == len(own)
        seeds.append(dict(zip(points, own, strict=True)))
    assert seeds[0].items() <= seeds[1].items()


def test_another_seed_gives_other_noise_and_none_draws_no_number(rods, monkeypatch):
    drawn = []
    real = np.random.SeedSequence
    monkeypatch.setattr(scan.np.random, "SeedSequence", lambda e: drawn.append(e) or real(e))
    run = planned_runs(scene().scan)[0]
    scan.simulate_run(scene(), None, run)
    assert drawn == []
    for seed in (1, 2):
        scan.simulate_run(scene({"thermal": {"seed": seed}}), None, run)
    assert len({call[3].seed for call in rods.calls[1:]}) == 2


def test_the_diagram_has_a_letter_for_each_start():
    ends = ["not_docked", "docked_still", "rotating_steadily", "translocated"] * 2
    table = pd.DataFrame(
        {
            "lambda_eff": [0.5, 0.5, 0.1, 0.1] * 2,
            "flow_ratio": [90.0] * 4 + [122.5] * 4,
            "end": [*ends[:-2], "time_reached", FAILED],
        }
    )
    header, rows = phase_diagram(table)
    assert header == ["ratio", "0.1", "0.5"]
    assert rows == [["122.5", "ux", "ND"], ["90", "RT", "ND"]]
