"""How often planted behaviours are recognised, and what they are taken for otherwise.

    python tests/benchmarks/behaviours.py planted 25 OUT.json    # rotors a behaviour
    python tests/benchmarks/behaviours.py hard 25 OUT.json

`planted`: D 2-60 rad2/s, |omega| 4 to 40 sd, sigma 0.1-0.3 rad, 10 % missing, 16 s at 500
frames/s, exposed for the whole frame and for its first tenth. `hard`: speeds of 1 to 4 sd, half of
the frames missing, 2 s, all of which should be unclassified rather than wrong. Rows are behaviours
put in, columns what they were called.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from datetime import date
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "motion"))

from planted import FRAME_S, NAMES, Planted, plant

from rotortrack.motion.behaviour import Behaviour, classify
from rotortrack.motion.changepoints import find_switches
from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.increments import increments, step_sizes
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.readings import Circle

SCENES = {
    "planted": {
        "whole exposure": {"exposed": 1.0},
        "short exposure": {"exposed": 0.1},
    },
    "hard": {
        "speeds of 1 to 4 sd": {"speed_range": (1.0, 4.0)},
        "half the frames": {"missing": 0.5},
        "two seconds": {"n": 1000},
    },
}


def call(rotor: Planted, exposed: float) -> tuple[Behaviour, float]:
    """Classify a rotor; also the CPU time of that alone, s."""
    times = {"frame_interval_s": FRAME_S, "exposure_s": exposed * FRAME_S}
    places = (rotor.x_nm, rotor.y_nm, rotor.sd_nm, rotor.sd_nm)
    estimate = estimate_motion(rotor.frame, *places, Circle(0.0, 0.0, 100.0), **times)
    steps = step_sizes(increments(rotor.frame, rotor.theta, "drop"))
    switches = find_switches(rotor.frame, rotor.theta, **times)
    start = time.thread_time()
    found = classify(
        estimate,
        steps,
        rotor.frame,
        rotor.theta,
        switches,
        frame_interval_s=FRAME_S,
        options=MotionOptions(),
    )
    return found, time.thread_time() - start


def main(kind: str, count: int, out: Path) -> None:
    result: dict[str, object] = {"date": date.today().isoformat(), "rotors": count}
    for scene, how in SCENES[kind].items():
        table, spent = {}, []
        for k, name in enumerate(NAMES):
            called: Counter[str] = Counter()
            for seed in range(count):
                rotor = plant(name, np.random.default_rng([seed, k, 2026]), **how)
                found, cpu_s = call(rotor, how.get("exposed", 1.0))
                called[found.name] += 1
                spent.append(cpu_s)
            table[name] = dict(called)
            print(scene, name, dict(called), flush=True)
        result[scene] = {"called": table, "median_ms": round(1e3 * float(np.median(spent)), 2)}
        out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
