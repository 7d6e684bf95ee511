"""Tables of a field: what the rod reads, saves of solved fields, and scaling with the voltage."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotortrack.errors import ArchiveError, ConfigurationError, FieldError
from rotortrack.simulate.archive import read_archive, write_archive
from rotortrack.simulate.field.mesh import graded
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.sample import QUANTITIES, RADIAL, hermite_nodes

LINEAR_TO_V: Final = 0.2
"""Flow is linear in the voltage to 2.4 % up to here, and 16 % less than linear at 0.5 V."""

SPACING: Final = (0.5, 1.12, 20.0)
"""Distance of a table's lines: on the walls (nm), its growth away from them, and at most (nm)."""

_CORNER_NM: Final = 0.35
"""Fields are infinite at a sharp rim; its node has their mean at this distance."""

_NUDGE_NM: Final = 1e-6
_KIND: Final = "a table of a nanopore's field"
_DIMENSIONS: Final = {"r_nm": 1, "z_nm": 1, "values": 3}

Array = NDArray[np.float64]


class Solution(Protocol):
    """What can be tabulated."""

    @property
    def options(self) -> FieldOptions:
        """Pore, salt and voltage."""

    @property
    def voltage_v(self) -> float:
        """Potential of the trans solution."""

    @property
    def current_a(self) -> float:
        """Current from trans to cis."""

    @property
    def flow_m3_s(self) -> float:
        """Flow of water from trans to cis."""

    @property
    def current_error_rel(self) -> float:
        """Relative error of the current."""

    @property
    def flow_error_rel(self) -> float:
        """Relative error of the flow."""

    def evaluate_all(
        self, quantities: tuple[str, ...], r_nm: ArrayLike, z_nm: ArrayLike
    ) -> dict[str, Array]:
        """Evaluate some quantities at points in the water."""


