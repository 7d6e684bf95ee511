"""Options of the nanopore's fields; the defaults are the paper's Tables S1-S5.

Where the tables can be read in more than one way, the reading is an option.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class FieldOptions(Options):
    """Pore, salt, voltage and the accuracy of the solution."""

    voltage_v: float = option(0.1, "potential of the trans side, the cis side being grounded, V")
    cis_mm: float = option(50.0, "salt on the cis side, where the rod is, mM", gt=0)
    trans_mm: float = option(50.0, "salt on the trans side, mM", gt=0)
    electrical: Literal["fixed_potential", "zero_current", "shorted_agcl"] = option(
        "fixed_potential",
        "what the two sides are held at: voltage_v between the solutions, whatever lets no "
        "current pass, or voltage_v between two Ag/AgCl electrodes",
    )
    surface_charge_e_nm2: float = option(
        -0.1, "charge of the membrane's surface, elementary charges per nm^2"
    )
    pore_radius_nm: float = option(25.0, "radius of the pore, nm", gt=0)
    membrane_nm: float = option(20.0, "thickness of the membrane, nm", gt=0)
    box_radius_nm: float = option(500.0, "radius of the solved box, nm", gt=0)
    box_height_nm: float = option(
        1000.0, "height of the solved box, membrane in the middle, nm", gt=0
    )
    temperature_k: float = option(300.0, "absolute temperature, K", gt=0)
    viscosity_mpa_s: float = option(1.0, "viscosity of the water, mPa s", gt=0)
    relative_permittivity: float = option(78.0, "relative permittivity of the water", gt=0)
    cation_diffusion_m2_s: float = option(
        1.33e-9, "diffusion coefficient of the cation, Na+, m^2/s", gt=0
    )
    anion_diffusion_m2_s: float = option(
        2.03e-9, "diffusion coefficient of the anion, Cl-, m^2/s", gt=0
    )
    accuracy: Literal["fast", "default", "careful"] = option(
        "default", "fineness of the mesh: about 0.2, 0.05 or 0.03 % in the flow"
    )
