"""What is known of a movie, each value with the place that it came from."""

from __future__ import annotations

import math
import unicodedata
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

from rotortrack.errors import MetadataWarning

LONGEST_TEXT = 200
"""Characters kept of a free text: enough for a name, too few to flood a terminal."""


@dataclass(frozen=True)
class Value:
    """One value and its origin as it is shown to the user, such as ``file (ImageJ)``."""

    value: float | str
    origin: str


Metadata = Mapping[str, Value]
"""Values by option name (`pixel_size_nm`, `frame_interval_s`, `exposure_s`) and free names."""

NOTHING: Metadata = {}

# Outside these bounds a number describes paper, a screen or nothing at all: 72 dots an inch are
# 353 000 nm a pixel.
_BOUNDS = {
    "pixel_size_nm": (1.0, 1e5),
    "frame_interval_s": (1e-9, 1e6),
    "exposure_s": (1e-9, 1e6),
}
_DISAGREEMENT = 0.01

_NANOMETRES = {
    "nm": 1.0,
    "nanometer": 1.0,
    "nanometre": 1.0,
    "um": 1e3,
    "µm": 1e3,
    "micron": 1e3,
    "microns": 1e3,
    "micrometer": 1e3,
    "micrometre": 1e3,
    "mm": 1e6,
    "cm": 1e7,
    "m": 1e9,
    "å": 0.1,
    "angstrom": 0.1,
}
_SECONDS = {
    "ns": 1e-9,
    "us": 1e-6,
    "µs": 1e-6,
    "usec": 1e-6,
    "ms": 1e-3,
    "msec": 1e-3,
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "seconds": 1.0,
    "min": 60.0,
    "h": 3600.0,
}


def nanometres(length: object, unit: object) -> float | None:
    """Convert a length; None where the unit is no length (`pixel`) or describes print (`inch`)."""
    return _convert(length, unit, _NANOMETRES)


def seconds(time: object, unit: object) -> float | None:
    """Convert a time; None where the unit is not a time."""
    return _convert(time, unit, _SECONDS)


def collect(origin: str, **values: object) -> dict[str, Value]:
    """Keep what can be true: finite numbers within the bounds of their name, texts made safe.

    Parameters
    ----------
    origin
        Where the values come from, such as ``file (OME)``.
    **values
        Values by name; None means "not there".
    """
    kept: dict[str, Value] = {}
    for name, value in values.items():
        if value is None:
            continue
        if name in _BOUNDS:
            number = _number(value)
            low, high = _BOUNDS[name]
            if number is not None and low <= number <= high:
                kept[name] = Value(number, origin)
        elif isinstance(value, int | float) and math.isfinite(value):
            kept[name] = Value(value, origin)
        elif text := clean(str(value)):
            kept[name] = Value(text, origin)
    return kept


def merge(*layers: Metadata) -> dict[str, Value]:
    """Join layers, later ones win.

    Warns
    -----
    MetadataWarning
        Two layers differ by more than 1 % in a pixel size or a time.
    """
    merged: dict[str, Value] = {}
    for layer in layers:
        for name, new in layer.items():
            old = merged.get(name)
            if old is not None and name in _BOUNDS and _differ(old.value, new.value):
                warnings.warn(
                    f"{name} is {old.value:.6g} by {old.origin} but {new.value:.6g} by "
                    f"{new.origin}, which is used: give --{name.replace('_', '-')} if it is wrong",
                    MetadataWarning,
                    stacklevel=2,
                )
            merged[name] = new
    return merged


def clean(text: str) -> str:
    """Strip what could steer a terminal (control and format characters) and cut long texts."""
    safe = "".join(
        " " if character in "\t\r\n" else character
        for character in text
        if character in "\t\r\n" or unicodedata.category(character)[0] != "C"
    )
    return safe.strip()[:LONGEST_TEXT]


def _number(value: object) -> float | None:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _convert(value: object, unit: object, factors: Mapping[str, float]) -> float | None:
    number = _number(value)
    # ImageJ writes the micro sign as the escape \u00B5; the Greek letter mu looks the same.
    name = str(unit).strip().replace("\\u00B5", "µ").replace("\u03bc", "µ").lower()
    factor = factors.get(name)
    return None if number is None or factor is None else number * factor


def _differ(old: float | str, new: float | str) -> bool:
    first, second = float(old), float(new)
    return abs(first - second) > _DISAGREEMENT * max(abs(first), abs(second))
