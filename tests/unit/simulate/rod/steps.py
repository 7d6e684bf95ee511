"""Rods under loads that no scene has: the implicit step driven from Python, for exact answers."""

import numpy as np

from rotortrack.simulate.rod.forces import NO_NODES
from rotortrack.simulate.rod.implicit import implicit_step, keep_tensions, look, new_room, new_shape
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters

HELD = 1e12
"""Drag, pN us/nm, of a vertex that does not move."""


def free_rod(n=51, **options):
    return rod_parameters(RodOptions(n_vertices=n, **options), None)


def straight(n=51, length_nm=450.0, direction=(1.0, 0.0, 0.0)):
    s = np.linspace(-0.5, 0.5, n)[:, np.newaxis] * length_nm
    return s * (np.asarray(direction) / np.linalg.norm(direction))


def arc(n=51, edge_nm=9.0, radius_nm=150.0):
    angle = np.arange(n) * 2.0 * np.arcsin(edge_nm / (2.0 * radius_nm))
    x = radius_nm * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return x - x.mean(axis=0)


def bent(deflection_nm, length_nm=450.0):
    """A chain of equal links in the xz plane whose heights are given."""
    n = len(deflection_nm)
    edge = length_nm / (n - 1)
    dz = np.diff(deflection_nm)
    x = np.concatenate([[0.0], np.cumsum(np.sqrt(edge**2 - dz**2))])
    return np.stack([x - x.mean(), np.zeros(n), deflection_nm], axis=1)


def relax(x, rod, load, *, held=(), guided=(), dt_us=1.0, steps=1):
    """Step a rod with a load on its vertices, some of them held, some held across only.

    Gives the shape and the tensions of the last step.
    """
    shape, room = new_shape(len(x)), new_room(len(x))
    x, moved = x.copy(), np.empty_like(x)
    for _ in range(steps):
        look(x, rod, *NO_NODES, shape)
        shape.force[:] += load
        shape.drag[list(held)] = HELD
        shape.drag[list(guided), 0] = HELD
        assert implicit_step(x, rod, shape, dt_us, 1.0, room, moved)
        keep_tensions(room)
        x[:] = moved
    return x, room.values[3 : 4 * len(x) - 1 : 4].copy()
