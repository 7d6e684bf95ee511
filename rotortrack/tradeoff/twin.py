"""The twin of a finished analysis: a film of the rotors that it found, whose truth is known.

What the analysis makes of its twin is the bias and the error of *this* experiment: of its light,
its speeds, its crowding and its drift.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from rotortrack import files
from rotortrack.errors import InputError
from rotortrack.exchange.parquet import read_info
from rotortrack.pipeline.run import run_movie
from rotortrack.pipeline.store import BUDGET, CONFIG, RunFolder
from rotortrack.settings import Layer
from rotortrack.simulate.film.filming import film_scene
from rotortrack.simulate.scene import Scene, make_scene
from rotortrack.tradeoff.closed_loop import config_layer, reseeded
from rotortrack.tradeoff.score import Score, read_truth, score
from rotortrack.tradeoff.summary import summarise

_MOTIONS: Final = {
    "driven_ccw": "driven",
    "driven_cw": "driven",
    "brownian": "brownian",
    "switching": "switching",
    "toggling": "two_position",
    "unclassified": "driven",
}
"""How rotors of each behaviour are filmed; those of others are left out."""

_SEEN: Final = {"omega": "omega_rad_s", "diffusion": "diffusion_rad2_s", "radius": "radius_nm"}
_LEAST_D: Final = 1e-3

_NOT_OF_TWINS: Final = ("movie", "camera", "channels", "ends")
"""Options that the twin has of its own film, or no use for: it shows the first colour alone."""


@dataclass(frozen=True)
class Twin:
    """A scene like a finished analysis.

    Attributes
    ----------
    scene
        To be filmed.
    rotors
        Number in the run of each rotor of the scene, in its order.
    layers
        Options of the analysis, without those of movie, camera and second colour.
    left_out
        Rotors of the run that the twin does not hold, with the reason.
    """

    scene: Scene
    rotors: tuple[int, ...]
    layers: tuple[Layer, ...]
    left_out: dict[int, str]


def twin_of(run: Path) -> Twin:
    """Make a scene of the rotors that a run kept.

    Places, radii, speeds, diffusion, brightness, background, width of spots, drift, camera and
    length of the movie are those of the run; of two colours the twin shows the first.

    Parameters
    ----------
    run
        A finished run folder.

    Raises
    ------
    InputError
        The folder holds no finished run, or one that kept no rotor.
    """
    folder = RunFolder.open(run)
    options = tomllib.loads((folder.path / CONFIG).read_text(encoding="utf-8"))
    rotors, spots = folder.read("rotors"), folder.read("localisations")
    info = read_info(folder.path / "localisations.parquet")
    kept = rotors[rotors["verdict"] == "kept"]
    groups, numbers, left_out = [], [], {}
    duration_s = _value(info.frames) * options["movie"]["frame_interval_s"]
    x0, y0 = options["movie"].get("region", (0, 0))[:2]
    corner_nm = np.array([x0, y0]) * options["movie"]["pixel_size_nm"]
    for rotor in kept.to_dict("records"):
        made = _group(rotor, spots, corner_nm, duration_s)
        if isinstance(made, str):
            left_out[int(rotor["rotor"])] = made
        else:
            groups.append(made)
            numbers.append(int(rotor["rotor"]))
    if not groups:
        raise InputError(f"{run} kept no rotor whose motion is known: there is nothing to film")
    values: dict[str, Any] = {
        "film": _film(options, info),
        "rotors": groups,
        "background": {"photons": float(spots["background"].clip(lower=0.0).median())},
        "psf": {"sigma_nm": float(spots["sigma_nm"].median())},
        "camera": _camera(options),
    }
    drift = folder.path / "drift.csv"
    if drift.exists() and np.any(folder.read("drift")[["dx_nm", "dy_nm"]].to_numpy()):
        values["drift"] = {"table": str(drift)}
    scene = make_scene([Layer(f"the twin of {run}", values)], origin=f"the twin of {run}")
    stages = {name: own for name, own in options.items() if name not in _NOT_OF_TWINS}
    return Twin(scene, tuple(numbers), (Layer(f"options of {run}", stages),), left_out)


def error_budget(
    run: Path,
    folder: Path,
    *,
    films: int = 5,
    workers: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Film and analyse a run's twin some times, and write what it tells into the run.

    Parameters
    ----------
    run
        A finished run folder; `error_budget.json` is written into it.
    folder
        Where films and their analyses are kept.
    films
        How many.
    workers, progress
        Threads; called as films and analyses advance.

    Returns
    -------
    dict
        What was written: for each rotor the mean error (bias) and the rms error of speed, D and
        radius, how often it was found and kept, and how often the speed's 95 % interval held the
        truth; and the numbers of `summary.AIMS` for all.
    """
    twin = twin_of(run)
    files.make_folder(folder)
    scores = []
    for number in range(films):
        if progress is not None:
            progress(f"twin {number + 1} of {films}", 0, 0)
        movie = folder / f"twin-{number:02d}.tif"
        filmed = film_scene(reseeded(twin.scene, number), movie, workers=workers)
        layers = [*twin.layers, config_layer(filmed)]
        tables = run_movie(
            movie, layers, folder / f"run-{number:02d}", workers=workers, overwrite=True
        ).tables
        scores.append(score(read_truth(filmed.truth), tables["localisations"], tables["rotors"]))
    told = {
        "films": films,
        "rotors": _per_rotor(scores, twin.rotors),
        "left_out": {str(number): why for number, why in twin.left_out.items()},
        "all": {
            name: {key: value if math.isfinite(value) else None for key, value in vars(own).items()}
            for name, own in summarise(scores).items()
        },
    }
    files.write_text(run / BUDGET, json.dumps(told, indent=1) + "\n")
    return told


