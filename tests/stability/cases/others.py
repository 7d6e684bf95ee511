"""Hard cases of corrections, two colours, cameras and microscopy of rods at rest."""

from __future__ import annotations

import math

import numpy as np
from cases.registry import case, digits, does_not_apply, on_arrays

from rotortrack.afm import persistence
from rotortrack.cameras import hot_pixels
from rotortrack.corrections import density
from rotortrack.corrections.drift import curve, uncertainty
from rotortrack.localise import precision, wavelet
from rotortrack.twocolour import attractors, distance, distance_law, robust

RNG = np.random.default_rng(20260903)
X, Y = RNG.uniform(0.0, 1000.0, (2, 200))
PAIRS = "the rows of a table of pairs, which hold finite values"


def counted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    apart = np.hypot(x[:, None] - x, y[:, None] - y)
    return np.asarray(np.count_nonzero(apart < 50.0, axis=1) - 1)


near = on_arrays(
    density.neighbour_counts, X, Y, call=lambda x, y: density.neighbour_counts(x, y, 50.0)
)
case(near.name, "usual", lambda: digits(density.neighbour_counts(X, Y, 50.0), counted(X, Y)))
GRID = np.arange(100.0) * 50.0
case(
    near.name,
    "at the radius exactly",
    lambda: digits(
        density.neighbour_counts(GRID, np.zeros(100), 50.0), counted(GRID, np.zeros(100))
    ),
)
case(
    near.name,
    "translation 1e8",
    lambda: digits(
        density.neighbour_counts(np.round(X) + 1e8, np.round(Y) - 1e8, 50.0),
        density.neighbour_counts(np.round(X), np.round(Y), 50.0),
    ),
)
BINS = "the caller drops bins without a shift, and has at least as many as it smooths over"
KNOTS = np.linspace(0.0, 100.0, 12)
on_arrays(
    curve.curve_through,
    KNOTS,
    3.0 * KNOTS,
    call=lambda k, v: curve.curve_through(k, v, np.arange(100.0)),
    varied=[1],
    leaves_out=dict.fromkeys(("nan", "inf", "empty"), BINS),
)
on_arrays(
    curve.loess,
    KNOTS,
    3.0 * KNOTS,
    call=lambda x, y: curve.loess(x, y, 5),
    varied=[1],
    leaves_out=dict.fromkeys(("nan", "inf", "empty", "single"), BINS),
)
on_arrays(uncertainty.jackknife_sd, RNG.normal(size=(10, 4, 2)))
on_arrays(robust.scale_of, RNG.normal(size=(50, 2)), leaves_out={"empty": PAIRS})
on_arrays(robust.tukey, RNG.normal(size=(50, 2)), call=lambda r: robust.tukey(r, 1.0))
on_arrays(robust.bounded, RNG.normal(size=(50, 2)), call=lambda r: robust.bounded(r, 1.0))
LENGTHS = np.hypot(50.0 + RNG.normal(0.0, 30.0, 400), RNG.normal(0.0, 30.0, 400))
NOISE = np.full(400, 30.0)
on_arrays(distance.true_distance, LENGTHS, NOISE)
law = on_arrays(
    distance_law.log_density,
    LENGTHS,
    NOISE,
    call=lambda v, s: distance_law.log_density(v, s, 50.0, 0.0),
    leaves_out=dict.fromkeys(("nan", "inf"), PAIRS),
)


def log_rice(v: float, s: float, d: float) -> float:
    """Bessel function by its power series in extended precision."""
    half = np.longdouble(v) * np.longdouble(d) / np.longdouble(s) ** 2 / 2
    total = term = np.longdouble(1)
    for k in range(1, 2000):
        term = term * half / k * half / k
        total += term
    wide, sd = np.longdouble(v), np.longdouble(s)
    return float(
        np.log(wide / sd**2) - (wide**2 + np.longdouble(d) ** 2) / (2 * sd**2) + np.log(total)
    )


for label, (v, s, d) in {
    "usual": (60.0, 30.0, 50.0),
    "no distance": (60.0, 30.0, 0.0),
    "little noise": (50.0, 3.0, 50.0),
    "much noise": (50.0, 1e4, 50.0),
}.items():
    case(
        law.name,
        label,
        lambda v=v, s=s, d=d: digits(  # type: ignore[misc]
            distance_law.log_density(np.array([v]), np.array([s]), d, 0.0), log_rice(v, s, d)
        ),
    )
ROD = np.column_stack((np.linspace(-200.0, 200.0, 20), 0.0 * np.arange(20.0), np.full(20, 5.0)))
on_arrays(
    attractors.shape_distance_nm,
    ROD,
    ROD + np.array([0.0, 1.0, 0.0]),
    leaves_out=dict.fromkeys(("nan", "inf", "empty"), "shapes of simulated rods"),
)
on_arrays(hot_pixels.hot_pixels_of, RNG.uniform(1.0, 2.0, (16, 16)))
on_arrays(hot_pixels.hot_limit_e, RNG.uniform(1.0, 2.0, (16, 16)))


def chain(length: float, p: float) -> float:
    """Mean square distance by its power series, for stiff chains."""
    u, total, term = length / (2.0 * p), 0.0, 1.0
    for n in range(60):
        total += term
        term *= -u / (n + 3)
    return length**2 * total


on_arrays(
    persistence.mean_square_distance,
    np.linspace(10.0, 400.0, 20),
    call=lambda length: persistence.mean_square_distance(length, 50.0),
    leaves_out={"inf": "lengths of traced rods"},
)
for label, (length, p) in {
    "stiff": (10.0, 1e9),
    "below the series' end": (19.9, 1e3),
    "above the series' end": (20.1, 1e3),
    "usual": (400.0, 100.0),
}.items():
    case(
        "afm.persistence.mean_square_distance",
        label,
        lambda length=length, p=p: digits(  # type: ignore[misc]
            persistence.mean_square_distance(np.array([length]), p), chain(length, p)
        ),
    )
FRAME = RNG.poisson(20.0, (24, 24)).astype(np.float32)
TAPS = wavelet.bspline_taps(3, 2.0).astype(np.float32)
on_arrays(
    wavelet.wavelet_planes,
    FRAME,
    call=lambda f: wavelet.wavelet_planes(f.astype(np.float32), TAPS),
    leaves_out={"float32": "frames are float32"},
)
case(
    "localise.wavelet.bspline_taps",
    "sum",
    lambda: digits(
        [wavelet.bspline_taps(n, s).sum() for n in (1, 3, 5) for s in (1.0, 2.0, 3.5)], [1.0] * 9
    ),
)
does_not_apply(
    "localise.wavelet.bspline_taps",
    ("float32", "denormals", "duplicates", "nan", "inf", "empty", "single"),
    "takes two options that are checked where they are read",
)
for photons in (1.0, 1e3, 1e8):
    case(
        "localise.precision.bound_nm",
        f"{photons:g} photons, no background",
        lambda photons=photons: digits(  # type: ignore[misc]
            precision.bound_nm(
                photons, background=1e-12, sigma_nm=135.0, pixel_size_nm=20.0, radius_px=40
            )
            * math.sqrt(photons),
            math.sqrt(135.0**2 + 20.0**2 / 12.0),
        ),
    )
