"""How a run of a rod ends, and by which numbers that is decided.

The paper names docking, rotation, translocation and rods that never dock, but no thresholds. Those
used here are named below, and the numbers that were compared with them are part of every result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.rod.contact import deepest_nm
from rotortrack.simulate.rod.parameters import (
    HALF_MEMBRANE_NM,
    PORE_RADIUS_NM,
    ROD_RADIUS_NM,
    WALL,
)

HOVER_NM = 1.0
"""A rod whose lowest point floats this far above its contact with the membrane has not docked."""

AWAY_RADII = 2.0
"""A rod all of which is farther from the pore's mouth than this many pore radii has not docked."""

TRANSLOCATED_PART = 0.5
"""A rod with more of its vertices than this below the trans face has translocated."""

SIGNED_DISTANCE = 2.0
"""Walls from this reading on have an inside; the paper's pushes upwards only and has none."""

STILL_REV_S = 10.0
"""Slowest rotation that is called one, rev/s."""

STEADY_PART = 0.2
"""The mean rates of the last two quarters of a steady rotation differ by less than this part."""


class RodEnd(Enum):
    """How a run ended; the value is the word in tables and files."""

    TIME_REACHED = "time_reached"
    DOCKED_STILL = "docked_still"
    ROTATING_STEADILY = "rotating_steadily"
    TRANSLOCATED = "translocated"
    NOT_DOCKED = "not_docked"
    IN_MEMBRANE = "in_membrane"
    STEP_LIMIT = "step_limit"

    @property
    def sentence(self) -> str:
        """What it means, as shown to the user, with what to try."""
        return _SENTENCES[self]


_SENTENCES = {
    RodEnd.TIME_REACHED: "The time is over and the rod still changes shape or speed, or is free: "
    "give a longer duration_us if a steady state is sought.",
    RodEnd.DOCKED_STILL: "The rod lies on the pore and does not turn.",
    RodEnd.ROTATING_STEADILY: "The rod lies on the pore and turns at a steady rate.",
    RodEnd.TRANSLOCATED: "The rod went through the pore: give a larger flow_ratio or a smaller "
    "lambda_eff to keep it.",
    RodEnd.NOT_DOCKED: "The rod floats above the pore or beside it: give a smaller flow_ratio or "
    "start nearer to the pore.",
    RodEnd.IN_MEMBRANE: "The rod was pressed into the membrane, deeper than its radius, and what "
    "came then means nothing: give a larger wall_stiffness_pn_nm.",
    RodEnd.STEP_LIMIT: "max_steps was reached before duration_us: give more steps, a larger "
    "tolerance_nm or a shorter duration.",
}


@dataclass(frozen=True, kw_only=True)
class EndNumbers:
    """What the end was decided by.

    Parameters
    ----------
    rate_rad_us
        Friction-weighted rate of rotation about the pore's axis at the end: over the last stretch
        of a settled run, else over the last quarter. Positive counter-clockwise seen from cis.
    previous_rate_rad_us
        The same over the stretch, or quarter, before.
    lowest_nm
        Height of the lowest vertex above the membrane's cis face; nan without a membrane.
    nearest_nm
        Distance of the nearest vertex from the centre of the pore's cis mouth; nan without one.
    approach_nm
        How much nearer that is than a quarter of the run earlier.
    trans_part
        Part of the vertices below the trans face.
    deepest_nm
        How deep the rod's axis went into the membrane in any sample, negative where it stayed
        outside; nan without a membrane.
    deformation_nm_us
        Largest speed of a vertex against the rigid rotation, over the last stretch; nan where the
        run did not watch for it.
    settled
        Whether the shape had stopped changing.
    """

    rate_rad_us: float
    previous_rate_rad_us: float
    lowest_nm: float
    nearest_nm: float
    approach_nm: float
    trans_part: float
    deepest_nm: float
    deformation_nm_us: float
    settled: bool

    @property
    def rate_rev_s(self) -> float:
        """Rate of rotation in revolutions per second."""
        return self.rate_rad_us * 1e6 / (2.0 * math.pi)


