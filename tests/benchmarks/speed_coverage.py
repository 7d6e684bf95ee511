"""Coverage, bias and efficiency of signed speeds and diffusion, by simulation apart from them.

    python tests/benchmarks/speed_coverage.py --repeats 400 --minutes 40
    python tests/benchmarks/speed_coverage.py --kind brownian --frames 5000 --repeats 1000
    python tests/benchmarks/speed_coverage.py --cells D120 sigma0.05/missing0
    python tests/benchmarks/speed_coverage.py --minutes 0        # print the worst cells so far

The path is a random walk in 16 parts a frame, the camera averages positions on the circle over
the exposure, noise is added per axis, frames go missing at random. Truth is the omega that was put
in. The bias of omega is measured with the path's own displacement as control variate, whose mean
is known. The bound is the inverse of the likelihood's mean information at the true parameters,
noise unknown but for what the radius tells. `brownian` has no drift; otherwise |omega| is 1 to
300 rad/s. Each cell is written when it is done, and a later run goes on with those that are
missing or have fewer repeats.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from rotortrack.motion.circular import MOST_ANGLES, Grid, angles_needed
from rotortrack.motion.estimate import MotionEstimate, estimate_motion
from rotortrack.motion.readings import Circle, Pace, Timing, noise_prior_sd, readings

FRAME_S = 0.002
PARTS = 16
RADIUS_NM = 100.0
DIFFUSIONS = (0.2, 2.0, 20.0, 120.0)
NOISES = (0.05, 0.2, 0.5)
MISSING = (0.0, 0.4, 0.8)
EXPOSED = (1.0, 0.0)
RESULTS = Path(__file__).with_name("results") / "speed_coverage.json"
BOUND_SCENES = 24
IDENTIFIED = 0.15


@dataclass(frozen=True)
class Scene:
    """Positions of a simulated rotor, and the truth in every frame."""

    frame: np.ndarray
    x_nm: np.ndarray
    y_nm: np.ndarray
    sd_nm: np.ndarray
    true_x_nm: np.ndarray
    true_y_nm: np.ndarray
    displacement: float
    circle: Circle


def film(rng, path, sigma, missing, exposed) -> Scene:
    """Expose a path given at PARTS + 1 points a frame, the last being the next frame's first."""
    n = path.size // PARTS
    if exposed == 0.0:
        position = np.exp(1j * path[:-1].reshape(n, PARTS)[:, 0])
    else:
        parts = round(PARTS * exposed)
        on_circle = np.exp(1j * path)
        starts = PARTS * np.arange(n)[:, np.newaxis]
        weights = np.full(parts + 1, 1.0 / parts)
        weights[[0, -1]] *= 0.5
        position = on_circle[starts + np.arange(parts + 1)] @ weights
    seen_radius = RADIUS_NM * np.sqrt(np.mean(np.abs(position) ** 2))
    x, y = RADIUS_NM * position.real, -RADIUS_NM * position.imag
    sd = sigma * RADIUS_NM
    frame = np.flatnonzero(rng.random(n) >= missing)
    return Scene(
        frame=frame,
        x_nm=(x + rng.normal(0.0, sd, n))[frame],
        y_nm=(y + rng.normal(0.0, sd, n))[frame],
        sd_nm=np.full(frame.size, sd),
        true_x_nm=x,
        true_y_nm=y,
        displacement=float(path[-1] - path[0]),
        circle=Circle(x_nm=0.0, y_nm=0.0, radius_nm=seen_radius),
    )


def diffusing(rng, n, omega, diffusion, sigma, missing, exposed) -> Scene:
    pace = FRAME_S / PARTS
    step = rng.normal(omega * pace, np.sqrt(2.0 * diffusion * pace), n * PARTS)
    path = rng.uniform(0.0, 2.0 * np.pi) + np.concatenate(([0.0], np.cumsum(step)))
    return film(rng, path, sigma, missing, exposed)


def estimate(scene: Scene, exposed: float) -> MotionEstimate:
    return estimate_motion(
        scene.frame,
        scene.x_nm,
        scene.y_nm,
        scene.sd_nm,
        scene.sd_nm,
        scene.circle,
        frame_interval_s=FRAME_S,
        exposure_s=exposed * FRAME_S,
    )


