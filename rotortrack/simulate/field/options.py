"""Options of the nanopore field: Tables S1-S5 of the paper, and what they leave open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.errors import ConfigurationError
from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class FieldOptions(Options):
    """A charged circular pore in a membrane between two salt solutions.

    z > 0 is the cis side (grounded, where the rod is), z < 0 the trans side.
    """

    voltage_v: float = option(0.1, "voltage of the trans side against the cis side, V")
    cis_mm: float = option(50.0, "salt on the cis side, mM", gt=0)
    trans_mm: float = option(50.0, "salt on the trans side, mM", gt=0)
    electrical: Literal["fixed_potential", "zero_current", "shorted_agcl"] = option(
        "fixed_potential",
        "what voltage_v is: the difference between the solutions; not used, since no current "
        "flows; or between two Ag/AgCl electrodes, whose own step of kT/e ln(trans/cis) adds to it",
    )
    surface_charge_e_nm2: float = option(
        -0.1, "charge of the membrane's surface, elementary charges per nm2"
    )
    pore_radius_nm: float = option(25.0, "radius of the pore, nm", gt=0)
    membrane_nm: float = option(20.0, "thickness of the membrane, nm", gt=0)
    rim_radius_nm: float = option(0.0, "radius of the pore's rounded rims, nm (0: sharp)", ge=0)
    box_radius_nm: float = option(500.0, "radius of the solved volume, nm", gt=0)
    box_height_nm: float = option(1000.0, "height of the solved volume, both sides, nm", gt=0)
    temperature_k: float = option(300.0, "absolute temperature, K", gt=0)
    viscosity_mpa_s: float = option(1.0, "viscosity of the solution, mPa s", gt=0)
    relative_permittivity: float = option(78.0, "permittivity over that of vacuum", gt=0)
    cation_diffusivity_m2_s: float = option(
        1.33e-9, "diffusion coefficient of the cations (Na+), m2/s", gt=0
    )
    anion_diffusivity_m2_s: float = option(
        2.03e-9, "diffusion coefficient of the anions (Cl-), m2/s", gt=0
    )
    accuracy: Literal["fast", "default", "careful"] = option(
        "default",
        "meshes: of a sharp pore at 0.1 V the flow to 0.4 %, 0.1 % or 0.04 %; the solution carries "
        "its own estimate",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        mistakes = []
        if self.box_radius_nm < 2 * self.pore_radius_nm:
            mistakes.append("box_radius_nm must be at least twice pore_radius_nm")
        if self.box_height_nm < self.membrane_nm + 4 * self.pore_radius_nm:
            mistakes.append("box_height_nm must leave twice pore_radius_nm on either side")
        if 4 * self.rim_radius_nm > min(self.membrane_nm, self.pore_radius_nm):
            mistakes.append(
                "rim_radius_nm must be at most a quarter of membrane_nm and of pore_radius_nm"
            )
        if mistakes:
            raise ConfigurationError(*mistakes)
