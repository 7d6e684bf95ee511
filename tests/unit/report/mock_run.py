"""A run of plain-numpy rotors, and measurements of the text that a figure shows."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from rotortrack.tables import DRIFT, LOCALISATIONS, ROTORS, TRACKS, empty

FRAME_INTERVAL_S = 0.002
KINDS = ("driven_ccw", "driven_cw", "brownian", "stuck", "toggling")


@dataclass
class Run:
    rotors: pd.DataFrame
    tracks: pd.DataFrame
    localisations: pd.DataFrame
    drift: pd.DataFrame

    def of(self, rotor: int):
        spots = self.localisations[self.localisations["rotor"] == rotor]
        track = self.tracks[self.tracks["rotor"] == rotor]
        return spots, self.rotors[self.rotors["rotor"] == rotor].iloc[0].to_dict(), track


def by_rotor(table):
    return {int(number): part for number, part in table.groupby("rotor")}


def theta_of(kind, frames, rng):
    steps = rng.normal(0, 0.3, frames)
    if kind == "driven_ccw":
        return np.cumsum(steps + rng.uniform(0.01, 0.25))
    if kind == "driven_cw":
        return np.cumsum(steps - rng.uniform(0.01, 0.25))
    if kind == "brownian":
        return np.cumsum(steps)
    if kind == "stuck":
        return np.full(frames, 0.7) + rng.normal(0, 0.1, frames)
    return np.pi * (np.cumsum(rng.random(frames) < 0.02) % 2) + rng.normal(0, 0.1, frames)


def make_run(n=20, frames=8000, seed=1, pitch_nm=2000.0, first_number=0):
    rng = np.random.default_rng(seed)
    dt = FRAME_INTERVAL_S
    rows, tracks, spots = [], [], []
    columns = int(np.ceil(np.sqrt(n)))
    for i in range(n):
        kind = KINDS[i % len(KINDS)]
        number = first_number + i
        refused = kind == "stuck"
        theta = theta_of(kind, frames, rng)
        xc = 1500 + (i % columns) * pitch_nm + rng.uniform(-50, 50)
        yc = 1500 + (i // columns) * pitch_nm + rng.uniform(-50, 50)
        radius = rng.uniform(40, 110)
        x = xc + radius * np.cos(theta) + rng.normal(0, 9, frames)
        y = yc - radius * np.sin(theta) + rng.normal(0, 9, frames)
        seen = rng.random(frames) < 0.93
        seen[[0, -1]] = True
        frame = np.flatnonzero(seen)
        x, y = x[seen], y[seen]
        measured = np.arctan2(-(y - yc), x - xc)
        step = np.full(len(frame), np.nan)
        turn = np.mod(np.diff(measured), 2 * np.pi)
        step[1:] = np.where(turn <= np.pi, turn, turn - 2 * np.pi)
        cumulative = np.cumsum(np.nan_to_num(step))
        step[1:][np.diff(frame) != 1] = np.nan
        omega = cumulative[-1] / ((frame[-1] - frame[0]) * dt)
        sd = 0.3 / np.sqrt(dt * frames * dt)
        spots.append(pd.DataFrame({"frame": frame, "x_nm": x, "y_nm": y, "rotor": number}))
        tracks.append(
            pd.DataFrame(
                {
                    "rotor": number, "frame": frame, "time_s": frame * dt, "x_nm": x, "y_nm": y,
                    "theta_rad": measured, "step_rad": step, "cumulative_rad": cumulative,
                    "used": True,
                }
            )
        )  # fmt: skip
        nothing = np.nan if refused else 1.0
        rows.append(
            {
                "rotor": number, "x_nm": xc, "y_nm": yc, "radius_nm": radius,
                "radius_sd_nm": 0.4, "n_localisations": len(frame),
                "verdict": "refused" if refused else "kept",
                "reason": "immobile: its arc of 63 degrees is no wider than its noise"
                if refused else "",
                "behaviour": "unclassified" if refused else kind,
                "omega_rad_s": omega * nothing, "omega_sd_rad_s": sd * nothing,
                "speed_deg_s": np.degrees(omega) * nothing,
                "speed_ci_low_deg_s": np.degrees(omega - 1.96 * sd) * nothing,
                "speed_ci_high_deg_s": np.degrees(omega + 1.96 * sd) * nothing,
                "rev_per_s": omega / (2 * np.pi) * nothing,
                "diffusion_rad2_s": 22.5 * nothing, "diffusion_sd_rad2_s": 0.4 * nothing,
                "msd_speed_deg_s": abs(np.degrees(omega)) * nothing,
                "msd_diffusion_rad2_s": 22.5 * nothing,
                "msd_lag_min_s": dt * nothing, "msd_lag_max_s": 500 * dt * nothing,
            }
        )  # fmt: skip
    if not rows:
        return Run(*(empty(schema) for schema in (ROTORS, TRACKS, LOCALISATIONS, DRIFT)))
    at = np.arange(frames)
    drift = pd.DataFrame(
        {
            "frame": at, "dx_nm": 80 * np.sin(at / frames * 3), "dy_nm": -50 * at / frames,
            "sd_nm": 3.0,
        }
    )  # fmt: skip
    return Run(pd.DataFrame(rows), pd.concat(tracks), pd.concat(spots), drift)


def visible_texts(figure: Figure) -> list[tuple[str, np.ndarray]]:
    """Every drawn text with its extents (x0, y0, x1, y1) in pixels; ticks outside limits not."""
    figure.canvas.draw()
    renderer = FigureCanvasAgg.get_renderer(figure.canvas)
    hidden = set()
    for axes in [a for parent in figure.axes for a in (parent, *parent.child_axes)]:
        for axis in (axes.xaxis, axes.yaxis):
            if not (axes.axison and axis.get_visible()):
                hidden |= set(map(id, axis.findobj(Text)))
                continue
            shown = set(map(id, axis._update_ticks()))
            for tick in (*axis.majorTicks, *axis.minorTicks):
                if id(tick) not in shown:
                    hidden |= {id(tick.label1), id(tick.label2)}
    return [
        (t.get_text(), t.get_window_extent(renderer).extents)
        for t in figure.findobj(Text)
        if t.get_visible() and t.get_text().strip() and id(t) not in hidden
    ]


def overlaps(figure: Figure, slack: float = 0.5) -> list[tuple[str, str]]:
    """Pairs of texts whose extents intersect by more than `slack` pixels both ways."""
    return [
        (a, b)
        for (a, p), (b, q) in combinations(visible_texts(figure), 2)
        if min(p[2], q[2]) - max(p[0], q[0]) > slack and min(p[3], q[3]) - max(p[1], q[1]) > slack
    ]


def clipped(figure: Figure) -> list[str]:
    """Texts that stick out of the page."""
    width, height = figure.canvas.get_width_height()
    return [
        words
        for words, (x0, y0, x1, y1) in visible_texts(figure)
        if x0 < 0 or y0 < 0 or x1 > width or y1 > height
    ]
