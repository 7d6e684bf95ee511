"""Branches of steadily rotating shapes: how a rotor changes with the ratio of flow to field.

A branch is a curve of shapes, rates and ratios. It is followed by its arc length and not by the
ratio, so that it can be followed round folds, where two shapes meet and neither exists beyond: the
edges of the window in which rods rotate. Method: H. B. Keller, Numerical solution of bifurcation
and nonlinear eigenvalue problems (1977).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import RodError
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import FLOW, rod_parameters
from rotortrack.simulate.rod.relative_equilibrium import (
    CONVERGED_NM,
    CONVERGED_PN,
    STILL_PER_US,
    RelativeEquilibrium,
    around_axis,
    growth_rates,
    steady_jacobian,
    steady_residual,
)

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable

Array = NDArray[np.float64]

_MOST_CORRECTIONS: Final = 8
_QUICK: Final = 3
"""Corrections after which the next step may be longer."""

_MOST_HALVINGS: Final = 30
_LONGER: Final = 1.5
_SHORTEST: Final = 1e-3
"""Part of the first step below which a branch is given up."""

_LONGEST: Final = 4.0
_STRAIGHT: Final = 0.8
"""Least cosine between the directions at two points that follow each other."""

_KINK_NM: Final = 0.05
"""Steps below this may turn more: where a vertex meets or leaves the wall, the curve has a kink."""

_BESIDE: Final = 1.1
"""A point is passed where its distances from both ends of a step sum to less than this part more
than the step."""

_FLAT: Final = 1e-6
"""Slope of the ratio that is called none."""

_SAME: Final = 1e-5
"""Force, pN, that a state may be off when a branch starts from it."""


class BranchEnd(Enum):
    """Why a branch was followed no further."""

    LIMIT = "limit"
    CLOSED = "closed"
    MOST_POINTS = "most_points"
    LOST = "lost"


@dataclass(frozen=True)
class Branch:
    """Steadily rotating shapes along a curve, in order.

    Attributes
    ----------
    flow_ratio, omega_rad_us
        Ratio of flow to effective charge, and the rate there, shape (k,).
    positions_nm
        Vertices, shape (k, n, 3).
    rates_per_us
        Complex rates at which changes of the shape grow, the largest real part first, shape
        (k, 2 n). One passes 0 at a fold; where a pair of them passes it with an imaginary part,
        the steady shape begins to pulse.
    arc_nm
        Distance along the branch: root mean square move of the vertices, and the change of the
        ratio taken for nm, shape (k,).
    ratio_slope
        Change of the ratio per arc, shape (k,): 0 at a fold.
    folds
        Indices of the points at which the ratio turns back.
    end
        Why it ends: a limit was passed, it came back to its start, enough points were found, or no
        step was short enough, as at a kink of the contact.
    """

    flow_ratio: Array
    omega_rad_us: Array
    positions_nm: Array
    rates_per_us: NDArray[np.complex128]
    arc_nm: Array
    ratio_slope: Array
    folds: NDArray[np.intp]
    end: BranchEnd

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Where all changes of the shape die out, shape (k,)."""
        return np.asarray(self.rates_per_us[:, 0].real < STILL_PER_US)


