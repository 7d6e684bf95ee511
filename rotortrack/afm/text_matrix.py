"""Images written as text: a matrix of heights, with or without lines of a header in front."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ImageError

_LARGEST_HEADER = 1000
_METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9, "å": 1e-10}
_LENGTH = r"([-+0-9.,eE]+)\s*([a-zµμÅå]+)"


@dataclass(frozen=True)
class TextMatrix:
    """What a file says.

    Attributes
    ----------
    values
        (y, x) in units of the file.
    width_nm
        Width of the whole image by its header, or None.
    nm_per_unit
        Height of one unit by its header, or None.
    """

    values: NDArray[np.float64]
    width_nm: float | None
    nm_per_unit: float | None


def parse_matrix(text: str, path: Path) -> TextMatrix:
    """Read rows of numbers behind a header that Gwyddion, WSxM or nobody wrote.

    Numbers are separated by blanks, tabs, semicolons or commas; a comma in numbers that are
    separated otherwise is a decimal one.

    Raises
    ------
    ImageError
        There are no rows of numbers, they differ in length, or they list single points.
    """
    lines = text.splitlines()
    header, rows = _split(lines, path)
    columns = {len(row) for row in rows}
    if len(columns) > 1:
        odd = next(n for n, row in enumerate(rows) if len(row) != len(rows[0]))
        raise ImageError(
            f"{path} has rows of {len(rows[0])} and of {len(rows[odd])} numbers (row {odd + 1}): "
            "save the image as one matrix"
        )
    if columns == {3} and len(rows) > 50:
        raise ImageError(
            f"{path} seems to list points as x, y, z: save the image as a matrix of heights"
        )
    told = "\n".join(header)
    return TextMatrix(
        np.array(rows, np.float64),
        _length_nm(rf"(?im)^[#\s]*(?:width|x amplitude)\s*[:=]\s*{_LENGTH}", told),
        _units_nm(told),
    )


def _split(lines: list[str], path: Path) -> tuple[list[str], list[list[float]]]:
    """Part the header from the rows of numbers."""
    header: list[str] = []
    rows: list[list[float]] = []
    decimal = any(mark in line for line in lines[-2:] for mark in ";\t ") and not any(
        "." in line for line in lines[-2:]
    )
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith("#"):
            header.append(text)
            continue
        plain = text.replace(",", ".") if decimal else text.replace(",", " ")
        try:
            rows.append([float(cell) for cell in plain.replace(";", " ").split()])
        except ValueError:
            if rows:
                raise ImageError(
                    f"{path} has something else than numbers in line {number}: save the image as "
                    "a matrix of heights"
                ) from None
            header.append(text)
            if len(header) > _LARGEST_HEADER:
                break
    if not rows:
        raise ImageError(f"{path} holds no rows of numbers: save the image as a matrix of heights")
    return header, rows


def _length_nm(pattern: str, text: str) -> float | None:
    found = re.search(pattern, text)
    if found is None:
        return None
    metres = _METRES.get(found[2].lower())
    try:
        length = float(found[1].replace(",", "."))
    except ValueError:
        return None
    return 1e9 * metres * length if metres and length > 0 else None


def _units_nm(text: str) -> float | None:
    found = re.search(r"(?im)^[#\s]*value units\s*[:=]\s*([a-zµμÅå]+)", text)
    metres = _METRES.get(found[1].lower()) if found else None
    return 1e9 * metres if metres else None
