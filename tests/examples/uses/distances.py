"""Measured end-to-end distances beside those of simulated rods, in folders of the README."""

from pathlib import Path

import numpy as np
import pandas as pd

import rotortrack as rt

ends = pd.read_parquet(Path("two-colours") / "end_to_end.parquet")
for rotor, rows in ends.groupby("rotor"):
    noise_nm = np.sqrt(0.5 * (rows["x_sd_nm"] ** 2 + rows["y_sd_nm"] ** 2)).to_numpy()
    best = rt.true_distance(rows["distance_nm"].to_numpy(), noise_nm).default
    print(f"rotor {rotor}: {best.mean_nm:.0f} nm, {best.low_nm:.1f} to {best.high_nm:.1f} in 95 %")
rods = pd.read_parquet(Path("small-scan") / "runs.parquet")
turning = rods[rods["end"].str.startswith("rotat")]
print("simulated:", turning["end_to_end_nm"].round().tolist())