def follow_branch(
    rod: RodOptions,
    field: FieldTable,
    start: RelativeEquilibrium,
    between: tuple[float, float],
    *,
    upwards: bool = True,
    step_nm: float = 1.0,
    most_points: int = 200,
) -> Branch:
    """Follow steadily rotating shapes from one of them.

    Parameters
    ----------
    rod, field
        What the rod is, with the ratio of `start`, and the field of its pore.
    start
        From `find_equilibrium`.
    between
        Lowest and highest ratio; the branch ends with the first point beyond.
    upwards
        Whether the ratio rises at first. Behind a fold it falls.
    step_nm
        First step along the branch; those that follow are chosen by how fast they converge.
    most_points
        After which the branch ends.

    Returns
    -------
    Branch
        Its first point is `start`.

    Raises
    ------
    RodError
        The ratio of `start` is not between the limits, `start` is no state of this rod, or the rod
        has no flow to change.
    """
    if rod.lambda_eff == 0.0:
        raise RodError("without charge no ratio changes the flow: give a lambda_eff above 0")
    if not between[0] <= rod.flow_ratio <= between[1]:
        raise RodError(
            f"flow_ratio {rod.flow_ratio:g} is not between {between[0]:g} and {between[1]:g}: give "
            "limits around the state from which the branch starts"
        )
    curve = _Curve(rod, field, len(start.positions_nm))
    at = np.concatenate(
        (start.positions_nm.ravel(), start.tensions_pn, [start.omega_rad_us, rod.flow_ratio])
    )
    off = float(np.abs(curve.residual(at, at)).max())
    if not off < _SAME:
        raise RodError(
            f"the start is no steadily rotating shape of this rod and field ({off:.2g} pN are "
            "left): find it with the same options"
        )
    jacobian = curve.jacobian(at, at)
    first = np.eye(at.size)[-1] * (1.0 if upwards else -1.0)
    points = [_Point(at, curve.slope(jacobian, first), curve.rates(at, jacobian), 0.0)]
    folds = []
    step, end = step_nm, BranchEnd.MOST_POINTS
    while len(points) < most_points:
        last = points[-1]
        point, corrections = curve.go(last, step)
        if point is None:
            step /= 2.0
            if step < _SHORTEST * step_nm:
                end = BranchEnd.LOST
                break
            continue
        fold = curve.fold(last, point) if last.turns_before(point) else None
        if fold is not None:
            folds.append(len(points))
            points.append(fold)
        if len(points) > 2 and curve.passes(points[0], points[-1], point):
            points.append(curve.closing(points[0], points[-1]))
            end = BranchEnd.CLOSED
            break
        points.append(point)
        if not between[0] <= point.at[-1] <= between[1]:
            end = BranchEnd.LIMIT
            break
        if corrections <= _QUICK:
            step = min(step * _LONGER, _LONGEST * step_nm)
    states = np.array([point.at for point in points])
    n = len(start.positions_nm)
    return Branch(
        flow_ratio=states[:, -1].copy(),
        omega_rad_us=states[:, -2].copy(),
        positions_nm=states[:, : 3 * n].reshape(-1, n, 3),
        rates_per_us=np.array([point.rates for point in points]),
        arc_nm=np.array([point.arc for point in points]),
        ratio_slope=np.array([point.slope[-1] for point in points]),
        folds=np.array(folds, np.intp),
        end=end,
    )


@dataclass(frozen=True)
class _Point:
    at: Array
    slope: Array
    rates: NDArray[np.complex128]
    arc: float

    def turns_before(self, other: _Point) -> bool:
        """Whether the ratio turns back between this point, if not at it, and another."""
        return abs(self.slope[-1]) > _FLAT and bool(self.slope[-1] * other.slope[-1] < 0.0)


