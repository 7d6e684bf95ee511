"""How `rotortrack info` shows a movie, a table, camera maps or a configuration."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rotortrack_cli.console import Console, one_line

if TYPE_CHECKING:
    from rotortrack.cameras.line_noise import LineNoise
    from rotortrack.cameras.pixels import PixelCheck
    from rotortrack.pipeline.describe_configuration import ConfigurationReport
    from rotortrack.pipeline.describe_movie import MovieReport
    from rotortrack.pipeline.describe_table import MapsReport, TableReport

WIDTH = 100
_LABEL = 18
_MOST_LISTED = 8
_NOT_LATE_S = 1e-6
_LONGEST_VALUE = 40
_RECORDED = ("pixel_size_nm", "frame_interval_s", "frames", "width_px", "height_px")


def show_movie(console: Console, report: MovieReport) -> None:
    """Print what is in a movie."""
    from rotortrack.pipeline.describe_movie import NEEDED

    frames, height, width = report.shape
    files = one_line(str(report.files[0]))
    if len(report.files) > 1:
        files += f" and {_count(len(report.files) - 1, 'more file')}"
    console.text(
        f"{files}: {frames} frame{'s' * (frames != 1)} of {width} x {height} pixels, "
        f"{report.dtype}, {_size(report.size_bytes)}\n"
    )
    rows = [
        [name, report.values[name].value, report.values[name].origin]
        if name in report.values
        else [name, None, f"unknown: give --{name.replace('_', '-')}"]
        for name in NEEDED
    ]
    rows += [
        [name, value.value, value.origin]
        for name, value in report.values.items()
        if name not in NEEDED
    ]
    console.table(["", "value", "origin"], rows)
    console.text("")
    for note in report.notes:
        _entry(console, "understood", note)
    if report.missing_frames:
        _entry(console, "cut short", f"{report.missing_frames} declared frames are missing")
    _entry(console, "recorded times", _times(report))
    _entry(console, "gain", _gain(report))
    for label, noise in (("column noise", report.column_noise), ("row noise", report.row_noise)):
        _entry(console, label, _noise(noise, report.gain_in_use))
    for label, text in _pixels(report.pixels).items():
        _entry(console, label, text)
    console.json(report.as_dict())


def show_table(console: Console, report: TableReport) -> None:
    """Print what is in a table of localisations."""
    console.text(
        f"{report.path}: {_count(report.rows, 'localisation')} in "
        f"{_count(report.frames_with_rows, 'frame')}\n"
    )
    rows = [[c.name, c.unit, c.least, c.largest, c.missing, c.meaning] for c in report.columns]
    console.table(["column", "unit", "least", "largest", "missing", "meaning"], rows)
    console.text("")
    info = report.info
    recorded = {name: getattr(info, name) for name in _RECORDED}
    for name, value in recorded.items():
        if value is not None:
            _entry(console, name, f"{value:.6g}")
    unknown = [name for name, value in recorded.items() if value is None]
    if not info.provenance:
        unknown.append("how it was made")
    if unknown:
        _entry(console, "not recorded", ", ".join(unknown))
    for key, value in info.provenance.items():
        _entry(console, one_line(str(key)), _short(value))
    console.json(report.as_dict())


def show_maps(console: Console, report: MapsReport) -> None:
    """Print what is in a file of camera maps."""
    console.text(f"{report.path}: camera maps\n")
    header = ["array", "size", "median", "least", "largest", "outliers"]
    rows = [
        [
            array.name,
            " x ".join(map(str, reversed(array.shape))) or "one number",
            array.median,
            array.least,
            array.largest,
            array.outliers,
        ]
        for array in report.arrays
    ]
    console.table(header, rows)
    console.text("")
    if report.hot_pixels is not None:
        _entry(
            console,
            "noise",
            f"{_count(report.hot_pixels, 'hot pixel')}: read noise far above that of most pixels, "
            "not searched for spots",
        )
    if report.dead_pixels is not None:
        _entry(console, "dead", f"{_count(report.dead_pixels, 'pixel')}, left out everywhere")
    for key, value in report.provenance.items():
        _entry(console, one_line(str(key)), _short(value))
    console.json(report.as_dict())


def show_configuration(console: Console, report: ConfigurationReport) -> None:
    """Print which options a configuration gives."""
    console.text(f"{report.path}: {report.kind}, {_count(len(report.options), 'option')}\n")
    rows = [[o.section, o.name, _spelt(o.value), o.meaning] for o in report.options]
    console.table(["section", "option", "value", "meaning"], rows)
    if report.left_out:
        console.text("")
    for sentence in report.left_out:
        _entry(console, "not taken over", sentence)
    console.json(report.as_dict())


def _spelt(value: Any) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return textwrap.shorten(one_line(text), _LONGEST_VALUE, placeholder=" ...")


def _entry(console: Console, label: str, text: str) -> None:
    console.text(
        textwrap.fill(
            one_line(text),
            WIDTH,
            initial_indent=label.ljust(_LABEL - 1) + " ",
            subsequent_indent=" " * _LABEL,
        )
    )


def _times(report: MovieReport) -> str:
    times = report.times
    if times is None:
        return "the file tells none"
    if times.irregular:
        return (
            f"irregular: {times.low_s * 1e3:.4g} to {times.high_s * 1e3:.4g} ms from frame to frame"
        )
    late = (
        "on time"
        if times.jitter_s < _NOT_LATE_S
        else f"less than {times.jitter_s * 1e3:.2g} ms late"
    )
    text = f"every {times.interval_s * 1e3:.6g} ms, 95 % of the frames {late}, "
    if not times.dropped:
        return text + "none dropped"
    return text + f"{_count(times.dropped, 'frame')} dropped in {_count(times.places, 'place')}"


def _gain(report: MovieReport) -> str:
    gain = report.gain
    if gain.reason is not None:
        return f"unknown: {gain.reason.partition(': ')[2]}"
    return (
        f"{gain.gain_e_per_adu:.3g} +- {gain.sd:.2g} electrons per count, as the variance grows "
        "with the mean"
    )


def _noise(noise: LineNoise, gain_e_per_adu: float | None) -> str:
    if noise.reason is not None:
        return f"unknown: {noise.reason.partition(': ')[2]}"
    found = noise.sentence(gain_e_per_adu if noise.matters else None).partition(" noise of ")[2]
    return found if noise.matters else f"none that matters ({found})"


def _pixels(seen: PixelCheck) -> dict[str, str]:
    """Say what was seen in the counts, by label."""
    counts = f"{seen.least_adu:g} to {seen.largest_adu:g}"
    if seen.saturated_pixels:
        where = _count(seen.saturated_frames, "frame")
        counts += (
            f"; {_count(seen.saturated_pixels, 'pixel')} in {where} saturated (at "
            f"{seen.saturation_adu:g})"
        )
    elif seen.saturation_adu is not None:
        counts += f"; none saturated (at {seen.saturation_adu:g})"
        if (bits := seen.looks_like_bits) is not None:
            counts += (
                f", but {seen.largest_adu:g} is the end of a {bits}-bit converter: give "
                f"--saturation-adu {seen.largest_adu:g} if the camera has one"
            )
    if seen.missing_pixels:
        counts += f"; {_count(seen.missing_pixels, 'pixel')} without a number"
    empty = [
        f"{_count(len(numbers), 'frame')} {what} (number {_listed(numbers)})"
        for what, numbers in (("all 0", seen.zero_frames), ("constant", seen.constant_frames))
        if numbers
    ]
    dead = [
        f"{_count(len(numbers), f'dead {what}')} ({_listed(numbers)})"
        for what, numbers in (("row", seen.dead_rows), ("column", seen.dead_columns))
        if numbers
    ]
    if seen.dead_pixels:
        dead.append(f"{_count(seen.dead_pixels, 'pixel')} in all that never change")
    return {
        "counts": counts,
        "empty frames": f"{'; '.join(empty) or 'none'} of {seen.frames} looked at",
        "dead pixels": "; ".join(dead) or "none",
    }


def _listed(numbers: Sequence[int]) -> str:
    """Name the first few numbers."""
    shown = ", ".join(map(str, numbers[:_MOST_LISTED]))
    more = len(numbers) - _MOST_LISTED
    return f"{shown} and {more} more" if more > 0 else shown


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"


def _size(size_bytes: float) -> str:
    for unit in ("bytes", "kB", "MB"):
        if size_bytes < 1000:
            return f"{size_bytes:.3g} {unit}"
        size_bytes /= 1000
    return f"{size_bytes:.3g} GB"


def _short(value: Any) -> str:
    """Give a recorded value in at most two lines."""
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return textwrap.shorten(one_line(text), 2 * (WIDTH - _LABEL) - 10, placeholder=" ...")
