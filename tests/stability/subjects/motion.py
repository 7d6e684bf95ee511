"""Angles, speeds and mean-square displacements."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pandas as pd
from battery import Digits, Subject, attempt, digits, word_for

from rotortrack.motion.angles import build_tracks, unbroken_angle
from rotortrack.motion.blur import radius_factor
from rotortrack.motion.diffusion import Diffusion
from rotortrack.motion.ensemble import Track, msd_lags, track_msd
from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.msd import MSD, fit_msd, msd
from rotortrack.motion.plan import Setting, frames_needed, smallest_speed, speed_sd
from rotortrack.motion.plan_movie import plan_movie
from rotortrack.motion.population import binomial_share
from rotortrack.motion.readings import Circle
from rotortrack.motion.timed_steps import steady, switching, timed_steps
from rotortrack.motion.trigger import frame_clock, rising_edges
from rotortrack.motion.voltage import frame_voltages, voltage_steps
from rotortrack.motion.voltage_speeds import step_edges_s
from rotortrack.motion.windowed_speed import windowed_speed

DT_S = 0.002


def _walk(n=400, omega=30.0, diffusion=4.0, seed=1, radius=100.0, noise=10.0):
    rng = np.random.default_rng(seed)
    theta = np.cumsum(rng.normal(omega * DT_S, math.sqrt(2 * diffusion * DT_S), n))
    x = radius * np.cos(theta) + rng.normal(0, noise, n)
    y = -radius * np.sin(theta) + rng.normal(0, noise, n)
    return np.arange(n), theta, x, y, np.full(n, noise)


FRAME, THETA, X, Y, SD = _walk()


def _estimate(frame, x, y, sd, method="increments", circle=None):
    centre = circle or Circle(0.0, 0.0, 100.0)
    found = estimate_motion(
        frame, x, y, sd, sd, centre, frame_interval_s=DT_S, exposure_s=DT_S, method=method
    )
    fit = found.fit
    return [fit.omega_rad_s, fit.omega_sd_rad_s, fit.diffusion_rad2_s]


def _estimated(*arguments):
    found, refused = attempt(lambda: _estimate(*arguments))
    assert found is not None, refused
    return found


def _shifted_estimate():
    far = Circle(1e8, -1e8, 100.0)
    moved = _estimated(FRAME, X + 1e8, Y - 1e8, SD, "increments", far)
    return digits(moved, _estimated(FRAME, X, Y, SD))


def _scaled_estimate():
    plain = _estimated(FRAME, X, Y, SD)
    worst = 15.0
    for scale in (1e-9, 1e9):
        own = Circle(0.0, 0.0, 100.0 * scale)
        found = _estimated(FRAME, scale * X, scale * Y, scale * SD, "increments", own)
        worst = min(worst, digits(found, plain).value)
    return Digits(worst)


def _mirrored_estimate():
    found = _estimated(FRAME, X, -Y, SD)
    return digits([-found[0], *found[1:]], _estimated(FRAME, X, Y, SD))


def _missing(part):
    frame, _, x, y, sd = _walk(3000)
    chosen = np.random.default_rng(2).choice(3000, round(3000 * (1 - part)), replace=False)
    kept = np.sort(chosen)
    return word_for(lambda: _estimate(frame[kept], x[kept], y[kept], sd[kept], "auto"))


def _exact_msd(theta, lag):
    parts = [Fraction(float(value)) for value in theta]
    squares = [(b - a) ** 2 for a, b in zip(parts[:-lag], parts[lag:], strict=True)]
    return float(sum(squares) / len(squares))


def _msd_of(theta):
    def against_fractions():
        found, refused = attempt(lambda: msd(theta).values)
        assert found is not None, refused
        lags = (1, 2, 7, len(theta) // 2, len(theta) - 1)
        return Digits(min(digits(found[m - 1], _exact_msd(theta, m)).value for m in lags))

    return against_fractions


def _blur_near(x):
    """Hold the factor against its series in exact fractions, for diffusion alone."""

    def against_series():
        c, exact = Fraction(x), Fraction(0)
        for k in range(2, 60):
            exact += Fraction((-1) ** k) * c ** (k - 2) / math.factorial(k)
        return digits(radius_factor(0.0, x / DT_S, DT_S), math.sqrt(2.0 * float(exact)))

    return against_series


def _planned(call):
    hard = {
        "no diffusion": {"diffusion_rad2_s": 0.0},
        "diffusion 1e6": {"diffusion_rad2_s": 1e6},
        "no noise": {"localisation_sd_nm": 0.0},
        "noise ten times the radius": {"localisation_sd_nm": 1000.0},
        "no exposure": {"exposure_s": 0.0},
        "two frames": {"frames": 2.0},
        "1e9 frames": {"frames": 1e9},
        "one frame in a hundred seen": {"detection": 0.01},
    }
    plain = {
        "diffusion_rad2_s": 4.0, "radius_nm": 100.0, "localisation_sd_nm": 10.0,
        "frame_interval_s": DT_S, "exposure_s": DT_S, "frames": 5000.0,
    }  # fmt: skip
    return {
        name: lambda changes=changes: word_for(lambda: call(Setting(**{**plain, **changes})))
        for name, changes in hard.items()
    }


def _table(frame, x, y):
    spots = pd.DataFrame({"frame": frame, "x_nm": x, "y_nm": y, "rotor": 0})
    spots = spots.assign(x_sd_nm=10.0, y_sd_nm=10.0, fit_flags=0)
    rotors = pd.DataFrame({"rotor": [0], "x_nm": [0.0], "y_nm": [0.0], "radius_nm": [100.0]})
    rotors = rotors.assign(verdict="kept", x_sd_nm=1.0, y_sd_nm=1.0, radius_fit_nm=100.0)
    made = build_tracks(spots, rotors, frame_interval_s=DT_S, gap_mode="drop")
    return made[["theta_rad", "step_rad"]].to_numpy().T


def _half_turns():
    x = np.array([100.0, -100.0] * 3)
    return digits(_table(np.arange(6), x, np.zeros(6))[1][1:], np.full(5, math.pi))


TIME_S = np.arange(0.0, 2.0, 1e-4)
TRIGGER_V = np.where((TIME_S % 0.01) < 0.005, 5.0, 0.0)
VOLTAGE_V = np.where(TIME_S < 1.0, 0.05, 0.1) + 1e-4 * np.sin(1e3 * TIME_S)
NOISE = Diffusion(4.0, 0.1, 0.01, np.eye(2) * 1e-4)


def _clock():
    return frame_clock(rising_edges(TIME_S, TRIGGER_V))


def _volts(time_s, volts):
    steps = voltage_steps(time_s, volts, min_step_s=0.2)
    made = frame_voltages(time_s, volts, _clock(), steps, n_frames=100, exposure_s=0.002)
    return made.mean_v[5:95]


def _edges(time_s, volts):
    steps = voltage_steps(time_s, volts, min_step_s=0.2)
    return step_edges_s(steps, _clock(), first_edge=0, frame_interval_s=0.01, exposure_s=0.002)


def _steps(frame, theta):
    return timed_steps(frame, theta, NOISE, steady(30.0), frame_interval_s=DT_S, exposure_s=DT_S)


def _curve(values):
    n = len(values)
    return MSD(np.arange(1, n + 1), values, np.arange(n, 0, -1))


LAG_S = DT_S * np.arange(1, 101)
CURVE = (30.0 * LAG_S) ** 2 + 8.0 * LAG_S
ONE, TWO = np.array([1.0]), np.array([2.0])

ANGLES = {"inf": "angles come from atan2, which is never infinite"}
TRACES = {"inf": "the reader of traces refuses what is not finite: tests/cli/test_daq.py"}

SUBJECTS = (
    Subject(
        "motion.estimate.estimate_motion",
        _estimate,
        (FRAME, X, Y, SD),
        ordered=True,
        own={
            "translation 1e8, centre too": _shifted_estimate,
            "scale 1e-9 and 1e9, radius too": _scaled_estimate,
            "mirrored: the sign alone": _mirrored_estimate,
            "half of the frames missing": lambda: _missing(0.5),
            "80 % of the frames missing": lambda: _missing(0.8),
            "on the circle, all at one place": lambda: word_for(
                lambda: _estimate(FRAME, 0 * X + 100.0, 0 * Y, SD, "circular")
            ),
            "on the circle, all at its centre": lambda: word_for(
                lambda: _estimate(FRAME, 0 * X, 0 * Y, SD, "circular")
            ),
            "on the circle, noise far above the radius": lambda: word_for(
                lambda: _estimate(FRAME, X, Y, 50 * SD, "circular")
            ),
            "nothing moves": lambda: word_for(lambda: _estimate(FRAME, 0 * X + 100, 0 * Y, SD)),
        },
    ),
    Subject(
        "motion.msd.msd",
        lambda theta: msd(theta).values,
        (THETA,),
        ordered=True,
        own={
            "against fractions": _msd_of(THETA),
            "a turn of 1e5 rad": _msd_of(np.linspace(0, 1e5, 400) + THETA),
            "an offset of 1e8 rad": _msd_of(THETA + 1e8),
            "a constant": lambda: digits(msd(np.full(50, 3.0)).values, np.zeros(49), 1.0),
        },
    ),
    Subject(
        "motion.msd.fit_msd",
        lambda values: fit_msd(_curve(values), DT_S, lags=50).speed_rad_s,
        (CURVE,),
        {"inf": "mean squares of finite angles are finite"},
        ordered=True,
        own={
            "an exact curve": lambda: digits(
                fit_msd(_curve(CURVE), DT_S, lags=50).speed_rad_s, 30.0
            ),
            "no speed": lambda: digits(
                fit_msd(_curve(8.0 * LAG_S), DT_S, lags=50).diffusion_rad2_s, 4.0
            ),
        },
    ),
    Subject("motion.angles.unbroken_angle", unbroken_angle, (FRAME, THETA), ANGLES, ordered=True),
    Subject(
        "motion.angles.build_tracks",
        _table,
        (FRAME, X, Y),
        ordered=True,
        own={"steps of exactly half a turn": _half_turns},
    ),
    Subject(
        "motion.blur.radius_factor",
        radius_factor,
        own={
            **{f"D t = {x:g}": _blur_near(x) for x in (1e-300, 1e-12, 0.00999, 0.01001, 1.0, 5.0)},
            "nan": lambda: digits(radius_factor(math.nan, 1.0, DT_S), 1.0),
            "inf": lambda: digits(radius_factor(math.inf, 1.0, DT_S), 1.0),
            "half a turn in the exposure": lambda: digits(
                radius_factor(math.pi / DT_S, 0.0, DT_S), 2.0 / math.pi
            ),
        },
    ),
    Subject(
        "motion.ensemble.track_msd",
        lambda frame, x, y: track_msd(
            Track(frame, np.column_stack([x, y]), None), np.arange(1, 20)
        )[0],
        (FRAME, X, Y),
        ordered=True,
        places=(1, 2),
        degrees=2.0,
    ),
    Subject(
        "motion.ensemble.msd_lags",
        msd_lags,
        own={
            "no length": lambda: digits(msd_lags(0), [1]),
            "1e9 frames": lambda: word_for(lambda: msd_lags(10**9)),
        },
    ),
    Subject("motion.plan.speed_sd", speed_sd, own=_planned(lambda s: speed_sd(s, 30.0))),
    Subject(
        "motion.plan.smallest_speed", smallest_speed, own=_planned(lambda s: smallest_speed(s, 3.0))
    ),
    Subject(
        "motion.plan.frames_needed",
        frames_needed,
        own=_planned(lambda s: frames_needed(s, 30.0, 3.0)),
    ),
    Subject(
        "motion.plan_movie.plan_movie",
        plan_movie,
        own=_planned(lambda s: plan_movie(s, omega_rad_s=30.0, driven_z=3.0).speed_sd_rad_s),
    ),
    Subject(
        "motion.population.binomial_share",
        binomial_share,
        own={
            "none of none": lambda: word_for(lambda: list(vars(binomial_share(0, 0)).values())),
            "none of 10": lambda: digits(binomial_share(0, 10).high, 1 - 0.025 ** (1 / 10)),
            "all of 10": lambda: digits(binomial_share(10, 10).low, 0.025 ** (1 / 10)),
            "1 of 1e9": lambda: word_for(lambda: list(vars(binomial_share(1, 10**9)).values())),
        },
    ),
    Subject(
        "motion.timed_steps.timed_steps",
        lambda frame, theta: _steps(frame, theta).step_rad,
        (FRAME, THETA),
        ANGLES,
        ordered=True,
    ),
    Subject(
        "motion.timed_steps.steady",
        steady,
        own={"a second at 3 rad/s": lambda: digits(steady(3.0)(ONE, TWO), 3.0)},
    ),
    Subject(
        "motion.timed_steps.switching",
        switching,
        own={
            "across an edge": lambda: digits(
                switching(np.array([0.0, 1.0, 2.0]), np.array([1.0, -3.0]))(0.5 * ONE, 1.5 * ONE),
                -1.0,
            ),
            "a speed that is not known": lambda: digits(
                switching(np.array([1.0, 2.0]), np.array([math.nan]))(ONE, TWO), 0.0, 1.0
            ),
        },
    ),
    Subject(
        "motion.windowed_speed.windowed_speed",
        lambda frame, theta: windowed_speed(_steps(frame, theta)).omega_rad_s,
        (FRAME, THETA),
        ANGLES,
        ordered=True,
    ),
    Subject(
        "motion.trigger.rising_edges",
        lambda time_s, volts: rising_edges(time_s, volts).time_s,
        (TIME_S, TRIGGER_V),
        ordered=True,
    ),
    Subject(
        "motion.trigger.frame_clock",
        lambda time_s, volts: frame_clock(rising_edges(time_s, volts)).frame_at(np.array([0.5])),
        (TIME_S, TRIGGER_V),
        ordered=True,
    ),
    Subject(
        "motion.voltage.voltage_steps",
        lambda time_s, volts: voltage_steps(time_s, volts, min_step_s=0.2).start_s,
        (TIME_S, VOLTAGE_V),
        TRACES,
        ordered=True,
    ),
    Subject(
        "motion.voltage.frame_voltages",
        _volts,
        (TIME_S, VOLTAGE_V),
        {**TRACES, "nothing": "voltage_steps of a trace without samples has no step"},
        ordered=True,
    ),
    Subject(
        "motion.voltage_speeds.step_edges_s", _edges, (TIME_S, VOLTAGE_V), TRACES, ordered=True
    ),
)

EXEMPT = {
    "motion.measure.measure_motion": "calls estimate_motion and msd for every row of a table",
    "motion.particles.track_particles": "links by trackpy and calls track_msd: tests/accuracy",
    "motion.population.of_rotors": "counts words of a table: tests/unit/motion/test_population.py",
    "motion.screen.screen": "holds features against limits: tests/unit/motion/test_screen.py",
    "motion.verdicts.overrule": "exchanges words in a table: tests/unit/motion/test_verdicts.py",
    "motion.voltage_speeds.step_changes": "subtracts rows of a table: tests/unit/motion",
    "motion.voltage_speeds.voltage_speeds": "calls estimates stretch by stretch: tests/unit/motion",
}
