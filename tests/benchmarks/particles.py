"""Bias and coverage of the diffusion coefficient of single free particles.

    python tests/benchmarks/particles.py PARTICLES tests/benchmarks/results/particles.json

Particles are simulated by plain numpy: the path is averaged over the exposure and read with noise,
and the errors that are told with the positions are wrong by a factor. Frames of 10 ms.
"""

from __future__ import annotations

import datetime
import itertools
import json
import sys
import time
from pathlib import Path

import numpy as np

from rotortrack.motion.covariance import covariance_estimate, step_products
from rotortrack.motion.free_particle import fit_free_particle
from rotortrack.motion.readings import Timing

FRAME_S, PARTS = 0.01, 16


def particle(rng, frames, diffusion_um2_s, noise_nm, exposed, missing):
    """Frames and positions of one particle."""
    spread = np.sqrt(2e6 * diffusion_um2_s * FRAME_S / PARTS)
    path = np.cumsum(rng.normal(0.0, spread, (frames * PARTS, 2)), axis=0)
    seen = max(round(PARTS * exposed), 1)
    place = path.reshape(frames, PARTS, 2)[:, :seen].mean(axis=1)
    place += rng.normal(0.0, noise_nm, place.shape)
    frame = np.flatnonzero(rng.random(frames) >= missing)
    return frame, *place[frame].T


def trial(rng, particles, *, frames, diffusion, noise, exposed, missing, told):
    """Measure many particles of one kind."""
    timing = Timing(FRAME_S, FRAME_S * exposed)
    values, inside, cve, directed, seconds = [], [], [], [], 0.0
    for _ in range(particles):
        frame, x, y = particle(rng, frames, diffusion, noise, exposed, missing)
        variance = np.full(frame.size, (noise * told) ** 2)
        start = time.thread_time()
        found = fit_free_particle(frame, x, y, variance, variance, timing)
        seconds += time.thread_time() - start
        low, high = found.diffusion_interval_nm2_s
        values.append(found.diffusion_nm2_s / 1e6)
        inside.append(low <= 1e6 * diffusion <= high)
        directed.append(found.directed_p < 0.05)
        cve.append(covariance_estimate(step_products(frame, x, y), timing).diffusion_nm2_s / 1e6)
    return {
        "frames": frames,
        "diffusion_um2_s": diffusion,
        "noise_nm": noise,
        "exposed": exposed,
        "missing": missing,
        "told_over_true_error": told,
        "particles": particles,
        "bias": round(float(np.mean(values)) / diffusion - 1.0, 4),
        "relative_sd": round(float(np.std(values)) / diffusion, 4),
        "covariance_estimator_relative_sd": round(float(np.nanstd(cve)) / diffusion, 4),
        "coverage_95": round(float(np.mean(inside)), 4),
        "directed_at_5_percent": round(float(np.mean(directed)), 4),
        "ms": round(1e3 * seconds / particles, 3),
    }


def main() -> None:
    """Measure the grid, and write after every row."""
    particles, target = int(sys.argv[1]), Path(sys.argv[2])
    rows = []
    grid = itertools.product((20, 60, 200), ((0.1, 20.0), (0.02, 30.0), (0.1, 5.0)), (0.0, 1.0))
    for k, (frames, (diffusion, noise), exposed) in enumerate(grid):
        kind = {"frames": frames, "diffusion": diffusion, "noise": noise, "exposed": exposed}
        for missing, told in ((0.0, 1.0), (0.3, 0.8)):
            rng = np.random.default_rng(k)
            rows.append(trial(rng, particles, **kind, missing=missing, told=told))
            content = {"date": datetime.date.today().isoformat(), "rows": rows}
            target.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
