"""Run folders and scans whose distances and speeds are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from rotortrack.exchange import parquet
from rotortrack.pipeline.scan_parts import DIMENSIONS
from rotortrack.simulate.archive import write_archive
from rotortrack.simulate.rod.observe import DYES_NM, dye_centres_nm
from rotortrack.simulate.tables import RUNS
from rotortrack.tables import ROTORS, empty
from rotortrack.twocolour.measured import Film, measured_group
from rotortrack.twocolour.tables import END_TO_END, END_TO_END_ROTORS

FILM = Film(exposure_s=0.002, min_spread=1.3, mirrored=False)
LENGTH_NM = 450.0
FRAMES = (200, 400)


def group_tables(seed, n=12, mean_nm=180.0, sd_nm=60.0, noise_nm=15.0, **changed):
    """Make the three tables of n rotors; speeds go with the 1.5th power of the distance."""
    rng = np.random.default_rng(seed)
    true = np.maximum(rng.normal(mean_nm, sd_nm, n), 30.0)
    lengths = rng.integers(*FRAMES, n)
    owner = np.repeat(np.arange(n), lengths)
    total = len(owner)
    turned = 2.0 * np.pi * rng.random(total)
    dx = true[owner] * np.cos(turned) + rng.normal(0.0, noise_nm, total)
    dy = true[owner] * np.sin(turned) + rng.normal(0.0, noise_nm, total)
    sd = np.full(total, noise_nm)
    frames = pd.DataFrame(
        {
            "rotor": owner,
            "frame": np.concatenate([np.arange(length) for length in lengths]),
            **{"dx_nm": dx, "dy_nm": dy, "x_sd_nm": sd, "y_sd_nm": sd},
            "distance_nm": np.hypot(dx, dy),
        }
    )
    true_sd = np.full(n, 3.0)
    ends = pd.DataFrame(
        {
            "rotor": np.arange(n),
            "n_frames": lengths,
            "end_to_end_nm": true + rng.normal(0.0, true_sd),
            "end_to_end_sd_nm": true_sd,
            **{"noise_nm": noise_nm, "told_noise_nm": noise_nm, "registration_error_nm": 3.0},
        }
    )
    speed = rng.choice([-1.0, 1.0], n) * 720.0 * (true / 180.0) ** 1.5
    speed *= np.exp(rng.normal(0.0, 0.2, n))
    speed_sd = np.full(n, 40.0)
    rotors = pd.DataFrame(
        {
            "rotor": np.arange(n),
            **{"x_nm": 0.0, "y_nm": 0.0, "verdict": "kept", "localisation_sd_nm": noise_nm / 1.4},
            "behaviour": np.where(speed > 0, "driven_ccw", "driven_cw"),
            "speed_deg_s": speed,
            "omega_sd_rad_s": np.radians(speed_sd),
            "diffusion_rad2_s": 2.0,
        }
    )
    return frames, ends, rotors.assign(**changed)


def group(seed, name="run", film=FILM, **kwargs):
    """Make a measured group."""
    return measured_group(name, *group_tables(seed, **kwargs), film)


def write_run(folder: Path, seed: int, *, without=(), mirrored="unknown", **kwargs) -> Path:
    """Write a run folder with tables of end-to-end distances."""
    folder.mkdir(parents=True)
    frames, ends, rotors = group_tables(seed, **kwargs)
    tables = {END_TO_END: frames, END_TO_END_ROTORS: ends, ROTORS: rotors}
    for schema, table in tables.items():
        if schema.name not in without:
            parquet.write_table(folder / f"{schema.name}.parquet", table, schema, {})
    movie = {"frame_interval_s": 0.002, "exposure_s": 0.002, "mirrored": mirrored}
    options = {"movie": {key: {"value": v, "origin": "flag"} for key, v in movie.items()}}
    lists = {key: [] for key in ("inputs", "notes", "warnings", "steps", "tables")}
    more = {"state": "complete", "counts": {}, "seconds": {}, "versions": {}, "options": options}
    (folder / "run.json").write_text(json.dumps({**lists, **more}))
    return folder


def arc(span_nm: float, turn_rad: float = 0.0, *, mirrored=False, vertices=21):
    """Bend a rod so that its ends are a distance apart, above the pore's axis."""
    at = np.linspace(-0.5, 0.5, vertices)
    x, y = span_nm * at, 40.0 + 0.3 * span_nm * (0.25 - at**2) + 30.0 * at
    z = (x + 1j * (-y if mirrored else y)) * np.exp(1j * turn_rad)
    return np.stack([z.real, z.imag, np.full(vertices, 15.0)], axis=1)


def scan_tables(runs):
    """Make the table and shapes of runs (lambda_eff, flow_ratio, end, span, turn, mirrored)."""
    rows, shapes = [], []
    for number, (charge, ratio, end, span, turn, mirrored) in enumerate(runs):
        shape = arc(span, turn, mirrored=mirrored)
        shapes.append(shape)
        dyes = dye_centres_nm(shape, LENGTH_NM, DYES_NM)
        rows.append(
            {
                **{"run": number, "placement": 0, "mirrored": mirrored, "end": end},
                **{"lambda_eff": charge, "flow_ratio": ratio},
                "rate_rev_s": (-1.0 if mirrored else 1.0) * 10.0 * span,
                "end_to_end_dyes_xy_nm": np.hypot(*(dyes[1] - dyes[0])[:2]),
            }
        )
    table = pd.concat([empty(RUNS), pd.DataFrame(rows)])[RUNS.names]
    numbers = {c.name: 0 if c.dtype == "int64" else "" for c in RUNS.columns if c.dtype != "bool"}
    blank = {name: value for name, value in numbers.items() if RUNS.dtypes[name] != "float64"}
    return table.fillna(blank).astype(RUNS.dtypes), np.array(shapes)


TURNS = "rotating_steadily"
GRID = [
    (charge, ratio, TURNS, 150.0 + 40.0 * i + 15.0 * j, 0.3 * i, mirrored)
    for i, charge in enumerate((0.1, 0.2, 0.26))
    for j, ratio in enumerate((120.0, 130.0))
    for mirrored in (False, True)
]


def write_scan(folder: Path, runs=GRID, **changed) -> Path:
    """Write the folder of a finished scan."""
    folder.mkdir(parents=True)
    table, shapes = scan_tables(runs)
    parquet.write_table(folder / "runs.parquet", table, RUNS, {})
    angles = np.zeros((len(table), 101))
    arrays = {"shape_nm": shapes, "time_us": angles, "turned_rad": angles}
    write_archive(folder / "shapes.npz", {name: arrays[name] for name in DIMENSIONS}, {})
    rod = {"length_nm": {"value": LENGTH_NM, "origin": "default"}}
    facts = {"state": "complete", "key": "0", "runs": len(table), "options": {"rod": rod}}
    (folder / "scan.json").write_text(json.dumps({**facts, **changed}))
    return folder
