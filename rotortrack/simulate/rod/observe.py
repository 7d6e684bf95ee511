"""What is measured on a simulated rod: its rate, its ends, its shape, torque, friction and power.

All are means over the last quarter of a run, or values at its last shape where they are shapes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.rod.balance import force_balance
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import friction_prefactor
from rotortrack.simulate.rod.shape import chirality, shape_class

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable
    from rotortrack.simulate.rod.run import RodRun

Array = NDArray[np.float64]

DYES_NM: Final = (20.0, 40.0)
"""Lengths of the rod that carry the dyes of its first and of its last end."""

_LAST_PART: Final = 0.25
_PER_SECOND: Final = 1e6
_CHIRAL: Final = 1e-3
"""Smallest chirality that has a hand."""


@dataclass(frozen=True)
class Observation:
    """Numbers of one run.

    Attributes
    ----------
    rate_rev_s
        Signed rate, weighted by friction: exact for a shape that only turns. Counter-clockwise
        seen from cis is positive.
    rate_tip_rev_s, rate_last_tip_rev_s
        The rate at which a microscope sees the first and the last end go round the pore's axis;
        nan where an end passes the axis or half a turn between two samples.
    end_to_end_nm, end_to_end_xy_nm
        Mean distance of the two ends, and as seen from above.
    end_to_end_dyes_nm, end_to_end_dyes_xy_nm
        The same between the centres of the two dye clouds.
    shape, handedness
        Class of the last shape; the sign of its chirality, 0 for none.
    torque_pn_nm
        Torque of field, flow and salt about the axis at the last shape.
    friction_pn_nm_s
        Rotational friction of the last shape.
    power_pn_nm_s
        Friction times the square of the rate: what turning dissipates.
    """

    rate_rev_s: float
    rate_tip_rev_s: float
    rate_last_tip_rev_s: float
    end_to_end_nm: float
    end_to_end_xy_nm: float
    end_to_end_dyes_nm: float
    end_to_end_dyes_xy_nm: float
    shape: str
    handedness: int
    torque_pn_nm: float
    friction_pn_nm_s: float
    power_pn_nm_s: float


def observe_run(run: RodRun, rod: RodOptions, field: FieldTable | None = None) -> Observation:
    """Measure a run.

    Parameters
    ----------
    run
        Samples of time, shape and angle.
    rod, field
        What was simulated.

    Returns
    -------
    Observation
    """
    begin = run.time_us[-1] - _LAST_PART * (run.time_us[-1] - run.time_us[0])
    late = run.time_us >= begin
    positions, last = run.positions_nm[late], run.positions_nm[-1]
    tips = [tip_rate_rev_s(run.time_us[late], positions[:, end]) for end in (0, -1)]
    ends = positions[:, -1] - positions[:, 0]
    dyes = dye_centres_nm(positions, rod.length_nm, DYES_NM)
    clouds = dyes[:, 1] - dyes[:, 0]
    friction = rotational_friction_pn_nm_s(last, rod.viscosity_mpa_s, friction_prefactor(rod))
    rate = run.numbers.rate_rev_s
    hand = chirality(last)
    return Observation(
        rate_rev_s=rate,
        rate_tip_rev_s=tips[0],
        rate_last_tip_rev_s=tips[1],
        end_to_end_nm=_mean_length(ends),
        end_to_end_xy_nm=_mean_length(ends[:, :2]),
        end_to_end_dyes_nm=_mean_length(clouds),
        end_to_end_dyes_xy_nm=_mean_length(clouds[:, :2]),
        shape=shape_class(last),
        handedness=int(np.sign(hand)) if abs(hand) > _CHIRAL else 0,
        torque_pn_nm=torque_pn_nm(last, force_balance(last, rod, field).driving),
        friction_pn_nm_s=friction,
        power_pn_nm_s=friction * (2.0 * math.pi * rate) ** 2,
    )


def tip_rate_rev_s(time_us: Array, tip_nm: Array) -> float:
    """Give the rate at which one end is seen to go round the axis.

    Parameters
    ----------
    time_us, tip_nm
        (k,) and (k, 3).

    Returns
    -------
    float
        From the first and the last angle, unwrapped; nan where a step is above 90 degrees, since a
        longer one cannot be told from one the other way, or for fewer than two samples.
    """
    if len(time_us) < 2:
        return math.nan
    angle = np.arctan2(tip_nm[:, 1], tip_nm[:, 0])
    steps = (np.diff(angle) + math.pi) % (2.0 * math.pi) - math.pi
    if np.abs(steps).max() > math.pi / 2.0:
        return math.nan
    seconds = float(time_us[-1] - time_us[0]) / _PER_SECOND
    return float(steps.sum()) / (2.0 * math.pi * seconds)


def dye_centres_nm(positions_nm: Array, length_nm: float, dyes_nm: tuple[float, float]) -> Array:
    """Give the centres of the dyes at both ends.

    Parameters
    ----------
    positions_nm
        Vertices, nm, shape (..., n, 3).
    length_nm
        Contour length of the rod.
    dyes_nm
        Lengths from the first and from the last end over which dyes are spread evenly.

    Returns
    -------
    ndarray
        (..., 2, 3) nm.
    """
    n = positions_nm.shape[-2]
    at = np.linspace(0.0, length_nm, n)
    weights = np.stack([_line_weights(at, dyes_nm[0]), _line_weights(at, dyes_nm[1])[::-1]])
    return np.asarray(weights @ positions_nm, np.float64)


def rotational_friction_pn_nm_s(
    x: Array, viscosity_mpa_s: float = 1.0, prefactor: float = math.pi
) -> float:
    """Give the friction of a shape that turns about the axis.

    xi = prefactor eta int r^2 ((t . e_phi)^2 / 2 + 1 - (t . e_phi)^2) dl, with prefactor pi by the
    paper's Note 2 and 3 pi by its Note 4.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3).
    viscosity_mpa_s
        Viscosity of the water.
    prefactor
        Friction across the rod per length and viscosity.

    Returns
    -------
    float
        pN nm s; prefactor eta L^3 / 12 for a straight rod that turns about its middle.
    """
    edges = np.diff(x, axis=0)
    length = np.linalg.norm(edges, axis=1)
    tangent = edges / length[:, np.newaxis]
    total = 0.0
    # Simpson's rule is exact for r^2 along a straight segment.
    for part, weight in ((0.0, 1.0), (0.5, 4.0), (1.0, 1.0)):
        place = x[:-1] + part * edges
        square = place[:, 0] ** 2 + place[:, 1] ** 2
        # r (t . e_phi) needs no direction e_phi, which the axis does not have.
        around = place[:, 0] * tangent[:, 1] - place[:, 1] * tangent[:, 0]
        total += weight / 6.0 * float(np.sum((square - around**2 / 2.0) * length))
    return prefactor * viscosity_mpa_s * 1e-3 * total / _PER_SECOND


def torque_pn_nm(x: Array, force_pn: Array) -> float:
    """Give the torque about the axis of forces on vertices, both of shape (n, 3)."""
    return float(np.sum(x[:, 0] * force_pn[:, 1] - x[:, 1] * force_pn[:, 0]))


def _mean_length(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=-1).mean())


def _line_weights(at: Array, covered: float) -> Array:
    """Weights of vertices for the mean over the first `covered` nm of the chain.

    Between vertices the chain is straight, so that the mean is an integral of its hat functions.
    """
    edge = at[1] - at[0]
    weights = np.zeros(at.size)
    for i in range(at.size - 1):
        part = min(max((covered - at[i]) / edge, 0.0), 1.0)
        weights[i] += part - part**2 / 2.0
        weights[i + 1] += part**2 / 2.0
    return np.asarray(weights / weights.sum(), np.float64)
