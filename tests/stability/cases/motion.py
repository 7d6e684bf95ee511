"""Hard cases of angles, steps, displacements, speeds and diffusion."""

from __future__ import annotations

import cmath
import math
from decimal import Decimal, localcontext

import numpy as np
from cases.registry import case, digits, on_arrays, on_numbers

from rotortrack.motion import angles, blur, increments, likelihood, msd, occupancy, readings

RNG = np.random.default_rng(20260901)
STEPS = 0.3 * RNG.standard_normal(200)
THETA = np.angle(np.exp(1j * np.cumsum(STEPS)))
FRAME = np.arange(200)
NO_ROWS = "frames and angles are those of a track, which has finite angles"


def series_of_radius(omega: float, diffusion: float, exposure: float) -> float:
    """Power series of 2 (exp(-c) - 1 + c) / c^2 with fifty decimals."""
    with localcontext() as context:
        context.prec = 50
        a, b = Decimal(diffusion) * Decimal(exposure), -Decimal(omega) * Decimal(exposure)
        real, imaginary, total = Decimal(1), Decimal(0), Decimal(0)
        for n in range(400):
            total += real
            real, imaginary = (
                -(real * a - imaginary * b) / (n + 3),
                -(real * b + imaginary * a) / (n + 3),
            )
        return float(total.sqrt())


on_numbers(
    blur.radius_factor,
    [31.4, 60.0, 2e-3],
    series_of_radius,
    {
        "at rest": [0.0, 0.0, 2e-3],
        "just below the series' end": [4.9, 0.5, 2e-3],
        "just above the series' end": [5.1, 0.5, 2e-3],
        "D -> 0": [31.4, 1e-30, 2e-3],
        "a whole turn in the exposure": [3141.5926, 1e-3, 2e-3],
        "both fast": [7e3, 7e3, 2e-3],
    },
)
case(
    "motion.blur.radius_factor",
    "far beyond a turn",
    lambda: digits(
        blur.radius_factor(1e8, 1.0, 2e-3),
        math.sqrt(
            2.0
            * (
                (cmath.exp(complex(-2e-3, 2e5)) - 1 + complex(2e-3, -2e5))
                / complex(2e-3, -2e5) ** 2
            ).real
        ),
    ),
)
on_numbers(likelihood.freedom, [0.1], lambda sd: max(2.0 / sd**2, 1.0), {"not known": [1e9]})
on_numbers(likelihood.quantile, [1.0], lambda _: 1.0 / math.tan(math.pi * 0.025) ** 2)
on_numbers(
    likelihood.profile_rise, [1.0], lambda _: math.log1p(1.0 / math.tan(math.pi * 0.025) ** 2)
)
on_numbers(
    likelihood.student_square,
    [4.0, 10.0],
    lambda d, f: f * math.expm1(max(d, 0.0) / f),
    {"none": [0.0, 10.0], "tiny": [1e-300, 10.0], "negative by rounding": [-1e-18, 10.0]},
)
on_numbers(
    likelihood.drift_p,
    [4.0, 1.0],
    lambda s, _: 1.0 - 2.0 * math.atan(math.sqrt(s)) / math.pi,
    {"none": [0.0, 1.0]},
)

steps = on_arrays(angles.step, THETA[:-1], THETA[1:], leaves_out={"inf": NO_ROWS})
case(
    steps.name,
    "exactly 180 degrees",
    lambda: digits(angles.step(np.zeros(2), np.array([np.pi, -np.pi])), [np.pi, np.pi]),
)
on_arrays(
    angles.angle,
    *(RNG.normal(0.0, 100.0, (2, 50))),
    call=lambda x, y: angles.angle(x, y, np.array(0.0), np.array(0.0)),
)
case(
    "motion.angles.angle",
    "scale 1e-9 to 1e9",
    lambda: digits(
        [
            angles.angle(np.array(s), np.array(-s), np.array(0.0), np.array(0.0))
            for s in (1e-9, 1.0, 1e9)
        ],
        [math.pi / 4.0] * 3,
    ),
)
for mode in ("drop", "bridge", "model"):
    case(
        "motion.angles.consecutive_steps",
        f"80 % missing, {mode}",
        lambda mode=mode: digits(  # type: ignore[misc]
            angles.consecutive_steps(np.zeros(40), FRAME[::5], mode, 0.0), np.zeros(39)
        ),
    )
on_arrays(
    angles.consecutive_steps,
    THETA,
    FRAME,
    call=lambda theta, frame: angles.consecutive_steps(theta, frame, "drop"),
    leaves_out={"nan": NO_ROWS, "inf": NO_ROWS},
)
on_arrays(
    increments.increments,
    FRAME,
    THETA,
    call=lambda frame, theta: increments.increments(frame, theta, "drop"),
    leaves_out={"nan": NO_ROWS, "inf": NO_ROWS},
)
on_arrays(
    increments.step_sizes,
    STEPS,
    call=lambda s: increments.step_sizes(
        increments.Increments(s, np.ones(s.size, np.int64), np.zeros(s.size, np.int64))
    ),
    leaves_out={"nan": NO_ROWS, "inf": NO_ROWS},
)


def plain_msd(x: np.ndarray, lags: range) -> list[float]:
    """Mean-square displacement in extended precision, pair by pair."""
    wide = x.astype(np.longdouble)
    return [float(np.nanmean((wide[m:] - wide[:-m]) ** 2)) for m in lags]


curve = on_arrays(msd.msd, np.cumsum(STEPS))
WALK = np.cumsum(RNG.normal(0.0, 0.1, 20_000))
HARD = {
    "usual": WALK,
    "1e5 rad": WALK + 5.0 * np.arange(20_000),
    "translation 1e8": np.round(WALK * 2**20) / 2**20 + 1e8,
    "80 % missing": np.where(RNG.random(20_000) < 0.8, np.nan, WALK),
}
for label, track in HARD.items():
    case(
        curve.name,
        label,
        lambda track=track: digits(  # type: ignore[misc]
            msd.msd(track, 50).values, plain_msd(track, range(1, 51))
        ),
    )


def fitted(v: float, d: float) -> list[float]:
    lags = np.arange(1, 101)
    tau = lags * 2e-3
    fit = msd.fit_msd(
        msd.MSD(lags, v**2 * tau**2 + 2.0 * d * tau, np.full(100, 10)), 2e-3, lags=100
    )
    return [fit.speed_rad_s, fit.diffusion_rad2_s]


for v, d in ((31.4, 2.0), (31.4, 0.0), (0.0, 2.0), (1e4, 1e-3), (1e-6, 60.0)):
    case(
        "motion.msd.fit_msd",
        f"v {v:g}, D {d:g}",
        lambda v=v, d=d: digits(fitted(v, d), [v, d], size=max(v, d)),  # type: ignore[misc]
    )
on_arrays(readings.radial_scatter, 100.0 + RNG.normal(0.0, 10.0, 300))
on_arrays(occupancy.strayed_rad, THETA, leaves_out=dict.fromkeys(("nan", "inf", "empty"), NO_ROWS))
