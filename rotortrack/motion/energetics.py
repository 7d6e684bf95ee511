"""Torque, power and friction of a rotor from its motion alone, with intervals.

Friction is ``kT / D`` by the fluctuation-dissipation theorem, the torque ``kT omega / D`` is what
keeps this friction turning, the power ``kT omega^2 / D`` what it dissipates. No model of the rod
enters. All hold for a rotor that drifts and diffuses freely; one whose residuals are uneven
(`MotionEstimate.resampled`) has these as effective values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import constants, optimize, special

from rotortrack.motion.likelihood import Fit

Floats = NDArray[np.float64]

PAPER_TEMPERATURE_K = 300.0
BOLTZMANN_PN_NM_K = constants.k * 1e21

_Z = 1.959963984540054
_NODES = np.linspace(-6.0, 6.0, 601)
_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.exp(-0.5 * _NODES**2).sum()

Interval = tuple[float, float]
_UNKNOWN = (math.nan, math.nan)


@dataclass(frozen=True)
class Energetics:
    """Torque (pN nm, signed), power (pN nm/s) and friction (pN nm s) with intervals of 95 %."""

    torque_pn_nm: float
    torque_sd_pn_nm: float
    torque_interval_pn_nm: Interval
    power_pn_nm_s: float
    power_interval_pn_nm_s: Interval
    friction_pn_nm_s: float
    friction_interval_pn_nm_s: Interval

    def row(self) -> dict[str, float]:
        """Columns of `tables.ROTORS`."""
        return {
            "torque_pn_nm": self.torque_pn_nm,
            "torque_sd_pn_nm": self.torque_sd_pn_nm,
            "torque_ci_low_pn_nm": self.torque_interval_pn_nm[0],
            "torque_ci_high_pn_nm": self.torque_interval_pn_nm[1],
            "power_pn_nm_s": self.power_pn_nm_s,
            "power_ci_low_pn_nm_s": self.power_interval_pn_nm_s[0],
            "power_ci_high_pn_nm_s": self.power_interval_pn_nm_s[1],
            "friction_pn_nm_s": self.friction_pn_nm_s,
            "friction_ci_low_pn_nm_s": self.friction_interval_pn_nm_s[0],
            "friction_ci_high_pn_nm_s": self.friction_interval_pn_nm_s[1],
        }


UNKNOWN_ENERGETICS = Energetics(
    math.nan, math.nan, _UNKNOWN, math.nan, _UNKNOWN, math.nan, _UNKNOWN
)


def energetics(fit: Fit, temperature_k: float = PAPER_TEMPERATURE_K) -> Energetics:
    """Torque, power and friction with intervals of 95 %.

    D is a variance, so its estimate is distributed like chi-square with ``f = 2 / sd(log D)^2``
    degrees of freedom about the true one, and the sd of omega goes with the root of the true D.
    With G = chi2_f / f and a normal z,

        omega / D -> (omega G + sd(omega) sqrt(G) z) / D

    is the pivotal quantity whose quantiles are the interval: exact for the mean over the variance
    of a normal sample. The power has that of ``omega |omega| / D``, folded at zero: a rotor whose
    speed may be zero has a power that may be.

    Where D is hardly known (`Fit.one_sided`) it may be nearly zero, so that friction has only a
    lower limit, and torque and power a limit where the sign of the speed is sure.

    Parameters
    ----------
    fit
        Speed and diffusion with intervals.
    temperature_k
        Absolute temperature; the published simulations have 300 K.

    Returns
    -------
    Energetics
        nan where speed or diffusion is unknown; infinite values where D = 0.

    Notes
    -----
    Cost: 2 ms.
    """
    kt = BOLTZMANN_PN_NM_K * temperature_k
    omega, diffusion = fit.omega_rad_s, fit.diffusion_rad2_s
    if not (np.isfinite(omega) and np.isfinite(diffusion)):
        return UNKNOWN_ENERGETICS
    low_d, high_d = fit.diffusion_interval_rad2_s
    friction = _over(kt, diffusion)
    if fit.one_sided or not low_d > 0.0:
        return Energetics(
            torque_pn_nm=kt * _over(omega, diffusion),
            torque_sd_pn_nm=math.inf,
            torque_interval_pn_nm=_limits(fit, kt),
            power_pn_nm_s=kt * _over(omega**2, diffusion),
            power_interval_pn_nm_s=_folded(_limits(fit, kt, squared=True)),
            friction_pn_nm_s=friction,
            friction_interval_pn_nm_s=(_over(kt, high_d), math.inf),
        )
    # Sds that belong to the intervals: those know how far from normal the estimates are.
    log_sd = math.log(high_d / low_d) / (2.0 * _Z)
    low, high = fit.omega_interval_rad_s
    omega_sd = (high - low) / (2.0 * _Z)
    degrees = 2.0 / log_sd**2
    # Wilson and Hilferty's cube, good to 1e-3 of its sd for 80 degrees of freedom and more.
    ninth = 2.0 / (9.0 * degrees)
    spread = np.maximum(1.0 - ninth + math.sqrt(ninth) * _NODES, 0.0) ** 3
    scale = kt / diffusion
    ends = [_quantile(p, omega, omega_sd, spread) for p in (0.025, 0.975)]
    signed_squares = [_quantile(p, omega, omega_sd, spread, squared=True) for p in (0.025, 0.975)]
    return Energetics(
        torque_pn_nm=scale * omega,
        torque_sd_pn_nm=scale * math.hypot(omega * log_sd, omega_sd),
        torque_interval_pn_nm=(scale * ends[0], scale * ends[1]),
        power_pn_nm_s=scale * omega**2,
        power_interval_pn_nm_s=_folded((scale * signed_squares[0], scale * signed_squares[1])),
        friction_pn_nm_s=friction,
        friction_interval_pn_nm_s=(kt / high_d, kt / low_d),
    )


def _quantile(
    p: float, omega: float, omega_sd: float, spread: Floats, *, squared: bool = False
) -> float:
    """Quantile of ``omega G + sd sqrt(G) z``, or of ``s |s|`` with ``s = omega sqrt(G) + sd z``."""
    root = np.sqrt(spread)

    def below(value: float) -> float:
        if squared:
            bound = math.copysign(math.sqrt(abs(value)), value)
            deviate = (bound - omega * root) / omega_sd
        else:
            deviate = (value - omega * spread) / (omega_sd * np.maximum(root, 1e-12))
        return float(_WEIGHTS @ special.ndtr(deviate)) - p

    reach = (abs(omega) + 8.0 * omega_sd) * float(root.max()) * (1.0 + float(root.max()))
    if squared:
        reach = reach**2
    return float(optimize.brentq(below, -reach, reach, xtol=1e-9 * reach))


def _limits(fit: Fit, kt: float, *, squared: bool = False) -> Interval:
    """Limits of ``kT omega / D``, or of ``kT omega |omega| / D``, for 0 < D < upper end."""
    low, high = fit.omega_interval_rad_s
    most = fit.diffusion_interval_rad2_s[1]
    if squared:
        low, high = low * abs(low), high * abs(high)
    return (
        kt * _over(low, most) if low > 0.0 else -math.inf,
        kt * _over(high, most) if high < 0.0 else math.inf,
    )


def _folded(signed: Interval) -> Interval:
    """Interval of the size of what has this one with its sign."""
    low, high = signed
    if low <= 0.0 <= high:
        return 0.0, max(-low, high)
    return min(abs(low), abs(high)), max(abs(low), abs(high))


def _over(value: float, diffusion: float) -> float:
    if diffusion > 0.0:
        return value / diffusion
    return math.nan if value == 0.0 else math.copysign(math.inf, value)
