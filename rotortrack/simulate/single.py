"""One rod of a scene: where it starts, how it moves, what is seen of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rotortrack.simulate.rod.observe import Observation, observe_run
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import RodRun, run_rod

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable
    from rotortrack.simulate.rod.options import (
        RodOptions,
        StartOptions,
        SteppingOptions,
        ThermalOptions,
    )


@dataclass(frozen=True)
class Simulated:
    """A run and what is seen of it."""

    run: RodRun
    seen: Observation


def simulate_rod(
    rod: RodOptions,
    start: StartOptions,
    stepping: SteppingOptions,
    field: FieldTable | None = None,
    thermal: ThermalOptions | None = None,
) -> Simulated:
    """Place a rod, integrate it and observe its end.

    Parameters
    ----------
    rod, start, stepping
        Sections of the scene.
    field
        Field, flow and wall; None for a free rod.
    thermal
        Thermal noise; None for none.

    Raises
    ------
    RodError
        The rod cannot be integrated.
    """
    membrane_nm = 0.0 if field is None else field.membrane_nm
    placed = place_rod(rod, start, membrane_nm=membrane_nm)
    run = run_rod(rod, stepping, placed, field, thermal)
    return Simulated(run, observe_run(run, rod, field))
