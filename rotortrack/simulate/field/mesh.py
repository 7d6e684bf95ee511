"""Tensor-product mesh around a pore, graded toward the walls, by numpy alone.

Cells are rectangles between the lines `r_nm` and `z_nm`; the cells inside the membrane are left
out. A rounded rim is the same mesh pushed sideways near the rims: every mesh point X of the sharp
geometry lies in truth at X + d(X), where d turns the two edges of a rim into an arc and vanishes
beyond the rim's radius, so that topology and search stay those of rectangles.

An elongated pore is no longer axisymmetric: it would need the same grading in three dimensions (x,
y, z; a stadium as a mapped annulus times z), some 50 times the unknowns, and with that an iterative
solver in place of the direct one. The weak forms would lose their weight r and the hoop term.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Rim:
    """A rounded rim of the membrane |z| < half_nm beyond r = pore_nm."""

    pore_nm: float
    half_nm: float
    radius_nm: float

    def displaced(self, points: Floats) -> Floats:
        """Map points (2, ...) of the sharp geometry to the rounded one."""
        moved = points.copy()
        if self.radius_nm == 0:
            return moved
        side = np.sign(points[1])
        # Seen from the rim: x into the membrane, y away from it.
        x = (points[0] - self.pore_nm) / self.radius_nm
        y = (np.abs(points[1]) - self.half_nm) / self.radius_nm
        level = np.minimum(np.maximum(np.abs(x), np.abs(y)), 1.0)
        # From 0 on the wall of the pore to 1 on the face of the membrane, through the fluid.
        turn = np.mod(np.arctan2(y, x), 2 * math.pi)
        turn = np.where(turn > 1.75 * math.pi, 0.0, turn)
        blend = np.clip(1 - turn / (1.5 * math.pi), 0.0, 1.0)
        angle = math.pi / 4 * (1 - level)
        into, down = 1 - np.cos(angle), np.sin(angle)
        # The wall point at distance `level` goes onto the arc; the face point is its mirror image.
        wall_x, wall_y = into, -1 + down + level
        moved[0] += self.radius_nm * ((1 - blend) * wall_x + blend * -wall_y)
        moved[1] += side * self.radius_nm * ((1 - blend) * wall_y + blend * -wall_x)
        return moved

    def undisplaced(self, points: Floats) -> Floats:
        """Invert `displaced` by Newton steps on the few points near a rim."""
        found = points.copy()
        if self.radius_nm == 0:
            return found
        near = (np.abs(points[0] - self.pore_nm) <= self.radius_nm) & (
            np.abs(np.abs(points[1]) - self.half_nm) <= self.radius_nm
        )
        target = points[:, near]
        guess = target.copy()
        tiny = 1e-6 * self.radius_nm
        for _ in range(25):
            here = self.displaced(guess)
            error = here - target
            if not error.size or np.abs(error).max() < 1e-10 * self.radius_nm:
                break
            by_r = (self.displaced(guess + np.array([[tiny], [0.0]])) - here) / tiny
            by_z = (self.displaced(guess + np.array([[0.0], [tiny]])) - here) / tiny
            determinant = by_r[0] * by_z[1] - by_z[0] * by_r[1]
            determinant = np.where(np.abs(determinant) < 0.05, 0.05, determinant)
            step = np.stack(
                [
                    (by_z[1] * error[0] - by_z[0] * error[1]) / determinant,
                    (by_r[0] * error[1] - by_r[1] * error[0]) / determinant,
                ]
            )
            limit = 0.3 * self.radius_nm
            guess = guess - np.clip(step, -limit, limit)
        found[:, near] = guess
        return found


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Lines of a tensor-product mesh, nm; `solid` (n_r - 1, n_z - 1) marks cells left out."""

    r_nm: Floats
    z_nm: Floats
    solid: NDArray[np.bool_]
    rim: Rim | None = None

    @property
    def cells(self) -> int:
        """How many cells hold fluid."""
        return int((~self.solid).sum())

    def refined(self, ratio: float) -> Grid:
        """Split every cell in four, graded cells so that the grading becomes sqrt(ratio)."""
        solid = np.repeat(np.repeat(self.solid, 2, axis=0), 2, axis=1)
        return Grid(
            r_nm=_split(self.r_nm, ratio), z_nm=_split(self.z_nm, ratio), solid=solid, rim=self.rim
        )


def _split(lines: Floats, ratio: float) -> Floats:
    sizes = np.diff(lines)
    padded = np.concatenate([sizes[:1], sizes, sizes[-1:]])
    trend = np.sign(np.round(padded[2:] / padded[:-2] - 1.0, 6))
    part = 1 / (1 + math.sqrt(ratio) ** trend)
    middle = lines[:-1] + part * sizes
    return np.sort(np.concatenate([lines, middle]))


def graded(length: float, first: float, ratio: float, cap: float, both: bool = False) -> Floats:
    """Lines from 0 to `length` whose steps grow from `first` by `ratio` up to `cap`.

    With `both` the steps grow from either end toward the middle.
    """
    if both:
        half = graded(length / 2, first, ratio, cap)
        return np.concatenate([half, length - half[-2::-1]])
    steps: list[float] = []
    step, total = first, 0.0
    while total < length - 0.3 * min(step, cap):
        steps.append(min(step, cap))
        total += steps[-1]
        step *= ratio
    lines = np.concatenate([[0.0], np.cumsum(steps)])
    lines *= length / lines[-1]
    lines[-1] = length
    return np.asarray(lines)


def pore_grid(
    *,
    pore_nm: float,
    membrane_nm: float,
    box_radius_nm: float,
    box_height_nm: float,
    first_nm: float,
    ratio: float,
    rim_nm: float = 0.0,
) -> Grid:
    """Mesh of the fluid around a membrane with one pore, finest at its walls and rims."""
    half = membrane_nm / 2
    cap_nm = 0.08 * min(box_radius_nm, box_height_nm / 2)

    def away(length: float) -> Floats:
        if rim_nm == 0:
            return graded(length, first_nm, ratio, cap_nm)
        # The rounded part ends on a line of the mesh, since the map has a kink there.
        near = graded(rim_nm, first_nm, ratio, rim_nm)
        last = near[-1] - near[-2]
        return np.concatenate([near, rim_nm + graded(length - rim_nm, last, ratio, cap_nm)[1:]])

    inside = away(pore_nm)
    if rim_nm == 0:
        lumen = graded(membrane_nm, min(first_nm, membrane_nm / 4), ratio, cap_nm, both=True)
    else:
        part = away(half)
        lumen = np.concatenate([part, membrane_nm - part[-2::-1]])
    outside = away(box_radius_nm - pore_nm)
    above = half + away(box_height_nm / 2 - half)
    r_nm = np.concatenate([(pore_nm - inside)[::-1], pore_nm + outside[1:]])
    z_nm = np.concatenate([-above[::-1], lumen[1:-1] - half, above])
    middle_r, middle_z = (r_nm[1:] + r_nm[:-1]) / 2, (z_nm[1:] + z_nm[:-1]) / 2
    r_nm[0] = 0.0
    solid = (middle_r[:, None] > pore_nm) & (np.abs(middle_z)[None, :] < half)
    rim = Rim(pore_nm=pore_nm, half_nm=half, radius_nm=rim_nm) if rim_nm > 0 else None
    return Grid(r_nm=r_nm, z_nm=z_nm, solid=solid, rim=rim)
