"""Power, false alarms, times and intervals of the search for switches of speed.

    python tests/benchmarks/switches.py REPEATS tests/benchmarks/switches.json

Rotors are simulated by plain numpy: the path is averaged over the exposure and read with noise.
Frames of 2 ms; where there is a switch, it is at 18 s. The file is written after every row.
"""

from __future__ import annotations

import datetime
import json
import sys
import time
from pathlib import Path

import numpy as np

from rotortrack.motion.changepoints import find_switches

FRAME_S, FRAMES, SHORT, SWITCH_S, PARTS = 0.002, 20_000, 4000, 18.0, 8


def rotor(rng, omega, diffusion, sigma, missing):
    """Frames and angles of a rotor whose speed is given for each frame."""
    pace = FRAME_S / PARTS
    frames = omega.size
    turn = np.repeat(omega * pace, PARTS)
    path = np.cumsum(turn + rng.normal(0.0, np.sqrt(2 * diffusion * pace), turn.size))
    theta = path.reshape(frames, PARTS).mean(axis=1) + rng.normal(0.0, sigma, frames)
    seen = np.flatnonzero(rng.random(frames) >= missing)
    return seen, np.angle(np.exp(1j * theta[seen]))


def trial(
    rng, repeats, *, diffusion, change_deg_s, base_deg_s=300.0, sigma=0.2, missing=0.0,
    frames=FRAMES,
):  # fmt: skip
    """Search many rotors of one kind."""
    omega = np.full(frames, np.deg2rad(base_deg_s))
    omega[round(SWITCH_S / FRAME_S) :] += np.deg2rad(change_deg_s)
    errors, inside, counts, reversals, seconds = [], [], [], 0, 0.0
    for _ in range(repeats):
        track = rotor(rng, omega, diffusion, sigma, missing)
        start = time.thread_time()
        found = find_switches(*track, frame_interval_s=FRAME_S, exposure_s=FRAME_S)
        seconds += time.thread_time() - start
        counts.append(len(found))
        reversals += bool(found.reverses.any())
        if change_deg_s and len(found):
            nearest = min(found.times, key=lambda switch: abs(switch.time_s - SWITCH_S))
            errors.append(abs(nearest.time_s - SWITCH_S))
            inside.append(nearest.low_s <= SWITCH_S <= nearest.high_s)
    return {
        "frames": frames,
        "diffusion_rad2_s": diffusion,
        "change_deg_s": change_deg_s,
        "base_deg_s": base_deg_s,
        "sigma_rad": sigma,
        "missing": missing,
        "repeats": repeats,
        "any_switch": float(np.mean(np.array(counts) > 0)),
        "exactly_one": float(np.mean(np.array(counts) == 1)),
        "reversals": reversals / repeats,
        "median_error_s": float(np.median(errors)) if errors else None,
        "interval_coverage": float(np.mean(inside)) if inside else None,
        "seconds_each": round(seconds / repeats, 3),
    }


def rows(repeats):
    """Power and times of one switch, gaps, then false alarms in shorter tracks of driven rotors."""
    rng = np.random.default_rng(0)
    for diffusion, change in ((20, 1600), (20, 800), (2, 200), (2, 400), (2, 800), (2, 1600),
                              (60, 800), (60, 1600)):  # fmt: skip
        yield trial(rng, repeats, diffusion=diffusion, change_deg_s=change)
    for missing in (0.3, 0.6):
        yield trial(rng, repeats, diffusion=20, change_deg_s=1600, missing=missing)
    for diffusion, sigma, missing in ((20, 0.2, 0.0), (2, 0.2, 0.0), (60, 0.2, 0.3)):
        # Driven at four standard deviations of the speed, where a reversal is the likeliest.
        speed = np.rad2deg(4 * np.sqrt(2 * diffusion / (SHORT * FRAME_S)))
        yield trial(
            rng, 20 * repeats, diffusion=diffusion, change_deg_s=0.0, base_deg_s=float(speed),
            sigma=sigma, missing=missing, frames=SHORT,
        )  # fmt: skip


def main() -> None:
    repeats, path = int(sys.argv[1]), Path(sys.argv[2])
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    done = []
    for row in rows(repeats):
        done.append(row)
        path.write_text(json.dumps({"date": today, "rows": done}, indent=1) + "\n")


if __name__ == "__main__":
    main()