@dataclass(frozen=True, eq=False)
class FieldTable:
    """Fields of a pore on a graded grid, read by bicubic interpolation.

    Attributes
    ----------
    r_nm, z_nm
        (nr,) from 0 and (nz,) increasing.
    values
        (nr, nz, 8) in the order and units of ``QUANTITIES``; within the membrane the values of
        the nearest water.
    options
        What was solved, by name of :class:`FieldOptions`.
    voltage_v
        Potential of the trans side to which the values belong.
    current_a, flow_m3_s
        From trans to cis.
    current_error_rel, flow_error_rel
        Relative errors of the solution behind the table.
    """

    r_nm: Array
    z_nm: Array
    values: Array
    options: dict[str, Any]
    voltage_v: float
    current_a: float
    flow_m3_s: float
    current_error_rel: float
    flow_error_rel: float

    @functools.cached_property
    def nodes(self) -> Array:
        """Values and slopes, (nr, nz, 8, 4), for `sample_field`."""
        return hermite_nodes(self.r_nm, self.z_nm, self.values)

    @property
    def pore_radius_nm(self) -> float:
        """Radius of the pore."""
        return float(self.options["pore_radius_nm"])

    @property
    def membrane_nm(self) -> float:
        """Thickness of the membrane."""
        return float(self.options["membrane_nm"])

    @property
    def rim_radius_nm(self) -> float:
        """Radius of the pore's rim, 0 for a sharp one."""
        return float(self.options["rim_radius_nm"])

    def scaled(self, voltage_v: float) -> FieldTable:
        """Give the fields of another voltage, to which all but those at rest are proportional.

        Current and flow are, to 2.4 % at 0.2 V. Beside the pore salt piles up on one side and is
        lacking on the other: fields there, scaled from 0.1 V, are off by up to 2 % at 0.05 V and
        5 % at 0.2 V. Solve at the voltage itself where that matters.

        Raises
        ------
        FieldError
            Beyond 0.2 V, or with unequal salts or no voltage in this table: solve instead.
        """
        if voltage_v == self.voltage_v:
            return self
        remedy = f"solve the field at voltage_v = {voltage_v:g} instead"
        if not max(abs(voltage_v), abs(self.voltage_v)) <= LINEAR_TO_V:
            raise FieldError(
                f"fields are proportional to the voltage up to {LINEAR_TO_V:g} V only: {remedy}"
            )
        if self.options["cis_mm"] != self.options["trans_mm"] or self.voltage_v == 0.0:
            raise FieldError(
                "only fields of equal salts that were solved at some voltage can be scaled: "
                f"{remedy}"
            )
        factor = voltage_v / self.voltage_v
        # The mirror image of a pore has the opposite voltage, whatever piles up beside it.
        image = self._mirrored() if factor < 0.0 else self
        driven = np.array([1.0 if "equilibrium" in name else abs(factor) for name in QUANTITIES])
        return dataclasses.replace(
            self,
            z_nm=image.z_nm,
            values=image.values * driven,
            options={**self.options, "voltage_v": voltage_v},
            voltage_v=voltage_v,
            current_a=self.current_a * factor,
            flow_m3_s=self.flow_m3_s * factor,
        )

    def _mirrored(self) -> FieldTable:
        """Exchange cis and trans."""
        sign = np.array([-1.0 if name.endswith("_z") else 1.0 for name in QUANTITIES])
        return dataclasses.replace(self, z_nm=-self.z_nm[::-1], values=self.values[:, ::-1] * sign)

    def save(self, path: Path, *, compact: bool = False) -> None:
        """Write the table to an npz file, whole or not at all.

        Parameters
        ----------
        path
            The file.
        compact
            Keep seven digits of the values.

        Raises
        ------
        ResourceError
            The file cannot be written.
        """
        about = {
            "kind": _KIND,
            "quantities": QUANTITIES,
            **{
                name: getattr(self, name)
                for name in (
                    "options", "voltage_v", "current_a", "flow_m3_s",
                    "current_error_rel", "flow_error_rel",
                )
            },
        }  # fmt: skip
        values: Any = self.values.astype(np.float32) if compact else self.values
        write_archive(path, {"r_nm": self.r_nm, "z_nm": self.z_nm, "values": values}, about)

    @classmethod
    def load(cls, path: Path) -> FieldTable:
        """Read a table that `save` wrote.

        Raises
        ------
        ArchiveError
            The file is no such table; the sentence names it.
        """
        arrays, about = read_archive(path, _KIND, _DIMENSIONS)
        shape = arrays["r_nm"].size, arrays["z_nm"].size, len(QUANTITIES)
        lines = arrays["r_nm"], arrays["z_nm"]
        numbers = ("voltage_v", "current_a", "flow_m3_s", "current_error_rel", "flow_error_rel")
        try:
            if about["kind"] != _KIND or about["quantities"] != list(QUANTITIES):
                raise ValueError("it is another kind of archive, or of other quantities")
            if arrays["values"].shape != shape or min(shape) < 3:
                raise ValueError("its arrays do not fit")
            if not all(np.isfinite(array).all() for array in arrays.values()):
                raise ValueError("it holds values that are no numbers")
            if not all((np.diff(line) > 0).all() for line in lines) or lines[0][0] != 0.0:
                raise ValueError("its lines do not increase from the axis")
            if not lines[1][0] < 0.0 < lines[1][-1]:
                raise ValueError("its lines do not pass the pore")
            if any(arrays["values"][0, :, k].any() for k in RADIAL):
                raise ValueError("its radial parts do not vanish on the axis")
            # An own option that the file does not have would silently be the default.
            options = vars(FieldOptions(**about["options"]))
            if options.keys() != about["options"].keys():
                raise ValueError("its options are not whole")
            told = {name: float(about[name]) for name in numbers}
            # Errors that nobody estimated are no numbers.
            if not np.isfinite([told[name] for name in numbers[:3]]).all():
                raise ValueError(f"one of {', '.join(numbers[:3])} is no number")
        except (KeyError, TypeError, ValueError, AttributeError, ConfigurationError) as error:
            raise ArchiveError(f"{path} cannot be read as {_KIND} ({error})") from error
        content: dict[str, Any] = {**arrays, **told, "options": options}
        return cls(**content)


