"""Phase diagram of the docked rod: 8 charges x 11 flows x 3 starts, its ends and its time.

    python tests/benchmarks/phase_diagram.py                 # all processors
    python tests/benchmarks/phase_diagram.py --workers 1 --mirrored

Prints the diagram and writes results/phase_diagram-DATE.json. The field is the embedded table. A
first small scan compiles, or loads, the loops, and is not timed. `reference` holds the letters of
an independent trial of the same model (bilinear table of another mesh, no extrapolation); the
regions should agree, single letters at their edges need not: several states live side by side.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np

from rotortrack.pipeline.scan_run import run_scan
from rotortrack.simulate.scan import phase_diagram
from rotortrack.simulate.scene import read_scene
from rotortrack.simulate.scene_field import field_for

ROOT = Path(__file__).parents[2]
RESULTS = Path(__file__).with_name("results")

REFERENCE = """
 200 NNN NNN NNN NNN NNN NNN NNN NNN
 170 NNN NNN NNN NNN NNN NNN NNN NNN
 155 NNN NNN NNN NNN NNN NNR NNR NNR
 145 NNN NNN NNN NRR NRR NRR NRR NRR
 138 NNN NDD DRR DRR RRR RRR RRR NRR
 130 DDD DDD DRR DRR RRR RRR RRR TTT
 122 DDD DDD DDD RRR RRR RRR TTT TTT
 115 DDD DDD DDD RRR RTT TTT TTT TTT
 105 DDD DDD DDD RTT TTT TTT TTT TTT
  90 DDD DDD DTT TTT TTT TTT TTT TTT
  60 DDD DDD TTT TTT TTT TTT TTT TTT
"""


def measure(workers: int, mirrored: bool) -> dict[str, object]:
    """Make the diagram in a new folder."""
    scene = read_scene(ROOT / "sample_data" / "scenes" / "scan.toml")
    scan = dataclasses.replace(scene.scan, mirrored=mirrored)
    scene = dataclasses.replace(scene, scan=scan)
    one = dataclasses.replace(scan, lambda_eff=(0.26,), flow_ratio=(130.0,))
    field = field_for(scene.field)
    with tempfile.TemporaryDirectory() as folder:
        run_scan(dataclasses.replace(scene, scan=one), field, Path(folder) / "warm", workers=1)
        begun, used = time.perf_counter(), time.process_time()
        done = run_scan(scene, field, Path(folder) / "scan", workers=workers)
        seconds, cpu_s = time.perf_counter() - begun, time.process_time() - used
    runs = done.runs
    rotating = runs[runs["end"] == "rotating_steadily"]
    header, rows = phase_diagram(runs)
    letters = [cell[: 3 * (1 + mirrored) : 1 + mirrored] for row in rows for cell in row[1:]]
    expected = [cell for line in REFERENCE.split("\n") for cell in line.split()[1:]]
    pairs = zip("".join(letters), "".join(expected), strict=True)
    result: dict[str, object] = {
        "date": str(date.today()),
        "processors": os.cpu_count(),
        "load": os.getloadavg()[0],
        "workers": workers,
        "runs": len(runs),
        "seconds": round(seconds, 2),
        "cpu_s": round(cpu_s, 2),
        "slowest_run_s": max(done.facts["run_seconds"]),
        "simulated_ms": round(runs["simulated_us"].sum() / 1e3, 1),
        "steps": int(runs["n_steps"].sum()),
        "ends": done.facts["ends"],
        "letters_as_in_the_trial": round(float(np.mean([a == b for a, b in pairs])), 3),
        "rates_rev_s": np.percentile(rotating["rate_rev_s"].abs(), [0, 50, 100]).round(1).tolist(),
        "end_to_end_nm": np.percentile(rotating["end_to_end_nm"], [0, 50, 100]).round(1).tolist(),
        "field": field.origin,
        "diagram": {"header": header, "rows": rows},
    }
    if mirrored:
        result["mirror_rate_difference"] = _mirror_difference(runs)
    return result


def _mirror_difference(runs) -> float:
    """Largest relative difference between the rates of mirror images that both rotate."""
    point = ["lambda_eff", "flow_ratio", "placement"]
    plain, mirror = (
        runs[(runs["mirrored"] == side) & (runs["end"] == "rotating_steadily")].set_index(point)
        for side in (False, True)
    )
    both = plain.join(mirror, rsuffix="_mirror", how="inner")
    difference = (both["rate_rev_s"] + both["rate_rev_s_mirror"]).abs() / both["rate_rev_s"].abs()
    return float(difference.max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--mirrored", action="store_true", help="and every mirror image")
    given = parser.parse_args()
    result = measure(given.workers, given.mirrored)
    diagram = result["diagram"]
    assert isinstance(diagram, dict)
    for row in [diagram["header"], *diagram["rows"]]:
        print("".join(f"{cell:>8}" for cell in row))
    print(json.dumps({key: value for key, value in result.items() if key != "diagram"}, indent=1))
    path = RESULTS / f"phase_diagram-{date.today()}.json"
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
