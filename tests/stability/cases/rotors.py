"""Hard cases of clusters and circles."""

from __future__ import annotations

import math

import numpy as np
from cases.registry import case, digits, on_arrays, on_numbers

from rotortrack.rotors import circle, cluster, ring, ring_likelihood, two_rings

RNG = np.random.default_rng(20260902)
TURN = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
RADIUS = 100.0 + RNG.normal(0.0, 8.0, 400)
X, Y = RADIUS * np.cos(TURN), RADIUS * np.sin(TURN)
GIVEN = "positions without a value are left out before"


def shape(x: np.ndarray, y: np.ndarray, method: str = "hyper") -> np.ndarray:
    found = circle.fit_circle(x, y, method)  # type: ignore[arg-type]
    return np.array([found.x_nm, found.y_nm, found.radius_nm])


def how_it_ended(x: np.ndarray, y: np.ndarray) -> str:
    return circle.fit_circle(x, y).end.name.lower()


fit = on_arrays(circle.fit_circle, X, Y)
for method in ("auto", "hyper", "kasa", "pratt", "taubin", "geometric"):
    for size in (1e-9, 1e9):
        case(
            fit.name,
            f"scale {size:g}, {method}",
            lambda method=method, size=size: digits(  # type: ignore[misc]
                shape(X * size, Y * size, method),
                size * shape(X, Y, method),
                size=100.0 * size,
            ),
        )
    case(
        fit.name,
        f"translation 1e8, {method}",
        lambda method=method: digits(  # type: ignore[misc]
            shape(np.round(X * 2**20) / 2**20 + 1e8, np.round(Y * 2**20) / 2**20 - 1e8, method)
            - [1e8, -1e8, 0.0],
            shape(np.round(X * 2**20) / 2**20, np.round(Y * 2**20) / 2**20, method),
            size=100.0,
        ),
    )
    case(
        fit.name,
        f"rotation, {method}",
        lambda method=method: digits(  # type: ignore[misc]
            shape(0.6 * X - 0.8 * Y, 0.8 * X + 0.6 * Y, method),
            np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]) @ shape(X, Y, method),
            size=100.0,
        ),
    )
    case(
        fit.name,
        f"permutation, {method}",
        lambda method=method: digits(  # type: ignore[misc]
            shape(X[::-1], Y[::-1], method), shape(X, Y, method), size=100.0
        ),
    )
for degrees in (180.0, 90.0, 30.0):
    arc = np.radians(np.linspace(0.0, degrees, 200))
    case(
        fit.name,
        f"exact arc of {degrees:g} degrees",
        lambda arc=arc: digits(  # type: ignore[misc]
            shape(100.0 * np.cos(arc), 100.0 * np.sin(arc)), [0.0, 0.0, 100.0], size=100.0
        ),
    )
for degrees in (3.0, 0.3):
    tiny = np.radians(np.linspace(0.0, degrees, 200))
    case(
        fit.name,
        f"exact arc of {degrees:g} degrees",
        lambda arc=tiny: (  # type: ignore[misc]
            f"answers: {how_it_ended(100.0 * np.cos(arc), 100.0 * np.sin(arc))}"
        ),
    )
case(
    fit.name,
    "collinear",
    lambda: f"answers: {how_it_ended(TURN, 3.0 * TURN)}",
)
on_arrays(circle.occupied_arc_deg, TURN, leaves_out={"nan": GIVEN, "inf": GIVEN})
labels = on_arrays(
    cluster.cluster,
    X,
    Y,
    call=lambda x, y: cluster.cluster(x, y, 30.0),
)
for size in (1e-9, 1e9):
    case(
        labels.name,
        f"scale {size:g}",
        lambda size=size: digits(  # type: ignore[misc]
            cluster.cluster(X * size, Y * size, 30.0 * size), cluster.cluster(X, Y, 30.0)
        ),
    )
case(
    labels.name,
    "translation 1e8",
    lambda: digits(cluster.cluster(X + 1e8, Y - 1e8, 30.0), cluster.cluster(X, Y, 30.0)),
)
on_numbers(
    cluster.percolation_margin,
    [1e-5, 50.0],
    lambda n, d: 4.51 / (math.pi * d**2) / n,
)
on_arrays(cluster.background_density, X, Y)
on_arrays(ring.ring_evidence, X, Y, call=lambda x, y: ring.ring_evidence(x, y, 0.0, 0.0))
on_arrays(
    ring_likelihood.fit_ring,
    X,
    Y,
    call=lambda x, y: ring_likelihood.fit_ring(x, y, (0.0, 0.0, 100.0)),
    leaves_out={
        "nan": GIVEN,
        "inf": GIVEN,
        "denormals": "its one caller scales positions to a size of 1",
        "empty": "its one caller refuses fewer than three positions",
    },
)
on_arrays(
    two_rings.two_rings,
    X,
    Y,
    call=lambda x, y: two_rings.two_rings(x, y, (0.0, 0.0, 100.0)),
    leaves_out={"nan": GIVEN, "inf": GIVEN},
)
