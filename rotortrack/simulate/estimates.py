"""Numbers on the back of an envelope: one formula each, and the printed number it meets or misses.

They need no simulation and check those that do. The page of the paper's inconsistencies
(README.md of this folder) is built on them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

ELEMENTARY_CHARGE_C = 1.602176634e-19
BOLTZMANN_J_K = 1.380649e-23
AVOGADRO = 6.02214076e23
FARADAY_C_MOL = ELEMENTARY_CHARGE_C * AVOGADRO
VACUUM_PERMITTIVITY_F_M = 8.8541878128e-12


def thermal_energy_pn_nm(temperature_k: float = 300.0) -> float:
    """Give kT in pN nm: 4.142 at 300 K."""
    return BOLTZMANN_J_K * 1e21 * temperature_k


def thermal_voltage_v(temperature_k: float = 300.0) -> float:
    """Give kT/e in V: 25.85 mV at 300 K."""
    return BOLTZMANN_J_K * temperature_k / ELEMENTARY_CHARGE_C


def bare_line_charge_c_m(charges_per_base_pair: float = 12.0, rise_nm: float = 0.34) -> float:
    """Give the bare charge per length, n e / a, C/m: 5.65e-9, printed (rounded) as 5.7e-9."""
    return charges_per_base_pair * ELEMENTARY_CHARGE_C / (rise_nm * 1e-9)


def debye_length_nm(
    salt_mm: float = 50.0, *, temperature_k: float = 300.0, relative_permittivity: float = 78.0
) -> float:
    """Give sqrt(eps kT / (2 e^2 n)) of a 1:1 salt, nm: 1.360 at 50 mM, as printed (1.36)."""
    permittivity = relative_permittivity * VACUUM_PERMITTIVITY_F_M
    thermal_v = thermal_voltage_v(temperature_k)
    return 1e9 * math.sqrt(permittivity * thermal_v / (2.0 * FARADAY_C_MOL * salt_mm))


def grahame_potential_v(
    surface_charge_e_nm2: float = -0.1,
    salt_mm: float = 50.0,
    *,
    temperature_k: float = 300.0,
    relative_permittivity: float = 78.0,
) -> float:
    """Give the potential of a flat charged wall, (2kT/e) asinh(sigma lambda_D e / (2 eps kT)), V.

    -29.87 mV with the defaults and -53.2 mV at -0.2 e/nm^2; the paper prints none.
    """
    thermal_v = thermal_voltage_v(temperature_k)
    length_m = 1e-9 * debye_length_nm(
        salt_mm, temperature_k=temperature_k, relative_permittivity=relative_permittivity
    )
    charge_c_m2 = surface_charge_e_nm2 * ELEMENTARY_CHARGE_C * 1e18
    permittivity = relative_permittivity * VACUUM_PERMITTIVITY_F_M
    reduced = charge_c_m2 * length_m / (2.0 * permittivity * thermal_v)
    return 2.0 * thermal_v * math.asinh(reduced)


def electroosmotic_mobility_m2_vs(
    wall_potential_v: float, *, viscosity_mpa_s: float = 1.0, relative_permittivity: float = 78.0
) -> float:
    """Give Smoluchowski's slip per field, -eps zeta / eta, m^2/(V s): 2.063e-8 at -29.87 mV."""
    permittivity = relative_permittivity * VACUUM_PERMITTIVITY_F_M
    return -permittivity * wall_potential_v / (viscosity_mpa_s * 1e-3)


def bulk_conductivity_s_m(
    salt_mm: float = 50.0,
    *,
    cation_m2_s: float = 1.33e-9,
    anion_m2_s: float = 2.03e-9,
    temperature_k: float = 300.0,
) -> float:
    """Give F^2 (D+ + D-) c / RT of a 1:1 salt, S/m: 0.627 with the defaults."""
    gas_constant = BOLTZMANN_J_K * AVOGADRO
    return FARADAY_C_MOL**2 * (cation_m2_s + anion_m2_s) * salt_mm / (gas_constant * temperature_k)


def hall_conductance_ns(
    pore_radius_nm: float = 25.0,
    membrane_nm: float = 20.0,
    conductivity_s_m: float | None = None,
    *,
    access_radii: float = math.pi / 4.0,
) -> float:
    """Give the conductance of an uncharged pore, s pi R^2 / (L + 2 a R), nS.

    20.77 nS with Hall's access length a = pi/4 of a radius on each side, 20.15 nS with 0.8217, the
    end correction of a long pipe. The paper prints none.
    """
    conductivity = bulk_conductivity_s_m() if conductivity_s_m is None else conductivity_s_m
    length_nm = membrane_nm + 2.0 * access_radii * pore_radius_nm
    return conductivity * math.pi * pore_radius_nm**2 / length_nm


