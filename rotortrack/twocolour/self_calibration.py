"""The registration's error, read off rotors that turn rigidly.

The end-to-end vector of a rigid rotor that turns about one axis traces a circle; the centre of that
circle is what the registration misses there. An end-to-end distance that breathes in phase with the
angle looks the same, so one rotor's centre may be its own; what many rotors share as a smooth
function of place is the map's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.rotors.circle import CircleEnd, fit_circle
from rotortrack.twocolour.fit import Fitted, best_map
from rotortrack.twocolour.options import RegisterOptions

Floats = NDArray[np.float64]

LONGEST_NM = 100.0
"""Longer end-to-end vectors show a registration error worse than the rods' own unevenness."""

FEWEST_TURNS = 20.0
_UNEVEN = 0.3
_MUCH_BREATHING = 0.15
_LEAST_BREATHING_NM = 5.0
_CHANCE = 3.0
_FEWEST_ROTORS = 4
_FEWEST_FOR_A_MAP = 12
_BETTER = 0.8


@dataclass(frozen=True)
class LocalShift:
    """What one rotor tells of the registration's error at its place.

    Attributes
    ----------
    x_nm, y_nm, sd_nm
        How far the second end is seen from where it is, and the standard deviation per axis; nan
        where the vector traces no circle.
    radius_nm, radius_sd_nm
        Radius of that circle: the end-to-end distance of a rigid rod.
    turns
        Full turns of the vector, either way.
    rigid
        Whether the assumptions held.
    reason
        Which did not.
    """

    x_nm: float
    y_nm: float
    sd_nm: float
    radius_nm: float
    radius_sd_nm: float
    turns: float
    rigid: bool
    reason: str


def local_shift(dx_nm: Floats, dy_nm: Floats, noise_nm: Floats) -> LocalShift:
    """Read the registration's error off the vectors of one rotor.

    Parameters
    ----------
    dx_nm, dy_nm
        End-to-end vectors, (frames,), in order of frames, nm.
    noise_nm
        Their noise per axis, (frames,), without that of the registration.

    Returns
    -------
    LocalShift
        Tested are: the vector traces a circle all around, of at most 100 nm, in at least 20 turns,
        in all directions evenly, and scatters about it no more than its noise tells.
    """
    fit = fit_circle(dx_nm, dy_nm)
    angle = np.arctan2(-(dy_nm - fit.y_nm), dx_nm - fit.x_nm)
    turns = full_turns(angle)
    if fit.end is not CircleEnd.FITTED:
        none = math.nan
        return LocalShift(none, none, none, none, none, turns, False, "the vector traces no circle")
    told = float(np.sqrt(np.mean(np.asarray(noise_nm, np.float64) ** 2)))
    shaken = told**2 * (1.0 + _CHANCE * math.sqrt(2.0 / fit.n_used))
    breathing = math.sqrt(max(fit.residual_sd_nm**2 - shaken, 0.0))
    most = max(_MUCH_BREATHING * fit.radius_nm, _LEAST_BREATHING_NM)
    uneven = max(abs(np.exp(1j * k * angle).mean()) for k in (1, 2))
    tests = (
        (fit.radius_nm <= LONGEST_NM, f"longer than {LONGEST_NM:g} nm"),
        (turns >= FEWEST_TURNS, f"fewer than {FEWEST_TURNS:g} turns"),
        (uneven <= _UNEVEN, "directions are uneven"),
        (breathing <= most, f"breathes by {breathing:.0f} nm"),
    )
    failed = [reason for passed, reason in tests if not passed]
    return LocalShift(
        x_nm=fit.x_nm,
        y_nm=fit.y_nm,
        sd_nm=math.sqrt(0.5 * (fit.x_sd_nm**2 + fit.y_sd_nm**2)),
        radius_nm=fit.radius_nm,
        radius_sd_nm=fit.radius_sd_nm,
        turns=turns,
        rigid=not failed,
        reason=", ".join(failed),
    )


