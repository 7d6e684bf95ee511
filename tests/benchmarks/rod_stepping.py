"""Stepping of the rod: error of the rotation rate, and speed against the paper's own integrator.

    python tests/benchmarks/rod_stepping.py tests/benchmarks/results/rod_stepping.json

Rods dock on the pore of the embedded table and rotate. `rates`: the mean rate over the last 40 us
of 500 us, start and docking included, against a run in steps of at most 0.02 us at a tolerance of
1e-4 nm. `transient`: the largest error of a vertex after 1, 2, 3 and 4 us of docking, against a
tolerance of 1e-6 nm. `against_the_paper`: 20 us of steady rotation, from the same shape; the error
is that of the angle turned, the jitter the standard deviation of the rate between samples.
`whole_run`: 200 us from the start above the membrane; the error is that of the rate over the last
20 us. All runs are timed in one process, by the thread's own time, best of three where they are
short.
"""

from __future__ import annotations

import datetime
import functools
import json
import math
import sys
import time
from pathlib import Path

import numpy as np

from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.placement import PLACEMENTS, place_rod
from rotortrack.simulate.rod.run import run_rod

ROTORS = ((0.26, 130.0, 0), (0.26, 138.0, 1), (0.15, 105.0, 0), (0.35, 122.0, 0), (0.35, 130.0, 2))
"""lambda_eff, flow ratio and placement; rates of 4000 to 15 000 rev/s."""


def timed(rod, start, field, repeats=3, **stepping):
    """Run a rod and time it."""
    options = SteppingOptions(**stepping)
    best = math.inf
    for _ in range(repeats):
        begin = time.thread_time()
        run = run_rod(rod, options, start, field)
        best = min(best, time.thread_time() - begin)
    return run, best


def placed(rod, placement, field):
    """Start at one of the three placements."""
    x, y = PLACEMENTS[placement]
    return place_rod(rod, StartOptions(offset_x_nm=x, offset_y_nm=y), membrane_nm=field.membrane_nm)


def late_rate(run, span_us=40.0):
    """Mean rate over the last stretch, rad/us."""
    begin = np.searchsorted(run.time_us, run.time_us[-1] - span_us - 1e-9)
    turned = run.turned_rad[-1] - run.turned_rad[begin]
    return turned / (run.time_us[-1] - run.time_us[begin])


def rates(field):
    """Error of the rate of each rotor at several tolerances."""
    for lambda_eff, ratio, placement in ROTORS:
        rod = RodOptions(lambda_eff=lambda_eff, flow_ratio=ratio)
        run = functools.partial(timed, rod, placed(rod, placement, field), field)
        exact = late_rate(run(1, duration_us=500.0, tolerance_nm=1e-4, max_step_us=0.02)[0])
        row = {
            "lambda_eff": lambda_eff,
            "flow_ratio": ratio,
            "offset_nm": PLACEMENTS[placement],
            "rate_rev_s": exact * 1e6 / (2 * math.pi),
        }
        for tolerance in (0.1, 1e-2, 1e-3):
            result, seconds = run(duration_us=500.0, tolerance_nm=tolerance)
            row[f"tolerance {tolerance:g} nm"] = {
                "error_rel": abs(late_rate(result) / exact - 1.0),
                "seconds": round(seconds, 3),
                "steps": result.n_steps,
            }
        yield row


def vertex_errors(run, exact):
    """Largest distance of a vertex from where it should be, at each sample but the first."""
    distance = np.linalg.norm(run.positions_nm - exact.positions_nm, axis=2).max(axis=1)
    return [float(f"{error:.2g}") for error in distance[1:]]


METHODS = {
    "paper": {"method": "paper"},
    "explicit 0.35 ns": {"method": "explicit", "step_us": 3.5e-4},
    "tolerance 0.1 nm": {"tolerance_nm": 0.1},
    "tolerance 0.01 nm": {"tolerance_nm": 1e-2},
    "tolerance 0.001 nm": {"tolerance_nm": 1e-3},
    "tolerance 0.0001 nm": {"tolerance_nm": 1e-4},
}


def transient(field):
    """Error and time of 4 us of docking."""
    rod = RodOptions()
    run = functools.partial(timed, rod, placed(rod, 0, field), field, duration_us=4.0)
    exact, _ = run(1, sample_us=1.0, tolerance_nm=1e-6)
    for name, stepping in METHODS.items():
        result, seconds = run(sample_us=1.0, **stepping)
        yield {
            "method": name,
            "errors_nm": vertex_errors(result, exact),
            "us_per_s": round(4.0 / seconds, 1),
            "steps": result.n_steps,
        }


def against_the_paper(field):
    """Error and time of 20 us of steady rotation."""
    rod = RodOptions()
    docked, _ = timed(
        rod, placed(rod, 0, field), field, 1, duration_us=400.0, sample_us=50.0, max_step_us=0.05
    )
    run = functools.partial(timed, rod, docked.positions_nm[-1], field, duration_us=20.0)
    exact, _ = run(1, tolerance_nm=1e-4, max_step_us=0.02)
    for name, stepping in METHODS.items():
        result, seconds = run(1 if "method" in stepping else 3, **stepping)
        pace = np.diff(result.turned_rad) / np.diff(result.time_us)
        yield {
            "method": name,
            "angle_error_rel": abs(result.turned_rad[-1] / exact.turned_rad[-1] - 1.0),
            "rate_jitter_rel": float(pace.std() / abs(pace.mean())),
            "errors_nm": vertex_errors(result, exact)[24::25],
            "us_per_s": round(20.0 / seconds, 1),
            "steps": result.n_steps,
        }


def whole_run(field):
    """Error and time of docking and beginning rotation."""
    rod = RodOptions()
    run = functools.partial(timed, rod, placed(rod, 2, field), field, duration_us=200.0)
    exact = late_rate(run(1, tolerance_nm=1e-4, max_step_us=0.02)[0], 20.0)
    for name, stepping in METHODS.items():
        result, seconds = run(1 if "method" in stepping else 3, **stepping)
        yield {
            "method": name,
            "rate_error_rel": abs(late_rate(result, 20.0) / exact - 1.0),
            "us_per_s": round(200.0 / seconds, 1),
            "steps": result.n_steps,
        }


def main() -> None:
    """Measure and store."""
    field = embedded_table()
    for stepping in METHODS.values():
        timed(RodOptions(), placed(RodOptions(), 0, field), field, 1, duration_us=0.1, **stepping)
    result = {"date": datetime.datetime.now(datetime.UTC).date().isoformat()}
    for measure in (against_the_paper, whole_run, transient, rates):
        result[measure.__name__] = list(measure(field))
        Path(sys.argv[1]).write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
