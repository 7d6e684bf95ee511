"""Where pores are: in rows and columns, or scattered."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film.options import LatticeOptions
from rotortrack.simulate.film.streams import Effect, stream

_TRIES = 2000
"""Places that are tried at one distance, for few points."""

_TRIES_A_POINT = 4

_MOST_PORES = 10_000_000
"""Places of a lattice about a field; more are a pitch in the wrong unit."""


def lattice(
    options: LatticeOptions, size_nm: tuple[float, float], margin_nm: float, seed: int
) -> NDArray[np.float64]:
    """Give the pores of a lattice about the middle of a field, in the order of their filling.

    Parameters
    ----------
    options
        Pitch, rotation, occupancy and jitter.
    size_nm
        Width and height of the field.
    margin_nm
        Pores closer to the edge than this are left out.
    seed
        Of the film.

    Returns
    -------
    Places (x, y), shape (pores, 2): a random order of those that may hold rotors.

    Raises
    ------
    ConfigurationError
        The pitch makes more places than memory should hold.
    """
    reach = math.ceil(math.hypot(*size_nm) / options.pitch_nm)
    if (2 * reach + 1) ** 2 > _MOST_PORES:
        raise ConfigurationError(
            f"a pitch_nm of {options.pitch_nm:g} makes too many places in a field of "
            f"{size_nm[0]:.0f} x {size_nm[1]:.0f} nm: raise it"
        )
    steps = options.pitch_nm * np.arange(-reach, reach + 1)
    across, down = (axis.ravel() for axis in np.meshgrid(steps, steps))
    turn = math.radians(options.rotation_deg)
    # y points down, so that a positive turn is counter-clockwise on the image.
    x_nm = size_nm[0] / 2.0 + across * math.cos(turn) + down * math.sin(turn)
    y_nm = size_nm[1] / 2.0 - across * math.sin(turn) + down * math.cos(turn)
    rng = stream(seed, Effect.LATTICE)
    places = np.stack([x_nm, y_nm], axis=1)
    # Drawn for every place, so that jitter and occupancy change no other.
    shifts, order = rng.standard_normal(places.shape), rng.random(len(places))
    places += options.jitter_nm * shifts
    inside = np.all((places >= margin_nm) & (places <= np.subtract(size_nm, margin_nm)), axis=1)
    chosen = np.flatnonzero(inside)[np.argsort(order[inside])]
    return places[chosen[: max(round(options.occupancy * len(chosen)), min(len(chosen), 1))]]


def scatter(
    count: int,
    shape_px: tuple[int, int],
    pixel_size_nm: float,
    margin_px: float,
    separation_nm: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Place points one by one at random, starting over closer together when they do not fit.

    Parameters
    ----------
    count, shape_px, pixel_size_nm
        How many, and the height and width of the field.
    margin_px
        Distance to its edges.
    separation_nm
        Wanted distance between points; less where the field is too small for it.
    rng
        Source of the places.

    Returns
    -------
    Places (x, y), nm, shape (count, 2).

    Raises
    ------
    ConfigurationError
        The field is smaller than its margins.
    """
    height, width = shape_px
    if min(shape_px) <= 2.0 * margin_px:
        raise ConfigurationError(
            f"a field of {width} x {height} px leaves no room for rotors, which stay "
            f"{margin_px:.1f} px off its edges: raise width_px and height_px in [film] (shape_px "
            "in a script), or name places by x_nm and y_nm"
        )
    low = np.array([margin_px, margin_px]) * pixel_size_nm
    high = np.array([width - margin_px, height - margin_px]) * pixel_size_nm
    while True:
        placed = np.empty((0, 2))
        for candidate in rng.uniform(low, high, (max(_TRIES, _TRIES_A_POINT * count), 2)):
            if np.all(np.hypot(*(placed - candidate).T) >= separation_nm):
                placed = np.vstack([placed, candidate])
            if len(placed) >= count:
                return placed[:count]
        separation_nm *= 0.95
