"""Rods under loads that no scene has: the implicit step driven from Python, for exact answers."""

from dataclasses import dataclass, field

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


def at(x, *place_nm):
    """The same shape elsewhere."""
    return x + np.array(place_nm)


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


@dataclass(frozen=True)
class Field:
    """A field and the membrane that it belongs to, as a run wants them."""

    r_nm: np.ndarray
    z_nm: np.ndarray
    nodes: np.ndarray
    pore_radius_nm: float = 25.0
    membrane_nm: float = 20.0
    rim_radius_nm: float = 0.0
    voltage_v: float = 0.1
    current_error_rel: float = 0.0
    flow_error_rel: float = 0.0
    options: dict = field(default_factory=dict)


def tabulated(r_nm, z_nm, **quantities):
    """A field whose quantities are functions of (r, z), with nodes of value and slopes."""
    names = ["e_applied_r", "e_applied_z", "e_equilibrium_r", "e_equilibrium_z"]
    names += ["u_r", "u_z", "lnc_r", "lnc_z"]
    r, z = np.meshgrid(r_nm, z_nm, indexing="ij")
    nodes = np.zeros((len(r_nm), len(z_nm), 8, 4))
    h = 1e-3
    for name, f in quantities.items():
        q = names.index(name)
        nodes[:, :, q, 0] = f(r, z)
        nodes[:, :, q, 1] = (f(r + h, z) - f(r - h, z)) / (2 * h)
        nodes[:, :, q, 2] = (f(r, z + h) - f(r, z - h)) / (2 * h)
        nodes[:, :, q, 3] = (
            f(r + h, z + h) - f(r - h, z + h) - f(r + h, z - h) + f(r - h, z - h)
        ) / (4 * h * h)
    return Field(np.asarray(r_nm), np.asarray(z_nm), nodes)


def uniform_field(e_z_v_m=0.0, u_z_nm_us=0.0):
    """The same field and flow along z everywhere."""
    return tabulated(
        np.linspace(0.0, 600.0, 13),
        np.linspace(-600.0, 600.0, 25),
        e_applied_z=lambda r, _: 0.0 * r + e_z_v_m,
        u_z=lambda r, _: 0.0 * r + u_z_nm_us,
    )


def toy_field(strength=1.0, slip=1.0):
    """Something like a pore's field in closed form: it draws a rod in, a flow holds it off."""

    def spread(r, z):
        return 625.0 / (r * r + z * z + 625.0) ** 1.5 * 1e6 * strength

    def rise(z):
        return np.sqrt(z * z + 25.0)

    def held(z):
        return 20.63e-6 * slip * (1.0 - np.exp(-np.sqrt((z - 10.0) ** 2 + 1.0)))

    near = np.concatenate([np.arange(0.0, 50.0, 2.0), np.arange(50.0, 400.0, 10.0)])
    return tabulated(
        near,
        np.concatenate([-near[:0:-1], near]),
        e_applied_r=lambda r, z: spread(r, z) * r,
        e_applied_z=lambda r, z: spread(r, z) * rise(z),
        u_r=lambda r, z: spread(r, z) * r * held(z),
        u_z=lambda r, z: spread(r, z) * rise(z) * held(z),
    )
