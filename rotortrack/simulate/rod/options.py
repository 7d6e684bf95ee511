"""Options of the simulated rod, its time steps, its start and its thermal noise.

Where the paper can be read in more than one way, the reading is an option. ``CORRECTED`` holds the
defaults, ``PAPER_LITERAL`` what is printed, its slips included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class RodOptions(Options):
    """What the rod is made of and how it meets field, flow and membrane."""

    length_nm: float = option(450.0, "contour length of the rod, nm", gt=0)
    n_vertices: int = option(
        51, "vertices of the chain (101 doubles the cost, 26 falls on wrong states)", ge=3, le=2001
    )
    persistence_length_nm: float = option(1500.0, "persistence length, nm", gt=0)
    temperature_k: float = option(
        300.0, "absolute temperature that turns persistence length into stiffness, K", gt=0
    )
    viscosity_mpa_s: float = option(1.0, "viscosity of the water, mPa s", gt=0)
    bending: Literal["energy", "doubled", "printed"] = option(
        "energy",
        "bending force: gradient of the energy, twice that (the printed factor), or as printed, "
        "whose wrong sign makes a torque out of nothing",
    )
    lambda_eff: float = option(
        0.26, "part of the bare line charge on which the electric field acts", ge=0
    )
    flow_ratio: float = option(
        130.0, "flow factor lambda_flow over lambda_eff, as on the axis of the phase diagram", ge=0
    )
    electric_field: Literal["applied", "total"] = option(
        "applied", "field on the rod: without or with that of the wall's double layer"
    )
    diffusiophoretic_mobility_nm2_us: float = option(
        0.0,
        "mobility M of the drift M grad(ln c) in a salt gradient, nm^2/us (positive: to more salt)",
    )
    friction: Literal["resistive", "slender_body"] = option(
        "resistive",
        "friction across the rod per length and viscosity: friction_prefactor, or "
        "4 pi/(ln(length/bundle_diameter_nm) + 0.84)",
    )
    friction_prefactor: float = option(
        math.pi, "friction across the rod per length and viscosity, twice that along it", gt=0
    )
    bundle_diameter_nm: float = option(
        8.0, "hydrodynamic diameter of the bundle in slender-body friction, nm", gt=0
    )
    friction_length_nm: float | None = option(
        None,
        "length whose friction one vertex carries, nm (absent: the distance of two vertices; the "
        "paper also prints 30)",
        gt=0,
    )
    end_weight: Literal["half", "full"] = option(
        "half", "friction of the two end vertices: half a segment's, or a whole one's"
    )
    wall_drag: Literal["none", "cylinder"] = option(
        "none",
        "friction of motion beside the membrane: as far from it, or that of a cylinder near a wall "
        "(the drag of the flow keeps its value)",
    )
    wall_gap_nm: float = option(
        0.5, "layer of water that stays between rod and membrane in wall_drag, nm", gt=0
    )
    wall: Literal["signed_distance", "z_only", "none"] = option(
        "signed_distance",
        "membrane: pushes along the shortest way out, only upwards (the paper), or absent",
    )
    contact: Literal["segments", "vertices"] = option(
        "segments", "parts of the rod that touch a signed-distance wall"
    )
    rod_radius_nm: float = option(3.0, "distance of the rod's axis from what it touches, nm", ge=0)
    wall_stiffness_pn_nm: float = option(
        5.0, "stiffness of the wall against one segment, pN/nm", ge=0
    )
    leash: Literal["none", "harmonic", "worm_like"] = option(
        "none",
        "tether from the rod to the pore's centre: a spring beyond its length, or a worm-like "
        "chain that stiffens towards its length",
    )
    leash_at: Literal["middle", "first", "last"] = option(
        "middle", "vertex from which the tether starts"
    )
    leash_length_nm: float = option(50.0, "contour length of the tether, nm", gt=0)
    leash_persistence_nm: float = option(50.0, "persistence length of a worm-like tether, nm", gt=0)
    leash_stiffness_pn_nm: float = option(
        1.0, "stiffness of a harmonic tether beyond its length, pN/nm", ge=0
    )


@dataclass(frozen=True, kw_only=True)
class SteppingOptions(Options):
    """How time is stepped, sampled and ended."""

    method: Literal["implicit", "explicit", "paper"] = option(
        "implicit",
        "linearly implicit with error control, explicit Euler of fixed step, or the paper's "
        "explicit Euler of capped displacement",
    )
    tolerance_nm: float = option(1e-2, "largest error of a vertex in an implicit step, nm", gt=0)
    step_us: float = option(1e-4, "step of explicit Euler, first implicit step, us", gt=0)
    max_step_us: float = option(0.5, "longest implicit step, us", gt=0)
    cap_nm: float = option(0.02, "largest displacement in a step of the paper's rule, nm", gt=0)
    duration_us: float = option(200.0, "simulated time, us", gt=0)
    sample_us: float = option(0.2, "time between two stored shapes, us", gt=0)
    max_steps: int = option(10_000_000, "steps after which a run ends unfinished", ge=1)
    stop_when_settled: bool = option(
        False, "end before duration_us when the rod rotates steadily, lies still or is lost"
    )


@dataclass(frozen=True, kw_only=True)
class StartOptions(Options):
    """Where the straight rod lies at time 0."""

    offset_x_nm: float = option(0.0, "offset of the rod's centre along the rod, nm")
    offset_y_nm: float = option(3.0, "offset of the rod's centre across the rod, nm")
    height_nm: float = option(
        5.0, "height of the rod's lowest point above the membrane's cis face, nm"
    )
    tilt_deg: float = option(
        0.2, "angle of the rod with the membrane, which breaks the mirror symmetry, degrees"
    )
    azimuth_deg: float = option(0.0, "angle by which the whole start is turned, degrees")
    mirrored: bool = option(False, "start from the mirror image, which turns the other way")
    jitter_nm: float = option(
        0.0, "standard deviation of the vertices about the straight line, nm", ge=0
    )
    seed: int = option(0, "seed of the jitter", ge=0)


@dataclass(frozen=True, kw_only=True)
class ThermalOptions(Options):
    """Thermal noise; only a scene that names it draws random numbers."""

    temperature_k: float = option(300.0, "absolute temperature of the noise, K", gt=0)
    seed: int = option(0, "seed of the noise", ge=0)
    step_us: float = option(
        1e-4, "step with noise, us (to 4e-4 variances of 9-nm links are right to 0.5 %)", gt=0
    )
    theta: float = option(
        0.5,
        "implicit part of the bending force (0.5: exact variances of bending modes)",
        ge=0,
        le=1,
    )
    metric_force: bool = option(
        False, "take away what rigid links prefer to stiff springs (below 1 % of the stiffness)"
    )


CORRECTED: dict[str, dict[str, Any]] = {"rod": {}, "stepping": {}}
"""Values by section of the preset `corrected`: the defaults."""

PAPER_LITERAL: dict[str, dict[str, Any]] = {
    "rod": {
        "bending": "printed",
        "flow_ratio": 75.0,
        "electric_field": "total",
        "end_weight": "full",
        "wall": "z_only",
        "contact": "vertices",
    },
    "stepping": {"method": "paper"},
}
"""Values by section of the preset `paper_literal`: Methods and Note 2 to the letter."""

PRESETS = {"corrected": CORRECTED, "paper_literal": PAPER_LITERAL}
