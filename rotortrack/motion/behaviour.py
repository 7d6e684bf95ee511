"""What a rotor does, with the evidence for it and how clear it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rotortrack.motion.changepoints import Switches
from rotortrack.motion.estimate import MotionEstimate
from rotortrack.motion.increments import StepSizes
from rotortrack.motion.occupancy import (
    Memory,
    Places,
    brownian_amplitude,
    confinement,
    dwell_places,
    memory,
    strayed_rad,
)
from rotortrack.motion.options import MotionOptions

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BehaviourName = Literal[
    "driven_ccw",
    "driven_cw",
    "switching",
    "brownian",
    "toggling",
    "confined",
    "stuck",
    "unclassified",
]

UNDRIVEN_P = 0.01
"""p of no drift below which a rotor is not called Brownian."""
UNLIKELY = 3.0
"""A_n over its Brownian expectation that diffusion alone exceeds with a probability of 1e-4."""
CONFINED = 15.0
"""Least exponent of the chance, exp(-15), that diffusion alone stays within the range; so small
because D at short times is itself uncertain."""
SURE_Z = 3.0
"""Standard deviations by which both speeds about a switch of direction differ from zero."""

_OPPOSITE = np.deg2rad(30.0)
_LEAST_SHARE = 0.05
_IN_TRANSIT = 0.2
_ONE_PLACE = 0.7
_LEAST_TOGGLES = 3
_COHERENT = 4.0
_LEAST_P = 1e-300
_EVEN_P = 1e-3
_FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Behaviour:
    """Name of a behaviour, one short phrase of evidence, and how clear it is.

    `margin` is the least ratio of a feature to its threshold: above 1 for a behaviour that is
    named, the more the clearer. For `unclassified` it is that of the nearest behaviour, at most 1,
    and 0 where nothing was measured.
    """

    name: BehaviourName
    evidence: str
    margin: float


NOT_CLASSIFIED = Behaviour("unclassified", "not measured", 0.0)


def classify(
    estimate: MotionEstimate,
    steps: StepSizes,
    frame: Integers,
    theta_rad: Floats,
    switches: Switches | None,
    *,
    frame_interval_s: float,
    options: MotionOptions,
) -> Behaviour:
    """Name the behaviour of one rotor, `unclassified` rather than wrong.

    In this order:

    - toggling: two dwell places 180 +- 30 degrees apart, visited in turn and more than diffusion
      explains (`UNLIKELY`), with hardly any time in between.
    - driven_ccw, driven_cw: the speed differs from zero by `driven_z` standard deviations and turns
      the rotor by more than `stuck_turn_deg` in the movie; switching, if it reverses.
    - stuck: neither drift nor diffusion at the upper end of its interval turn it so far.
    - confined: it moves, but stays at one place within less than a turn although diffusion at short
      times would have taken it farther (`CONFINED`): its mean-square displacement levels off.
    - switching: speeds of opposite sign, each `SURE_Z` standard deviations from zero, and even
      residuals beside the switches.
    - brownian: no drift, diffusion that is more than zero, residuals and occupancy as they should.

    Parameters
    ----------
    estimate, steps
        Estimates of the rotor.
    frame, theta_rad
        Frames, ascending, and angles, shape (n,).
    switches
        Switches of speed; None where they were not looked for, then none is found.
    frame_interval_s
        Time between frame starts, s.
    options
        Thresholds `driven_z`, `stuck_turn_deg` and `min_steps`.

    Notes
    -----
    Cost: 10 ms for 8000 frames, apart from the estimates.
    """
    fit = estimate.fit
    if steps.n_steps < options.min_steps or not np.isfinite(fit.omega_sd_rad_s):
        return Behaviour("unclassified", f"only {steps.n_steps} steps or no speed", 0.0)
    once = memory(frame, theta_rad, 1, frame_interval_s)
    if steps.folded and not _remembers(frame, theta_rad):
        return Behaviour("unclassified", "angles of adjacent frames are unrelated", 0.0)
    places = dwell_places(theta_rad)
    told = _Told(estimate, frame, theta_rad, switches, once, places, frame_interval_s, options)
    tried = []
    for rule in (_toggling, _driven, _stuck, _confined, _switching, _brownian):
        found = rule(told)
        if found.margin > 1.0:
            return replace(found, margin=float(found.margin))
        tried.append(found)
    near = max(tried, key=lambda one: one.margin)
    return Behaviour("unclassified", f"nearest is {near.name}: {near.evidence}", float(near.margin))


@dataclass(frozen=True)
class _Told:
    estimate: MotionEstimate
    frame: Integers
    theta_rad: Floats
    switches: Switches | None
    once: Memory
    places: Places
    frame_interval_s: float
    options: MotionOptions

    @property
    def duration_s(self) -> float:
        return float(self.frame[-1] - self.frame[0]) * self.frame_interval_s

    @property
    def drift_z(self) -> float:
        """Normal deviate of the test of no drift, which knows how surely the sd is known."""
        return float(stats.norm.isf(0.5 * max(self.estimate.fit.drift_p, _LEAST_P)))

    @property
    def least_turn_rad(self) -> float:
        return math.radians(self.options.stuck_turn_deg)

    def diffused_rad(self, end: int) -> float:
        """How far diffusion goes in the movie at the lower (0) or upper (1) end of D."""
        bound = self.estimate.fit.diffusion_interval_rad2_s[end]
        return math.sqrt(2.0 * self.duration_s * max(bound, 0.0))


def _remembers(frame: Integers, theta_rad: Floats) -> bool:
    """Whether angles of adjacent frames are related; those of noise alone are not."""
    step = np.diff(theta_rad)[np.diff(frame) == 1]
    return bool(abs(np.exp(1j * step).sum()) > _COHERENT * math.sqrt(max(step.size, 1)))


def _ratio(value: float, threshold: float) -> float:
    return value / threshold if threshold > 0.0 else math.inf


def _reversal(told: _Told) -> tuple[float, str]:
    """Margin and evidence of the surest switch of direction."""
    found = told.switches
    if found is None or len(found) == 0 or not found.reverses.any():
        return 0.0, "no switch of direction"
    z = np.abs(found.speeds.omega_rad_s / found.speeds.sd_rad_s)
    sure = np.where(found.reverses, np.minimum(z[1:], z[:-1]), 0.0)
    best = int(np.argmax(sure))
    before, after = found.speeds.omega_rad_s[best : best + 2]
    times = int(found.reverses.sum())
    evidence = (
        f"{times} reversal{'s' if times > 1 else ''}, at {found.times[best].time_s:.2f} s from "
        f"{before:.3g} to {after:.3g} rad/s, {sure[best]:.1f} sd each at least"
    )
    strength = float(found.statistic[best] / found.threshold)
    margin = min(float(sure[best]) / SURE_Z, strength)
    if found.white.p < _EVEN_P:
        # Stick-slip seems to switch all the time.
        return min(margin, 0.5), f"{evidence}, but uneven between them too"
    return margin, evidence


def _driven(told: _Told) -> Behaviour:
    fit = told.estimate.fit
    turned = abs(fit.omega_rad_s) * told.duration_s
    margin = min(told.drift_z / told.options.driven_z, _ratio(turned, told.least_turn_rad))
    reversal, evidence = _reversal(told)
    if margin > 1.0 and reversal > 1.0:
        return Behaviour("switching", evidence, reversal)
    return Behaviour(
        "driven_ccw" if fit.omega_rad_s > 0.0 else "driven_cw",
        f"turns at {fit.omega_rad_s:.3g} +- {fit.omega_sd_rad_s:.2g} rad/s, p {fit.drift_p:.1g} of "
        "no drift",
        margin,
    )


def _toggling(told: _Told) -> Behaviour:
    twice = memory(told.frame, told.theta_rad, 2, told.frame_interval_s)
    places = told.places
    diffusion = max(twice.diffusion_rad2_s, told.estimate.fit.diffusion_rad2_s)
    expected = brownian_amplitude(2, diffusion, told.duration_s)
    margin = min(
        _ratio(twice.amplitude, UNLIKELY * expected),
        _ratio(_OPPOSITE, np.pi - places.apart_rad),
        min(places.shares) / _LEAST_SHARE,
        _ratio(_IN_TRANSIT, places.outside),
        places.toggles / _LEAST_TOGGLES,
    )
    if not math.isfinite(places.apart_rad):
        return Behaviour("toggling", "no two dwell places", 0.0)
    return Behaviour(
        "toggling",
        f"two places {math.degrees(places.apart_rad):.0f} deg apart, {places.toggles} changes, "
        f"A2 {twice.amplitude:.2f} ({expected:.2f} by diffusion)",
        margin,
    )


def _stuck(told: _Told) -> Behaviour:
    fit = told.estimate.fit
    drifted = abs(fit.omega_rad_s) * told.duration_s
    # A range is about six standard deviations.
    margin = min(
        _ratio(told.least_turn_rad, told.diffused_rad(1)),
        _ratio(told.least_turn_rad, drifted),
        _ratio(told.least_turn_rad, 6.0 * told.once.wander_rad),
    )
    return Behaviour(
        "stuck",
        f"moves {math.degrees(told.once.wander_rad):.1f} deg beyond noise, D below "
        f"{fit.diffusion_interval_rad2_s[1]:.2g} rad2/s",
        margin,
    )


def _confined(told: _Told) -> Behaviour:
    after = told.estimate.posterior
    theta = told.theta_rad if after is None else after.theta_rad
    strayed = strayed_rad(theta)
    diffusion = told.once.diffusion_rad2_s
    wander = told.once.wander_rad
    # Hopping between places is not confinement to one.
    apart = min(told.places.shares) > _LEAST_SHARE
    margin = min(
        told.places.saddle / _ONE_PLACE if apart else math.inf,
        confinement(strayed, diffusion, told.duration_s) / CONFINED,
        _ratio(_FULL_TURN, strayed),
        _ratio(strayed, told.least_turn_rad),
    )
    return Behaviour(
        "confined",
        f"stays within {math.degrees(strayed):.0f} deg, MSD levels off at {2 * wander**2:.2g} rad2 "
        f"within {1e3 / told.once.rate_per_s:.2g} ms",
        margin,
    )


def _switching(told: _Told) -> Behaviour:
    margin, evidence = _reversal(told)
    return Behaviour("switching", evidence, margin)


def _brownian(told: _Told) -> Behaviour:
    fit = told.estimate.fit
    amplitudes = {
        order: abs(np.exp(1j * order * told.theta_rad).mean())
        / brownian_amplitude(order, fit.diffusion_rad2_s, told.duration_s)
        for order in (1, 2)
    }
    margin = min(
        _ratio(told.diffused_rad(0), told.least_turn_rad),
        float(stats.norm.isf(0.5 * UNDRIVEN_P)) / max(told.drift_z, 1e-6),
        *(UNLIKELY / max(ratio, 1e-6) for ratio in amplitudes.values()),
    )
    if told.estimate.resampled:
        margin = 0.0
    found = told.switches
    if found is not None and len(found):
        margin = min(margin, float(found.threshold / found.statistic.max()))
    return Behaviour(
        "brownian",
        f"D {fit.diffusion_rad2_s:.3g} rad2/s, p {fit.drift_p:.2g} of no drift, A1 and A2 "
        f"{amplitudes[1]:.1f} and {amplitudes[2]:.1f} of those by diffusion",
        margin,
    )
