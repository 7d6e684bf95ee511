"""The closed loop at full size: films of simulated rods, analysed by default and paper preset.

    python tests/benchmarks/closed_loop.py                    # 13 films of 65 rotors, 20 minutes
    python tests/benchmarks/closed_loop.py --films 1

The scene is sample_data/scenes/check.toml on 256 x 256 pixels with more rotors: 13 films hold 429
driven and 208 Brownian rotors, 104 stuck ones and 52 pores with two, of 600 photons each. Writes
results/closed_loop-DATE.json and .png.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from datetime import date
from pathlib import Path

from rotortrack.report.figures import canvas
from rotortrack.report.figures import closed_loop as picture
from rotortrack.settings import Layer
from rotortrack.simulate.scene import make_scene, read_scene
from rotortrack.tradeoff.closed_loop import check_scene

SCENE = Path(__file__).parents[2] / "sample_data" / "scenes" / "check.toml"
RESULTS = Path(__file__).with_name("results")
COUNTS = (33, 16, 8, 4)
"""Driven, Brownian and stuck rotors, and pores with two, in each film."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--films", type=int, default=13)
    asked = parser.parse_args()
    values = read_scene(SCENE).as_dict()
    values["film"] |= {"height_px": 256, "width_px": 256, "seed": 100}
    for group, count in zip(values["rotors"], COUNTS, strict=True):
        group["count"] = count
    scene = make_scene([Layer("closed loop", values)])
    begun = time.perf_counter()

    def tell(stage: str, done: int, _: int) -> None:
        if not done:
            print(f"{time.perf_counter() - begun:6.0f} s  {stage}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        loop = check_scene(
            scene,
            Path(folder),
            films=asked.films,
            keep_movies=False,
            progress=tell,
        )
    headings, rows = loop.table()
    print("\n".join(" | ".join(row) for row in [headings, *rows]))
    told = loop.as_dict() | {
        "seconds": time.perf_counter() - begun,
        "analysis_seconds": {one.preset: one.seconds for one in loop.analyses},
        "scene": values,
    }
    print(json.dumps({key: told[key] for key in ("verdicts", "behaviours")}, indent=1))
    target = RESULTS / f"closed_loop-{date.today().isoformat()}.json"
    target.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    drawn = picture.figure(
        {one.preset: one.rotors for one in loop.analyses}, told["verdicts"], told["behaviours"]
    )
    canvas.save_as(drawn, target.with_suffix(".png"))


if __name__ == "__main__":
    main()
