"""What a movie of a rotor can tell: errors of speed and diffusion before it is filmed.

A turning angle that drifts, diffuses and is read with noise and blur has Gaussian steps with
variance a and covariance b of adjacent ones (`diffusion`). The information on the speed in N of
them, ``dt^2 1' S^-1 1``, has a closed form, which is the Fisher bound and what the estimate of
`estimate` reaches.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, special, stats

from rotortrack.motion.blur import radius_factor
from rotortrack.motion.likelihood import freedom
from rotortrack.motion.readings import noise_prior_sd

POWER = 0.95
"""Part of the rotors of a speed in which a test must tell it from Brownian motion."""

FIVE_PERCENT = 1.96
"""Errors that a normal value exceeds in 5 %, on either side."""

FOLDED_STEP_DEG = 55.0
"""Standard deviation of steps above which counting by the 180-degree rule is biased."""

LEAST_RADIUS_FACTOR = 0.95
"""Blur that is still advisable: the circle shrinks by 5 %."""

_MOST_FRAMES = 1e12
_MOST_PHOTONS = 1e9
_SPECTRUM = 4000
_WIDEST_NOISE_RAD = 0.5


@dataclass(frozen=True)
class Setting:
    """One rotor and how it is filmed.

    Attributes
    ----------
    diffusion_rad2_s
        Rotational diffusion coefficient.
    radius_nm, localisation_sd_nm
        Radius of the circle and error of a position per axis.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    frames
        Frames from the first to the last.
    detection
        Part of them in which the rotor is seen.
    """

    diffusion_rad2_s: float
    radius_nm: float
    localisation_sd_nm: float
    frame_interval_s: float
    exposure_s: float
    frames: float
    detection: float = 1.0

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the end of the last."""
        return self.frames * self.frame_interval_s

    def noise_rad(self, omega_rad_s: float = 0.0) -> float:
        """Error of one angle, on the circle that blur has shrunk."""
        return self.localisation_sd_nm / (self.radius_nm * self.blur(omega_rad_s))

    def blur(self, omega_rad_s: float = 0.0) -> float:
        """Radius that is seen over the true one."""
        return radius_factor(omega_rad_s, self.diffusion_rad2_s, self.exposure_s)

    def step_sd_rad(self, omega_rad_s: float = 0.0) -> float:
        """Give the standard deviation of steps between adjacent frames."""
        square, _ = _moments(self, omega_rad_s, self.frame_interval_s)
        return math.sqrt(square)


def speed_sd(setting: Setting, omega_rad_s: float = 0.0) -> float:
    """Give the standard deviation of the best estimate of the speed, rad/s.

    For a long movie sqrt(2 D / T). Frames that are missing lengthen the others' intervals.

    Parameters
    ----------
    setting
        Rotor and movie.
    omega_rad_s
        Speed, which blurs the circle.
    """
    interval = setting.frame_interval_s / setting.detection
    steps = setting.frames * setting.detection - 1.0
    if steps < 1.0:
        return math.inf
    square, product = _moments(setting, omega_rad_s, interval)
    if square == 0.0:
        return 0.0
    return 1.0 / (interval * math.sqrt(_ones(steps, square, product)))


def diffusion_relative_sd(setting: Setting) -> float:
    """Give the standard deviation of the best estimate of D over D, the noise estimated too.

    The scatter of the radius tells the noise as well, as in the analysis. Missing frames lengthen
    the intervals of the others; inf without diffusion.
    """
    if setting.diffusion_rad2_s == 0.0:
        return math.inf
    interval = setting.frame_interval_s / setting.detection
    steps = setting.frames * setting.detection - 1.0
    if steps < 3.0:
        return math.inf
    modes = int(min(steps, _SPECTRUM))
    rise = 2.0 * np.sin(0.5 * np.pi * np.arange(1, modes + 1) / (modes + 1)) ** 2
    diffusive = 2.0 * setting.diffusion_rad2_s * (interval - setting.exposure_s / 3.0 * rise)
    noisy = 2.0 * setting.noise_rad() ** 2 * rise
    shares = np.stack([diffusive, noisy]) / (diffusive + noisy)
    # Of a long movie only a part is summed up, whose information grows with the frames.
    information = 0.5 * steps / modes * shares @ shares.T
    information[1, 1] += noise_prior_sd(steps) ** -2
    if setting.localisation_sd_nm == 0.0:
        return float(information[0, 0] ** -0.5)
    determinant = information[0, 0] * information[1, 1] - information[0, 1] ** 2
    return math.sqrt(information[1, 1] / determinant) if determinant > 0.0 else math.inf


@dataclass(frozen=True)
class SpeedTest:
    """Two-sided test of a speed against rest by Student's t, D being estimated too.

    Attributes
    ----------
    threshold
        Errors by which the speed must differ from zero.
    degrees
        Degrees of freedom of D.
    """

    threshold: float
    degrees: float

    @property
    def _centre(self) -> float:
        return self.threshold * (1.0 - 0.25 / self.degrees)

    @property
    def _spread(self) -> float:
        return math.sqrt(1.0 + self.threshold**2 / (2.0 * self.degrees))

    @property
    def need(self) -> float:
        """Speed over its error that is told in 95 % of rotors."""
        return self._centre + self._spread * float(special.ndtri(POWER))

    def power(self, speed_over_sd: float) -> float:
        """Probability that a speed is told, by the normal form of the noncentral t."""
        ends = (speed_over_sd - self._centre, -speed_over_sd - self._centre)
        return float(sum(special.ndtr(end / self._spread) for end in ends))


