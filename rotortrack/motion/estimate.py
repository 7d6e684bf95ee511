"""Signed speed, diffusion and every frame's position of one rotor, by the model that fits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from rotortrack.motion.circular import MOST_ANGLES, CircularFit, angles_needed, fit_circular
from rotortrack.motion.likelihood import NO_FIT, Fit
from rotortrack.motion.linear import (
    LinearFit,
    fit_increments,
    log_densities,
    prediction_moves,
    unwrap,
)
from rotortrack.motion.optimum import curvature_inverse
from rotortrack.motion.posterior import Posterior, posterior, smooth_on_circle, smooth_on_line
from rotortrack.motion.readings import (
    Circle,
    Pace,
    Readings,
    Timing,
    first_guess,
    noise_prior,
    readings,
)
from rotortrack.motion.residuals import (
    UNTESTED,
    Whiteness,
    block_bootstrap,
    calibrated,
    whiteness,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

WIDE_NOISE_RAD = 0.4
_WRAPPED_SHARE = 2e-5
_OUTLYING_SD = 6.0
_LEAST_READINGS = 10
_CAUTIOUS = 0.4


class Reason(Enum):
    """Why a model was chosen; the value is the word in the rotors table."""

    SMALL_STEPS = "small_steps"
    WIDE_STEPS = "wide_steps"
    WIDE_NOISE = "wide_noise"
    OUTLIERS = "outliers"
    ASKED_FOR = "asked_for"
    TOO_SLOW_FOR_GRID = "too_slow_for_grid"
    TOO_FEW_FRAMES = "too_few_frames"
    NO_CIRCLE = "no_circle"
    NOT_MEASURED = "not_measured"

    @property
    def sentence(self) -> str:
        """What it means, as shown to the user."""
        return _SENTENCES[self]


_SENTENCES = {
    Reason.SMALL_STEPS: (
        "Steps between readings stay below half a turn, where increments have an exact likelihood."
    ),
    Reason.WIDE_STEPS: (
        "Some steps between readings, over gaps too, may exceed half a turn, so the likelihood on "
        "the circle was used."
    ),
    Reason.WIDE_NOISE: (
        "The angles' noise is too wide to be Gaussian, so the likelihood on the circle was used."
    ),
    Reason.OUTLIERS: (
        "Some readings lie so far off that they are false; the likelihood on the circle allows "
        "for them."
    ),
    Reason.ASKED_FOR: "The estimator was asked for.",
    Reason.TOO_SLOW_FOR_GRID: (
        "The rotor diffuses too little in a frame for a grid of angles; bin frames for an exact "
        "answer."
    ),
    Reason.TOO_FEW_FRAMES: "Too few frames, or none that adjoin, tell neither speed nor diffusion.",
    Reason.NO_CIRCLE: "Without a circle there are no angles.",
    Reason.NOT_MEASURED: "Only kept rotors with a track are measured.",
}


@dataclass(frozen=True)
class MotionEstimate:
    """Motion of one rotor with intervals of 95 %.

    Attributes
    ----------
    fit
        Speed, diffusion, intervals and test of no drift. Where `resampled` these come from the
        block bootstrap.
    method, reason
        Which likelihood gave them and why.
    noise_sd_rad
        Median noise of one angle.
    white
        Tests of the residuals.
    n_false
        Readings that were taken for false spots because the rotor cannot have been there.
    resampled
        Whether the residuals are so uneven that the model fails (stick-slip, washboard, switches).
    posterior
        Angle and position in every frame; None where there is no estimate.
    """

    fit: Fit
    method: Literal["increments", "circular", "none"]
    reason: Reason
    noise_sd_rad: float
    white: Whiteness
    n_false: int
    resampled: bool
    posterior: Posterior | None


NOT_ESTIMATED = MotionEstimate(
    NO_FIT,
    "none",
    Reason.TOO_FEW_FRAMES,
    math.nan,
    UNTESTED,
    0,
    resampled=False,
    posterior=None,
)


def estimate_motion(
    frame: Integers,
    x_nm: Floats,
    y_nm: Floats,
    x_sd_nm: Floats,
    y_sd_nm: Floats,
    circle: Circle,
    *,
    frame_interval_s: float,
    exposure_s: float,
    method: Literal["auto", "increments", "circular"] = "auto",
    white_p: float = 1e-3,
    seed: int = 0,
) -> MotionEstimate:
    """Estimate signed speed and diffusion with honest intervals, and where the rotor was.

    Increments are exact as long as no step between two readings may reach half a turn and noise is
    nearly Gaussian; it is 20 times faster. Otherwise the likelihood on the circle is used.

    Parameters
    ----------
    frame
        Frames with a position, ascending without repeats, shape (n,).
    x_nm, y_nm, x_sd_nm, y_sd_nm
        Positions and their standard deviations, nan where these are not known.
    circle
        Centre and the radius as fitted, before any correction for blur.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    method
        "auto" chooses.
    white_p
        Probability of the residual tests below which intervals come from the block bootstrap.
    seed
        Of the bootstrap and of the residual tests' calibration.

    Returns
    -------
    MotionEstimate
        nan with fewer than ten readings, without adjacent frames, or with all places at the
        circle's centre.

    Raises
    ------
    ValueError
        Frames do not ascend.

    Notes
    -----
    8000 frames: increments 20 ms, circular 0.2 to 0.6 s.
    """
    if not circle.radius_nm > 0.0:
        return replace(NOT_ESTIMATED, reason=Reason.NO_CIRCLE)
    if frame.size and np.diff(frame).min(initial=1) < 1:
        raise ValueError("frames must ascend without repeats")
    timing = Timing(frame_interval_s, exposure_s)
    # Single precision would cost half of the digits of a speed.
    x, y, x_sd, y_sd = (np.asarray(part, np.float64) for part in (x_nm, y_nm, x_sd_nm, y_sd_nm))
    seen = readings(frame, x, y, x_sd, y_sd, circle)
    if len(seen) < _LEAST_READINGS or not seen.distance_nm.any():
        return NOT_ESTIMATED
    start = first_guess(seen, timing)
    if not math.isfinite(start.omega_rad_s):
        return NOT_ESTIMATED
    prior = noise_prior(seen, timing, start.diffusion_rad2_s, circle.radius_nm)
    linear = fit_increments(seen, timing, start, prior)
    reason = _reason(linear, seen)
    if method != "auto":
        on_circle, reason = method == "circular", Reason.ASKED_FOR
    else:
        on_circle = reason is not Reason.SMALL_STEPS
    if on_circle and method == "auto" and _too_slow(linear, seen, timing):
        on_circle, reason = False, Reason.TOO_SLOW_FOR_GRID
    circular = fit_circular(seen, timing, [start, _pace(linear.fit)], prior) if on_circle else None
    fit = circular.fit if circular else linear.fit
    pace = _pace(fit)
    false = np.zeros(len(seen), np.bool_)
    strayed, innovation, variance = unwrap(seen, timing, pace)
    if circular:
        false = circular.grid.false_readings(pace)
        deviation, ahead = circular.grid.residuals(pace)
        white = whiteness(deviation[1:][~false[1:]], ahead[1:][~false[1:]])
    else:
        ahead = seen.theta_rad - innovation
        white = whiteness((innovation / np.sqrt(variance))[1:], ahead[1:])
    move, drift = prediction_moves(seen, timing, pace, variance)
    white = calibrated(white, float(ahead[1]), move, drift, seed)
    uneven = white.p < white_p and fit.diffusion_rad2_s > 0.0
    if uneven:
        fit = _resample(fit, seen, timing, circular, seed)
    if fit.one_sided:
        # A D that is hardly known, were it too small, would make positions look too certain.
        cautious = _CAUTIOUS * fit.diffusion_interval_rad2_s[1]
        pace = replace(pace, diffusion_rad2_s=max(pace.diffusion_rad2_s, cautious))
    if circular:
        moments = smooth_on_circle(circular.grid, pace)
    else:
        moments = smooth_on_line(seen, timing, strayed, pace)
    return MotionEstimate(
        fit=fit,
        method="circular" if circular else "increments",
        reason=reason,
        noise_sd_rad=_noise_sd(fit, seen),
        white=white,
        n_false=int(np.count_nonzero(false)),
        resampled=uneven,
        posterior=posterior(seen, timing, pace, moments, circle),
    )


def compile_kernels() -> None:
    """Compile what a rotor may need, by measuring a short one in both ways."""
    rng = np.random.default_rng(0)
    frame = np.flatnonzero(np.arange(60) % 7)
    theta = 0.3 * frame + rng.normal(0.0, 0.1, frame.size)
    sd = np.full(frame.size, 10.0)
    methods: tuple[Literal["increments", "circular"], ...] = ("increments", "circular")
    for method in methods:
        estimate_motion(
            frame,
            100.0 * np.cos(theta),
            -100.0 * np.sin(theta),
            sd,
            sd,
            Circle(0.0, 0.0, 100.0),
            frame_interval_s=0.002,
            exposure_s=0.002,
            method=method,
        )


def _pace(fit: Fit) -> Pace:
    return Pace(fit.omega_rad_s, fit.diffusion_rad2_s, fit.noise_factor)


def _noise_sd(fit: Fit, seen: Readings) -> float:
    return math.sqrt(fit.noise_factor * float(np.median(seen.noise_rad2)))


def _reason(linear: LinearFit, seen: Readings) -> Reason:
    """Whether increments are unbiased, and if not, why."""
    sd = np.sqrt(linear.variance[1:])
    if _noise_sd(linear.fit, seen) > WIDE_NOISE_RAD:
        return Reason.WIDE_NOISE
    if np.mean(special.ndtr(-np.pi / sd)) > _WRAPPED_SHARE:
        return Reason.WIDE_STEPS
    if np.any(np.abs(linear.innovation[1:]) > _OUTLYING_SD * sd):
        return Reason.OUTLIERS
    return Reason.SMALL_STEPS


def _too_slow(linear: LinearFit, seen: Readings, timing: Timing) -> bool:
    """Whether D is so small that no allowed grid resolves a frame's diffusion."""
    pace = _pace(linear.fit)
    if pace.diffusion_rad2_s == 0.0:
        return True
    return angles_needed(pace, seen, timing) > MOST_ANGLES