def bound(scenes, omegas, diffusion, exposed) -> tuple[float, float]:
    """Standard deviations of omega and of log D by the mean information at the truth."""
    timing = Timing(FRAME_S, exposed * FRAME_S)
    total = np.zeros((3, 3))
    for scene, omega in zip(scenes, omegas, strict=True):
        seen = readings(scene.frame, scene.x_nm, scene.y_nm, scene.sd_nm, scene.sd_nm, scene.circle)
        truth = np.array([omega, np.log(diffusion), 0.0])
        low = Pace(omega, 0.7 * diffusion, 0.8)
        grid = Grid(seen, timing, min(max(angles_needed(low, seen, timing), 48), MOST_ANGLES))
        stride = np.array([np.sqrt(diffusion / (seen.frame[-1] * FRAME_S)), 0.1, 0.1])

        def value(at, grid=grid):
            return grid.log_densities(Pace(at[0], np.exp(at[1]), np.exp(at[2]))).sum()

        unit = np.diag(stride)
        for i, j in itertools.product(range(3), repeat=2):
            corners = [
                a * b * value(truth + a * unit[i] + b * unit[j])
                for a, b in itertools.product((-1.0, 1.0), repeat=2)
            ]
            total[i, j] -= sum(corners) / (4.0 * stride[i] * stride[j])
    # Where the motion hides the noise, the radius alone tells it.
    total[2, 2] += sum(noise_prior_sd(scene.frame.size) ** -2 for scene in scenes)
    covariance = np.linalg.inv(total / len(scenes))
    return float(np.sqrt(covariance[0, 0])), float(np.sqrt(covariance[1, 1]))


def position_error(scene, found: MotionEstimate, sigma, diffusion, exposed) -> dict[str, float]:
    """Root-mean-square error of posterior positions over the goal, and pull; seen and missed.

    Along the circle the goal is ``sqrt(0.5 / sqrt(1 + 4 / q))`` single-frame bounds. A rotor that
    diffuses far in an exposure leaves the circle inwards, with the variance of `posterior`, and
    only its own reading tells by how much.
    """
    after = found.posterior
    seen = np.isin(after.frame, scene.frame)
    square = (after.x_nm - scene.true_x_nm[after.frame]) ** 2
    square += (after.y_nm - scene.true_y_nm[after.frame]) ** 2
    told = after.x_sd_nm**2 + after.y_sd_nm**2
    q = 2.0 * diffusion * FRAME_S / sigma**2
    inward = (2.0 * diffusion * exposed * FRAME_S / sigma) ** 2 / 180.0
    goal = np.sqrt(0.5 / np.sqrt(1.0 + 4.0 / q) + 0.5 * inward / (1.0 + inward))
    result = {"error_over_goal": np.sqrt(square[seen].mean() / 2.0) / (sigma * RADIUS_NM * goal)}
    result["pull_seen"] = np.sqrt(square[seen].mean() / told[seen].mean())
    missed = ~seen
    result["pull_missed"] = (
        np.sqrt(square[missed].mean() / told[missed].mean()) if missed.any() else np.nan
    )
    return result


