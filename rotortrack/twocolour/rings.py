"""The rings that both ends of a rotor trace, and how the ends stand to each other.

Angles of each end are taken about the centre of its own ring, which a registration error moves but
does not turn.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.rotors.circle import CircleEnd, CircleFit, fit_circle

Floats = NDArray[np.float64]

_TANDEM_RAD = math.pi / 4.0
_UNLIKE = 0.1
_CLEAR_SD = 3.0
_TOLD_NM = 1e-9


@dataclass(frozen=True)
class Rings:
    """Both rings of one rotor.

    Attributes
    ----------
    first_radius_nm, first_radius_sd_nm, second_radius_nm, second_radius_sd_nm
        Radii; nan for an end that traces no ring.
    centres_apart_nm, centres_apart_sd_nm
        Distance of the centres, and its standard deviation per axis with the registration's.
    phase_rad, phase_sd_rad
        Angle of the second end ahead of the first, counter-clockwise on the displayed image, and
        its spread over time (noise included).
    arrangement
        tandem (both ends on one side of the axis, within 45 degrees), opposed (on two sides), skew
        (between); centred where one end stays on the axis; unknown where neither traces a ring.
    docking
        off-centre where the radii differ, by more than a tenth and three standard deviations:
        the rod is held beside its middle; centred where they do not; unknown without two rings.
    """

    first_radius_nm: float
    first_radius_sd_nm: float
    second_radius_nm: float
    second_radius_sd_nm: float
    centres_apart_nm: float
    centres_apart_sd_nm: float
    phase_rad: float
    phase_sd_rad: float
    arrangement: str
    docking: str


def both_rings(
    first_nm: Floats, second_nm: Floats, *, registration_sd_nm: float = 0.0, stretch: float = 1.0
) -> Rings:
    """Fit the rings of both ends.

    Parameters
    ----------
    first_nm, second_nm
        Places of the ends in the same frames, (frames, 2), nm, y down.
    registration_sd_nm
        Standard deviation of the registration per axis.
    stretch
        True radius over that of places averaged over the exposure, at least 1.

    Returns
    -------
    Rings
    """
    fits = [fit_circle(ends[:, 0], ends[:, 1]) for ends in (first_nm, second_nm)]
    rings = [fit.end is CircleEnd.FITTED for fit in fits]
    radii = [
        (stretch * fit.radius_nm, stretch * fit.radius_sd_nm) if ring else (math.nan, math.nan)
        for fit, ring in zip(fits, rings, strict=True)
    ]
    phase, phase_sd, arrangement, docking = math.nan, math.nan, "unknown", "unknown"
    apart, apart_sd = math.nan, math.nan
    if all(rings):
        angles = [_angles(ends, fit) for ends, fit in zip((first_nm, second_nm), fits, strict=True)]
        mean = complex(np.exp(1j * (angles[1] - angles[0])).mean())
        phase = cmath.phase(mean)
        phase_sd = math.sqrt(max(-2.0 * math.log(max(abs(mean), _TOLD_NM)), 0.0))
        arrangement = _arrangement(phase)
        docking = _docking(*radii)
        apart = math.hypot(fits[1].x_nm - fits[0].x_nm, fits[1].y_nm - fits[0].y_nm)
        variances = [0.5 * (fit.x_sd_nm**2 + fit.y_sd_nm**2) for fit in fits]
        apart_sd = math.sqrt(sum(variances) + registration_sd_nm**2)
    elif any(rings):
        still = fits[rings.index(False)]
        if still.end is CircleEnd.NOT_A_RING:
            arrangement = "centred"
    return Rings(*radii[0], *radii[1], apart, apart_sd, phase, phase_sd, arrangement, docking)


def _angles(ends: Floats, fit: CircleFit) -> Floats:
    angles: Floats = np.arctan2(-(ends[:, 1] - fit.y_nm), ends[:, 0] - fit.x_nm)
    return angles


def _arrangement(phase_rad: float) -> str:
    if abs(phase_rad) < _TANDEM_RAD:
        return "tandem"
    return "opposed" if abs(phase_rad) > math.pi - _TANDEM_RAD else "skew"


def _docking(first: tuple[float, float], second: tuple[float, float]) -> str:
    difference = abs(first[0] - second[0])
    clear = difference > _CLEAR_SD * math.hypot(first[1], second[1])
    return "off-centre" if clear and difference > _UNLIKE * max(first[0], second[0]) else "centred"
