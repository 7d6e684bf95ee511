"""Smoothing thin-plate splines about a polynomial."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.twocolour.polynomial import Frame, powers

Floats = NDArray[np.float64]

MOST_KNOTS = 120
_NEGLIGIBLE = 1e-9


def spread_out(points: Floats, most: int) -> NDArray[np.intp]:
    """Choose points that cover all others well: each the one farthest from those before.

    Returns
    -------
    Their rows, at most `most`; points at the same place are chosen once.
    """
    middle = points.mean(axis=0)
    chosen = [int(np.argmax(np.sum((points - middle) ** 2, axis=1)))]
    square = np.sum((points - points[chosen[0]]) ** 2, axis=1)
    while len(chosen) < min(most, len(points)):
        farthest = int(np.argmax(square))
        if square[farthest] <= 0.0:
            break
        chosen.append(farthest)
        square = np.minimum(square, np.sum((points - points[farthest]) ** 2, axis=1))
    return np.array(chosen)


def bending(points: Floats, knots: Floats, derivative: int) -> Floats:
    """Kernel of a plate that resists its derivatives of that order, (points, knots).

    r^2 log r for the second, the thin plate's; -r^4 log r for the third.
    """
    square = np.sum((points[:, np.newaxis] - knots[np.newaxis]) ** 2, axis=2)
    sign = 1.0 if derivative % 2 == 0 else -1.0
    logarithm = np.log(np.maximum(square, 1e-300))
    kernel: Floats = (0.5 * sign) * square ** (derivative - 1) * logarithm
    return kernel


@dataclass(frozen=True)
class Plate:
    """Columns of a spline for some knots: those of bending energy 1 each, free of polynomials.

    The bending energy is the natural penalty of splines (Duchon 1977); that of the polynomial up
    to `order`, which optics need anyhow, is not charged.

    Attributes
    ----------
    order
        Order of the polynomial that bends at no cost, at least `derivative` - 1.
    derivative
        Order of the derivatives whose squares are the energy: 2, or 3 for smoother maps.
    frame, knots
        Where variables are -1 and 1; the knots in these, (knots, 2).
    shapes
        (knots, columns): kernels make up columns by these.
    """

    order: int
    derivative: int
    frame: Frame
    knots: Floats
    shapes: Floats

    @classmethod
    def at(cls, knots_nm: Floats, frame: Frame, order: int, derivative: int) -> Plate:
        """Make the columns; there are more knots than the polynomial has coefficients."""
        knots = frame.inside(knots_nm)
        basis = powers(knots, order)
        rest = np.linalg.qr(basis, "complete")[0][:, basis.shape[1] :]
        energy, axes = np.linalg.eigh(rest.T @ bending(knots, knots, derivative) @ rest)
        kept = energy > _NEGLIGIBLE * energy.max(initial=0.0)
        shapes = rest @ axes[:, kept] / np.sqrt(energy[kept])
        return cls(order, derivative, frame, knots, shapes)

    def free(self, points: Floats) -> Floats:
        """Columns of the polynomial."""
        return powers(self.frame.inside(points), self.order)

    def bent(self, points: Floats) -> Floats:
        """Columns of bending energy 1."""
        inside = self.frame.inside(points)
        columns: Floats = bending(inside, self.knots, self.derivative) @ self.shapes
        return columns


@dataclass(frozen=True)
class SplineMap:
    """A polynomial and the bending of a thin plate held at knots.

    Attributes
    ----------
    order, frame, coefficients
        As of a polynomial map.
    derivative
        Order of the derivatives that the plate resists.
    knots
        Within -1 to 1, (knots, 2).
    weights
        Of their kernels, nm, (knots, 2).
    """

    order: int
    derivative: int
    frame: Frame
    coefficients: Floats
    knots: Floats
    weights: Floats

    @property
    def name(self) -> str:
        """What it is called in reports."""
        kind = "thin-plate spline" if self.derivative == 2 else "smoother spline"
        return f"{kind} about a polynomial of order {self.order}"

    def __call__(self, points: Floats) -> Floats:
        """Map places, nm, (points, 2)."""
        inside = self.frame.inside(points)
        mapped: Floats = powers(inside, self.order) @ self.coefficients
        for start in range(0, len(points), 4096):
            part = slice(start, start + 4096)
            mapped[part] += bending(inside[part], self.knots, self.derivative) @ self.weights
        return mapped

    def as_dict(self) -> dict[str, Any]:
        """Give it for a file."""
        return {
            "kind": "spline",
            "order": self.order,
            "derivative": self.derivative,
            "frame": self.frame.as_dict(),
            "coefficients_nm": self.coefficients.tolist(),
            "knots": self.knots.tolist(),
            "weights_nm": self.weights.tolist(),
        }
