"""Speed of one rotor against time, in windows, with the band that diffusion alone allows."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from rotortrack.motion.diffusion import UNKNOWN, Diffusion
from rotortrack.motion.timed_steps import steady, switching, timed_steps
from rotortrack.motion.windowed_speed import WindowedSpeed, windowed_speed
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats
from rotortrack.report.figures.columns import column
from rotortrack.report.words import Row
from rotortrack.units import TURN_RAD

LEAST_WINDOW_S = 0.5
_MOST_WINDOWS = 60
_FEWEST_FRAMES = 20


def speeds_of(
    track: pd.DataFrame,
    rotor: Row,
    switches: pd.DataFrame | None = None,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> tuple[WindowedSpeed, float] | None:
    """Measure the speed in windows of half a second, or longer in a long record.

    Parameters
    ----------
    track, rotor
        The rotor's rows of the tracks and its row of the rotors table, whose speed, D and noise of
        an angle are taken.
    switches
        Its switches of speed, if any.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.

    Returns
    -------
    Speeds and the length of a window (s); None where speed or D is not known, or the record is
    shorter than three windows.
    """
    omega, diffusion = words.number(rotor, "omega_rad_s"), words.number(rotor, "diffusion_rad2_s")
    noise = np.nan_to_num(words.number(rotor, "theta_noise_rad"))
    frame, angle = track["frame"].to_numpy(np.int64), column(track, "theta_rad")
    good = np.isfinite(angle)
    if "used" in track:
        good &= track["used"].to_numpy(bool)
    frame, angle = frame[good], angle[good]
    if len(frame) < _FEWEST_FRAMES or not (math.isfinite(omega) and diffusion >= 0):
        return None
    lasted_s = float(frame[-1] - frame[0]) * frame_interval_s
    window_s = max(LEAST_WINDOW_S, lasted_s / _MOST_WINDOWS, _FEWEST_FRAMES * frame_interval_s)
    if lasted_s < 3 * window_s:
        return None
    known = Diffusion(diffusion, diffusion, float(noise) ** 2, UNKNOWN.covariance)
    drift = steady(omega)
    if switches is not None and len(switches):
        switches = switches.sort_values("time_s")
        inner = switches["time_s"].to_numpy(np.float64)
        rates = np.append(switches["before_rad_s"], switches["after_rad_s"].iloc[-1:])
        drift = switching(np.concatenate([[-np.inf], inner, [np.inf]]), rates)
    steps = timed_steps(
        frame, angle, known, drift, frame_interval_s=frame_interval_s, exposure_s=exposure_s
    )
    return windowed_speed(steps, window_s=window_s, windows_per_length=2), window_s


def draw(
    axes: Axes,
    found: tuple[WindowedSpeed, float],
    rotor: Row,
    switches: pd.DataFrame | None = None,
    *,
    colour: str | None = None,
) -> None:
    """Draw speeds with a band of two standard deviations; what stays within it is diffusion.

    The dashed line is the rotor's speed, or its speeds between switches, which are marked.
    """
    speeds, window_s = found
    colour = colour or style.behaviour(rotor.get("behaviour")).colour
    time, value, sd = speeds.time_s, speeds.omega_rad_s / TURN_RAD, speeds.sd_rad_s / TURN_RAD
    axes.fill_between(
        time, value - 2 * sd, value + 2 * sd, color=colour, alpha=0.25, lw=0, label="±2 sd"
    )
    axes.plot(time, value, color=colour, lw=1.0)
    axes.axhline(0, color=style.PALE, lw=0.8, zorder=0)
    _draw_expected(axes, time, rotor, switches)
    half = window_s / 2
    axes.set_xlim(min(0.0, float(time[0]) - half), float(time[-1]) + half)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("speed (rev/s)")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    canvas.caption(axes, f"speed in windows of {window_s:.2g} s")


def _draw_expected(axes: Axes, time: Floats, rotor: Row, switches: pd.DataFrame | None) -> None:
    ends = np.array([0.0, time[-1] * 2])
    speed, _ = words.rev_per_s(rotor)
    if switches is None or len(switches) == 0:
        axes.plot(ends, [speed, speed], "--", color=style.INK, lw=0.9, label="measured speed")
        return
    switches = switches.sort_values("time_s")
    at = switches["time_s"].to_numpy(np.float64)
    for low, high in zip(switches["time_ci_low_s"], switches["time_ci_high_s"], strict=True):
        axes.axvspan(low, high, color=style.ORANGE, alpha=0.3, lw=0, zorder=0)
    rates = np.append(switches["before_rad_s"], switches["after_rad_s"].iloc[-1:]) / TURN_RAD
    axes.stairs(
        rates, np.concatenate([[0.0], at, ends[1:]]), baseline=None, ls="--", color=style.INK,
        lw=0.9, label="measured speeds",
    )  # fmt: skip
