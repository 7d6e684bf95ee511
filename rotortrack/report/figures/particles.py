"""Mobile particles: tracks in the field, mean-square displacements, diffusion coefficients."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from rotortrack.motion.ensemble import Ensemble, Track, msd_lags, track_msd
from rotortrack.report import style, words
from rotortrack.report.figures import canvas
from rotortrack.report.figures.canvas import Floats

_NM2_PER_UM2 = 1e6
_COLOURS = "viridis"
_MOST_TRACKS = 2000
_MOST_MSDS = 150
_MOST_POINTS = 400


@canvas.in_house_style
def figure(
    tracks: pd.DataFrame, particles: pd.DataFrame, whole: Ensemble, *, frame_interval_s: float
) -> Figure:
    """Draw tracks coloured by D, mean-square displacements of each and of all, and all D.

    Parameters
    ----------
    tracks, particles
        Tables `PARTICLE_TRACKS`, ordered by particle and frame, and `PARTICLES`.
    whole
        All particles together.
    frame_interval_s
        Time from frame to frame (s).
    """
    made = canvas.new_figure(10.6, 5.55)
    canvas.heading(made, _title(whole), 0.2)
    field = canvas.place(made, 0.75, 0.55, 4.25, 4.25)
    bar = canvas.place(made, 5.15, 0.55, 0.13, 4.25)
    curves = canvas.place(made, 6.8, 2.95, 3.6, 1.85)
    histogram = canvas.place(made, 6.8, 0.55, 3.6, 1.6)
    if not len(particles):
        for axes in (field, curves, histogram):
            canvas.notice(axes, "no particles")
        bar.set_axis_off()
        return made
    parts = _parts(tracks)
    diffusion = particles["diffusion_um2_s"].to_numpy(np.float64)
    _draw_field(field, bar, parts, diffusion)
    _draw_msds(curves, parts, whole, frame_interval_s)
    _draw_histogram(histogram, particles, whole)
    return made


def _title(whole: Ensemble) -> str:
    counted = words.count(whole.n_particles, "mobile particle")
    if not math.isfinite(whole.diffusion_nm2_s):
        return counted
    mean = significant(whole.diffusion_nm2_s, whole.diffusion_sd_nm2_s)
    return f"{counted}: mean D = {mean} µm²/s"


def significant(value_nm2_s: float, sd_nm2_s: float) -> str:
    """Write D ± sd in µm²/s without an exponent where that is readable."""
    value, sd = value_nm2_s / _NM2_PER_UM2, sd_nm2_s / _NM2_PER_UM2
    if value != 0.0 and abs(value) < 1e-3:
        power = math.floor(math.log10(abs(value)))
        scaled = words.plus_minus(value / 10.0**power, sd / 10.0**power, "")
        return f"({scaled})·10{canvas.superscript(power)}"
    return words.plus_minus(value, sd, "")


def _parts(tracks: pd.DataFrame) -> list[Track]:
    starts = np.flatnonzero(np.diff(tracks["particle"].to_numpy(), prepend=-1))[1:]
    frame = np.split(tracks["frame"].to_numpy(np.int64), starts)
    place = np.split(tracks[["x_nm", "y_nm"]].to_numpy(np.float64), starts)
    return [Track(f, p, None) for f, p in zip(frame, place, strict=True)]


def _draw_field(axes: Axes, bar: Axes, parts: list[Track], diffusion: Floats) -> None:
    """Draw every track in the colour of its D; of very many only the longest."""
    order = np.argsort([-part.frame.size for part in parts], kind="stable")[:_MOST_TRACKS]
    moving = diffusion[np.isfinite(diffusion) & (diffusion > 0.0)]
    low, high = _decent_range(moving)
    norm = LogNorm(low, high)
    lines = [_thinned(parts[k].place_nm) / 1000.0 for k in order]
    # A particle without diffusion takes the colour of the slowest.
    shown = np.clip(np.nan_to_num(diffusion[order], nan=low), low, high)
    drawn = LineCollection(lines, linewidths=0.7, cmap=_COLOURS, norm=norm)
    drawn.set_array(shown)
    axes.add_collection(drawn)
    everything = np.concatenate(lines)
    centre = (everything.max(axis=0) + everything.min(axis=0)) / 2.0
    half = 0.53 * float(max(np.ptp(everything, axis=0).max(), 0.1))
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] + half, centre[1] - half)
    axes.spines[["top", "right"]].set_visible(True)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6))
        axis.set_major_formatter(FuncFormatter(lambda value, _: words.minus(f"{value:g}")))
    axes.set_xlabel("x (µm)")
    axes.set_ylabel("y (µm)")
    left_out = len(parts) - len(order)
    axes.set_title(f"tracks; {left_out} of the shortest not shown" if left_out else "tracks")
    colours = axes.figure.colorbar(ScalarMappable(norm, _COLOURS), cax=bar)
    canvas.log_ticks(bar.yaxis, low, high)
    colours.set_label("D (µm²/s)")
    bar.yaxis.set_label_coords(4.2, 0.5)


def _thinned(place: Floats) -> Floats:
    """Keep at most a few hundred points of a track, the first and the last among them."""
    if len(place) <= _MOST_POINTS:
        return place
    chosen: Floats = place[np.linspace(0, len(place) - 1, _MOST_POINTS).round().astype(int)]
    return chosen


def _decent_range(values: Floats) -> tuple[float, float]:
    """Limits of a logarithmic axis that are never less than a factor of two apart."""
    if values.size == 0:
        return 0.1, 1.0
    low, high = (float(v) for v in np.quantile(values, [0.02, 0.98]))
    if high < 2.0 * low:
        middle = math.sqrt(low * high)
        low, high = middle / 1.5, middle * 1.5
    return low, high


def _draw_msds(axes: Axes, parts: list[Track], whole: Ensemble, frame_interval_s: float) -> None:
    """Draw the mean-square displacement of single particles, of all, and what D and noise give."""
    axes.set_xlabel("lag τ (s)")
    axes.set_ylabel("MSD (µm²)")
    table = whole.msd[whole.msd["xy_msd_nm2"] > 0.0]
    if not len(table):
        canvas.notice(axes, "no mean-square displacement")
        return
    chosen = np.unique(np.linspace(0, len(parts) - 1, _MOST_MSDS).round().astype(int))
    single = []
    for k in chosen:
        lags = msd_lags(int(np.ptp(parts[k].frame)), 30)
        values, _ = track_msd(parts[k], lags)
        known = np.isfinite(values) & (values > 0.0)
        single.append(
            np.stack([lags[known] * frame_interval_s, values[known] / _NM2_PER_UM2], axis=1)
        )
    axes.add_collection(LineCollection(single, colors=style.PALE, linewidths=0.6, zorder=1))
    axes.plot([], [], color=style.PALE, lw=1.2, label="single particles")
    lag = table["lag_s"].to_numpy(np.float64)
    mean = table["xy_msd_nm2"].to_numpy(np.float64) / _NM2_PER_UM2
    sd = table["xy_msd_sd_nm2"].to_numpy(np.float64) / _NM2_PER_UM2
    sparse = np.unique(np.geomspace(1, len(lag), 25).round().astype(int)) - 1
    axes.errorbar(
        lag[sparse],
        mean[sparse],
        yerr=np.minimum(np.nan_to_num(sd[sparse]), 0.9 * mean[sparse]),
        fmt="o",
        ms=3,
        lw=0.9,
        color=style.BLUE,
        label="all, with sd over particles",
        zorder=3,
    )
    if math.isfinite(whole.diffusion_nm2_s) and whole.diffusion_nm2_s > 0.0:
        slope = 4.0 * whole.diffusion_nm2_s / _NM2_PER_UM2
        offset = mean[0] - slope * lag[0]
        model = slope * lag + offset
        axes.plot(
            lag[model > 0],
            model[model > 0],
            color=style.VERMILLION,
            lw=1.1,
            zorder=4,
            label="4Dτ and noise, D from steps",
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    points = np.concatenate([mean, *(s[:, 1] for s in single if len(s))])
    low, high = (float(v) for v in np.quantile(points[points > 0.0], [0.005, 1.0]))
    low, high = min(low, float(mean.min())) / 2.0, high * 4.0
    left, right = lag.min() / 1.3, lag.max() * 1.3
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    canvas.log_ticks(axes.xaxis, left, right)
    canvas.log_ticks(axes.yaxis, low, high)
    axes.legend(loc="upper left", labelspacing=0.2)
    if math.isfinite(whole.alpha):
        axes.set_title(
            f"exponent of the first lags {words.plus_minus(whole.alpha, whole.alpha_sd, '')}"
        )


def _draw_histogram(axes: Axes, particles: pd.DataFrame, whole: Ensemble) -> None:
    """Draw how many particles have which D, the mean with its interval, and the median."""
    axes.set_xlabel("D (µm²/s)")
    axes.set_ylabel("particles")
    values = particles["diffusion_um2_s"].to_numpy(np.float64)
    moving = values[np.isfinite(values) & (values > 0.0)]
    if not moving.size:
        canvas.notice(axes, "no particle diffuses")
        return
    low, high = float(moving.min()) / 1.15, float(moving.max()) * 1.15
    if high < 2.0 * low:
        low, high = low / 1.4, high * 1.4
    bins = int(np.clip(2.0 * math.sqrt(moving.size), 8, 40))
    edges = np.geomspace(low, high, bins + 1)
    axes.hist(moving, edges.tolist(), color=style.SKY, edgecolor="white", linewidth=0.4)
    mean = whole.diffusion_nm2_s / _NM2_PER_UM2
    sd = whole.diffusion_sd_nm2_s / _NM2_PER_UM2
    if low < mean < high:
        axes.axvspan(
            max(mean - 1.96 * sd, low), mean + 1.96 * sd, color=style.VERMILLION, alpha=0.25
        )
        axes.axvline(mean, color=style.VERMILLION, lw=1.1, label="mean, 95 %")
    middle = float(np.median(values[np.isfinite(values)]))
    if low < middle < high:
        axes.axvline(middle, color=style.INK, lw=1.1, ls="--", label="median")
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    canvas.log_ticks(axes.xaxis, low, high)
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    still = int(np.count_nonzero(~(values > 0.0)))
    axes.set_title(f"each particle; {still} with D = 0" if still else "each particle")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.02, 0.97), ncols=2, columnspacing=1.2)
