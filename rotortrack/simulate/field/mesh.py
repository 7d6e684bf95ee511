"""The mesh: a tensor product of graded lines in r and z without the block that is membrane.

Cells are smallest at the pore's rim, where fields are singular, and beside the charged walls; they
grow in geometric progression away from them. Rectangles need no mesh generator and are found by
bisection. An elongated pore has no axis of symmetry: it would need such a product in three
dimensions, of about a hundred times as many cells, and an iterative solver.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.field.grading import Grading, graded, graded_both
from rotortrack.simulate.field.options import FieldOptions


@dataclass(frozen=True)
class Mesh:
    """Lines of a tensor grid; cells within the membrane are not part of the fluid.

    Attributes
    ----------
    r_nm, z_nm
        (columns + 1,) from 0 and (rows + 1,), increasing.
    fluid
        (columns, rows) whether a cell is filled with water.
    """

    r_nm: NDArray[np.float64]
    z_nm: NDArray[np.float64]
    fluid: NDArray[np.bool_]


def make_mesh(options: FieldOptions, grading: Grading) -> Mesh:
    """Make the mesh of a pore.

    Raises
    ------
    ConfigurationError
        The box does not hold the pore.
    """
    radius, half = options.pore_radius_nm, options.membrane_nm / 2.0
    outer, height = options.box_radius_nm, options.box_height_nm / 2.0
    if outer < 2.0 * radius or height < half + 2.0 * radius:
        raise ConfigurationError(
            f"a box of box_radius_nm {outer:g} and box_height_nm {2 * height:g} is too small for a "
            f"pore of radius {radius:g} nm: ten times the pore's radius and more is usual"
        )
    lumen_r = radius - graded(radius, grading)[::-1]
    r_nm = np.concatenate((lumen_r, radius + graded(outer - radius, grading)[1:]))
    lumen_z = graded_both(2.0 * half, grading) - half
    above = half + graded(height - half, grading)[1:]
    z_nm = np.concatenate((-above[::-1], lumen_z, above))
    r_nm[0] = 0.0
    middle_r, middle_z = (r_nm[1:] + r_nm[:-1]) / 2.0, (z_nm[1:] + z_nm[:-1]) / 2.0
    solid = (middle_r[:, np.newaxis] > radius) & (np.abs(middle_z) < half)
    return Mesh(r_nm, z_nm, ~solid)
