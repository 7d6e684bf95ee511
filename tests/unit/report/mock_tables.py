"""Every further column and table of a run, made of the rotors and tracks of `mock_run`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from mock_run import FRAME_INTERVAL_S, Run, make_run

from rotortrack.units import TURN_RAD

KT_PN_NM = 4.11
BINS = 24


@dataclass
class Whole:
    run: Run
    posterior: pd.DataFrame
    profiles: pd.DataFrame
    switches: pd.DataFrame
    voltages: pd.DataFrame
    voltage_speeds: pd.DataFrame

    def tables(self) -> dict[str, object]:
        """All arguments of draw_run that are tables."""
        parts = {name: getattr(self.run, name) for name in vars(self.run)}
        return {**parts, **{k: v for k, v in vars(self).items() if k != "run"}}


def make_whole(n=20, frames=8000, seed=1, **options) -> Whole:
    run = make_run(n, frames, seed, **options)
    rng = np.random.default_rng(seed + 1000)
    if n:
        _add_columns(run, rng)
    frame = np.arange(max(frames, 2))
    step = (frame > len(frame) // 3).astype(int) + (frame > 2 * len(frame) // 3)
    voltages = pd.DataFrame(
        {
            "frame": frame, "voltage_v": np.array([0.05, 0.1, 0.05])[step], "step": step,
            "transition": np.r_[False, np.diff(step) != 0],
        }
    )  # fmt: skip
    return Whole(
        run, _posterior(run.tracks), _profiles(run.rotors, rng), _switches(run), voltages,
        _voltage_speeds(run.rotors, rng),
    )  # fmt: skip


def _add_columns(run: Run, rng) -> None:
    rotors = run.rotors
    n = len(rotors)
    nothing = np.where(rotors["verdict"] == "kept", 1.0, np.nan)
    diffusion = rng.lognormal(np.log(15.0), 0.8, n) * nothing
    spread = rng.uniform(1.05, 1.6, n)
    rotors["drift_p"] = np.where(rng.random(n) < 0.6, 1e-4, rng.random(n)) * nothing
    rotors["diffusion_rad2_s"] = diffusion
    rotors["diffusion_sd_rad2_s"] = diffusion * (spread - 1) / 2
    rotors["diffusion_ci_low_rad2_s"] = diffusion / spread
    rotors["diffusion_ci_high_rad2_s"] = diffusion * spread
    omega, sd = rotors["omega_rad_s"], rotors["omega_sd_rad_s"]
    for name, unit, value, error in (
        ("torque", "pn_nm", KT_PN_NM * omega / diffusion, KT_PN_NM * sd / diffusion),
        ("power", "pn_nm_s", KT_PN_NM * omega**2 / diffusion, 2 * KT_PN_NM * sd / diffusion),
        ("friction", "pn_nm_s", KT_PN_NM / diffusion, KT_PN_NM / diffusion * (spread - 1) / 2),
    ):
        rotors[f"{name}_{unit}"] = value
        rotors[f"{name}_ci_low_{unit}"] = value - 1.96 * error
        rotors[f"{name}_ci_high_{unit}"] = value + 1.96 * error
    rotors["power_ci_low_pn_nm_s"] = rotors["power_ci_low_pn_nm_s"].clip(lower=0)
    rotors["x_sd_nm"], rotors["y_sd_nm"] = 0.5, 0.7
    rotors["theta_noise_rad"] = 9.0 / rotors["radius_nm"]
    rotors["localisation_sd_nm"] = 9.0
    rotors["behaviour_margin"] = rng.uniform(0.5, 6, n)
    rotors["behaviour_evidence"] = "turns at a speed that chance gives once in 10000 rotors"
    fast = rotors["msd_speed_deg_s"]
    rotors["paper_class"] = np.select(
        [rotors["behaviour"].isin(["brownian", "toggling"]), fast > 720, fast > 100],
        ["none", "fast", "slow"], "between",
    )  # fmt: skip
    rotors.loc[rotors["verdict"] != "kept", "paper_class"] = ""
    run.tracks["theta_sd_rad"] = 0.12
    run.tracks["x_sd_nm"] = run.tracks["y_sd_nm"] = 9.0


def _posterior(tracks: pd.DataFrame) -> pd.DataFrame:
    parts = []
    for number, track in tracks.groupby("rotor"):
        frame = np.arange(track["frame"].iloc[0], track["frame"].iloc[-1] + 1)
        theta = np.interp(frame, track["frame"], np.unwrap(track["theta_rad"]))
        seen = np.isin(frame, track["frame"])
        parts.append(
            pd.DataFrame(
                {
                    "rotor": number, "frame": frame, "seen": seen,
                    "theta_rad": np.angle(np.exp(1j * theta)),
                    "theta_sd_rad": np.where(seen, 0.1, 0.25),
                }
            )
        )  # fmt: skip
    columns = ["rotor", "frame", "seen", "theta_rad", "theta_sd_rad"]
    return pd.concat(parts) if parts else pd.DataFrame(columns=columns)


def _profiles(rotors: pd.DataFrame, rng) -> pd.DataFrame:
    middle = (np.arange(BINS) + 0.5) * TURN_RAD / BINS - np.pi
    parts = []
    for row in rotors.to_dict("records"):
        tilt = 1 + 0.4 * np.cos(middle - row["rotor"])
        parts.append(
            pd.DataFrame(
                {
                    "rotor": row["rotor"], "bin": np.arange(BINS), "angle_rad": middle,
                    "n_frames": 300, "occupancy": tilt / BINS, "occupancy_sd": 0.1 / BINS,
                    "omega_rad_s": row["omega_rad_s"] / tilt + rng.normal(0, 3, BINS),
                    "omega_sd_rad_s": 3.0,
                }
            )
        )  # fmt: skip
    return pd.concat(parts) if parts else pd.DataFrame(columns=["rotor", "bin"])


def _switches(run: Run) -> pd.DataFrame:
    """The first rotor that turns clockwise switches in the middle of its record."""
    columns = [
        "rotor", "switch", "time_s", "time_ci_low_s", "time_ci_high_s", "before_rad_s",
        "after_rad_s",
    ]  # fmt: skip
    turning = run.rotors[run.rotors.get("behaviour", pd.Series(dtype=str)) == "driven_cw"]
    if len(turning) == 0:
        return pd.DataFrame(columns=columns)
    number = turning["rotor"].iloc[0]
    own = run.tracks["rotor"] == number
    cumulative = run.tracks.loc[own, "cumulative_rad"].to_numpy().copy()
    middle = len(cumulative) // 2
    cumulative[middle:] = 2 * cumulative[middle] - cumulative[middle:]
    run.tracks.loc[own, "cumulative_rad"] = cumulative
    run.tracks.loc[own, "theta_rad"] = np.angle(
        np.exp(1j * (run.tracks.loc[own, "theta_rad"].iloc[0] + cumulative))
    )
    run.rotors.loc[run.rotors["rotor"] == number, "behaviour"] = "switching"
    at = float(run.tracks.loc[own, "frame"].iloc[middle]) * FRAME_INTERVAL_S
    speed = float(turning["omega_rad_s"].iloc[0])
    row = [number, 0, at, 0.98 * at, 1.02 * at, speed, -speed]
    return pd.DataFrame([row], columns=columns)


def _voltage_speeds(rotors: pd.DataFrame, rng) -> pd.DataFrame:
    kept = rotors[rotors["verdict"] == "kept"]
    return pd.DataFrame(
        [
            {
                "rotor": row["rotor"], "step": step, "voltage_v": volts, "start_s": 5.0 * step,
                "stop_s": 5.0 * step + 5.0, "n_frames": 2500,
                "omega_rad_s": row["omega_rad_s"] * volts / 0.05 + rng.normal(0, 2),
                "omega_sd_rad_s": 2.0, "voltage_sd_v": 1e-4,
            }
            for row in kept.to_dict("records")
            for step, volts in enumerate((0.05, 0.1, 0.05))
        ],
        columns=["rotor", "step", "voltage_v", "voltage_sd_v", "start_s", "stop_s", "n_frames",
                 "omega_rad_s", "omega_sd_rad_s"],
    )  # fmt: skip
