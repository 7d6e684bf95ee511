"""Columns of the tables that simulations write."""

from __future__ import annotations

from rotortrack.tables import Column, Schema

RUNS = Schema(
    "runs",
    (
        Column("run", "int64", "", "number of the run, from 0", required=True),
        Column("placement", "int64", "", "number of the start, from 0", required=True),
        Column("mirrored", "bool", "", "whether the start is its mirror image", required=True),
        Column("lambda_eff", "float64", "", "part of the bare charge", required=True),
        Column("flow_ratio", "float64", "", "factor of the flow over lambda_eff", required=True),
        Column("end", "str", "", "how the run ended, as `rod.RodEnd` names it", required=True),
        Column("rate_rev_s", "float64", "1/s", "signed rate, weighted by friction"),
        Column("rate_tip_rev_s", "float64", "1/s", "signed rate of the first tip as it is seen"),
        Column("rate_last_tip_rev_s", "float64", "1/s", "that of the last tip"),
        Column("end_to_end_nm", "float64", "nm", "distance of the ends"),
        Column("end_to_end_xy_nm", "float64", "nm", "the same seen from above"),
        Column("end_to_end_dyes_nm", "float64", "nm", "distance of the centres of the dyes"),
        Column("end_to_end_dyes_xy_nm", "float64", "nm", "the same seen from above"),
        Column("shape", "str", "", "last shape seen from cis, as `rod.shape` names it"),
        Column("handedness", "int64", "", "1: outward flow turns it counter-clockwise; -1, 0"),
        Column("torque_pn_nm", "float64", "pN nm", "torque of field and flow on the last shape"),
        Column("friction_pn_nm_s", "float64", "pN nm s", "rotational friction of the last shape"),
        Column("power_pn_nm_s", "float64", "pN nm/s", "friction times the rate squared"),
        Column("deepest_nm", "float64", "nm", "how deep the rod's axis went into the membrane"),
        Column("simulated_us", "float64", "us", "time that was simulated"),
        Column("n_steps", "int64", "", "accepted steps of time"),
        Column("problem", "str", "", "why a run could not be simulated, empty otherwise"),
    ),
)
"""One row for each run of a scan."""
