"""ThunderSTORM's formulas as our options: its thresholds count in ADU, ours in photo-electrons.

The planes of a formula are in ADU there and in electrons here, so a threshold that is a sum of
multiples of statistics, such as ``2*std(Wave.F1)``, holds in both. In any other formula the planes
are divided by the gain and the result is multiplied by it.
"""

from __future__ import annotations

import re

_PLANE = re.compile(r"(?<![\w.])(Wave\.(?:F1|F2|F|I)|F|I)(?![\w.(])")
_FUNCTIONS = ("std", "var", "mean", "median", "max", "min", "sum", "abs")
_NAME = re.compile(r"(?<![\w.])[A-Za-z_][\w.]*")
_NUMBER = r"\d+\.?\d*(?:[eE][+-]?\d+)?"
_STATISTIC = r"(?:std|mean|median|max|min|sum)\s*\(\s*(?:Wave\.(?:F1|F2|F|I)|F|I)\s*\)"
_TERM = rf"(?:{_NUMBER}\s*\*\s*{_STATISTIC}|{_STATISTIC}(?:\s*[*/]\s*{_NUMBER})?)"
_SCALES = re.compile(rf"\s*{_TERM}(?:\s*[+-]\s*{_TERM})*\s*")
_LONGEST = 60
"""Long enough for what the plugin's users write, and short enough to stay readable with gains."""

_BOUND = re.compile(rf"\(?\s*uncertainty(?:_xy)?\s*<\s*({_NUMBER})\s*\)?")


def in_photons(formula: str, gain_e_per_adu: float | None) -> tuple[float | str | None, str | None]:
    """Translate a threshold.

    Parameters
    ----------
    formula
        The plugin's, in ADU.
    gain_e_per_adu
        Electrons per count of the same protocol.

    Returns
    -------
    float or str or None
        Our threshold, in photo-electrons; None where there is none.
    str or None
        What is wrong with it, as the end of a sentence.
    """
    if len(formula) > _LONGEST or re.search(r"[^\w\s.+\-*/()]", formula):
        return None, "uses signs that are not known here: give --threshold"
    unknown = [
        name
        for name in _NAME.findall(formula)
        if name not in _FUNCTIONS and not _PLANE.fullmatch(name)
    ]
    if unknown:
        return None, f"uses {unknown[0]}, which does not exist here: give --threshold"
    if _SCALES.fullmatch(formula):
        return formula.strip(), None
    if gain_e_per_adu is None or not gain_e_per_adu > 0:
        return None, "is in ADU, and the protocol tells no gain: give --threshold in photons"
    if re.fullmatch(rf"\s*{_NUMBER}\s*", formula):
        return float(formula) * gain_e_per_adu, None
    gain = f"{gain_e_per_adu:.9g}"
    scaled = _PLANE.sub(rf"(\1/{gain})", formula.strip())
    return f"{gain}*({scaled})", None


def largest_uncertainty(formula: str) -> tuple[float | None, str]:
    """Find the bound on the uncertainty (nm) in a filter, and what else the filter demands."""
    bounds = []
    rest = []
    for part in formula.split("&"):
        match = _BOUND.fullmatch(part.strip())
        if match and "|" not in formula:
            bounds.append(float(match[1]))
        elif part.strip():
            rest.append(part.strip())
    return min(bounds, default=None), " & ".join(rest)