def tabulate(solution: Solution, spacing: tuple[float, float, float] = SPACING) -> FieldTable:
    """Sample a solved field on the grid of a table.

    Parameters
    ----------
    solution
        Of :func:`rotortrack.simulate.field.solve.solve_field`.
    spacing
        Distances of the lines.

    Returns
    -------
    FieldTable
    """
    options = solution.options
    radius, half = options.pore_radius_nm, options.membrane_nm / 2.0
    outer, height = options.box_radius_nm, options.box_height_nm / 2.0
    lumen = radius - graded(radius, *spacing)[::-1]
    r_nm = np.concatenate((lumen, radius + graded(outer - radius, *spacing)[1:]))
    above = half + graded(height - half, *spacing)[1:]
    within = graded(2.0 * half, *spacing, both=True) - half
    z_nm = np.concatenate((-above[::-1], within, above))
    r_nm[0] = 0.0
    r, z = np.meshgrid(r_nm, z_nm, indexing="ij")
    values = _mean_about(solution, *_nearest_water(options, r, z))
    values[0][:, RADIAL] = 0.0
    return FieldTable(
        r_nm=r_nm,
        z_nm=z_nm,
        values=values,
        options=dataclasses.asdict(options),
        voltage_v=solution.voltage_v,
        current_a=solution.current_a,
        flow_m3_s=solution.flow_m3_s,
        current_error_rel=solution.current_error_rel,
        flow_error_rel=solution.flow_error_rel,
    )


def _nearest_water(options: FieldOptions, r: Array, z: Array) -> tuple[Array, Array]:
    """Move points within the membrane to the nearest water, on a rounded rim to its arc."""
    radius, half, rim = options.pore_radius_nm, options.membrane_nm / 2.0, options.rim_radius_nm
    to_lumen, to_face = r - radius, half - np.abs(z)
    inside = ~_is_wet(options, r, z)
    # Seen from the middle of the rim's arc, the water lies towards the axis and the face.
    x, y = rim - to_lumen, rim - to_face
    rounded = inside & (x > 0.0) & (y > 0.0)
    sideways = inside & ~rounded & (to_lumen <= to_face)
    up = inside & ~rounded & ~sideways
    stretch = rim / np.where(rounded, np.hypot(x, y), 1.0)
    moved_r = np.where(rounded, radius + rim - x * stretch, np.where(sideways, radius, r))
    moved_z = np.where(rounded, half - rim + y * stretch, np.where(up, half, np.abs(z)))
    return moved_r, np.copysign(moved_z, z)


def _is_wet(options: FieldOptions, r: Array, z: Array) -> NDArray[np.bool_]:
    """Whether points lie in the water or on a wall."""
    radius, half, rim = options.pore_radius_nm, options.membrane_nm / 2.0, options.rim_radius_nm
    x, y = radius + rim - r, np.abs(z) - half + rim
    beyond_arc = (x > 0.0) & (y > 0.0) & (np.hypot(x, y) >= rim)
    return np.asarray((r <= radius) | (np.abs(z) >= half) | (beyond_arc & (rim > 0.0)))


def _mean_about(solution: Solution, r: Array, z: Array) -> Array:
    """Mean of all quantities over the cells that meet at each point: slopes jump there.

    Returns
    -------
    ndarray
        (nr, nz, 8).
    """
    options = solution.options
    radius, half = options.pore_radius_nm, options.membrane_nm / 2.0
    at_corner = (np.abs(r - radius) < _NUDGE_NM) & (np.abs(np.abs(z) - half) < _NUDGE_NM)
    reach = np.where(at_corner, _CORNER_NM / np.sqrt(2.0), _NUDGE_NM)
    total, count = np.zeros((*r.shape, len(QUANTITIES))), np.zeros(r.shape)
    for along_r in (-1.0, 1.0):
        for along_z in (-1.0, 1.0):
            at_r = np.clip(r + along_r * reach, 0.0, options.box_radius_nm)
            highest = options.box_height_nm / 2.0
            at_z = np.clip(z + along_z * reach, -highest, highest)
            wet = _is_wet(options, at_r, at_z)
            # Dry places are asked for on the axis, where all is water, and left out.
            found = solution.evaluate_all(
                QUANTITIES, np.where(wet, at_r, 0.0), np.where(wet, at_z, 0.0)
            )
            for k, name in enumerate(QUANTITIES):
                total[..., k] += np.where(wet, found[name], 0.0)
            count += wet
    return total / count[..., np.newaxis]