def _resample(
    fit: Fit, seen: Readings, timing: Timing, circular: CircularFit | None, seed: int
) -> Fit:
    """Put intervals of the block bootstrap in place of those of the model."""
    point = np.array([fit.omega_rad_s, math.log(fit.diffusion_rad2_s), math.log(fit.noise_factor)])

    def on_line(at: Floats) -> Floats:
        pace = Pace(float(at[0]), math.exp(at[1]), math.exp(at[2]))
        return log_densities(seen, timing, pace)

    def on_circle(at: Floats) -> Floats:
        assert circular is not None
        return circular.grid.log_densities(Pace(float(at[0]), math.exp(at[1]), math.exp(at[2])))

    if circular:
        found = block_bootstrap(on_circle, point, circular.maximum.covariance, seed)
    else:
        sd = np.array([fit.omega_sd_rad_s, max(fit.diffusion_relative_sd, 0.01), 0.1])
        covariance = curvature_inverse(lambda at: float(on_line(at).sum()), point, sd)
        found = block_bootstrap(on_line, point, covariance, seed)
    return replace(
        fit,
        omega_sd_rad_s=float(found.sd[0]),
        omega_interval_rad_s=found.omega_interval_rad_s,
        drift_p=found.drift_p,
        diffusion_sd_rad2_s=float(found.sd[1]) * fit.diffusion_rad2_s,
        diffusion_interval_rad2_s=found.diffusion_interval_rad2_s,
        diffusion_relative_sd=float(found.sd[1]),
    )
