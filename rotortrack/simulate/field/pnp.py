"""Poisson-Nernst-Planck: potential and two ions in given flow, by Newton's method.

Unknowns are phi = potential / (kT/e) and the quasi-potentials psi+, psi- of the ions, whose
concentrations, in units of `Scales.salt_mm`, are

    c+ = exp(psi+ - phi),  c- = exp(psi- + phi),

positive by construction; psi has no double layer, so Newton's method needs no continuation:

    -lap phi = (c+ - c-) / (2 lambda_D^2),   d phi / d n = sigma e / (eps kT/e) on the walls,
    div(D c grad psi - u c) = 0,             no flux through the walls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray

from rotortrack.errors import InputError
from rotortrack.simulate.field.mesh import Floats
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.space import Space, factorised, sparse_sum

ELEMENTARY_CHARGE_C = 1.602176634e-19
BOLTZMANN_J_K = 1.380649e-23
FARADAY_C_MOL = 96485.33212
VACUUM_PERMITTIVITY_F_M = 8.8541878128e-12
PER_NM3_PER_MM = 6.02214076e-4

_MOST_STEPS = 60
_LARGEST_STEP = 3.0
"""Newton's steps are cut to this many kT/e: exp() makes longer ones overshoot."""

_TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Units and coefficients of the equations in nm, us, kT/e and `salt_mm`."""

    salt_mm: float
    thermal_v: float
    energy_pn_nm: float
    debye_nm: float
    charge_per_nm: float
    cation_nm2_us: float
    anion_nm2_us: float
    viscosity: float
    speed_nm_us: float
    """eps (kT/e)^2 / (eta lambda_D): what flow compares with, so that rest needs no division."""

    @classmethod
    def of(cls, options: FieldOptions) -> Scales:
        """Work the scales out; the salt is the geometric mean of the two sides."""
        salt = math.sqrt(options.cis_mm * options.trans_mm)
        energy = BOLTZMANN_J_K * options.temperature_k
        thermal = energy / ELEMENTARY_CHARGE_C
        permittivity = options.relative_permittivity * VACUUM_PERMITTIVITY_F_M
        debye = math.sqrt(permittivity * thermal / (2 * FARADAY_C_MOL * salt))
        surface = options.surface_charge_e_nm2 * ELEMENTARY_CHARGE_C * 1e18
        return cls(
            salt_mm=salt,
            thermal_v=thermal,
            energy_pn_nm=energy * 1e21,
            debye_nm=debye * 1e9,
            charge_per_nm=surface / (permittivity * thermal) * 1e-9,
            cation_nm2_us=options.cation_diffusivity_m2_s * 1e12,
            anion_nm2_us=options.anion_diffusivity_m2_s * 1e12,
            viscosity=options.viscosity_mpa_s * 1e-3,
            speed_nm_us=permittivity * thermal**2 / (options.viscosity_mpa_s * debye) * 1e6,
        )

    @property
    def screening(self) -> float:
        """1 / (2 lambda_D^2), per nm2."""
        return 0.5 / self.debye_nm**2


@dataclass
class Ions:
    """Nodal values (n2,) of phi, psi+ and psi-, in kT/e."""

    phi: Floats
    plus: Floats
    minus: Floats

    def copy(self) -> Ions:
        """Copy all three."""
        return Ions(self.phi.copy(), self.plus.copy(), self.minus.copy())

    @property
    def salt(self) -> Floats:
        """Logarithm s = (psi+ + psi-) / 2 of the neutral salt outside any double layer."""
        return (self.plus + self.minus) / 2

    @property
    def virtual(self) -> Floats:
        """Potential v = (psi+ - psi-) / 2 outside any double layer."""
        return (self.plus - self.minus) / 2


class PoissonNernstPlanck:
    """The discrete equations on a space.

    Parameters
    ----------
    space, scales
        Where, and with which coefficients.
    charged
        Parts of the boundary that carry the surface charge.
    ends
        Parts where potential and concentrations are held.
    """

    def __init__(
        self,
        space: Space,
        scales: Scales,
        *,
        charged: tuple[str, ...] = ("wall",),
        ends: tuple[str, ...] = ("cis", "trans"),
    ) -> None:
        self.space, self.scales = space, scales
        self.held = space.boundary(*ends)
        self.free = np.ones(space.n2, dtype=bool)
        self.free[self.held] = False
        self.wall = scales.charge_per_nm * sum(space.boundary_weight(name) for name in charged)
        ones = np.ones_like(space.weight)
        self.stiffness = space.products(space.by_r, ones, space.by_r) + space.products(
            space.by_z, ones, space.by_z
        )
        self.nodes3 = np.concatenate([3 * space.nodes2 + k for k in range(3)], axis=1)
        self.free3 = np.repeat(self.free, 3)

    def harmonic(self, values: Floats) -> Floats:
        """Solve Laplace's equation with `values` (n2,) on the ends and no flux elsewhere."""
        nodes = self.space.nodes2
        residual = self.space.gather((self.stiffness @ values[nodes][:, :, None])[..., 0])
        residual[self.held] = 0
        matrix = sparse_sum(nodes, nodes, self.stiffness, self.free)
        return values - np.asarray(factorised(matrix).solve(residual))

    def relax_potential(self, ions: Ions) -> int:
        """Solve Poisson's equation for phi in place, psi+ and psi- held; return the steps."""
        space, scales = self.space, self.scales
        for steps in range(1, _MOST_STEPS + 1):
            plus, minus = self.concentrations(ions)
            k = scales.screening
            local = (self.stiffness @ ions.phi[space.nodes2][:, :, None])[..., 0]
            local -= space.loads(k * (plus - minus), space.value)
            residual = space.gather(local) - self.wall
            residual[self.held] = 0
            matrix = self.stiffness + space.products(space.value, k * (plus + minus), space.value)
            jacobian = sparse_sum(space.nodes2, space.nodes2, matrix, self.free)
            step = np.asarray(factorised(jacobian).solve(residual))
            largest = _limited(step)
            ions.phi -= step
            if largest < _TOLERANCE:
                return steps
        raise InputError(_NO_END)

    def concentrations(self, ions: Ions) -> tuple[Floats, Floats]:
        """c+ and c- at the quadrature points, in units of the salt."""
        phi = self.space.at_points(ions.phi)
        # Past these bounds an iterate is wrong anyway, and exp() must not overflow.
        plus = np.clip(self.space.at_points(ions.plus) - phi, -200.0, 60.0)
        minus = np.clip(self.space.at_points(ions.minus) + phi, -200.0, 60.0)
        return np.exp(plus), np.exp(minus)

    def residual(self, ions: Ions, flow: tuple[Floats, Floats]) -> Floats:
        """Residuals (n2, 3) of the three equations; on the ends, the flux in through them."""
        space = self.space
        plus, minus = self.concentrations(ions)
        local = (self.stiffness @ ions.phi[space.nodes2][:, :, None])[..., 0]
        local -= space.loads(self.scales.screening * (plus - minus), space.value)
        whole = [space.gather(local) - self.wall]
        for psi, density, diffusivity in self._species(ions, plus, minus):
            flux_r, flux_z = self._flux(psi, density, diffusivity, flow)
            whole.append(
                space.gather(space.loads(flux_r, space.by_r) + space.loads(flux_z, space.by_z))
            )
        return np.stack(whole, axis=1)

    def _species(
        self, ions: Ions, plus: Floats, minus: Floats
    ) -> tuple[tuple[Floats, Floats, float], tuple[Floats, Floats, float]]:
        scales = self.scales
        return (
            (ions.plus, plus, scales.cation_nm2_us),
            (ions.minus, minus, scales.anion_nm2_us),
        )

    def _flux(
        self, psi: Floats, density: Floats, diffusivity: float, flow: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """Minus the flux of a species, over its diffusivity."""
        slope_r, slope_z = self.space.slopes(psi)
        return (
            density * (slope_r - flow[0] / diffusivity),
            density * (slope_z - flow[1] / diffusivity),
        )

    def jacobian(self, ions: Ions, flow: tuple[Floats, Floats]) -> scipy.sparse.linalg.SuperLU:
        """Factorise the slope of the residual by the unknowns (phi, psi+, psi- of each node)."""
        space, k = self.space, self.scales.screening
        plus, minus = self.concentrations(ions)
        matrix = np.zeros((space.nodes2.shape[0], 27, 27))
        mass_plus = k * space.products(space.value, plus, space.value)
        mass_minus = k * space.products(space.value, minus, space.value)
        matrix[:, :9, :9] = self.stiffness + mass_plus + mass_minus
        matrix[:, :9, 9:18] = -mass_plus
        matrix[:, :9, 18:] = mass_minus
        for species, (psi, density, diffusivity) in enumerate(self._species(ions, plus, minus)):
            at = slice(9 + 9 * species, 18 + 9 * species)
            flux_r, flux_z = self._flux(psi, density, diffusivity, flow)
            drift = space.products(space.by_r, flux_r, space.value)
            drift += space.products(space.by_z, flux_z, space.value)
            matrix[:, at, at] = drift
            matrix[:, at, at] += space.products(space.by_r, density, space.by_r)
            matrix[:, at, at] += space.products(space.by_z, density, space.by_z)
            matrix[:, at, :9] = -drift if species == 0 else drift
        return factorised(sparse_sum(self.nodes3, self.nodes3, matrix, self.free3))

    def step(
        self, ions: Ions, flow: tuple[Floats, Floats], factors: scipy.sparse.linalg.SuperLU
    ) -> float:
        """Take one Newton step in place and return its largest change, in kT/e, before any cut."""
        residual = self.residual(ions, flow)
        residual[self.held] = 0
        change = np.asarray(factors.solve(residual.ravel()))
        largest = _limited(change)
        if not math.isfinite(largest):
            raise InputError(_NO_END)
        change = change.reshape(-1, 3)
        ions.phi -= change[:, 0]
        ions.plus -= change[:, 1]
        ions.minus -= change[:, 2]
        return largest

    def solve(
        self, ions: Ions, flow: tuple[Floats, Floats]
    ) -> tuple[int, scipy.sparse.linalg.SuperLU]:
        """Newton's method in place; return the steps and the last factors."""
        for steps in range(1, _MOST_STEPS + 1):
            factors = self.jacobian(ions, flow)
            # The step after a small one squares it, and needs no new factors either.
            if self.step(ions, flow, factors) < 1e-4:
                return steps, factors
        raise InputError(_NO_END)

    def fluxes(self, ions: Ions, flow: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """Flux of cations and of anions along z through the trans and the cis end, each (2,).

        In units of salt_mm nm3/us, from the residual at the held nodes: as exact as the energy.
        """
        residual = self.residual(ions, flow)[:, 1:]
        diffusivity = np.array([self.scales.cation_nm2_us, self.scales.anion_nm2_us])
        parts = [
            sign * 2 * math.pi * diffusivity * residual[self.space.boundary(name)].sum(axis=0)
            for name, sign in (("trans", 1.0), ("cis", -1.0))
        ]
        return np.array([parts[0][0], parts[1][0]]), np.array([parts[0][1], parts[1][1]])


_NO_END = (
    "the ions' equations found no solution; lower voltage_v or surface_charge_e_nm2, or choose "
    "accuracy = 'careful'"
)


def _limited(step: NDArray[np.float64]) -> float:
    largest = float(np.abs(step).max(initial=0.0))
    if largest > _LARGEST_STEP:
        step *= _LARGEST_STEP / largest
    return largest
