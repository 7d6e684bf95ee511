"""Maps through pairs of beads: several kinds are fitted, that which predicts best is taken."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import RegistrationError
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.polynomial import (
    HIGHEST_ORDER,
    Frame,
    PolynomialMap,
    parameters_of,
    powers,
)
from rotortrack.twocolour.robust import bounded, scale_of, tukey
from rotortrack.twocolour.smoother import Smoother, Solution
from rotortrack.twocolour.thin_plate import MOST_KNOTS, Plate, SplineMap, spread_out

Floats = NDArray[np.float64]

_PLATES = ((2, 1), (2, 3), (3, 3))
"""Derivative that is resisted, and order of the polynomial that is free."""

_STIFFNESSES = 10.0 ** np.arange(-9.0, 5.0, 0.5)
_POINTS_A_PARAMETER = 2
_ROUNDS = 10
_SETTLED = 1e-3
_WORTH = 0.5
"""Standard errors by which a map must predict better than a simpler one."""


class Map(Protocol):
    """A map from places of the second colour to those of the first, nm."""

    @property
    def name(self) -> str:
        """What it is called in reports."""

    def __call__(self, points: Floats) -> Floats:
        """Map places, (points, 2)."""

    def as_dict(self) -> dict[str, Any]:
        """Give it for a file."""


@dataclass(frozen=True)
class Fitted:
    """A map and what its beads tell of it.

    Attributes
    ----------
    mapping
        The map.
    weights
        Of the pairs; 0 where a pair is taken for a mismatch.
    residual, left_out
        Residuals of pairs from the map, and from the one without that pair, nm, (pairs, 2).
    parameters
        Effective parameters of a coordinate.
    variance
        Gives the variance of the map at places for noise of variance 1.
    """

    mapping: Map
    weights: Floats
    residual: Floats
    left_out: Floats
    parameters: float
    variance: Callable[[Floats], Floats]

    @property
    def used(self) -> NDArray[np.bool_]:
        """Pairs that are not taken for mismatches."""
        return self.weights > 0.0

    @property
    def noise_nm(self) -> float:
        """Standard deviation of a coordinate of a pair about the map."""
        used = self.used
        freedom = max(int(used.sum()) - self.parameters, 1.0)
        return float(np.sqrt(0.5 * np.sum(self.residual[used] ** 2) / freedom))


def best_map(second: Floats, first: Floats, options: RegisterOptions) -> tuple[Fitted, Fitted]:
    """Fit the kinds of maps that `options` allow and take the best.

    Each is judged by how well it predicts beads that it has not seen; of several that do so
    equally well the simplest is taken.

    Parameters
    ----------
    second, first
        Places of the beads in both colours, nm, (pairs, 2), some of them mismatched.
    options
        Kind and order of the map.

    Returns
    -------
    The best, and the most telling one of the noise: the best of all kinds.

    Raises
    ------
    RegistrationError
        There are fewer than two beads for each parameter.
    """
    robust = start(second, first)
    scale = scale_of(robust.residual, robust.parameters)
    wanted = list(_kinds(len(second), options))
    if not wanted:
        _refuse_few(len(second), options)
    chosen = [fit_once(second, first, robust.weights) for fit_once in wanted]
    fits = chosen
    if options.model != "auto" or options.order is not None:
        every = _kinds(len(second), RegisterOptions())
        fits = [fit_once(second, first, robust.weights) for fit_once in every] + chosen
    scale = min([scale, *(scale_of(fit.left_out) for fit in fits)])
    return _pick(chosen, scale), _pick(fits, scale)


def start(second: Floats, first: Floats) -> Fitted:
    """Fit a polynomial of low order that mismatches do not pull: least lengths, then Tukey's."""
    order = max(o for o in (1, 2, 3) if o == 1 or 4 * parameters_of(o) <= len(second))
    frame = Frame.about(second)
    columns = powers(frame.inside(second), order)
    weights = np.ones(len(second))
    for _ in range(_ROUNDS):
        solution = _solve(columns, first, weights)
        length = np.hypot(*solution.residual.T)
        weights = 1.0 / np.maximum(length, 0.1 * np.median(length) + 1e-9)
        weights /= weights.max()
    weights = tukey(solution.residual, scale_of(solution.residual, columns.shape[1]))
    return fit_polynomial(order)(second, first, weights)


FitOnce = Callable[[Floats, Floats, Floats], Fitted]


