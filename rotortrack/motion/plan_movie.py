"""The plan of one movie: what it will tell of one rotor, what a speed needs, and one advice."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from rotortrack.motion.plan import (
    FIVE_PERCENT,
    FOLDED_STEP_DEG,
    Setting,
    diffusion_relative_sd,
    fastest_speed,
    frames_needed,
    longest_exposure,
    most_noise,
    photons_needed,
    smallest_speed,
    speed_sd,
    speed_test,
)

Precision = Callable[[float], float]

_MOSTLY = 0.8
_WIDE_NOISE_RAD = 0.4


@dataclass(frozen=True)
class MoviePlan:
    """What a movie tells.

    Attributes
    ----------
    setting
        Rotor and movie.
    omega_rad_s
        Speed that is to be resolved, None where none was given.
    driven_z
        Errors by which the speed of a driven rotor differs from zero.
    speed_sd_rad_s
        Error of the speed.
    diffusion_share
        Part of its square that diffusion alone makes, 2 D / T.
    diffusion_relative_sd
        Error of D over D.
    smallest_5_rad_s, smallest_rad_s
        Smallest speed told from Brownian motion in 95 % of such rotors, at 5 % and at `driven_z`.
    fastest_rad_s
        Speed at which steps exceed half a turn in 2.5 % of frames.
    step_sd_rad
        Standard deviation of steps between adjacent frames.
    longest_exposure_s
        Exposure that shrinks the circle by 5 %, the frame interval at most.
    power_5, power_z
        Probability that the speed is told, at 5 % and at `driven_z`; nan without one.
    frames_needed
        Frames in which 95 % of such rotors are told at `driven_z`; inf where no number suffices.
    most_noise_nm, photons_needed
        Localisation error, and photons, that suffice within the movie as it is; nan where even
        perfect positions do not.
    """

    setting: Setting
    omega_rad_s: float | None
    driven_z: float
    speed_sd_rad_s: float
    diffusion_share: float
    diffusion_relative_sd: float
    smallest_5_rad_s: float
    smallest_rad_s: float
    fastest_rad_s: float
    step_sd_rad: float
    longest_exposure_s: float
    power_5: float
    power_z: float
    frames_needed: float
    most_noise_nm: float
    photons_needed: float

    @property
    def folded(self) -> bool:
        """Whether counting by the 180-degree rule is biased at this frame rate."""
        return math.degrees(self.step_sd_rad) > FOLDED_STEP_DEG


def plan_movie(
    setting: Setting,
    *,
    omega_rad_s: float | None,
    driven_z: float,
    precision: Precision | None = None,
) -> MoviePlan:
    """Plan a movie of one rotor.

    Parameters
    ----------
    setting
        Rotor and movie.
    omega_rad_s
        Speed that is to be resolved.
    driven_z
        Errors by which a speed must differ from zero.
    precision
        Localisation error (nm) by the number of photons, where known.
    """
    speed = abs(omega_rad_s or 0.0)
    sd = speed_sd(setting, speed)
    needed, noise_nm, photons = math.nan, math.nan, math.nan
    strict, lenient = math.nan, math.nan
    if omega_rad_s is not None:
        needed = frames_needed(setting, speed, driven_z)
        noise_nm = most_noise(setting, speed, driven_z)
        if precision is not None:
            photons = photons_needed(precision, noise_nm)
        distance = speed / sd if sd > 0.0 else math.inf
        strict = speed_test(setting, driven_z).power(distance)
        lenient = speed_test(setting, FIVE_PERCENT).power(distance)
    by_diffusion = 2.0 * setting.diffusion_rad2_s / setting.duration_s
    return MoviePlan(
        setting=setting,
        omega_rad_s=omega_rad_s,
        driven_z=driven_z,
        speed_sd_rad_s=sd,
        diffusion_share=min(by_diffusion / sd**2, 1.0) if 0.0 < sd < math.inf else 0.0,
        diffusion_relative_sd=diffusion_relative_sd(setting),
        smallest_5_rad_s=smallest_speed(setting, FIVE_PERCENT),
        smallest_rad_s=smallest_speed(setting, driven_z),
        fastest_rad_s=fastest_speed(setting),
        step_sd_rad=setting.step_sd_rad(speed),
        longest_exposure_s=longest_exposure(setting, speed),
        power_5=lenient,
        power_z=strict,
        frames_needed=needed,
        most_noise_nm=noise_nm,
        photons_needed=photons,
    )


def advice(plan: MoviePlan) -> str:
    """Say in one sentence what to change, or that nothing needs to be."""
    setting = plan.setting
    limit = math.degrees(plan.fastest_rad_s)
    if plan.omega_rad_s is None:
        return _general_advice(plan)
    wanted = abs(math.degrees(plan.omega_rad_s))
    alias = 180.0 / setting.frame_interval_s
    if wanted >= alias:
        return (
            f"{wanted:.4g} deg/s is more than half a turn a frame, which no analysis can tell from "
            f"slower turning the other way: film at more than {wanted / 180.0:.4g} frames/s."
        )
    if not plan.power_z < 0.95:
        if wanted > limit:
            return (
                f"The speed is resolved, but beyond {limit:.4g} deg/s steps exceed half a turn, so "
                "rely on the likelihood on the circle, or film faster."
            )
        return (
            f"The speed is resolved, {wanted / math.degrees(plan.speed_sd_rad_s):.3g} times its "
            f"error; {_seconds(plan.frames_needed * setting.frame_interval_s)} would suffice."
        )
    longer = _seconds(plan.frames_needed * setting.frame_interval_s)
    if not math.isfinite(plan.most_noise_nm):
        own = math.degrees(math.sqrt(2.0 * setting.diffusion_rad2_s / setting.duration_s))
        return (
            f"Diffusion alone makes an error of {own:.3g} deg/s in {_seconds(setting.duration_s)}, "
            f"so more photons do not help: record {longer}."
        )
    photons = ""
    if math.isfinite(plan.photons_needed):
        photons = f", which takes {plan.photons_needed:.3g} photons a frame"
    return (
        f"Localisation noise hides the speed: bring it below {plan.most_noise_nm:.3g} nm{photons}, "
        f"or record {longer}."
    )


def _general_advice(plan: MoviePlan) -> str:
    setting = plan.setting
    if plan.fastest_rad_s == 0.0:
        return (
            f"Steps of {math.degrees(plan.step_sd_rad):.3g} deg between frames exceed half a turn "
            "too often at any speed: film faster."
        )
    if setting.noise_rad() > _WIDE_NOISE_RAD:
        return (
            f"Angles are uncertain by {math.degrees(setting.noise_rad()):.3g} deg: gather more "
            "photons a frame first."
        )
    if plan.diffusion_share > _MOSTLY:
        return (
            "Diffusion makes nearly all of the error, so more photons do not help: a movie four "
            "times as long resolves half the speed."
        )
    return (
        "Localisation noise makes much of the error: more photons help, and so does a longer movie."
    )


def _seconds(value: float) -> str:
    """Write a duration in the unit that reads best."""
    if not math.isfinite(value):
        return "for longer than any movie lasts"
    for limit, unit, name in ((120.0, 1.0, "s"), (7200.0, 60.0, "min")):
        if value < limit:
            return f"{value / unit:.3g} {name}"
    return f"{value / 3600.0:.3g} h"
