"""Compile all that a simulated rod needs, before it is needed."""

from __future__ import annotations

import contextlib

import numpy as np

from rotortrack.errors import RodError
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.field.sample import sample_fields
from rotortrack.simulate.rod.balance import force_balance
from rotortrack.simulate.rod.contact import contact_energy
from rotortrack.simulate.rod.elasticity import bending_energy
from rotortrack.simulate.rod.options import (
    RodOptions,
    StartOptions,
    SteppingOptions,
    ThermalOptions,
)
from rotortrack.simulate.rod.parameters import rod_parameters
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.relative_equilibrium import find_equilibrium
from rotortrack.simulate.rod.run import run_rod


def compile_kernels() -> None:
    """Run every kernel of rods and fields once, on next to nothing.

    Raises
    ------
    ArchiveError
        The table that comes with the package cannot be read.
    """
    rod, field = RodOptions(), embedded_table()
    start = place_rod(rod, StartOptions(), membrane_nm=field.membrane_nm)
    brief = SteppingOptions(duration_us=1e-3, sample_us=1e-3)
    run_rod(rod, brief, start, field)
    run_rod(rod, brief, start, field, ThermalOptions())
    force_balance(start, rod, field)
    parameters = rod_parameters(rod, field)
    bending_energy(start, parameters)
    contact_energy(start, parameters)
    sample_fields(field.r_nm, field.z_nm, field.nodes, start, np.empty((len(start), 4, 3)))
    # A straight rod is near no rotating shape; the search has compiled what it needs by then.
    with contextlib.suppress(RodError):
        find_equilibrium(rod, field, start)