def _kinds(n: int, options: RegisterOptions) -> Iterator[FitOnce]:
    """Give the kinds of maps that may be tried with n beads, simplest first."""
    model = "polynomial" if options.order and options.model == "auto" else options.model
    if model == "affine":
        orders: tuple[int, ...] = (1,)
    elif model in ("auto", "polynomial"):
        orders = (options.order,) if options.order else tuple(range(1, HIGHEST_ORDER + 1))
    else:
        orders = ()
    for order in orders:
        if n >= _POINTS_A_PARAMETER * parameters_of(order):
            yield fit_polynomial(order)
    if model in ("auto", "spline"):
        for derivative, order in _PLATES:
            if n >= 4 * parameters_of(order) and options.order in (None, order):
                yield fit_spline(order, derivative)
    if model == "local-mean" and n >= 2 * options.neighbours:
        from rotortrack.twocolour.local_mean import fit_local_mean

        yield fit_local_mean(options.neighbours)


def _refuse_few(n: int, options: RegisterOptions) -> None:
    if options.model == "local-mean":
        need, what = 2 * options.neighbours, f"a local mean of {options.neighbours}"
    elif options.model == "spline":
        need, what = 4 * parameters_of(options.order or 1), "a spline"
    else:
        order = 1 if options.model == "affine" else options.order or 1
        need = _POINTS_A_PARAMETER * parameters_of(order)
        what = "an affine map" if order == 1 else f"a polynomial of order {order}"
    raise RegistrationError(
        "too few beads",
        f"{n} beads are seen in both colours, but {what} needs {need}, two a parameter: film more "
        "beads or stage positions, or choose a simpler --model",
    )


def _pick(fits: list[Fitted], scale: float) -> Fitted:
    """Take the simplest of those that predict as well as the best."""
    losses = [bounded(fit.left_out, scale) for fit in fits]
    best = min(losses, key=lambda loss: float(loss.mean()))
    for fit, loss in zip(fits, losses, strict=True):
        excess = loss - best
        if excess.mean() <= _WORTH * excess.std() / np.sqrt(len(excess)):
            return fit
    raise AssertionError("the best is as good as itself")


def fit_polynomial(order: int) -> FitOnce:
    """Give the robust least-squares fit of a polynomial."""

    def fit_once(second: Floats, first: Floats, weights: Floats) -> Fitted:
        frame = Frame.about(second)
        columns = powers(frame.inside(second), order)
        solution, weights = _settle(lambda w: _solve(columns, first, w), weights, columns.shape[1])
        covariance = solution.covariance
        return Fitted(
            mapping=PolynomialMap(order, frame, solution.free),
            weights=weights,
            residual=solution.residual,
            left_out=solution.left_out,
            parameters=solution.parameters,
            variance=lambda points: _variance(powers(frame.inside(points), order), covariance),
        )

    return fit_once


def fit_spline(order: int, derivative: int) -> FitOnce:
    """Give the robust smoothing spline whose stiffness predicts left-out beads best."""

    def fit_once(second: Floats, first: Floats, weights: Floats) -> Fitted:
        frame = Frame.about(second)
        knots = second[weights > 0.0]
        plate = Plate.at(knots[spread_out(knots, MOST_KNOTS)], frame, order, derivative)
        free, bent = plate.free(second), plate.bent(second)

        def solve(weights: Floats) -> Solution:
            smoother = Smoother(free, bent, weights)
            used = weights > 0.0
            most = used.sum() / _POINTS_A_PARAMETER
            solutions = [smoother.solve(first, stiffness) for stiffness in _STIFFNESSES]
            # Two beads a parameter here, too: a map through every bead knows nothing of noise.
            allowed = [s for s in solutions if s.parameters <= most] or solutions[-1:]
            return min(allowed, key=lambda s: float(np.mean(s.left_out[used] ** 2)))

        solution, weights = _settle(solve, weights, None)
        covariance = solution.covariance

        def variance(points: Floats) -> Floats:
            return _variance(np.hstack([plate.free(points), plate.bent(points)]), covariance)

        return Fitted(
            mapping=SplineMap(
                order,
                derivative,
                frame,
                solution.free,
                plate.knots,
                plate.shapes @ solution.penalised,
            ),
            weights=weights,
            residual=solution.residual,
            left_out=solution.left_out,
            parameters=solution.parameters,
            variance=variance,
        )

    return fit_once


def _solve(columns: Floats, first: Floats, weights: Floats) -> Solution:
    return Smoother(columns, np.zeros((len(columns), 0)), weights).solve(first, 1.0)


def _settle(
    solve: Callable[[Floats], Solution], weights: Floats, parameters: int | None
) -> tuple[Solution, Floats]:
    """Repeat a fit with weights by its own residuals until they stay."""
    for _ in range(_ROUNDS):
        solution = solve(weights)
        count = solution.parameters if parameters is None else parameters
        renewed = tukey(solution.residual, scale_of(solution.residual, count))
        settled = np.abs(renewed - weights).max() < _SETTLED
        weights = renewed
        if settled:
            break
    return solve(weights), weights


def _variance(columns: Floats, covariance: Floats) -> Floats:
    spread: Floats = np.einsum("ij,jk,ik->i", columns, covariance, columns, optimize=True)
    return np.maximum(spread, 0.0)