def drag_over_pull(
    flow_ratio: float,
    mobility_m2_vs: float,
    *,
    friction_prefactor: float = math.pi,
    viscosity_mpa_s: float = 1.0,
) -> float:
    """Give the drag of a flow u = mu E across the rod over the pull of E: ratio pi eta mu / rho.

    Above 1 the flow holds the rod off. It is 1 at a ratio lambda_flow/lambda_eff of 87.3 for the
    wall's -0.1 e/nm^2; the printed ratio of 75 gives 0.86 there, and 1.53 at -0.2 e/nm^2.
    """
    friction_pa_s = friction_prefactor * viscosity_mpa_s * 1e-3
    return flow_ratio * friction_pa_s * mobility_m2_vs / bare_line_charge_c_m()


def salt_flux_mol_m2_s(
    difference_mm: float, *, diffusion_m2_s: float = 1.6e-9, membrane_nm: float = 20.0
) -> float:
    """Give the flux D dc / L through a pore, mol/(m^2 s).

    36 at the printed 450 mM and 40 at 550 - 50 = 500 mM; the printed 25 is neither (Note 3).
    """
    return diffusion_m2_s * difference_mm / (membrane_nm * 1e-9)


def concentration_rate_um_s(
    flux_mol_m2_s: float,
    *,
    pore_radius_nm: float = 25.0,
    n_pores: int = 400,
    volume_ul: float = 50.0,
) -> float:
    """Give the change of concentration in a reservoir, J n pi R^2 / V, uM/s.

    0.39 at a flux of 25, 0.57 at 36 and 0.63 at 40; the printed 0.6 is met by both of the latter.
    """
    area_m2 = n_pores * math.pi * (pore_radius_nm * 1e-9) ** 2
    # 1 ul is 1e-9 m^3 and 1 mol/m^3 is 1e3 uM.
    return flux_mol_m2_s * area_m2 / (volume_ul * 1e-9) * 1e3


def access_factor(pore_radius_nm: float = 25.0, membrane_nm: float = 20.0) -> float:
    """Give what a flux D dc / L loses to the diffusion up to the pore, 1 + pi d / (4 L): 2.96."""
    return 1.0 + math.pi * pore_radius_nm / (2.0 * membrane_nm)


def rotational_friction_pn_nm_s(
    positions_nm: NDArray[np.float64],
    *,
    prefactor: float = math.pi,
    viscosity_mpa_s: float = 1.0,
) -> float:
    """Give the friction of a rod that turns about the z axis, pN nm s.

    c eta int r^2 (1 - (t.e_phi)^2 / 2) dl over the segments, each integrated exactly in r^2.
    Note 4 prints 3 pi for c, Note 2 means pi; about the printed 0.012 for rotating shapes with pi.

    Parameters
    ----------
    positions_nm
        Vertices of the rod about the axis, nm, shape (n, 3).
    prefactor, viscosity_mpa_s
        c and eta.
    """
    begin, edge = positions_nm[:-1], np.diff(positions_nm, axis=0)
    length = np.linalg.norm(edge, axis=1)
    total = 0.0
    # Simpson's rule is exact for the r^2 of a straight segment; r (t.e_phi) is constant along it.
    moment = begin[:, 0] * edge[:, 1] - begin[:, 1] * edge[:, 0]
    # Vertices that coincide have no direction, and no length that it would count for.
    around = np.divide(moment, length, out=np.zeros_like(length), where=length > 0.0)
    for place, weight in ((0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)):
        point = begin + place * edge
        total += weight * float(np.sum(length * (point[:, 0] ** 2 + point[:, 1] ** 2)))
    total -= 0.5 * float(np.sum(length * around**2))
    # 1 mPa s nm^3 is 1e-9 pN nm s.
    return prefactor * viscosity_mpa_s * total * 1e-9


def straight_rod_friction_pn_nm_s(
    length_nm: float = 450.0, *, prefactor: float = math.pi, viscosity_mpa_s: float = 1.0
) -> float:
    """Give c eta L^3 / 12 of a straight rod about its centre: 0.0239 (pi), 0.0716 (3 pi)."""
    return prefactor * viscosity_mpa_s * length_nm**3 / 12.0 * 1e-9


def rotational_power_pn_nm_s(friction_pn_nm_s: float, angular_velocity_rad_s: float) -> float:
    """Give xi omega^2, pN nm/s: 187.5 or 45 kT/s from 0.012 and 125 rad/s, as printed (190)."""
    return friction_pn_nm_s * angular_velocity_rad_s**2
