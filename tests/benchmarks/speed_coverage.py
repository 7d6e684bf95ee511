"""Coverage, bias and efficiency of signed speeds and diffusion, by simulation apart from them.

    python tests/benchmarks/speed_coverage.py grid 1000 400 OUT.csv     # frames, rotors a cell
    python tests/benchmarks/speed_coverage.py brownian 8000 1000 OUT.csv
    python tests/benchmarks/speed_coverage.py posterior 8000 4 OUT.csv
    python tests/benchmarks/speed_coverage.py uneven 4000 100 OUT.csv

The path is a random walk in 16 parts a frame, the camera averages positions on the circle over
the exposure, noise is added per axis, frames go missing at random. Truth is the omega that was put
in. The bias of omega is measured with the path's own displacement as control variate, whose mean
is known. The bound is the inverse of the likelihood's mean information at the true parameters,
noise unknown. Results are appended row by row, so a run can be stopped.
"""

from __future__ import annotations

import csv
import itertools
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotortrack.motion.circular import MOST_ANGLES, Grid, angles_needed
from rotortrack.motion.estimate import MotionEstimate, estimate_motion
from rotortrack.motion.readings import Circle, Pace, Timing, readings

FRAME_S = 0.002
PARTS = 16
RADIUS_NM = 100.0
DIFFUSIONS = (0.2, 2.0, 20.0, 120.0)
NOISES = (0.05, 0.2, 0.5)
MISSING = (0.0, 0.4, 0.8)
EXPOSED = (1.0, 0.0)


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
    covariance = np.linalg.inv(total / len(scenes))
    return float(np.sqrt(covariance[0, 0])), float(np.sqrt(covariance[1, 1]))


def position_error(scene: Scene, found: MotionEstimate, sigma: float, diffusion: float):
    """Root-mean-square error of posterior positions over the bound's, and pull; seen and missed."""
    after = found.posterior
    seen = np.isin(after.frame, scene.frame)
    square = (after.x_nm - scene.true_x_nm[after.frame]) ** 2
    square += (after.y_nm - scene.true_y_nm[after.frame]) ** 2
    told = after.x_sd_nm**2 + after.y_sd_nm**2
    q = 2.0 * diffusion * FRAME_S / sigma**2
    goal = np.sqrt(0.5 / np.sqrt(1.0 + 4.0 / q))
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
        if number < 24:
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
                **position_error(scene, found, sigma, diffusion),
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


def main() -> None:
    kind, n, repeats, out = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    cells = list(itertools.product(DIFFUSIONS, NOISES, MISSING, EXPOSED))
    part = (
        slice(*(int(v) if v else None for v in sys.argv[5].split(":")))
        if len(sys.argv) > 5
        else slice(None)
    )
    for values in cells[part]:
        row = cell(n, repeats, *values, brownian=kind == "brownian")
        row = {key: f"{value:.4g}" for key, value in row.items()}
        new = not out.exists()
        with out.open("a", newline="") as file:
            writer = csv.DictWriter(file, row)
            if new:
                writer.writeheader()
            writer.writerow(row)


if __name__ == "__main__":
    main()
