"""Example scenes: a seeded field of well-separated ideal rotors of the kinds asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rotortrack.simulate.film.places import scatter
from rotortrack.simulate.ideal import IdealRotor, IdealScene

ExampleKind = Literal[
    "driven", "driven_ccw", "driven_cw", "brownian", "stuck", "switching", "two_position"
]

PAPER_LIKE: tuple[ExampleKind, ...] = (
    *("driven_ccw",) * 3,
    *("driven_cw",) * 2,
    "brownian",
    "stuck",
    "two_position",
)

SPEED_RAD_S = (8.0, 60.0)
DIFFUSION_RAD2_S = (0.5, 20.0)
RADIUS_NM = (60.0, 180.0)
PHOTONS = (500.0, 1500.0)


def example_scene(
    kinds: Sequence[ExampleKind] = PAPER_LIKE,
    *,
    rng: np.random.Generator,
    shape_px: tuple[int, int] = (64, 96),
    n_frames: int = 2000,
    pixel_size_nm: float = 108.3,
    frame_interval_s: float = 0.002,
    exposure_s: float = 0.002,
    sigma_px: float = 1.2,
    background_photons: float = 10.0,
    photons: tuple[float, float] = PHOTONS,
    separation_nm: float = 1500.0,
) -> IdealScene:
    """Scatter rotors over a frame, with random speed, diffusion, radius and brightness.

    Speeds and diffusion coefficients are uniform in their logarithm over `SPEED_RAD_S` and
    `DIFFUSION_RAD2_S`, radii and photons uniform over `RADIUS_NM` and `photons`. A rotor named
    `driven` or `switching` turns either way.

    Parameters
    ----------
    kinds
        One word a rotor.
    rng
        Source of everything random.
    shape_px, n_frames, pixel_size_nm, frame_interval_s, exposure_s, background_photons
        As in :class:`IdealScene`.
    sigma_px
        Width of a spot, pixels.
    photons
        Least and most photo-electrons of a spot per frame.
    separation_nm
        Wanted distance between centres; less where the frame is too small for it.

    Raises
    ------
    ConfigurationError
        The frame is smaller than one spot.
    """
    centres = scatter(len(kinds), shape_px, pixel_size_nm, 6.0 * sigma_px, separation_nm, rng)
    rotors = tuple(
        _example_rotor(kind, x_nm, y_nm, photons, n_frames * frame_interval_s, rng)
        for kind, (x_nm, y_nm) in zip(kinds, centres.tolist(), strict=True)
    )
    return IdealScene(
        shape_px=shape_px,
        n_frames=n_frames,
        pixel_size_nm=pixel_size_nm,
        frame_interval_s=frame_interval_s,
        exposure_s=exposure_s,
        sigma_nm=sigma_px * pixel_size_nm,
        background_photons=background_photons,
        rotors=rotors,
    )


def _example_rotor(
    kind: ExampleKind,
    x_nm: float,
    y_nm: float,
    photons: tuple[float, float],
    duration_s: float,
    rng: np.random.Generator,
) -> IdealRotor:
    """Draw one rotor; every kind draws the same numbers, so changing one leaves the others be."""
    speed = float(np.exp(rng.uniform(*np.log(SPEED_RAD_S))))
    diffusion = float(np.exp(rng.uniform(*np.log(DIFFUSION_RAD2_S))))
    sign = float(rng.choice([-1.0, 1.0]))
    still = IdealRotor(
        kind="stuck",
        x_nm=x_nm,
        y_nm=y_nm,
        radius_nm=float(rng.uniform(*RADIUS_NM)),
        photons=float(rng.uniform(*photons)),
        start_rad=float(rng.uniform(-np.pi, np.pi)),
    )
    match kind:
        case "driven" | "driven_ccw" | "driven_cw":
            direction = {"driven": sign, "driven_ccw": 1.0, "driven_cw": -1.0}[kind]
            return replace(
                still, kind="driven", omega_rad_s=direction * speed, diffusion_rad2_s=diffusion
            )
        case "switching":
            return replace(
                still,
                kind="switching",
                omega_rad_s=sign * speed,
                diffusion_rad2_s=diffusion,
                event_rate_per_s=4.0 / duration_s,
            )
        case "brownian":
            return replace(still, kind="brownian", diffusion_rad2_s=diffusion)
        case "two_position":
            return replace(
                still,
                kind="two_position",
                diffusion_rad2_s=diffusion,
                event_rate_per_s=20.0 / duration_s,
                wobble_sd_rad=0.15,
            )
        case "stuck":
            return still
