"""Accuracy and time of the nanopore field: errors against a far finer mesh, beside the estimates.

    python tests/benchmarks/field_accuracy.py RESULT.json

Each pore is solved at the accuracies given and on a mesh with cells of 0.02 nm at the rim (0.05 nm
where it is rounded). Ratios are estimate over true error: honest means 1/3 to 3 for the flow.
"""

from __future__ import annotations

import datetime
import json
import sys
import time
from pathlib import Path

import numpy
import scipy
import skfem

from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.solve import field_grid, solve_field, solve_on

PORES = {
    "paper": ({}, ("fast", "default", "careful")),
    "sigma -0.05": ({"surface_charge_e_nm2": -0.05}, ("fast", "default")),
    "sigma -0.2": ({"surface_charge_e_nm2": -0.2}, ("fast", "default")),
    "sigma -0.4": ({"surface_charge_e_nm2": -0.4}, ("fast", "default")),
    "5 mM": ({"cis_mm": 5.0, "trans_mm": 5.0}, ("fast", "default")),
    "500 mM": ({"cis_mm": 500.0, "trans_mm": 500.0}, ("fast", "default")),
    "1 V": ({"voltage_v": 1.0}, ("fast", "default")),
    "radius 10": ({"pore_radius_nm": 10.0}, ("fast", "default")),
    "50:550 shorted": (
        {"voltage_v": 0.0, "trans_mm": 550.0, "electrical": "shorted_agcl"},
        ("fast", "default"),
    ),
    "50:550 fixed": ({"voltage_v": 0.0, "trans_mm": 550.0}, ("fast", "default")),
    "rim 2 nm": ({"rim_radius_nm": 2.0}, ("fast", "default")),
}


def measured(values: dict, accuracies: tuple[str, ...]) -> dict:
    """Errors, estimates and times of one pore."""
    options = FieldOptions(**values)
    reference = solve_on(options, field_grid(options, 0.05 if options.rim_radius_nm else 0.02, 1.4))
    rows = {}
    for accuracy in accuracies:
        began = time.process_time()
        solved = solve_field(FieldOptions(**values, accuracy=accuracy))
        cpu_s = time.process_time() - began
        flow = abs(solved.flow_m3_s / reference.flow_m3_s - 1)
        current = abs(solved.current_a / reference.current_a - 1)
        rows[accuracy] = {
            "current_a": solved.current_a,
            "flow_m3_s": solved.flow_m3_s,
            "flow_error": flow,
            "flow_estimate_over_error": solved.flow_error_rel / flow,
            "current_error": current,
            "current_estimate_over_error": solved.current_error_rel / current,
            "unknowns": solved.unknowns,
            "cpu_s": round(cpu_s, 2),
            "wall_s": round(solved.seconds, 2),
        }
    return {"reference_flow_m3_s": reference.flow_m3_s, "accuracies": rows}


def main() -> None:
    """Measure all pores and write the result after each."""
    result = {
        "date": datetime.datetime.now(tz=datetime.UTC).date().isoformat(),
        "versions": {m.__name__: m.__version__ for m in (numpy, scipy, skfem)},
        "pores": {},
    }
    for name, (values, accuracies) in PORES.items():
        result["pores"][name] = measured(values, accuracies)
        for accuracy, row in result["pores"][name]["accuracies"].items():
            print(
                f"{name:15s} {accuracy:8s} flow {row['flow_error']:.1e}"
                f" (x{row['flow_estimate_over_error']:.2f}) current {row['current_error']:.1e}"
                f" (x{row['current_estimate_over_error']:.2f}) {row['cpu_s']} s",
                flush=True,
            )
        Path(sys.argv[1]).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
