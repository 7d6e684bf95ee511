"""Thermal noise against exact laws, at the paper's rod and at finer and longer steps.

    python tests/benchmarks/thermal.py tests/benchmarks/results/thermal-DATE.json [rows]

Joint variance and persistence length of the 450-nm rod, of short rods of the same links for ever
longer steps, of finer links; diffusion of a stiff rod; rods on the pore at 300 K. Each number
stands with its standard error and its exact value; the file is written after every row.
"""

from __future__ import annotations

import datetime
import importlib.util
import json
import sys
import time
from pathlib import Path

import numpy as np

from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.rod.options import (
    RodOptions,
    StartOptions,
    SteppingOptions,
    ThermalOptions,
)
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import run_rod

_SPEC = importlib.util.spec_from_file_location(
    "brownian", Path(__file__).parents[1] / "unit" / "simulate" / "rod" / "brownian.py"
)
law = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(law)

# Name: vertices, link nm, duration us, sample us, step us, theta, metric force.
JOINTS = {
    "paper": (51, 9.0, 150.0, 0.02, 1e-4, 0.5, False),
    "paper_metric": (51, 9.0, 60.0, 0.02, 1e-4, 0.5, True),
    "short_0.05ns": (11, 9.0, 60.0, 1e-3, 0.5e-4, 0.5, True),
    "short_0.1ns": (11, 9.0, 120.0, 1e-3, 1e-4, 0.5, True),
    "short_0.2ns": (11, 9.0, 200.0, 2e-3, 2e-4, 0.5, True),
    "short_0.4ns": (11, 9.0, 200.0, 4e-3, 4e-4, 0.5, True),
    "short_0.1ns_rigid": (11, 9.0, 120.0, 1e-3, 1e-4, 0.5, False),
    "short_0.1ns_implicit": (11, 9.0, 60.0, 1e-3, 1e-4, 1.0, True),
    "short_0.8ns": (11, 9.0, 200.0, 4e-3, 8e-4, 0.5, True),
    "fine_0.1ns": (21, 4.5, 30.0, 1e-3, 1e-4, 0.5, True),
    "fine_0.025ns": (21, 4.5, 15.0, 1e-3, 2.5e-5, 0.5, True),
}
DIFFUSION = {"stiff_0.2ns": (400.0, 4e-3, 2e-4), "stiff_0.1ns": (200.0, 4e-3, 1e-4)}

# Name: lambda_eff, ratio, seed, step us; in the shipped field at 300 K for at most 40 us.
DOCKED = {
    "docked_0.26_130_0.2ns": (0.26, 130.0, 1, 2e-4),
    "docked_0.26_130_0.1ns": (0.26, 130.0, 1, 1e-4),
    "docked_0.15_120_a": (0.15, 120.0, 1, 2e-4),
    "docked_0.15_120_b": (0.15, 120.0, 2, 2e-4),
    "docked_0.15_120_c": (0.15, 120.0, 3, 2e-4),
}


def joints(n, edge_nm, duration_us, sample_us, step_us, theta, metric):
    """Joint variance over the exact one, and persistence length."""
    rod = RodOptions(n_vertices=n, length_nm=edge_nm * (n - 1))
    start = law.equilibrium_rod(n, np.random.default_rng(1), edge_nm=edge_nm)
    stepping = SteppingOptions(duration_us=duration_us, sample_us=sample_us)
    noise = ThermalOptions(seed=1, step_us=step_us, theta=theta, metric_force=metric)
    begin = time.thread_time()
    run = run_rod(rod, stepping, start, thermal=noise)
    seconds = time.thread_time() - begin
    cosines = law.joint_cosines(run.positions_nm)
    variance, variance_error = law.mean_and_error((np.arccos(cosines) ** 2).mean(axis=1))
    cosine, cosine_error = law.mean_and_error(cosines.mean(axis=1))
    exact = law.joint_mean(np.square, edge_nm=edge_nm)
    persistence = -edge_nm / np.log(cosine)
    return {
        "variance_over_exact": variance / exact,
        "its_error": variance_error / exact,
        "by_modes": law.joint_variance_ratio(n, theta, step_us, edge_nm=edge_nm),
        "persistence_nm": persistence,
        "persistence_error_nm": persistence * cosine_error / (1.0 - cosine),
        "exact_persistence_nm": -edge_nm / np.log(law.joint_mean(np.cos, edge_nm=edge_nm)),
        "step_seconds": seconds / run.n_steps,
        "simulated_us_per_s": duration_us / seconds,
    }


def turns(duration_us, sample_us, step_us):
    """Diffusion of a stiff rod of five vertices over its exact values."""
    rod = RodOptions(n_vertices=5, length_nm=36.0, persistence_length_nm=3000.0)
    start = law.equilibrium_rod(5, np.random.default_rng(1), persistence_nm=3000.0)
    stepping = SteppingOptions(duration_us=duration_us, sample_us=sample_us)
    noise = ThermalOptions(seed=1, step_us=step_us, metric_force=True)
    run = run_rod(rod, stepping, start, thermal=noise)
    drag = np.pi * 1e-3 * 9.0
    exact = {
        "across": law.KT / (4.0 * drag),
        "along": law.KT / (2.0 * drag),
        "turning": law.KT / (6.0 * drag * 81.0),
    }
    found = law.diffusion(run.positions_nm, run.time_us)
    return {
        name: {"over_exact": mean / exact[name], "its_error": error / exact[name]}
        for name, (mean, error) in found.items()
    }


def docked(lambda_eff, flow_ratio, seed, step_us):
    """What becomes of a rod on the pore, and how far it turns."""
    field = embedded_table()
    rod = RodOptions(lambda_eff=lambda_eff, flow_ratio=flow_ratio)
    start = place_rod(rod, StartOptions(), membrane_nm=field.membrane_nm)
    stepping = SteppingOptions(duration_us=40.0, stop_when_settled=True)
    begin = time.thread_time()
    run = run_rod(rod, stepping, start, field, ThermalOptions(seed=seed, step_us=step_us))
    seconds = time.thread_time() - begin
    late = run.time_us >= 0.5 * run.simulated_us
    return {
        "end": run.end.value,
        "simulated_us": run.simulated_us,
        "turns": run.turned_rad[-1] / (2.0 * np.pi),
        "mean_height_nm": run.positions_nm[late, :, 2].mean() - 10.0,
        "step_seconds": seconds / run.n_steps,
    }


def main() -> None:
    """Measure the rows named, or all, and store them."""
    path = Path(sys.argv[1])
    result = json.loads(path.read_text()) if path.exists() else {}
    result["date"] = datetime.datetime.now(datetime.UTC).date().isoformat()
    run_rod(
        RodOptions(n_vertices=3, length_nm=18.0),
        SteppingOptions(duration_us=1e-3, sample_us=1e-3),
        law.equilibrium_rod(3, np.random.default_rng(0)),
        thermal=ThermalOptions(),
    )
    names = sys.argv[2:] or [*JOINTS, *DIFFUSION, *DOCKED]
    for name in names:
        if name in JOINTS:
            row = joints(*JOINTS[name])
        else:
            row = turns(*DIFFUSION[name]) if name in DIFFUSION else docked(*DOCKED[name])
        result[name] = row
        print(name, json.dumps(row), flush=True)
        path.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
