"""False alarms, coverage of intervals and slopes of comparisons of groups of rotors.

    python tests/benchmarks/comparisons.py 4000 tests/benchmarks/results/comparisons-DATE.json

Rotors have distances of 180 +- 60 nm that breathe by 20 nm, and 50 to 600 frames. The file is
written after every row.
"""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

import numpy as np
from scipy import stats

from rotortrack.twocolour.compare_options import CompareOptions
from rotortrack.twocolour.correlation import correlate, detectable_rho
from rotortrack.twocolour.forward import draw_twins
from rotortrack.twocolour.measured import Film, MeasuredGroup
from rotortrack.twocolour.population import RodPopulation
from rotortrack.twocolour.resampling import (
    bootstrap,
    curves_of_counts,
    curves_of_values,
    effects,
    matched_p,
    permutation_p,
)

ROTORS = 45
EDGES = np.arange(0.0, 701.0, 5.0)
MEAN_NM, SD_NM, BREATHING_NM, NOISE_NM = 180.0, 60.0, 20.0, 20.0


def rotors(rng, n, mean_nm=MEAN_NM, sd_nm=SD_NM):
    """Draw one mean and the frames of each rotor."""
    means = rng.normal(mean_nm, sd_nm, n)
    lengths = rng.integers(50, 600, n)
    values = np.clip(
        np.repeat(means, lengths) + rng.normal(0.0, BREATHING_NM, lengths.sum()), 0, 699
    )
    return values, lengths


