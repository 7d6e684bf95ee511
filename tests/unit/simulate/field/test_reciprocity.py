"""Onsager's reciprocity: near equilibrium each drive moves what the others drive, equally.

Drives are a pressure, a voltage and a salt gradient across the pore; what they move is the volume,
the charge and the salt beyond that which the volume carries along. In the dissipation

    Q dp + (N+ - N-) kT dphi + (N+ + N- - 2 c Q) kT d(ln c)

they are conjugate, so that the table of answers is symmetric and positive. The solver knows nothing
of that: electroosmosis comes from the force on the water, the streaming current from the ions that
the water carries.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.pnp import PER_NM3_PER_MM, PoissonNernstPlanck
from rotortrack.simulate.field.solve import field_grid, solve_on
from rotortrack.simulate.field.stokes import Stokes, excess_force

SMALL = 0.02
"""Drive in kT; answers are odd in it, so that they bend by its square."""

WIDE = FieldOptions(voltage_v=0.0, box_radius_nm=200.0, box_height_nm=400.0)
NARROW = FieldOptions(
    voltage_v=0.0,
    pore_radius_nm=5.0,
    cis_mm=5.0,
    trans_mm=5.0,
    surface_charge_e_nm2=0.1,
    box_radius_nm=60.0,
    box_height_nm=100.0,
)
"""Double layers as wide as the pore, of the other sign: all three drives are tightly coupled."""


@dataclass
class Pore:
    """A pore at rest, and how its answers are counted."""

    options: FieldOptions
    first_nm: float
    ratio: float

    def __post_init__(self):
        self.grid = field_grid(self.options, self.first_nm, self.ratio)
        self.rest = solve_on(self.options, self.grid)
        self.space, self.scales = self.rest.space, self.rest.scales
        self.pnp = PoissonNernstPlanck(self.space, self.scales)
        self.stokes = Stokes(self.space, self.scales)
        self.density = self.scales.salt_mm * PER_NM3_PER_MM

    def moved(self, ions, velocity):
        """Volume, charges and excess salt per us, from trans to cis."""
        fluxes = self.pnp.fluxes(ions, self.stokes.sampled(velocity))
        plus, minus = (self.density * float(np.mean(flux)) for flux in fluxes)
        volume = self.stokes.flow_rate(velocity)
        return np.array([volume, plus - minus, plus + minus - 2 * self.density * volume])

    def by_voltage(self):
        volts = SMALL * self.scales.thermal_v
        answer = solve_on(replace(self.options, voltage_v=volts), self.grid)
        return self.moved(answer.ions, answer.velocity) / (SMALL * self.scales.energy_pn_nm)

    def by_salt(self):
        half = math.exp(SMALL / 2)
        cis, trans = self.options.cis_mm / half, self.options.trans_mm * half
        answer = solve_on(replace(self.options, cis_mm=cis, trans_mm=trans), self.grid)
        return self.moved(answer.ions, answer.velocity) / (SMALL * self.scales.energy_pn_nm)

    def by_pressure(self):
        """Ions carried along by a pressed flow, and the flow that they drive back."""
        n2, stokes = self.space.n2, self.stokes
        pressure = 1e-3 * self.density * self.scales.energy_pn_nm
        load = np.zeros(stokes.free.size)
        load[n2 : 2 * n2] = pressure * self.space.boundary_weight("trans") / self.scales.viscosity
        load[~stokes.free] = 0
        pressed = stokes.factors.solve(load)[: 2 * n2].reshape(2, -1)
        ions, velocity = self.rest.ions.copy(), pressed
        factors = self.pnp.jacobian(ions, stokes.sampled(velocity))
        for _ in range(8):
            for _ in range(2):
                change = self.pnp.step(ions, stokes.sampled(velocity), factors)
            last = velocity
            velocity = pressed + stokes.solve(*excess_force(self.space, self.scales, ions))
        assert change < 1e-10
        assert np.abs(velocity - last).max() < 1e-8 * np.abs(pressed).max()
        return self.moved(ions, velocity) / pressure


@pytest.mark.parametrize(
    ("options", "mesh", "allowed"),
    [(WIDE, (0.25, 2.0), (5e-4, 5e-3, 5e-4)), (NARROW, (0.5, 3.0), (5e-5, 2e-4, 5e-5))],
    ids=["wide", "narrow"],
)
def test_each_drive_moves_what_the_others_drive(options, mesh, allowed):
    pore = Pore(options, *mesh)
    table = np.stack([pore.by_pressure(), pore.by_voltage(), pore.by_salt()], axis=1)
    for (i, j), rel in zip([(0, 1), (0, 2), (1, 2)], allowed, strict=True):
        assert table[i, j] == pytest.approx(table[j, i], rel=rel)
    scale = np.sqrt(np.diag(table))
    coupling = table / np.outer(scale, scale)
    assert np.linalg.eigvalsh((coupling + coupling.T) / 2).min() > 0.0
    # Water goes with the ions that screen the wall, and these carry the current of a pressed flow.
    sign = -math.copysign(1, options.surface_charge_e_nm2)
    assert sign * coupling[0, 1] > 0.03
    assert coupling[0, 2] > 0.003