def speed_test(setting: Setting, errors: float) -> SpeedTest:
    """Give the test that chance passes as rarely as a normal value exceeds so many errors.

    Parameters
    ----------
    setting
        Rotor and movie; the more uncertain its D, the more is demanded.
    errors
        1.96 for 5 %, `driven_z` for a driven rotor.
    """
    relative = diffusion_relative_sd(setting)
    if not math.isfinite(relative):
        # Nothing diffuses, or nothing is told at all.
        return SpeedTest(errors, math.inf)
    degrees = freedom(relative)
    return SpeedTest(float(stats.t.isf(special.ndtr(-errors), degrees)), degrees)


def fastest_speed(setting: Setting) -> float:
    """Speed (rad/s) above which steps exceed half a turn in 2.5 % of frames; 0 where all do.

    The likelihood on the circle reaches up to half a turn a frame, pi / dt, and nothing further.
    """

    def reserve(omega: float) -> float:
        reached = omega * setting.frame_interval_s + 1.96 * setting.step_sd_rad(omega)
        return reached - math.pi

    alias = math.pi / setting.frame_interval_s
    if reserve(0.0) >= 0.0:
        return 0.0
    return float(optimize.brentq(reserve, 0.0, alias)) if reserve(alias) > 0.0 else alias


def smallest_speed(setting: Setting, errors: float) -> float:
    """Smallest speed (rad/s) that the test tells from Brownian motion in 95 % of such rotors.

    Returns
    -------
    float
        nan where even half a turn a frame is not told.
    """
    need = speed_test(setting, errors).need
    return _rising(
        lambda omega: omega - need * speed_sd(setting, omega),
        math.pi / setting.frame_interval_s,
    )


def frames_needed(setting: Setting, omega_rad_s: float, errors: float) -> float:
    """Frames in which the test tells this speed in 95 % of such rotors; inf where none do."""

    def short(log_frames: float) -> float:
        movie = replace(setting, frames=math.exp(log_frames))
        need = speed_test(movie, errors).need
        return need * speed_sd(movie, omega_rad_s) - abs(omega_rad_s)

    low, high = math.log(2.5 / setting.detection), math.log(_MOST_FRAMES)
    if short(high) > 0.0:
        return math.inf
    if short(low) <= 0.0:
        return math.ceil(math.exp(low))
    return float(math.ceil(math.exp(optimize.brentq(short, low, high))))


def most_noise(setting: Setting, omega_rad_s: float, errors: float) -> float:
    """Largest localisation error (nm) at which this movie tells the speed; nan where none does."""

    def excess(sd_nm: float) -> float:
        movie = replace(setting, localisation_sd_nm=sd_nm)
        need = speed_test(movie, errors).need
        return need * speed_sd(movie, omega_rad_s) - abs(omega_rad_s)

    widest = _WIDEST_NOISE_RAD * setting.radius_nm * setting.blur(omega_rad_s)
    if excess(0.0) > 0.0:
        return math.nan
    return widest if excess(widest) <= 0.0 else float(optimize.brentq(excess, 0.0, widest))


def photons_needed(precision: Callable[[float], float], sd_nm: float) -> float:
    """Photons at which `precision` (nm, of photons) reaches this error; nan where none do."""
    if not sd_nm > 0.0 or precision(_MOST_PHOTONS) > sd_nm:
        return math.nan
    if precision(1.0) <= sd_nm:
        return 1.0
    log_photons = optimize.brentq(
        lambda n: precision(math.exp(n)) - sd_nm, 0.0, math.log(_MOST_PHOTONS)
    )
    return float(math.ceil(math.exp(log_photons)))


def longest_exposure(setting: Setting, omega_rad_s: float) -> float:
    """Exposure (s) that shrinks the circle by 5 %, the frame interval at most."""

    def spare(exposure_s: float) -> float:
        factor = radius_factor(omega_rad_s, setting.diffusion_rad2_s, exposure_s)
        return LEAST_RADIUS_FACTOR - factor

    if spare(setting.frame_interval_s) <= 0.0:
        return setting.frame_interval_s
    return float(optimize.brentq(spare, 0.0, setting.frame_interval_s))


def _moments(setting: Setting, omega_rad_s: float, interval_s: float) -> tuple[float, float]:
    """Variance of a step and covariance of adjacent ones, rad^2."""
    noise = setting.noise_rad(omega_rad_s) ** 2
    blur = setting.diffusion_rad2_s * setting.exposure_s / 3.0
    return 2.0 * (setting.diffusion_rad2_s * interval_s - blur + noise), blur - noise


def _ones(n: float, square: float, product: float) -> float:
    """Sum of all elements of the inverse of the n x n matrix with these two diagonals.

    With r the root of ``b r^2 + a r + b`` below 1 the row sums of the inverse are
    ``(1 - (r^i + r^(n+1-i)) / (1 + r^(n+1))) / (a + 2 b)``.
    """
    left = square + 2.0 * product
    if left <= 1e-12 * square:
        return n * (n + 1.0) * (n + 2.0) / (6.0 * square)
    root = math.sqrt(max(left * (square - 2.0 * product), 0.0))
    r = -2.0 * product / (square + root)
    # A negative root comes from blur alone; its powers have no sign for a number of steps that is
    # not whole, and vanish.
    power_n = r**n if r > 0.0 else 0.0
    ends = 2.0 * r * (1.0 - power_n) / ((1.0 - r) * (1.0 + r * power_n))
    return (n - ends) / left


def _rising(function: Callable[[float], float], most: float) -> float:
    """Least argument at which a function that is negative at 0 becomes positive; nan above most."""
    low, high = 0.0, most / 4096.0
    while function(high) < 0.0:
        if high >= most:
            return math.nan
        low, high = high, min(2.0 * high, most)
    return float(optimize.brentq(function, low, high)) if function(low) < 0.0 else low
