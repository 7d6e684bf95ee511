"""True end-to-end distances from lengths that noise makes too long: errors and coverage.

    python tests/benchmarks/distances.py                  # 80 rotors of each kind
    python tests/benchmarks/distances.py --rotors 8

Vectors of a known distance, constant or breathing, get normal noise per axis; lengths alone are
fitted, with the noise known, free, and drawn to what was told by a prior. `wrong` tells every rotor
a noise that is wrong by a normal error of the size of that prior; `slow` breathes with a
correlation time of 20 frames. Writes results/distances-DATE.json.
"""

from __future__ import annotations

import argparse
import json
import time
from datetime import date
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from rotortrack.twocolour.distance import true_distance

RESULTS = Path(__file__).with_name("results")
PRIOR = 0.02
SLOW_FRAMES = 20.0
CASES = {
    "25 nm": {"distance": 25.0, "noise": 30.0},
    "50 nm": {"distance": 50.0, "noise": 30.0},
    "25 nm, wrong": {"distance": 25.0, "noise": 30.0, "wrong": PRIOR},
    "50 nm, noise varies": {"distance": 50.0, "noise": 30.0, "varies": 0.25},
    "250 nm, 15 nm": {"distance": 250.0, "noise": 15.0},
    "60 nm breathes 25 nm": {"distance": 60.0, "noise": 30.0, "breathing": 25.0},
    "60 nm breathes 25 nm, slow": {
        "distance": 60.0,
        "noise": 30.0,
        "breathing": 25.0,
        "slow": SLOW_FRAMES,
    },
    "25 nm breathes 25 nm": {"distance": 25.0, "noise": 30.0, "breathing": 25.0},
    "10 nm, 100 frames": {"distance": 10.0, "noise": 30.0, "frames": 100},
}


def rotor(
    rng, *, distance, noise, breathing=0.0, frames=5000, wrong=0.0, varies=0.0, slow=0.0
):  # fmt: skip
    """Simulate a rotor: measured lengths, told noise, the mean distance over its frames."""
    breath = rng.normal(size=frames)
    if slow:
        kept = np.exp(-1.0 / slow)
        start = rng.normal()
        breath, _ = lfilter([np.sqrt(1 - kept**2)], [1.0, -kept], breath, zi=[kept * start])
    true = distance + breathing * breath
    sd = noise * np.exp(varies * rng.normal(size=frames))
    lengths = np.hypot(true + sd * rng.normal(size=frames), sd * rng.normal(size=frames))
    return lengths, sd * (1.0 + wrong * rng.normal()), float(np.mean(true))


def told(estimates, truth, realised, lasting_sd=None):
    """Give bias, spread, told error and coverage, of the rod's own mean and its frames'."""
    mean = np.array([each.mean_nm for each in estimates])
    low = np.array([each.low_nm for each in estimates])
    high = np.array([each.high_nm for each in estimates])
    scores = {
        "mean_nm": float(mean.mean()),
        "sd_nm": float(mean.std()),
        "told_sd_nm": float(np.median([each.mean_sd_nm for each in estimates])),
        "coverage": float(np.mean((low <= truth) & (truth <= high))),
        "coverage_of_these_frames": float(np.mean((low <= realised) & (realised <= high))),
        "breathing_nm": float(np.mean([each.breathing_nm for each in estimates])),
        "breathing_scatter_nm": float(np.std([each.breathing_nm for each in estimates])),
    }
    if lasting_sd is not None:
        off = np.abs(mean - truth)
        scores["lasting_sd_nm"] = float(np.median(lasting_sd))
        scores["coverage_lasting"] = float(np.mean(off <= 1.96 * np.array(lasting_sd)))
    return scores


def trial(rotors, kind, seed):
    """Fit many rotors of one kind."""
    found, realised = [], []
    begun = time.process_time()
    for number in range(rotors):
        rng = np.random.default_rng([seed, number])
        lengths, noise, mean = rotor(rng, **kind)
        found.append(true_distance(lengths, noise, noise_prior=PRIOR))
        realised.append(mean)
    seconds = (time.process_time() - begun) / rotors
    true, realised = kind["distance"], np.array(realised)
    return {
        "plain_mean_nm": float(np.mean([each.plain_mean_nm for each in found])),
        "moment_nm": float(np.mean([each.moment_nm for each in found])),
        "known": told([each.known for each in found], true, realised),
        "free": told([each.free for each in found], true, realised),
        "default": told(
            [each.default for each in found],
            true,
            realised,
            [each.lasting_sd_nm for each in found],
        ),
        "n_independent": float(np.median([each.n_independent for each in found])),
        "cpu_seconds_each": round(seconds, 3),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rotors", type=int, default=80)
    asked = parser.parse_args()
    true_distance(np.linspace(20.0, 40.0, 10), np.full(10, 10.0))
    results = {"rotors": asked.rotors, "noise_prior": PRIOR, "cases": {}}
    for seed, (name, kind) in enumerate(CASES.items()):
        results["cases"][name] = one = trial(asked.rotors, kind, seed)
        print(f"{name}: mean {one['plain_mean_nm']:.1f}, {one['cpu_seconds_each']} s each")
        for fit in ("known", "free", "default"):
            shown = {key: round(value, 2) for key, value in one[fit].items()}
            print(f"    {fit:8}{shown}", flush=True)
    if asked.rotors >= 80:
        target = RESULTS / f"distances-{date.today().isoformat()}.json"
        target.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
