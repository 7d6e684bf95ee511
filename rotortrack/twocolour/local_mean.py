"""Local weighted means of polynomials (Goshtasby 1988), for comparison with older work.

Each bead has a polynomial of order 2 through its nearest neighbours; a place is mapped by the mean
of those whose reach it is in, weighted by w(r) = 1 - 3 r^2 + 2 r^3, where r is the distance over
the reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rotortrack.twocolour.polynomial import Frame, parameters_of, powers

if TYPE_CHECKING:
    from rotortrack.twocolour.fit import FitOnce, Fitted

Floats = NDArray[np.float64]

_ORDER = 2


@dataclass(frozen=True)
class LocalMeanMap:
    """Many polynomials of order 2, each about one bead.

    Attributes
    ----------
    frame
        Where variables are -1 and 1.
    centres
        Places of the beads in these, (beads, 2).
    reaches
        How far each polynomial counts, in these, (beads,).
    coefficients
        Of `powers` of the way from the centre over the reach, nm, (beads, columns, 2).
    """

    frame: Frame
    centres: Floats
    reaches: Floats
    coefficients: Floats

    @property
    def name(self) -> str:
        """What it is called in reports."""
        return "local weighted mean"

    def __call__(self, points: Floats) -> Floats:
        """Map places, nm, (points, 2); out of every reach by the nearest polynomial."""
        inside = self.frame.inside(points)
        mapped = np.empty_like(inside)
        for start in range(0, len(inside), 1024):
            part = slice(start, start + 1024)
            away = inside[part, np.newaxis] - self.centres
            distance = np.hypot(away[..., 0], away[..., 1]) / self.reaches
            weights = np.where(distance < 1.0, 1.0 - 3.0 * distance**2 + 2.0 * distance**3, 0.0)
            lost = weights.sum(axis=1) <= 0.0
            weights[lost, np.argmin(distance[lost], axis=1)] = 1.0
            chosen = np.nonzero(weights)
            local = away[chosen] / self.reaches[chosen[1], np.newaxis]
            columns = powers(local, _ORDER)
            values = np.einsum("ij,ijk->ik", columns, self.coefficients[chosen[1]])
            sums = np.zeros((len(away), 2))
            np.add.at(sums, chosen[0], weights[chosen][:, np.newaxis] * values)
            mapped[part] = sums / weights.sum(axis=1)[:, np.newaxis]
        return mapped

    def as_dict(self) -> dict[str, Any]:
        """Give it for a file."""
        return {
            "kind": "local-mean",
            "frame": self.frame.as_dict(),
            "centres": self.centres.tolist(),
            "reaches": self.reaches.tolist(),
            "coefficients_nm": self.coefficients.tolist(),
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> LocalMeanMap:
        """Make it of what `as_dict` gave.

        Raises
        ------
        KeyError, TypeError, ValueError
            The content is not that of such a map.
        """
        frame = Frame(**{name: float(value) for name, value in content["frame"].items()})
        centres, reaches, coefficients = (
            np.array(content[name], np.float64)
            for name in ("centres", "reaches", "coefficients_nm")
        )
        n = len(reaches)
        if centres.shape != (n, 2) or coefficients.shape != (n, parameters_of(_ORDER), 2):
            raise ValueError("the map's polynomials")
        return cls(frame, centres, reaches, coefficients)


def fit_local_mean(neighbours: int) -> FitOnce:
    """Give the fit of local weighted means through so many neighbours each."""

    def fit_once(second: Floats, first: Floats, weights: Floats) -> Fitted:
        from rotortrack.twocolour.fit import Fitted

        used = weights > 0.0
        frame = Frame.about(second)
        mapping = _through(frame, second[used], first[used], weights[used], neighbours)
        residual = first - mapping(second)
        left_out = residual.copy()
        places = np.flatnonzero(used)
        for number, place in enumerate(places):
            others = np.delete(np.arange(places.size), number)
            without = _through(
                frame,
                second[used][others],
                first[used][others],
                weights[used][others],
                neighbours,
                near=second[place],
            )
            left_out[place] = first[place] - without(second[place : place + 1])[0]
        columns = parameters_of(_ORDER)
        effective = places.size * columns / neighbours
        return Fitted(
            mapping=mapping,
            weights=weights,
            residual=residual,
            left_out=left_out,
            parameters=effective,
            variance=lambda points: np.full(len(points), columns / neighbours),
        )

    return fit_once


def _through(
    frame: Frame,
    second: Floats,
    first: Floats,
    weights: Floats,
    neighbours: int,
    near: Floats | None = None,
) -> LocalMeanMap:
    """Fit the polynomials of all beads, or of those that may reach one place."""
    inside = frame.inside(second)
    tree = cKDTree(inside)
    centres = inside
    if near is not None:
        _, rows = tree.query(frame.inside(near), min(4 * neighbours, len(inside)))
        centres = inside[rows]
    nearest = tree.query(centres, min(neighbours + 1, len(inside)))
    distances, members = (np.asarray(found) for found in nearest)
    reaches = np.maximum(distances[:, -1], 1e-12)
    local = (inside[members] - centres[:, np.newaxis]) / reaches[:, np.newaxis, np.newaxis]
    flat = powers(local.reshape(-1, 2), _ORDER)
    columns = flat.reshape(*members.shape, flat.shape[1])
    root = np.sqrt(weights[members])[..., np.newaxis]
    normal = np.linalg.pinv(root * columns)
    coefficients: Floats = normal @ (root * first[members])
    return LocalMeanMap(frame, centres, reaches, coefficients)
