"""Draw the rotors of a scene: where they are, how they are built, and how each one moves."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film.options import RotorsOptions
from rotortrack.simulate.film.places import lattice, scatter
from rotortrack.simulate.film.rotor import End, Rotor
from rotortrack.simulate.film.scene import FilmScene, within
from rotortrack.simulate.film.streams import Effect, stream

if TYPE_CHECKING:
    from rotortrack.simulate.film.shapes import Shape

MARGIN_NM = 800.0
"""Pores that the scene does not place stay this far from the edge, as far as a spot reaches."""

SEPARATION_NM = 1500.0
"""Distance of scattered pores, where there is room for it."""

_DRIVEN = ("driven", "switching")


class _Draw(enum.IntEnum):
    """Place of each property among a rotor's draws; all are drawn, so none changes another."""

    RADIUS = 0
    SECOND_RADIUS = 1
    SECOND_PHASE = 2
    OMEGA = 3
    DIRECTION = 4
    DIFFUSION = 5
    START = 6
    PHOTONS = 7
    SECOND_PHOTONS = 8
    ARRIVE = 9
    LEAVE = 10
    SECOND_AFTER = 11
    SHAPE = 12


def draw_rotors(scene: FilmScene, shapes: Sequence[Sequence[Shape]]) -> tuple[Rotor, ...]:
    """Draw all rotors that move by a law of their own; tables of positions are not among them.

    Parameters
    ----------
    scene
        What is filmed.
    shapes
        For each group the rods among which its rotors choose; empty for circles.

    Returns
    -------
    Rotors, numbered from 0; the second ones of their pores behind all others.

    Raises
    ------
    ConfigurationError
        The field has no room, or the lattice not enough pores.
    """
    first: list[Rotor] = []
    second: list[Rotor] = []
    for number, (group, x_nm, y_nm) in enumerate(_placed(scene)):
        for member, place in enumerate(zip(x_nm, y_nm, strict=True)):
            own = [
                stream(scene.film.seed, Effect.ROTOR, number, member, turn).random(len(_Draw))
                for turn in range(1 if group.second_after_s is None else 2)
            ]
            made = [_rotor(group, place, shapes[number], draws.tolist()) for draws in own]
            made = [replace(rotor, pore=len(first), group=number) for rotor in made]
            first.append(made[0])
            if group.second_after_s is not None:
                after_s = within(group.second_after_s, float(own[0][_Draw.SECOND_AFTER]))
                second.append(replace(made[1], arrive_s=made[0].arrive_s + after_s))
    return tuple(replace(rotor, number=at) for at, rotor in enumerate([*first, *second]))


def count_of(group: RotorsOptions) -> int:
    """How many pores a group takes."""
    return group.count or len(group.x_nm) or 1


def _placed(
    scene: FilmScene,
) -> Iterator[tuple[RotorsOptions, Sequence[float], Sequence[float]]]:
    """Give each group its pores; those that name none share the lattice's or scattered ones."""
    wanting = [
        0 if group.x_nm or group.motion == "table" else count_of(group) for group in scene.rotors
    ]
    places = _free_places(scene, sum(wanting))
    taken = 0
    for group, count in zip(scene.rotors, wanting, strict=True):
        if count:
            own = places[taken : taken + count]
            taken += count
            yield group, own[:, 0].tolist(), own[:, 1].tolist()
        else:
            yield group, group.x_nm, group.y_nm


def _free_places(scene: FilmScene, count: int) -> NDArray[np.float64]:
    if not count:
        return np.empty((0, 2))
    film = scene.film
    height, width = scene.field_px
    if scene.lattice is None:
        margin_px = MARGIN_NM / film.pixel_size_nm
        rng = stream(film.seed, Effect.PLACES)
        return scatter(count, (height, width), film.pixel_size_nm, margin_px, SEPARATION_NM, rng)
    size_nm = (width * film.pixel_size_nm, height * film.pixel_size_nm)
    pores = lattice(scene.lattice, size_nm, MARGIN_NM, film.seed)
    if len(pores) < count:
        raise ConfigurationError(
            f"[lattice] has {len(pores)} pores within the frame and [[rotors]] ask for {count}: "
            "lower their count, or the lattice's pitch_nm"
        )
    return pores[:count]


def _rotor(
    group: RotorsOptions,
    place: tuple[float, float],
    shapes: Sequence[Shape],
    draws: Sequence[float],
) -> Rotor:
    sign = {"ccw": 1.0, "cw": -1.0}.get(
        group.direction, 1.0 if draws[_Draw.DIRECTION] < 0.5 else -1.0
    )
    moves = group.motion != "stuck"
    driven = group.motion in _DRIVEN
    start = draws[_Draw.START] * 2.0 * math.pi
    if group.start_deg is not None:
        start = math.radians(group.start_deg)
    shape = shapes[int(draws[_Draw.SHAPE] * len(shapes))] if shapes else None
    omega = within(group.omega_rad_s, draws[_Draw.OMEGA], logarithmic=True)
    if shape is not None and group.own_rate:
        omega = 2.0 * math.pi * abs(shape.rate_rev_s)
    breathing_nm = group.breathing_sd_nm
    if shape is not None and not breathing_nm:
        breathing_nm = math.hypot(*shape.breathing_sd_nm) / math.sqrt(2.0)
    return Rotor(
        number=0,
        pore=0,
        group=0,
        motion=group.motion,
        x_nm=place[0],
        y_nm=place[1],
        ends=_ends(group, shape, sign, draws),
        omega_rad_s=sign * omega if driven else 0.0,
        diffusion_rad2_s=within(group.diffusion_rad2_s, draws[_Draw.DIFFUSION], logarithmic=True)
        if moves
        else 0.0,
        start_rad=start,
        switch_rate_per_s=group.switch_rate_per_s
        if group.motion in ("switching", "two_position")
        else 0.0,
        wobble_sd_rad=group.wobble_sd_rad if group.motion in ("two_position", "tethered") else 0.0,
        arc_rad=math.radians(group.arc_deg) if group.motion == "arc" else 0.0,
        breathing_sd_nm=breathing_nm,
        breathing_time_s=group.breathing_time_s if breathing_nm else 0.0,
        arrive_s=within(group.arrive_s, draws[_Draw.ARRIVE]),
        leave_s=math.inf if group.leave_s is None else within(group.leave_s, draws[_Draw.LEAVE]),
    )


def _ends(
    group: RotorsOptions, shape: Shape | None, sign: float, draws: Sequence[float]
) -> tuple[End, ...]:
    """Build the labelled ends, a rod's mirrored where it is to turn the other way."""
    photons = within(group.photons, draws[_Draw.PHOTONS])
    asked = group.photons if group.second_photons is None else group.second_photons
    second_photons = within(asked, draws[_Draw.SECOND_PHOTONS])
    if shape is not None:
        hand = math.copysign(1.0, sign * shape.rate_rev_s)
        places = [(radius, hand * phase, hand * tangent) for radius, phase, tangent in shape.ends]
    else:
        phase = math.radians(within(group.second_phase_deg, draws[_Draw.SECOND_PHASE]))
        places = [
            (within(group.radius_nm, draws[_Draw.RADIUS]), 0.0, 0.0),
            (within(group.second_radius_nm, draws[_Draw.SECOND_RADIUS]), phase, phase),
        ]
    return tuple(
        End(radius_nm=radius, phase_rad=phase, tangent_rad=tangent, photons=light, channel=channel)
        for channel, ((radius, phase, tangent), light) in enumerate(
            zip(places[: group.ends], (photons, second_photons), strict=False)
        )
    )