def end_numbers(
    time_us: NDArray[np.float64],
    positions_nm: NDArray[np.float64],
    turned_rad: NDArray[np.float64],
    rod: NDArray[np.float64],
    *,
    settled_us: float = math.nan,
    deformation_nm_us: float = math.nan,
) -> EndNumbers:
    """Measure what decides how a run ended.

    Parameters
    ----------
    time_us, positions_nm, turned_rad
        Samples of the run: shapes (k,), (k, n, 3), (k,).
    rod
        Parameters of the rod; without a pore in them the distances are nan.
    settled_us
        Length of the last stretch in which the shape stood still in the rotating frame; nan where
        it never did.
    deformation_nm_us
        Its speed of deformation.
    """
    settled = math.isfinite(settled_us)
    span = settled_us if settled else (time_us[-1] - time_us[0]) / 4.0
    ends = time_us[-1] - span * np.arange(3)
    turned = np.interp(ends, time_us, turned_rad)
    rates = (turned[:-1] - turned[1:]) / span if span > 0.0 else np.full(2, math.nan)
    lowest = nearest = approach = deepest = math.nan
    trans_part = 0.0
    if rod[PORE_RADIUS_NM] > 0.0:
        mouth = np.array([0.0, 0.0, rod[HALF_MEMBRANE_NM]])
        earlier = np.searchsorted(time_us, time_us[0] + 0.75 * (time_us[-1] - time_us[0]))
        last = positions_nm[-1] - mouth
        lowest = float(last[:, 2].min())
        nearest = float(np.linalg.norm(last, axis=1).min())
        before = positions_nm[min(earlier, len(time_us) - 1)] - mouth
        approach = float(np.linalg.norm(before, axis=1).min()) - nearest
        trans_part = float(np.mean(last[:, 2] < -2.0 * rod[HALF_MEMBRANE_NM]))
        deepest = float(deepest_nm(np.ascontiguousarray(positions_nm), rod))
    return EndNumbers(
        rate_rad_us=float(rates[0]),
        previous_rate_rad_us=float(rates[1]),
        lowest_nm=lowest,
        nearest_nm=nearest,
        approach_nm=approach,
        trans_part=trans_part,
        deepest_nm=deepest,
        deformation_nm_us=deformation_nm_us,
        settled=settled,
    )


def classify_end(
    numbers: EndNumbers, rod: NDArray[np.float64], *, time_is_over: bool = True
) -> RodEnd:
    """Name the end of a run by its numbers.

    Parameters
    ----------
    numbers
        From `end_numbers`.
    rod
        Parameters of the rod; without a pore the end is a matter of time alone.
    time_is_over
        Whether the run reached its end, by time or by settling, and not by running out of steps.
    """
    if numbers.trans_part > TRANSLOCATED_PART:
        return RodEnd.TRANSLOCATED
    if not time_is_over:
        return RodEnd.STEP_LIMIT
    if rod[PORE_RADIUS_NM] == 0.0:
        return RodEnd.TIME_REACHED
    if rod[WALL] >= SIGNED_DISTANCE and numbers.deepest_nm > rod[ROD_RADIUS_NM]:
        return RodEnd.IN_MEMBRANE
    if (
        numbers.lowest_nm > rod[ROD_RADIUS_NM] + HOVER_NM
        or numbers.nearest_nm > AWAY_RADII * rod[PORE_RADIUS_NM]
    ):
        on_its_way = not numbers.settled and numbers.approach_nm > HOVER_NM
        return RodEnd.TIME_REACHED if on_its_way else RodEnd.NOT_DOCKED
    rate, previous = numbers.rate_rad_us, numbers.previous_rate_rad_us
    if max(abs(rate), abs(previous)) < STILL_REV_S * 2e-6 * math.pi:
        return RodEnd.DOCKED_STILL
    if numbers.settled or abs(rate - previous) < STEADY_PART * abs(previous):
        return RodEnd.ROTATING_STEADILY
    return RodEnd.TIME_REACHED
