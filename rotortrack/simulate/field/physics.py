"""Numbers of the equations in the units in which they are solved: nm, us, pN, thermal voltages."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rotortrack.simulate.field.options import FieldOptions

ELEMENTARY_CHARGE_C = 1.602176634e-19
BOLTZMANN_J_K = 1.380649e-23
AVOGADRO = 6.02214076e23
VACUUM_PERMITTIVITY_F_M = 8.8541878128e-12


@dataclass(frozen=True)
class Physics:
    """Coefficients; concentrations are in units of the mean of the two sides.

    Attributes
    ----------
    thermal_v
        kT/e in volts, the unit of potentials.
    cis, trans
        Concentrations of the two sides.
    charge_nm2
        k of -lap(phi) = k (c+ - c-), nm^-2: half the inverse square of the Debye length.
    wall_per_nm
        Normal derivative of the potential on the wall, out of the fluid, 1/nm.
    cation_nm2_us, anion_nm2_us
        Diffusion coefficients.
    osmotic_pn_nm2
        Pressure RT c of one unit of concentration, pN/nm^2.
    viscosity_pn_us_nm2
        Viscosity of the water.
    ampere
        Current of one unit of (unit of concentration) nm^3/us of charges, A.
    """

    thermal_v: float
    cis: float
    trans: float
    charge_nm2: float
    wall_per_nm: float
    cation_nm2_us: float
    anion_nm2_us: float
    osmotic_pn_nm2: float
    viscosity_pn_us_nm2: float
    ampere: float


def physics_of(options: FieldOptions) -> Physics:
    """Turn options into coefficients."""
    thermal_v = BOLTZMANN_J_K * options.temperature_k / ELEMENTARY_CHARGE_C
    unit_mm = (options.cis_mm + options.trans_mm) / 2.0
    # 1 mM is 1 mol/m^3.
    per_m3 = unit_mm * AVOGADRO
    permittivity = options.relative_permittivity * VACUUM_PERMITTIVITY_F_M
    charge_m2 = per_m3 * ELEMENTARY_CHARGE_C / (permittivity * thermal_v)
    wall_c_m2 = options.surface_charge_e_nm2 * ELEMENTARY_CHARGE_C * 1e18
    pressure_pa = per_m3 * BOLTZMANN_J_K * options.temperature_k
    return Physics(
        thermal_v=thermal_v,
        cis=options.cis_mm / unit_mm,
        trans=options.trans_mm / unit_mm,
        charge_nm2=charge_m2 * 1e-18,
        wall_per_nm=wall_c_m2 / (permittivity * thermal_v) * 1e-9,
        cation_nm2_us=options.cation_diffusion_m2_s * 1e12,
        anion_nm2_us=options.anion_diffusion_m2_s * 1e12,
        osmotic_pn_nm2=pressure_pa * 1e-6,
        viscosity_pn_us_nm2=options.viscosity_mpa_s * 1e-3,
        ampere=per_m3 * 1e-27 * ELEMENTARY_CHARGE_C * 1e6,
    )


def debye_length_nm(options: FieldOptions, side_mm: float) -> float:
    """Give the Debye length of a salt concentration in the pore's water, nm."""
    physics = physics_of(options)
    unit_mm = (options.cis_mm + options.trans_mm) / 2.0
    return math.sqrt(1.0 / (2.0 * physics.charge_nm2 * side_mm / unit_mm))