class _Curve:
    """The equations of a steady rotation in 4 n + 1 unknowns: vertices, tensions, rate, ratio."""

    def __init__(self, rod: RodOptions, field: FieldTable, n: int) -> None:
        self._n = n
        self._charge = rod.lambda_eff
        self._parameters = rod_parameters(rod, field)
        self._table = field.r_nm, field.z_nm, field.nodes
        # Lengths along the curve count vertices and ratio, neither tensions nor rate.
        self._weights = np.zeros(4 * n + 1)
        self._weights[: 3 * n] = 1.0 / n
        self._weights[-1] = 1.0

    def jacobian(self, at: Array, origin: Array) -> Array:
        """Give the derivatives of the residual, (4 n, 4 n + 1)."""
        n, phase = self._n, self._phase(origin)
        result = np.empty((4 * n, 4 * n + 1))
        square = np.empty((4 * n, 4 * n))
        self._parameters[FLOW] = at[-1] * self._charge
        arguments = phase, origin[: 3 * n], self._parameters, *self._table
        steady_jacobian(at[:-1].copy(), *arguments, square)
        result[:, :-1] = square
        # The force is linear in the ratio.
        result[:, -1] = self.residual(at + np.eye(at.size)[-1], origin)
        result[:, -1] -= self.residual(at, origin)
        return result

    def go(self, last: _Point, step: float) -> tuple[_Point | None, int]:
        """Point one step on, None where it is not found, and the number of corrections."""
        start, slope = last.at, last.slope
        at = start + step * slope
        across = self._weights * slope
        for corrections in range(_MOST_CORRECTIONS + 1):
            residual = self.residual(at, start)
            if not np.isfinite(residual).all():
                break
            jacobian = self.jacobian(at, start)
            forces, lengths = residual[: 3 * self._n], residual[3 * self._n :]
            if np.abs(forces).max() < CONVERGED_PN and np.abs(lengths).max() < CONVERGED_NM:
                try:
                    onward = self.slope(jacobian, slope)
                except np.linalg.LinAlgError:
                    break
                if step > _KINK_NM and onward @ across < _STRAIGHT:
                    break
                arc = last.arc + self.distance(start, at)
                return _Point(at, onward, self.rates(at, jacobian), arc), corrections
            left = np.append(residual, across @ (at - start) - step)
            try:
                move = np.asarray(np.linalg.solve(np.vstack((jacobian, across)), -left), np.float64)
            except np.linalg.LinAlgError:
                break
            if not np.isfinite(move).all() or self.distance(move, 0.0) > 2.0 * step:
                break
            at = at + move
        return None, 0

    def fold(self, low: _Point, high: _Point) -> _Point | None:
        """Point between two others at which the ratio turns back; None where it is not found."""
        begin, span = low, float((high.at - low.at) @ (self._weights * low.slope))
        left, right = 0.0, span
        low_slope, high_slope = low.slope[-1], high.slope[-1]
        for _ in range(_MOST_HALVINGS):
            # By regula falsi, its Illinois form.
            step = (left * high_slope - right * low_slope) / (high_slope - low_slope)
            point, _ = self.go(begin, step)
            if point is None or abs(point.slope[-1]) < _FLAT:
                return point
            if point.slope[-1] * high_slope > 0.0:
                right, high_slope = step, point.slope[-1]
                low_slope /= 2.0
            else:
                left, low_slope = step, point.slope[-1]
                high_slope /= 2.0
        return None

    def passes(self, first: _Point, low: _Point, high: _Point) -> bool:
        """Whether the first point of a branch, turned, lies between two others."""
        before = self.distance(self._turned(first.at, low.at), low.at)
        after = self.distance(self._turned(first.at, high.at), high.at)
        return before + after < _BESIDE * self.distance(low.at, high.at)

    def closing(self, first: _Point, last: _Point) -> _Point:
        """Give the first point again, turned to where the branch comes back to it."""
        at = self._turned(first.at, last.at)
        arc = last.arc + self.distance(last.at, at)
        return _Point(at, first.slope, first.rates, arc)

    def distance(self, one: Array, other: Array | float) -> float:
        """Distance of two points as the arc counts it."""
        return float(np.sqrt(np.sum(self._weights * (one - other) ** 2)))

    def slope(self, jacobian: Array, along: Array) -> Array:
        """Direction of the curve, of length 1, on the side of another direction."""
        matrix = np.vstack((jacobian, self._weights * along))
        result: Array = np.linalg.solve(matrix, np.eye(along.size)[-1])
        return np.asarray(result / self.distance(result, 0.0), np.float64)

    def rates(self, at: Array, jacobian: Array) -> NDArray[np.complex128]:
        """Rates at which changes of the shape grow."""
        x = at[: 3 * self._n].reshape(-1, 3)
        return growth_rates(x, self._parameters, jacobian[:, :-1])

    def residual(self, at: Array, origin: Array) -> Array:
        """Give forces, errors of length and turn against an origin, (4 n,)."""
        result = np.empty(4 * self._n)
        self._parameters[FLOW] = at[-1] * self._charge
        steady_residual(
            at[:-1].copy(),
            self._phase(origin),
            origin[: 3 * self._n],
            self._parameters,
            *self._table,
            result,
        )
        return result

    def _turned(self, at: Array, like: Array) -> Array:
        """Turn a shape about the axis until it is nearest to another."""
        n = self._n
        x, y = at[: 3 * n].reshape(n, 3), like[: 3 * n].reshape(n, 3)
        angle = np.arctan2(np.sum(around_axis(x) * y), np.sum(x[:, :2] * y[:, :2]))
        result = at.copy()
        turned = result[: 3 * n].reshape(n, 3)
        turned[:, :2] = np.cos(angle) * x[:, :2] + np.sin(angle) * around_axis(x)[:, :2]
        return result

    def _phase(self, origin: Array) -> Array:
        around = around_axis(origin[: 3 * self._n].reshape(-1, 3)).ravel()
        return np.asarray(around / np.linalg.norm(around), np.float64)