def _per_rotor(scores: Sequence[Score], numbers: Sequence[int]) -> list[dict[str, Any]]:
    tables = pd.concat([one.rotors for one in scores], ignore_index=True)
    tables = tables.assign(omega_rad_s=tables["mean_omega_rad_s"])
    rows = []
    for index, own in tables.groupby("rotor"):
        kept = own[own["found"] & (own["found_verdict"] == "kept")]
        row: dict[str, Any] = {
            "rotor": numbers[int(str(index))],
            "found": float(own["found"].mean()),
            "kept": len(kept) / len(own),
        }
        for name, column in _SEEN.items():
            error = (kept[f"found_{column}"] - kept[column]).dropna()
            row[f"{name}_bias"] = float(error.mean()) if len(error) else None
            row[f"{name}_rms_error"] = float(np.sqrt((error**2).mean())) if len(error) else None
        row["speed_reported_sd_rad_s"] = _mean(kept["found_omega_sd_rad_s"])
        truth = np.degrees(kept["mean_omega_rad_s"])
        low, high = kept["found_speed_ci_low_deg_s"], kept["found_speed_ci_high_deg_s"]
        told = low <= high
        row["speed_coverage"] = _mean(((low <= truth) & (truth <= high))[told].astype(float))
        rows.append(row)
    return rows


def _mean(values: pd.Series[float]) -> float | None:
    values = values.dropna()
    return float(values.mean()) if len(values) else None


def _group(
    rotor: dict[Any, Any], spots: pd.DataFrame, corner_nm: np.ndarray[Any, Any], duration_s: float
) -> dict[str, Any] | str:
    """Give the [[rotors]] table of one rotor, or why there is none."""
    own = spots[spots["rotor"] == rotor["rotor"]]
    motion = _MOTIONS.get(rotor["behaviour"])
    if motion is None:
        return f"its behaviour, {rotor['behaviour']}, is not filmed"
    omega, diffusion = float(rotor["omega_rad_s"]), float(rotor["diffusion_rad2_s"])
    if not (math.isfinite(omega) and math.isfinite(diffusion)):
        return "its speed or D is not known"
    group: dict[str, Any] = {
        "x_nm": [float(rotor["x_nm"] - corner_nm[0])],
        "y_nm": [float(rotor["y_nm"] - corner_nm[1])],
        "motion": motion,
        "radius_nm": float(rotor["radius_nm"]),
        "diffusion_rad2_s": max(diffusion, _LEAST_D),
        "photons": float(own["photons"].median()),
    }
    if motion in ("driven", "switching"):
        if omega == 0.0:
            return "it does not turn"
        group |= {"omega_rad_s": abs(omega), "direction": "ccw" if omega > 0.0 else "cw"}
    if motion == "switching":
        group["switch_rate_per_s"] = max(float(rotor["n_switches"]), 1.0) / duration_s
    return group


def _film(options: dict[str, Any], info: Any) -> dict[str, Any]:
    movie = options["movie"]
    region = movie.get("region")
    return {
        "width_px": region[2] if region else _value(info.width_px),
        "height_px": region[3] if region else _value(info.height_px),
        "n_frames": _value(info.frames),
        "pixel_size_nm": movie["pixel_size_nm"],
        "frame_interval_s": movie["frame_interval_s"],
        "exposure_s": movie.get("exposure_s", movie["frame_interval_s"]),
        "mirrored": movie.get("mirrored") == "true",
    }


def _camera(options: dict[str, Any]) -> dict[str, Any]:
    names = ("offset_adu", "gain_e_per_adu", "read_noise_e", "camera_maps")
    return {name: options["camera"][name] for name in names if name in options["camera"]}


def _value(number: int | None) -> int:
    if number is None:
        raise InputError("the run's table of localisations does not tell the size of its movie")
    return number