def cell(n, repeats, diffusion, sigma, missing, exposed, *, brownian=False):
    """Simulate, estimate and sum up rotors of one kind."""
    rng = np.random.default_rng(
        [
            n,
            round(10 * diffusion),
            round(100 * sigma),
            round(10 * missing),
            round(exposed),
            brownian,
        ]
    )
    rows, scenes, omegas = [], [], []
    for number in range(repeats):
        speed = 0.0 if brownian else np.exp(rng.uniform(0.0, np.log(300.0)))
        omega = speed * rng.choice((-1.0, 1.0))
        scene = diffusing(rng, n, omega, diffusion, sigma, missing, exposed)
        start = time.thread_time()
        found = estimate(scene, exposed)
        took = time.thread_time() - start
        if number < BOUND_SCENES:
            scenes.append(scene)
            omegas.append(omega)
        fit = found.fit
        low, high = fit.omega_interval_rad_s
        d_low, d_high = fit.diffusion_interval_rad2_s
        rows.append(
            {
                "omega_error": fit.omega_rad_s - omega,
                "omega_controlled": fit.omega_rad_s - scene.displacement / (n * FRAME_S),
                "omega_covered": low <= omega <= high,
                "diffusion": fit.diffusion_rad2_s,
                "diffusion_covered": d_low <= diffusion <= d_high,
                "one_sided": fit.one_sided,
                "drift_called": fit.drift_p < 0.05,
                "circular": found.method == "circular",
                "uneven": found.resampled,
                "milliseconds": 1e3 * took,
                **position_error(scene, found, sigma, diffusion, exposed),
            }
        )
    column = {name: np.array([row[name] for row in rows], float) for name in rows[0]}
    omega_bound, d_bound = bound(scenes, omegas, diffusion, exposed)
    sd = column["omega_error"].std()
    return {
        "n": n,
        "D": diffusion,
        "sigma": sigma,
        "missing": missing,
        "exposed": exposed,
        "repeats": repeats,
        "circular": column["circular"].mean(),
        "cover_omega": column["omega_covered"].mean(),
        "cover_D": column["diffusion_covered"].mean(),
        "one_sided": column["one_sided"].mean(),
        "bound_rel_sd_D": d_bound,
        "bias_omega_sd": column["omega_controlled"].mean() / sd,
        "bias_omega_se": column["omega_controlled"].std() / np.sqrt(repeats) / sd,
        "bias_D": column["diffusion"].mean() / diffusion - 1.0,
        "bias_D_se": column["diffusion"].std() / np.sqrt(repeats) / diffusion,
        "sd_over_bound_omega": sd / omega_bound,
        "sd_over_bound_D": column["diffusion"].std() / diffusion / d_bound,
        "uneven": column["uneven"].mean(),
        "drift_called": column["drift_called"].mean(),
        "error_over_goal": column["error_over_goal"].mean(),
        "pull_seen": np.sqrt(np.mean(column["pull_seen"] ** 2)),
        "pull_missed": np.sqrt(np.mean(column["pull_missed"] ** 2)),
        "ms_median": np.median(column["milliseconds"]),
        "ms_max": column["milliseconds"].max(),
    }


def excesses(row: dict) -> dict[str, float]:
    """By how much a cell misses each bar, in units of the bar; negative where it is met.

    Three standard errors of the simulation are granted, so that what is positive is missed.
    """
    n, n_frames = row["repeats"], row["n"]
    error = 3.0 * math.sqrt(0.95 * 0.05 / n)
    off = {"cover_omega": (abs(row["cover_omega"] - 0.95) - 0.02 - error) / 0.02}
    low = (0.93 - row["cover_D"] - error) / 0.02
    high = (row["cover_D"] - 0.97 - error) / 0.02
    identified = (row["bound_rel_sd_D"] or math.inf) <= IDENTIFIED
    off["cover_D"] = max(low, high) if identified else low
    spread = 3.0 / math.sqrt(2.0 * n)
    off["sd_over_bound_omega"] = (row["sd_over_bound_omega"] - 1.1 - spread) / 0.1
    off["bias_omega"] = (abs(row["bias_omega_sd"]) - 0.05 - 3.0 * row["bias_omega_se"]) / 0.05
    if identified:
        off["sd_over_bound_D"] = (row["sd_over_bound_D"] - 1.1 - spread) / 0.1
        off["bias_D"] = (abs(row["bias_D"]) - 0.02 - 3.0 * row["bias_D_se"]) / 0.02
    if row["missing"] == 0.0:
        # The formula is that of a rotor which is seen in every frame.
        off["posterior"] = (row["error_over_goal"] - 1.05) / 0.05
    off["pull"] = (abs(row["pull_seen"] - 1.0) - 0.05) / 0.05
    if row["kind"] == "brownian":
        error = 3.0 * math.sqrt(0.05 * 0.95 / n)
        off["driven"] = (abs(row["drift_called"] - 0.05) - 0.01 - error) / 0.01
    limit = (1000.0 if row["circular"] > 0.5 else 30.0) * max(n_frames / 8000.0, 1.0)
    off["ms"] = (row["ms_median"] - limit) / limit
    return off