def full_turns(angle_rad: Floats) -> float:
    """Count full turns of an angle, either way: each begins where the one before it ended.

    Noise of less than half a turn from frame to frame makes none.
    """
    turned = np.unwrap(np.asarray(angle_rad, np.float64))
    count, anchor = 0, float(turned[0]) if turned.size else 0.0
    while True:
        away = np.flatnonzero(np.abs(turned - anchor) >= 2.0 * math.pi)
        if not away.size:
            return float(count)
        count += 1
        anchor = float(turned[away[0]])
        turned = turned[away[0] :]


@dataclass(frozen=True)
class SmoothShift:
    """The part of the registration's error that rotors share as a smooth function of place.

    Attributes
    ----------
    name
        The kind of the function.
    n_rotors
        How many rotors tell it.
    rms_nm
        Its size at those rotors, per axis.
    between_nm
        Standard deviation per axis of what single rotors show beside it: their own breathing.
    """

    name: str
    n_rotors: int
    rms_nm: float
    between_nm: float
    _fitted: Fitted | None
    _constant_nm: Floats
    _noise_nm: float

    def at(self, places_nm: Floats) -> Floats:
        """Give the shift of the second end at places, (places, 2), nm."""
        places = np.asarray(places_nm, np.float64).reshape(-1, 2)
        if self._fitted is None:
            return np.tile(self._constant_nm, (len(places), 1))
        return places - self._fitted.mapping(places)

    def sd_nm(self, places_nm: Floats) -> Floats:
        """Give its standard deviation per axis at places, (places,), nm."""
        places = np.asarray(places_nm, np.float64).reshape(-1, 2)
        if self._fitted is None:
            return np.full(len(places), self._noise_nm / math.sqrt(self.n_rotors))
        deviation: Floats = self._noise_nm * np.sqrt(self._fitted.variance(places))
        return deviation


def smooth_shift(places_nm: Floats, shifts_nm: Floats, sd_nm: Floats) -> SmoothShift | str:
    """Find the smooth part of the shifts that rotors show.

    Parameters
    ----------
    places_nm, shifts_nm, sd_nm
        Places of rigid rotors and what they tell there, (rotors, 2), and its standard deviation per
        axis, (rotors,).

    Returns
    -------
    SmoothShift or str
        The kind of function that best predicts rotors left out of it, or why there is none: rotors
        are too few, or what they show is not shared.
    """
    places, shifts = np.asarray(places_nm, np.float64), np.asarray(shifts_nm, np.float64)
    n = len(places)
    if n < _FEWEST_ROTORS:
        return f"{n} rigid rotors are too few, {_FEWEST_ROTORS} are needed"
    mean = shifts.mean(axis=0)
    nothing = float(np.mean(shifts**2))
    left_out = (shifts - mean) * n / (n - 1)
    constant = float(np.mean(left_out**2))
    told = float(np.mean(np.asarray(sd_nm, np.float64) ** 2))
    fitted: Fitted | None = None
    best, noise = constant, math.sqrt(float(np.sum((shifts - mean) ** 2)) / (2 * n - 2))
    if n >= _FEWEST_FOR_A_MAP:
        candidate, _ = best_map(places, places - shifts, RegisterOptions())
        predicted = float(np.mean(candidate.left_out[candidate.used] ** 2))
        if predicted < _BETTER * constant:
            fitted, best, noise = candidate, predicted, candidate.noise_nm
    if best > _BETTER * nothing:
        return "rotors show no error that they share"
    made = SmoothShift(
        name="a constant" if fitted is None else fitted.mapping.name,
        n_rotors=n,
        rms_nm=math.nan,
        between_nm=math.sqrt(max(noise**2 - told, 0.0)),
        _fitted=fitted,
        _constant_nm=mean,
        _noise_nm=noise,
    )
    rms = math.sqrt(float(np.mean(made.at(places) ** 2)))
    return SmoothShift(**{**vars(made), "rms_nm": rms})
