"""How far a steady rate is wrong by the field, by the number of vertices and by time stepping.

Each part is the change of the rate when its cause is made smaller or, for the field, when the field
is off by its own error. All go on from the run's last shape, so that they compare one state and not
which of several a rod falls into.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy.interpolate
from numpy.typing import NDArray

from rotortrack.errors import RodError
from rotortrack.simulate.field.sample import QUANTITIES
from rotortrack.simulate.rod.run import RodRun, run_rod

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable
    from rotortrack.simulate.rod.options import RodOptions, SteppingOptions

Array = NDArray[np.float64]

_BESIDE_THE_RIM: Final = 0.003
"""Rates on tables of other meshes and spacings differ by up to this part: they feel the field
beside the rim, of which current and flow as a whole tell nothing."""

_FINER: Final = 10.0
"""Factor by which the tolerance and the longest step are made smaller."""


@dataclass(frozen=True)
class RateBudget:
    """Relative errors of a rate; nan where a part could not be measured.

    Attributes
    ----------
    field
        Change when flow and field are off by their own errors, and 0.3 % for mesh and table.
    vertices
        Change with twice as many links, the wall as stiff per length: 20 % for 51 vertices on the
        paper's pore, whose rim the links of 9 nm hardly follow, and 0.2 % for 101.
    stepping
        Change at a tenth of the tolerance and of the longest step.
    """

    field: float
    vertices: float
    stepping: float

    @property
    def total(self) -> float:
        """Root of the sum of squares."""
        return math.sqrt(self.field**2 + self.vertices**2 + self.stepping**2)


def rate_budget(run: RodRun, field: FieldTable) -> RateBudget:
    """Measure the error budget of a steady rate.

    Parameters
    ----------
    run
        A run that ended rotating steadily, without noise.
    field
        Its field.

    Returns
    -------
    RateBudget

    Raises
    ------
    RodError
        The run does not rotate steadily.
    """
    rate = run.numbers.rate_rad_us
    if run.end.value != "rotating_steadily" or rate == 0.0:
        raise RodError("only a rod that rotates steadily has an error budget of its rate")
    stepping = dataclasses.replace(
        run.stepping, duration_us=run.simulated_us, sample_us=run.simulated_us / 400.0
    )
    last = run.positions_nm[-1]
    base = _rate(run.rod, stepping, last, field)
    finer_rod = dataclasses.replace(
        run.rod,
        n_vertices=2 * run.rod.n_vertices - 1,
        wall_stiffness_pn_nm=run.rod.wall_stiffness_pn_nm / 2.0,
    )
    finer_steps = dataclasses.replace(
        stepping,
        tolerance_nm=stepping.tolerance_nm / _FINER,
        max_step_us=stepping.max_step_us / _FINER,
    )
    return RateBudget(
        field=math.hypot(
            _change(base, _rate(run.rod, stepping, last, _off_by_its_errors(field))),
            _BESIDE_THE_RIM,
        ),
        vertices=_change(base, _rate(finer_rod, stepping, refined(last), field)),
        stepping=_change(base, _rate(run.rod, finer_steps, last, field)),
    )


def refined(x: Array) -> Array:
    """Halve all links of a chain, along a cubic spline through its vertices.

    Parameters
    ----------
    x
        Vertices, nm, shape (n, 3), all links of one length.

    Returns
    -------
    ndarray
        (2 n - 1, 3), all links half as long.
    """
    edge = float(np.linalg.norm(x[1] - x[0]))
    at = np.arange(len(x))
    fine = scipy.interpolate.CubicSpline(at, x)(np.arange(2 * len(x) - 1) / 2.0)
    links = np.diff(fine, axis=0)
    links *= edge / 2.0 / np.linalg.norm(links, axis=1, keepdims=True)
    placed = np.concatenate((np.zeros((1, 3)), np.cumsum(links, axis=0)))
    # The spline is longer than the chain: what that moves is shared by both ends.
    return np.asarray(placed + (fine - placed).mean(axis=0), np.float64)


def _rate(rod: RodOptions, stepping: SteppingOptions, start: Array, field: FieldTable) -> float:
    try:
        return run_rod(rod, stepping, start, field).numbers.rate_rad_us
    except RodError:
        return math.nan


def _off_by_its_errors(field: FieldTable) -> FieldTable:
    factors = np.ones(len(QUANTITIES))
    for k, name in enumerate(QUANTITIES):
        if name.startswith("u_"):
            factors[k] += field.flow_error_rel
        elif name.startswith("e_applied"):
            factors[k] -= field.current_error_rel
    return dataclasses.replace(field, values=field.values * factors)


def _change(base: float, other: float) -> float:
    return abs(other - base) / abs(base)
