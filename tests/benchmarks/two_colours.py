"""The closed loop of two colours: films of both ends, registered, analysed, held against truth.

    python tests/benchmarks/two_colours.py                # 20 films of 20 rotors, 2000 frames
    python tests/benchmarks/two_colours.py --films 2

Each film shows driven, Brownian, stuck and breathing rotors with two labelled ends beside (odd
films: one below the other, with a rolling shutter) each other, registered by a film of fiducials of
its own noise. Told are bias, error and pull (error over reported error) of every rotor's end-to-end
distance. Writes results/two_colours-DATE.json.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rotortrack.motion.blur import radius_factor
from rotortrack.pipeline.register_run import register_movies
from rotortrack.pipeline.run import run_movie
from rotortrack.settings import Layer
from rotortrack.simulate.film.filming import film_scene
from rotortrack.simulate.scene import make_scene

RESULTS = Path(__file__).with_name("results")
LINE_TIME_S = 7e-6
EXPOSURE_S = 0.002
ROTORS = (
    {"motion": "driven", "count": 10},
    {"motion": "brownian", "count": 4},
    {"motion": "stuck", "count": 3},
    {"motion": "driven", "count": 3, "breathing_sd_nm": 15.0},
)


def scene_of(film: int, frames: int) -> dict[str, Any]:
    """Describe a film: two ends of every rotor, a distortion, and a layout in turns."""
    below = film % 2 == 1
    values: dict[str, Any] = {
        "film": {
            "width_px": 128 if below else 256,
            "height_px": 256 if below else 128,
            "n_frames": frames,
            "exposure_s": EXPOSURE_S,
            "seed": 1000 + film,
        },
        "rotors": [
            {
                "ends": 2,
                "shape": "circle",
                "photons": [500.0, 1000.0],
                "radius_nm": [40.0, 150.0],
                "second_radius_nm": [40.0, 150.0],
                "second_phase_deg": 60.0 + 15.0 * (film % 9),
                **group,
            }
            for group in ROTORS
        ],
        "lattice": {"pitch_nm": 2400.0},
        "split": {
            "layout": "top-bottom" if below else "left-right",
            "shift_nm": [90.0, -60.0],
            "scale": 1.002,
            "rotation_deg": 0.25,
            "radial_nm": 60.0,
            "keystone_nm": 20.0,
        },
        "background": {"photons": 5.0},
        "camera": {},
    }
    if below:
        values["rolling_shutter"] = {"line_time_s": LINE_TIME_S}
    return values


def analysed(film: int, frames: int, folder: Path) -> pd.DataFrame:
    """Film, register and analyse one scene; give its rotors beside their truth."""
    values = scene_of(film, frames)
    beads = {key: values[key] for key in ("split", "background", "camera")}
    beads["film"] = {**values["film"], "n_frames": 20, "seed": 5000 + film}
    beads["fiducials"] = {"pitch_nm": 900.0, "missing": 0.1}
    for name, content in (("cells", values), ("beads", beads)):
        film_scene(make_scene([Layer("benchmark", content)]), folder / f"{name}.tif")
    below = film % 2 == 1
    layers = [
        Layer("film", {"channels": {"split": "top-bottom" if below else "left-right"}}),
        Layer("film", {"movie": {"pixel_size_nm": values["film"].get("pixel_size_nm", 108.3)}}),
    ]
    made = register_movies([folder / "beads.tif"], [], layers)
    made.registration.write(folder / "channels.json")
    more: dict[str, Any] = {
        "movie": {"frame_interval_s": 0.002, "exposure_s": EXPOSURE_S},
        "channels": {
            "registration": str(folder / "channels.json"),
            "line_time_s": LINE_TIME_S if below else 0.0,
        },
    }
    camera = make_scene([Layer("benchmark", values)]).film.camera
    more["camera"] = {
        name: getattr(camera, name) for name in ("offset_adu", "gain_e_per_adu", "read_noise_e")
    }
    result = run_movie(folder / "cells.tif", [*layers, Layer("film", more)], folder / "run")
    truth = pd.read_csv(folder / "cells.truth" / "rotors.csv")
    spots = pd.read_parquet(folder / "cells.truth" / "spots.parquet")
    truth["nm"] = [_mean_distance(row, spots) for _, row in truth.iterrows()]
    found = result.tables["end_to_end_rotors"].merge(
        result.rotors[["rotor", "x_nm", "y_nm", "verdict", "behaviour"]], on="rotor"
    )
    away = np.hypot(
        found["x_nm"].to_numpy()[:, None] - truth["x_nm"].to_numpy(),
        found["y_nm"].to_numpy()[:, None] - truth["y_nm"].to_numpy(),
    )
    # A stuck rotor's circle says nothing of its pore; its spots lie within its radius.
    nearest = away.argmin(axis=1)
    beside = truth.iloc[nearest].reset_index(drop=True).add_prefix("true_")
    both = pd.concat([found.reset_index(drop=True), beside], axis=1)
    both = both[away.min(axis=1) < 400.0].drop_duplicates("true_rotor")
    return both.assign(
        film=film,
        below=below,
        n_true=len(truth),
        target_error_nm=made.registration.target_error_nm,
        kind=np.where(both["true_breathing_sd_nm"] > 0, "breathing", both["true_motion"]),
    )


def _mean_distance(rotor: pd.Series, spots: pd.DataFrame) -> float:
    """Average the true distance of both ends over the frames.

    Of a rotor that breathes, radii are read off frame by frame; those of the exposures' mean places
    are shorter by what turning takes from them.
    """
    if rotor["breathing_sd_nm"] == 0:
        return float(rotor["end_to_end_nm"])
    shrunk = radius_factor(rotor["omega_rad_s"], rotor["diffusion_rad2_s"], EXPOSURE_S)
    mine = spots[spots["rotor"] == rotor["rotor"]]
    radius = np.hypot(mine["first_x_nm"] - rotor["x_nm"], mine["first_y_nm"] - rotor["y_nm"])
    first, second = (radius[mine["end"] == end].to_numpy() / shrunk for end in (0, 1))
    between = rotor["second_phase_rad"] - rotor["phase_rad"]
    return float(np.mean(np.abs(first - second * np.exp(1j * between))))


def told(rotors: pd.DataFrame) -> dict[str, float]:
    """Give bias, error, pull and coverage of some rotors' distances."""
    error = rotors["end_to_end_nm"] - rotors["true_nm"]
    pull = error / rotors["end_to_end_sd_nm"]
    inside = rotors["true_nm"].between(
        rotors["end_to_end_ci_low_nm"], rotors["end_to_end_ci_high_nm"]
    )
    return {
        "rotors": len(rotors),
        "bias_nm": float(error.mean()),
        "rmse_nm": float(np.sqrt((error**2).mean())),
        "rms_pull": float(np.sqrt((pull**2).mean())),
        "coverage": float(inside.mean()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--films", type=int, default=20)
    parser.add_argument("--frames", type=int, default=2000)
    asked = parser.parse_args()
    begun = time.perf_counter()
    tables = []
    for film in range(asked.films):
        with tempfile.TemporaryDirectory() as folder:
            tables.append(analysed(film, asked.frames, Path(folder)))
        print(
            f"{time.perf_counter() - begun:6.0f} s  film {film + 1}", told(tables[-1]), flush=True
        )
    rotors = pd.concat(tables, ignore_index=True)
    results = {
        "films": asked.films,
        "frames": asked.frames,
        "rotors_true": int(rotors.groupby("film")["n_true"].first().sum()),
        "target_error_nm": float(rotors.groupby("film")["target_error_nm"].first().mean()),
        "all": told(rotors),
        **{str(kind): told(part) for kind, part in rotors.groupby("kind")},
        "left_right": told(rotors[~rotors["below"]]),
        "top_bottom_rolling": told(rotors[rotors["below"]]),
        "seconds": time.perf_counter() - begun,
    }
    print(json.dumps(results, indent=1))
    if asked.films >= 20:
        target = RESULTS / f"two_colours-{date.today().isoformat()}.json"
        target.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
