"""Registration, end-to-end distances and comparisons."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from battery import Digits, Subject, attempt, digits, word_for
from scipy import special

from rotortrack.twocolour.distance import true_distance
from rotortrack.twocolour.distance_law import log_density
from rotortrack.twocolour.ends import Timing, map_second, undo_lag
from rotortrack.twocolour.ends_options import EndsOptions
from rotortrack.twocolour.measure import measure_ends
from rotortrack.twocolour.moving_median import moving_median
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.orientation import alignment, preferred_axis, rayleigh_p
from rotortrack.twocolour.register import register_beads
from rotortrack.twocolour.rings import both_rings
from rotortrack.twocolour.self_calibration import local_shift, smooth_shift
from rotortrack.twocolour.split import split_regions

RNG = np.random.default_rng(1)
LENGTHS = np.hypot(RNG.normal(60.0, 20.0, 300), RNG.normal(0.0, 20.0, 300))
NOISE = np.full(300, 20.0)
TURNED = np.linspace(0.0, 200.0, 300)
DX = 60.0 * np.cos(TURNED) + RNG.normal(0.0, 10.0, 300)
DY = -60.0 * np.sin(TURNED) + RNG.normal(0.0, 10.0, 300)
FIELD = 20_000.0
BEADS = RNG.uniform(1000.0, FIELD - 1000.0, (60, 2))
REGION = (0, 0, 200, 200)


def _rice(mean, noise, length):
    """Give the logarithm of Rice's density by scipy's scaled Bessel function."""
    z = length * mean / noise**2
    log = math.log(length / noise**2) - 0.5 * ((length - mean) / noise) ** 2
    return log + math.log(special.i0e(z))


def _law(ratio):
    def against_rice():
        lengths = np.array([0.3, 1.0, 2.0]) + ratio
        found, refused = attempt(lambda: log_density(lengths, np.ones(3), ratio, 0.0))
        assert found is not None, refused
        return digits(found, [_rice(ratio, 1.0, length) for length in lengths])

    return against_rice


def _distance(lengths, noise):
    best = true_distance(lengths, noise).default
    return [best.mean_nm, best.mean_sd_nm, best.low_nm, best.high_nm]


def _scaled_distance():
    plain = np.array(_distance(LENGTHS, NOISE))
    found = [_distance(s * LENGTHS, s * NOISE) for s in (1e-9, 1e9)]
    return Digits(min(digits(found[0], 1e-9 * plain).value, digits(found[1], 1e9 * plain).value))


def _shift(dx, dy):
    found = local_shift(dx, dy, np.full(len(dx), 10.0))
    return [found.x_nm, found.y_nm, found.radius_nm]


def _moved_shift(answer, _scale, shift, angle):
    x, y, radius = answer
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([cosine * x - sine * y + shift[0], sine * x + cosine * y + shift[1], radius])


def _rings(x, y):
    found = both_rings(np.column_stack([x, y]), np.column_stack([-1.5 * x, -1.5 * y]))
    return [found.first_radius_nm, found.second_radius_nm, math.cos(found.phase_rad)]


def _smooth(x, y):
    places = np.column_stack([x, y])
    shifts = (
        np.column_stack([20.0 + 0 * x, -10.0 + 0 * y]) + 0.1 * np.sin(np.arange(len(x)))[:, None]
    )
    found = smooth_shift(places, shifts, np.full(len(x), 0.1))
    return found.at(places[:3]) if not isinstance(found, str) else []


def _beads(places, seed=2):
    frames = np.repeat(np.arange(5), len(places))
    noise = np.random.default_rng(seed).normal(0.0, 2.0, (5 * len(places), 2))
    spots = np.tile(places, (5, 1)) + noise
    table = pd.DataFrame({"frame": frames, "x_nm": spots[:, 0], "y_nm": spots[:, 1]})
    return table.assign(photons=1e4, uncertainty_nm=2.0)


def _registered(x, y):
    """Register beads that a map of scale 1.001 and a shift move."""
    first = np.column_stack([x, y])
    second = (first - FIELD / 2) / 1.001 + FIELD / 2 + [120.0, -80.0]
    return register_beads(
        [_beads(first)], [_beads(second, 3)], RegisterOptions(),
        pixel_size_nm=100.0, regions=(REGION, REGION),
    )  # fmt: skip


def _mapped(x, y):
    middle = np.array([[FIELD / 2 + 120.0, FIELD / 2 - 80.0]])
    return _registered(x, y).to_first(middle)


def _inverse():
    made = _registered(*BEADS.T)
    there = made.to_second(BEADS)
    return digits(made.to_first(there), BEADS)


class _Shift:
    """A map that shifts alone."""

    def to_first(self, points):
        return points + np.array([10.0, -5.0])

    def error_nm(self, points):
        return np.full(len(points), 1.0)

    def inside(self, points):
        return np.ones(len(points), bool)


def _second(frame, x, y):
    spots = pd.DataFrame({"frame": frame, "x_nm": x, "y_nm": y})
    drift = pd.DataFrame({"frame": [0, 1], "dx_nm": [0.0, 1.0], "dy_nm": [0.0, 2.0]})
    return map_second(spots, _Shift(), drift).T


def _measured(frame, dx, dy):
    rows = {"frame": frame, "x_sd_nm": 7.0, "y_sd_nm": 7.0, "fit_flags": 0, "photons": 500.0}
    first = pd.DataFrame({**rows, "x_nm": 1000.0, "y_nm": 1000.0, "rotor": 0})
    second = pd.DataFrame({**rows, "x_nm": 1000.0 + dx, "y_nm": 1000.0 + dy})
    rotors = pd.DataFrame({"rotor": [0], "x_nm": [1000.0], "y_nm": [1000.0], "verdict": ["kept"]})
    found = measure_ends(
        first, second, second[["x_nm", "y_nm"]].to_numpy(float), rotors, _Shift(), EndsOptions(),
        timing=Timing(0.002, 0.0, 100.0, 0.002), workers=1,
    )  # fmt: skip
    return found.rotors[["end_to_end_nm", "end_to_end_sd_nm"]].to_numpy()


LINE = np.linspace(0.0, FIELD, 60)
FRAMES = np.arange(300)

SUBJECTS = (
    Subject(
        "twocolour.distance_law.log_density",
        lambda lengths, noise: log_density(lengths, noise, 60.0, 5.0),
        (LENGTHS, NOISE),
        {"denormals": "noise is above 0, which true_distance sees to"},
        own={
            **{
                f"mean over noise {x:g}, against Rice": _law(x)
                for x in (0.0, 1e-9, 0.5, 5.0, 38.0, 1e3, 1e8)
            },
            "breathing far above all": lambda: word_for(
                lambda: log_density(LENGTHS, NOISE, 60.0, 1e9)
            ),
            "a length of 0": lambda: word_for(
                lambda: log_density(np.zeros(1), np.ones(1), 1.0, 0.0)
            ),
        },
    ),
    Subject(
        "twocolour.distance.true_distance",
        _distance,
        (LENGTHS, NOISE),
        own={
            "scale 1e-9 and 1e9, noise too": _scaled_distance,
            "all lengths the same": lambda: word_for(
                lambda: _distance(np.full(50, 60.0), np.full(50, 20.0))
            ),
            "all lengths 0": lambda: word_for(lambda: _distance(np.zeros(50), np.full(50, 20.0))),
            "noise 1e-6 of the length": lambda: digits(
                _distance(np.full(50, 60.0) + 1e-5 * np.sin(FRAMES[:50]), np.full(50, 6e-5))[0],
                60.0,
            ),
            "noise 1e6 times the length": lambda: word_for(
                lambda: _distance(np.full(50, 1e-3), np.full(50, 1e3))
            ),
            "noise of very different size": lambda: word_for(
                lambda: _distance(LENGTHS, NOISE * 10.0 ** RNG.uniform(-3, 0, 300))
            ),
        },
    ),
    Subject(
        "twocolour.moving_median.moving_median",
        lambda values: moving_median(values, 5),
        (LENGTHS,),
        ordered=True,
        own={
            "a window longer than all": lambda: digits(moving_median(np.ones(3), 100), np.ones(3))
        },
    ),
    Subject(
        "twocolour.orientation.preferred_axis",
        lambda angles: [preferred_axis(angles).order, preferred_axis(angles).axis_deg],
        (RNG.normal(0.5, 0.2, 300),),
        ordered=True,
        own={
            "all the same": lambda: digits(preferred_axis(np.full(50, 0.5)).order, 1.0),
            "angles of 1e8 rad": lambda: word_for(
                lambda: preferred_axis(1e8 + RNG.normal(0.5, 0.2, 300)).order
            ),
        },
    ),
    Subject(
        "twocolour.orientation.rayleigh_p",
        rayleigh_p,
        own={
            "no resultant": lambda: digits(rayleigh_p(0.0, 50.0), 1.0),
            "all the same": lambda: word_for(lambda: rayleigh_p(1.0, 1e6)),
        },
    ),
    Subject(
        "twocolour.orientation.alignment",
        lambda axes, order: alignment(axes, order, 30.0).alignment,
        (RNG.uniform(0, 180, 40), RNG.uniform(0.1, 1, 40)),
        own={
            "along all": lambda: digits(
                alignment(np.full(5, 30.0), np.ones(5), 30.0).alignment, 1.0
            ),
            "half a turn further": lambda: digits(
                alignment(np.full(5, 30.0), np.ones(5), 210.0).alignment, 1.0
            ),
        },
    ),
    Subject(
        "twocolour.self_calibration.local_shift",
        _shift,
        (DX, DY),
        ordered=True,
        places=(0, 1),
        degrees=1.0,
        moves=_moved_shift,
    ),
    Subject(
        "twocolour.self_calibration.smooth_shift",
        _smooth,
        (BEADS[:, 0], BEADS[:, 1]),
        {
            "nan": "places of rotors are fitted centres",
            "inf": "places of rotors are fitted centres",
        },
        ordered=True,
    ),
    Subject("twocolour.rings.both_rings", _rings, (DX, DY), ordered=True),
    Subject(
        "twocolour.ends.undo_lag",
        lambda x, y: (
            undo_lag(
                x,
                y,
                np.full(len(x), 1e-3),
                pivot_nm=(0.0, 0.0),
                omega_rad_s=30.0,
                diffusion_rad2_s=2.0,
                exposure_s=0.002,
            )[0].T
        ),
        (DX, DY),
        {"inf": "only finite places come to it"},
    ),
    Subject("twocolour.ends.map_second", _second, (FRAMES, DX, DY), ordered=True),
    Subject("twocolour.measure.measure_ends", _measured, (FRAMES, DX, DY), ordered=True),
    Subject(
        "twocolour.register.register_beads",
        _mapped,
        (BEADS[:, 0], BEADS[:, 1]),
        {
            "denormals": "beads are filmed places",
            "duplicates": "beads of one place are one bead",
            "nan": "localisations are finite: the fits refuse others",
            "inf": "localisations are finite: the fits refuse others",
            "another order": "noise of the beads that are made goes by row",
        },
        own={
            "there and back": _inverse,
            "on a line": lambda: word_for(lambda: _mapped(LINE, 0 * LINE + 5000.0)),
            "nearly on a line": lambda: word_for(
                lambda: _mapped(LINE, 0.5 * LINE + 1e-6 * DX[:60])
            ),
            "in one heap": lambda: word_for(lambda: _mapped(9000 + 0.02 * LINE, 9000 + DX[:60])),
            "three beads": lambda: word_for(lambda: _mapped(*BEADS[:3].T)),
        },
    ),
    Subject(
        "twocolour.split.split_regions",
        split_regions,
        own={
            "an odd width": lambda: word_for(lambda: split_regions((64, 65), "left-right")),
            "one column": lambda: word_for(lambda: split_regions((64, 1), "left-right")),
            "halves": lambda: digits(
                np.ravel(split_regions((64, 128), "left-right")), [0, 0, 64, 64, 64, 0, 64, 64]
            ),
        },
    ),
)

EXEMPT = {
    "twocolour.measured.measured_group": "cuts tables by rotor: tests/unit/twocolour",
    "twocolour.population.rod_population": "cuts tables by cell: tests/unit/twocolour",
}