def cell_name(n, kind, diffusion, sigma, missing, exposed) -> str:
    return f"{kind}/N{n}/D{diffusion:g}/sigma{sigma:g}/missing{missing:g}/exposed{exposed:g}"


def measure(kind, n, repeats, values) -> dict:
    row = cell(n, repeats, *values, brownian=kind == "brownian")
    figures = {
        key: None if np.isnan(value) else float(f"{value:.4g}") for key, value in row.items()
    }
    return {"date": date.today().isoformat(), "kind": kind, **figures}


def write(path: Path, rows: dict[str, dict]) -> None:
    """Replace the results in one go, so that a run may be stopped at any time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    content = {"date": date.today().isoformat(), "cells": dict(sorted(rows.items()))}
    part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def report(rows: dict[str, dict], worst: int) -> None:
    """Print how many cells meet all bars, and those that are farthest off."""
    found = sorted(
        (
            (excess, bar, name)
            for name, row in rows.items()
            for bar, excess in excesses(row).items()
        ),
        reverse=True,
    )
    missed = {name for excess, _, name in found if excess > 0.0}
    print(f"{len(rows) - len(missed)} of {len(rows)} cells meet all bars; nearest to failing:")
    for excess, bar, name in found[:worst]:
        row = rows[name]
        told = {"posterior": "error_over_goal", "driven": "drift_called", "ms": "ms_median"}
        told |= {"bias_omega": "bias_omega_sd", "pull": "pull_seen"}
        value = row[told.get(bar, bar)]
        print(f"  {excess:+6.2f} {bar} {value:g}  {name} ({row['repeats']:g} rotors)")


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kind", choices=("driven", "brownian"), default="driven")
    parser.add_argument("--frames", type=int, nargs="+", default=[1000])
    parser.add_argument("--repeats", type=int, default=400, help="rotors a cell")
    parser.add_argument(
        "--cells",
        nargs="+",
        default=[""],
        help="parts of names, joined by /, that a cell must have",
    )
    parser.add_argument("--minutes", type=float, default=40.0, help="no cell starts after them")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--worst", type=int, default=12, help="bars to print at the end")
    parser.add_argument("--out", type=Path, default=RESULTS)
    return parser.parse_args()


def wanted(chosen: argparse.Namespace, rows: dict[str, dict]) -> list[tuple[str, int, tuple]]:
    """Cells to measure, spread over the grid, so that a short run sees all corners."""
    grid = itertools.product(DIFFUSIONS, NOISES, MISSING, EXPOSED)
    every = [
        (cell_name(n, chosen.kind, *values), n, values) for values in grid for n in chosen.frames
    ]
    order = np.random.default_rng(0).permutation(len(every))
    return [
        (name, n, values)
        for name, n, values in (every[i] for i in order)
        if any(set(part.split("/")) <= {*name.split("/"), ""} for part in chosen.cells)
        and rows.get(name, {"repeats": 0})["repeats"] < chosen.repeats
    ]


def main() -> None:
    chosen = options()
    rows = {}
    if chosen.out.exists():
        rows = json.loads(chosen.out.read_text(encoding="utf-8"))["cells"]
    todo = wanted(chosen, rows)
    end = time.monotonic() + 60.0 * chosen.minutes
    running: dict[Future, str] = {}
    with ProcessPoolExecutor(chosen.workers) as pool:
        while running or (todo and time.monotonic() < end):
            while todo and len(running) < chosen.workers and time.monotonic() < end:
                name, n, values = todo.pop(0)
                running[pool.submit(measure, chosen.kind, n, chosen.repeats, values)] = name
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                name = running.pop(future)
                rows[name] = future.result()
                write(chosen.out, rows)
                worst, bar = max((excess, bar) for bar, excess in excesses(rows[name]).items())
                print(f"{name}: {worst:+.2f} {bar}", flush=True)
    print(f"{len(todo)} cells of this kind are left")
    report(rows, chosen.worst)


if __name__ == "__main__":
    main()
