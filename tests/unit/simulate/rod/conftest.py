"""Shapes, pores and fields that the tests of the rod share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest


@dataclass(frozen=True)
class PlainPore:
    """The membrane's shape, without a field."""

    pore_radius_nm: float = 25.0
    membrane_nm: float = 20.0
    rim_radius_nm: float = 0.0


@pytest.fixture
def pore() -> PlainPore:
    """The paper's pore."""
    return PlainPore()


@pytest.fixture
def make_pore() -> type[PlainPore]:
    """A pore of other measures."""
    return PlainPore


@pytest.fixture
def wavy() -> np.ndarray:
    """Vertices of a rod that bends and twists, edges near 9 nm but not exactly."""
    rng = np.random.default_rng(7)
    x = np.zeros((51, 3))
    x[:, 0] = np.linspace(-225.0, 225.0, 51)
    return x + rng.normal(0.0, 1.2, x.shape)


@pytest.fixture
def linear_table() -> Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A table of quantities name=(a, b, c) for a + b r + c z, which any table holds exactly."""

    def table(**terms: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        r_nm = np.linspace(0.0, 600.0, 13)
        z_nm = np.linspace(-600.0, 600.0, 25)
        nodes = np.zeros((13, 25, 8, 4))
        names = [
            *("e_applied_r", "e_applied_z", "e_equilibrium_r", "e_equilibrium_z"),
            *("u_r", "u_z", "lnc_r", "lnc_z"),
        ]
        for name, (constant, per_r, per_z) in terms.items():
            nodes[:, :, names.index(name), 0] = (
                constant + per_r * r_nm[:, None] + per_z * z_nm[None, :]
            )
            nodes[:, :, names.index(name), 1] = per_r
            nodes[:, :, names.index(name), 2] = per_z
        return r_nm, z_nm, nodes

    return table


@pytest.fixture
def gradient() -> Callable[..., np.ndarray]:
    """Minus the gradient of an energy of (x, rod), by central differences of fourth order."""

    def minus_gradient(energy, x, rod, step=1e-3):
        result = np.zeros_like(x)
        for index in np.ndindex(x.shape):
            values = []
            for shift in (-2, -1, 1, 2):
                moved = x.copy()
                moved[index] += shift * step
                values.append(energy(moved, rod))
            result[index] = -(values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
        return result

    return minus_gradient