def counted(values, lengths):
    """Count each rotor's frames."""
    owner = np.repeat(np.arange(len(lengths)), lengths)
    at = (values // (EDGES[1] - EDGES[0])).astype(int)
    bins = len(EDGES) - 1
    return np.bincount(owner * bins + at, minlength=bins * len(lengths)).reshape(-1, bins)


def one_population(rng, repeats, permutations=499):
    """Compare halves of one population: how often is p below 0.05?"""
    first = np.arange(2 * ROTORS) < ROTORS
    below = {"mean_distance": 0, "distance_by_frames": 0, "distance_by_rotors": 0}
    frame_ks = 0
    for number in range(repeats):
        values, lengths = rotors(rng, 2 * ROTORS)
        owner = np.repeat(np.arange(len(lengths)), lengths)
        means = np.bincount(owner, values) / lengths
        frames = curves_of_counts(counted(values, lengths), EDGES)
        even = np.ones(len(lengths))
        for name, curves, weight in (
            ("mean_distance", curves_of_values(means), even),
            ("distance_by_frames", frames, lengths.astype(float)),
            ("distance_by_rotors", frames, even),
        ):
            below[name] += permutation_p(curves, weight, first, permutations, rng) < 0.05
        if number < 100:
            test = stats.ks_2samp(values[first[owner]], values[~first[owner]])
            frame_ks += test.pvalue < 0.05
    shares = {name: count / repeats for name, count in below.items()}
    return {"of": "one population", "repeats": repeats, "permutations": permutations,
            "below_0.05": shares, "frame_ks_below_0.05": frame_ks / min(repeats, 100)}  # fmt: skip


def population(rng, n=30):
    """Make rods of a scan."""
    distance = rng.uniform(60.0, 400.0, n)
    return RodPopulation(
        distance_nm=distance,
        radius_nm=np.stack([0.4 * distance, 0.6 * distance], axis=1),
        rate_rev_s=rng.normal(0.0, 5000.0, n),
        weight=np.full(n, 1.0 / n),
        attractor=np.arange(n),
        run=np.arange(n),
        cells=n,
        attractors=n,
        declared=True,
        mirrored_starts=True,
    )


def drawn_group(rng, rods, n=30):
    """Film rods of the population itself: what a declared prior says that the rotors are."""
    lengths = rng.integers(50, 200, n)
    total = int(lengths.sum())
    true = rods.distance_nm[rng.integers(0, len(rods.weight), n)]
    turned = 2.0 * np.pi * rng.random(total)
    sd = rng.uniform(10.0, 40.0, n)
    vector = np.repeat(true, lengths) * np.exp(1j * turned)
    known = np.repeat(sd, lengths)
    vector = vector + known * (rng.normal(size=total) + 1j * rng.normal(size=total))
    ends = np.append(0, np.cumsum(lengths))[:-1]
    distance = np.abs(vector)
    return MeasuredGroup(
        name="run", rotor=np.arange(n), n_frames=lengths, distance_nm=distance, x_sd_nm=known,
        y_sd_nm=known, mean_nm=np.add.reduceat(distance, ends) / lengths, true_nm=true,
        true_sd_nm=np.zeros(n), noise_ratio=np.ones(n), registration_sd_nm=np.zeros(n),
        speed_deg_s=np.full(n, 360.0), speed_sd_deg_s=np.full(n, 10.0),
        diffusion_rad2_s=np.zeros(n), localisation_sd_nm=np.full(n, 1.0),
        behaviour=("",) * n, film=Film(0.0, 1.3, None), left_out=0,
    )  # fmt: skip


def declared_prior(rng, repeats, permutations=499, twins=20):
    """Compare rods of a population with that population: how often is p below 0.05?"""
    rods = population(rng)
    below = 0
    for _ in range(repeats):
        group = drawn_group(rng, rods)
        made = draw_twins(group, rods, EDGES, twins=twins, rng=rng)
        curves = curves_of_values(np.concatenate([group.mean_nm, made.mean_nm.ravel()]))
        even = np.ones(group.n * (twins + 1))
        below += matched_p(curves, even, group.n, permutations, rng) < 0.05
    return {"of": "a declared prior", "repeats": repeats, "below_0.05": below / repeats}


def true_sizes(shift_nm, sd_nm):
    """Integrate Wasserstein-1 and energy distance of the means' two normal populations."""
    x = np.linspace(-2000.0, 2500.0, 200_001)
    gap = stats.norm.cdf(x, 0.0, SD_NM) - stats.norm.cdf(x, shift_nm, sd_nm)
    return float(np.trapezoid(np.abs(gap), x)), float(2.0 * np.trapezoid(gap**2, x))


def coverage(rng, repeats, shift_nm, sd_nm=SD_NM, resamples=400):
    """Count how often intervals hold the true distance of two populations."""
    first = np.arange(2 * ROTORS) < ROTORS
    truth = dict(zip(("wasserstein", "energy"), true_sizes(shift_nm, sd_nm), strict=True))
    truth["difference"] = -shift_nm
    inside = dict.fromkeys(truth, 0)
    for _ in range(repeats):
        values = np.concatenate(
            [rng.normal(0.0, SD_NM, ROTORS), rng.normal(shift_nm, sd_nm, ROTORS)]
        )
        drawn = bootstrap(
            2 * ROTORS, [np.flatnonzero(first), np.flatnonzero(~first)], resamples, rng
        )
        found = effects(curves_of_values(values), first * 1.0, ~first * 1.0, drawn)
        for name, true in truth.items():
            interval = getattr(found, name)
            inside[name] += interval.low <= true <= interval.high
    return {"of": "intervals", "shift_nm": shift_nm, "sd_nm": sd_nm, "repeats": repeats,
            "truth_nm": truth,
            "coverage": {name: count / repeats for name, count in inside.items()}}  # fmt: skip


def slopes(rng, repeats, x_error, resamples=400):
    """Fit a power of 1.5 through 90 rotors with errors in both axes."""
    n, found, inside, alarms = 90, [], 0, 0
    options = {"axes": "log", "resamples": resamples, "permutations": 199, "rng": rng}
    for _ in range(repeats):
        log_x = rng.normal(np.log(180.0), 0.35, n)
        x, y = np.exp(log_x), np.exp(1.5 * log_x - 2.0 + rng.normal(0.0, 0.3, n))
        x_sd, y_sd = x_error * rng.uniform(0.5, 1.5, n) * x, rng.uniform(0.05, 0.3, n) * y
        seen = x + rng.normal(0.0, x_sd), y + rng.normal(0.0, y_sd)
        one = correlate(*seen, x_sd, y_sd, **options)
        found.append(one.slope.value)
        inside += one.slope.low <= 1.5 <= one.slope.high
        none = correlate(seen[0], rng.permutation(seen[1]), x_sd, y_sd, **options)
        alarms += none.p < 0.05
    return {"of": "slopes", "rotors": n, "x_error": x_error, "repeats": repeats, "true": 1.5,
            "mean": float(np.mean(found)), "sd": float(np.std(found)), "coverage": inside / repeats,
            "rho_false_alarms": alarms / repeats, "detectable_rho": detectable_rho(n)}  # fmt: skip


def rows(repeats):
    """Bars first: one population with itself."""
    rng = np.random.default_rng(CompareOptions().seed)
    yield one_population(rng, repeats)
    yield declared_prior(rng, max(repeats // 4, 1))
    for shift_nm, sd_nm in ((0, 60), (5, 60), (10, 60), (20, 60), (40, 60), (100, 60), (0, 90)):
        yield coverage(rng, max(repeats // 4, 1), float(shift_nm), float(sd_nm))
    for x_error in (0.03, 0.08, 0.15):
        yield slopes(rng, max(repeats // 8, 1), x_error)


def main() -> None:
    repeats, path = int(sys.argv[1]), Path(sys.argv[2])
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    done = []
    for row in rows(repeats):
        done.append(row)
        path.write_text(json.dumps({"date": today, "rows": done}, indent=1) + "\n")


if __name__ == "__main__":
    main()
