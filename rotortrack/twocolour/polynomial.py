"""Polynomial maps of the plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HIGHEST_ORDER = 5


def parameters_of(order: int) -> int:
    """Coefficients of a polynomial of that order in each coordinate."""
    return (order + 1) * (order + 2) // 2


def powers(points: Floats, order: int) -> Floats:
    """Products of Legendre polynomials of u and v up to a total order.

    Parameters
    ----------
    points
        (points, 2), within -1 to 1: there the columns are nearly orthogonal.
    order
        Highest total order.

    Returns
    -------
    (points, columns), by order: 1, u, v, then those of order 2.
    """
    across = np.polynomial.legendre.legvander(points[:, 0], order)
    down = np.polynomial.legendre.legvander(points[:, 1], order)
    columns = [
        across[:, total - part] * down[:, part]
        for total in range(order + 1)
        for part in range(total + 1)
    ]
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class Frame:
    """The square in which maps count from -1 to 1, so that powers stay small.

    Attributes
    ----------
    x_nm, y_nm
        Its middle.
    half_nm
        Half of its side.
    """

    x_nm: float
    y_nm: float
    half_nm: float

    @classmethod
    def about(cls, points: Floats) -> Frame:
        """Give the square that holds all points."""
        low, high = points.min(axis=0), points.max(axis=0)
        middle = (low + high) / 2.0
        return cls(float(middle[0]), float(middle[1]), float(max(*(high - low) / 2.0, 1e-6)))

    def inside(self, points: Floats) -> Floats:
        """Give points, nm, in numbers from -1 to 1."""
        return (points - (self.x_nm, self.y_nm)) / self.half_nm

    def as_dict(self) -> dict[str, float]:
        """Give it for a file."""
        return {"x_nm": self.x_nm, "y_nm": self.y_nm, "half_nm": self.half_nm}


@dataclass(frozen=True)
class PolynomialMap:
    """x and y of the first colour as polynomials of a place in the second.

    Attributes
    ----------
    order
        Total order; 1 is the affine map.
    frame
        Where its variables are -1 and 1.
    coefficients
        Of `powers`, nm, (columns, 2).
    """

    order: int
    frame: Frame
    coefficients: Floats

    @property
    def name(self) -> str:
        """What it is called in reports."""
        return "affine" if self.order == 1 else f"polynomial of order {self.order}"

    def __call__(self, points: Floats) -> Floats:
        """Map places, nm, (points, 2)."""
        mapped: Floats = powers(self.frame.inside(points), self.order) @ self.coefficients
        return mapped

    def as_dict(self) -> dict[str, Any]:
        """Give it for a file."""
        return {
            "kind": "polynomial",
            "order": self.order,
            "frame": self.frame.as_dict(),
            "coefficients_nm": self.coefficients.tolist(),
        }
