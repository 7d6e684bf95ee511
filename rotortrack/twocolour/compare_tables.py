"""The columns of the table of comparisons."""

from __future__ import annotations

from rotortrack.tables import Column, Schema

COMPARISON = Schema(
    "comparison",
    (
        Column("first", "str", "", "the measured group", required=True),
        Column("second", "str", "", "the group or scan it is compared with", required=True),
        Column("quantity", "str", "", "distance, mean_distance, true_distance, speed or ccw_share"),
        Column("weight", "str", "", "what counts the same: frames or rotors"),
        Column("unit", "str", "", "of means, differences and distances between distributions"),
        Column("first_rotors", "int64", "", "rotors of the first group"),
        Column("second_rotors", "int64", "", "rotors of the second group, or shapes of the scan"),
        Column("first_frames", "int64", "", "frames of the first group, 0 where rotors count"),
        Column("second_frames", "int64", "", "frames of the second, those of one set of twins"),
        Column("first_mean", "float64", "unit", "mean of the first group"),
        Column("second_mean", "float64", "unit", "mean of the second group"),
        Column("difference", "float64", "unit", "first mean less second"),
        Column("difference_ci_low", "float64", "unit", "lower end of its 95 % interval"),
        Column("difference_ci_high", "float64", "unit", "upper end of its 95 % interval"),
        Column("wasserstein", "float64", "unit", "Wasserstein-1 of the distributions"),
        Column("wasserstein_ci_low", "float64", "unit", "lower end of its 95 % interval"),
        Column("wasserstein_ci_high", "float64", "unit", "upper end of its 95 % interval"),
        Column("energy", "float64", "unit", "energy distance, 2 int (F - G)^2 dx"),
        Column("energy_ci_low", "float64", "unit", "lower end of its 95 % interval"),
        Column("energy_ci_high", "float64", "unit", "upper end of its 95 % interval"),
        Column("ks", "float64", "", "largest |F - G|, a size and no test"),
        Column("ks_ci_low", "float64", "", "lower end of its 95 % interval"),
        Column("ks_ci_high", "float64", "", "upper end of its 95 % interval"),
        Column("p", "float64", "", "probability of such a distance between equal groups"),
        Column("p_reason", "str", "", "how p was found, or why there is none"),
    ),
)
"""One row for each pair of groups, quantity and weight."""
