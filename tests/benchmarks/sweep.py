"""The default options over what spots can be: photons, background, density, width.

    python tests/benchmarks/sweep.py [--frames 200]

Nothing is tuned: every film is localised with the same defaults. Prints a line a film and writes
results/sweep.json and results/sweep.png. Beside what was found stands what can be found: the
signal-to-noise ratio of the matched filter, N / sqrt(4 pi s^2 (b + v)) for N photons of width s on
background b with read variance v, and the share of lonely spots above the level which noise alone
exceeds in one candidate for every thousand spots, the precision that is asked of us. A recall near
`ideal` is as good as any search with such a precision; where `ideal` is small, nothing can see
these spots one by one.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from films import PIXEL_SIZE_NM, READ_NOISE_E, SIZE_PX, Film, Recipe, make, sweep_recipes
from scipy.optimize import brentq
from scipy.special import ndtr
from score import score

from rotortrack.cameras.camera import Camera
from rotortrack.localise.engine import localise
from rotortrack.localise.options import LocaliseOptions
from rotortrack.movies.movie import ArrayMovie
from rotortrack.report import style

RESULTS = Path(__file__).parent / "results"
FALSE_PER_SPOT = 1e-3
COLUMNS = (
    *("photons", "background", "emitters", "sigma_px", "snr", "ideal", "recall", "precision"),
    *("error_over_bound", "pull", "bias_px", "photon_bias"),
)


def signal_to_noise(recipe: Recipe) -> float:
    """Give the peak of the matched filter over its noise."""
    noise = recipe.background + READ_NOISE_E**2
    return recipe.photons / math.sqrt(4.0 * math.pi * recipe.sigma_px**2 * noise)


def noise_level(recipe: Recipe) -> float:
    """Give the level, in noise, above which filtered noise has as many maxima as are allowed.

    Noise filtered by a Gaussian of width s has the covariance exp(-d^2 / 4 s^2), and for high
    levels u about u exp(-u^2 / 2) / ((2 pi)^(3/2) 2 s^2) maxima a pixel (Adler, The Geometry of
    Random Fields, 1981).
    """
    allowed = FALSE_PER_SPOT * recipe.emitters / SIZE_PX**2
    scale = (2.0 * math.pi) ** 1.5 * 2.0 * recipe.sigma_px**2
    return float(brentq(lambda u: math.log(u) - 0.5 * u * u - math.log(allowed * scale), 1.0, 20.0))


def found_in(film: Film) -> dict[str, Any]:
    """Localise a film with the defaults."""
    camera = Camera(**{name: float(value) for name, value in vars(film.sensor).items()})
    movie = ArrayMovie(film.counts)
    blocks = list(localise(movie, camera, LocaliseOptions(), pixel_size_nm=PIXEL_SIZE_NM))
    spots = {key: np.concatenate([b.columns[key] for b in blocks]) for key in blocks[0].columns}
    lengths = {"x_px": "x_nm", "y_px": "y_nm", "x_sd_px": "x_sd_nm", "y_sd_px": "y_sd_nm"}
    return {
        "frame": spots["frame"],
        "photons": spots["photons"],
        **{px: spots[nm] / PIXEL_SIZE_NM for px, nm in lengths.items()},
    }


def measure(recipe: Recipe) -> dict[str, float]:
    """Give one line of the table."""
    film = make(recipe)
    truth = {name: getattr(film, name) for name in ("frame", "x_px", "y_px", "photons")}
    truth |= {"background": recipe.background, "sigma_px": recipe.sigma_px, **vars(film.sensor)}
    scores = score(truth, found_in(film))
    snr = signal_to_noise(recipe)
    return {
        "photons": recipe.photons,
        "background": recipe.background,
        "emitters": recipe.emitters,
        "sigma_px": recipe.sigma_px,
        "snr": snr,
        "ideal": float(ndtr(snr - noise_level(recipe))),
        "bias_px": max(abs(scores["bias_x_px"]), abs(scores["bias_y_px"])),
        **scores,
    }


def draw(rows: list[dict[str, float]], path: Path) -> None:
    """Draw recall and precision over photons, a line for each background."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    middle = [row for row in rows if row["emitters"] == 25.0 and row["sigma_px"] == 1.25]
    looks = (
        (style.BLUE, "o"),
        (style.GREEN, "s"),
        (style.ORANGE, "^"),
        (style.VERMILLION, "v"),
    )
    with mpl.rc_context(style.SETTINGS):
        figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.4), layout="constrained", sharex=True)
        backgrounds = sorted({row["background"] for row in middle})
        for background, (colour, marker) in zip(backgrounds, looks, strict=True):
            line = [row for row in middle if row["background"] == background]
            photons = [row["photons"] for row in line]
            for axis, key in zip(axes, ("recall", "precision"), strict=True):
                axis.plot(
                    photons,
                    [row[key] for row in line],
                    color=colour,
                    marker=marker,
                    label=f"background {background:g} photons/px",
                )
            axes[0].plot(photons, [row["ideal"] for row in line], color=colour, ls=":")
        axes[0].plot([], [], color=style.INK, ls=":", label="a lone spot could be found")
        for axis, key in zip(axes, ("recall", "precision"), strict=True):
            axis.set_xscale("log")
            axis.set_xlabel("photons a spot")
            axis.set_ylabel(key)
        axes[0].set_ylim(-0.03, 1.03)
        lowest = min(row["precision"] for row in middle)
        axes[1].set_ylim(lowest - 0.1 * (1.0 - lowest), 1.0 + 0.1 * (1.0 - lowest))
        axes[0].legend(loc="lower right", fontsize="small")
        figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description="Localise many kinds of spots with the defaults.")
    parser.add_argument("--frames", type=int, default=200)
    arguments = parser.parse_args()
    print(" ".join(f"{name:>10.10}" for name in COLUMNS))
    rows = []
    for recipe in sweep_recipes(arguments.frames):
        row = measure(recipe)
        rows.append({name: round(row[name], 5) for name in COLUMNS})
        print(" ".join(f"{row[name]:10.4g}" for name in COLUMNS), flush=True)
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps({"frames": arguments.frames, "rows": rows}, indent=1) + "\n"
    (RESULTS / "sweep.json").write_text(text, encoding="utf-8")
    draw(rows, RESULTS / "sweep.png")


if __name__ == "__main__":
    main()
