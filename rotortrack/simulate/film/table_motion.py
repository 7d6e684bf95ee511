"""Rotors whose places a table tells, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import TableError
from rotortrack.simulate.film.actors import Light
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.dyes import Dyes
from rotortrack.simulate.film.rotor import End, Rotor
from rotortrack.simulate.film.scene import FilmScene, within
from rotortrack.simulate.film.streams import Effect, stream
from rotortrack.tables import Column, Schema

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

POSITIONS: Final = Schema(
    "positions",
    (
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("rotor", "int64", "", "rotor number, from 0", required=True),
        Column("x_nm", "float64", "nm", "place along columns", required=True),
        Column("y_nm", "float64", "nm", "place along rows, down", required=True),
        Column("photons", "float64", "photons", "expected photons in the frame"),
    ),
)

_MOST_NM = 1e9
"""A place farther away than a metre is in another unit."""

_MOST_ROTORS = 100_000
"""More than any camera resolves; each takes memory in every block."""


class Positions:
    """Places of rotors, given frame after frame; a rotor without a row in a frame is dark in it.

    Parameters
    ----------
    frame, rotor
        Of each row, shape (rows,), in any order; no rotor twice in a frame.
    x_nm, y_nm
        Its place on the image of the first colour, from the outer corner of pixel (0, 0), y down.
    photons
        Expected photons; None where the table has none.

    Attributes
    ----------
    rotors
        Their numbers in the table, ascending.
    middle_nm
        Mean place (x, y) of each rotor, shape (rotors, 2).
    has_photons
        Whether the table tells them; else light is 1 wherever there is a row.
    """

    def __init__(
        self,
        frame: NDArray[np.int64],
        rotor: NDArray[np.int64],
        x_nm: Floats,
        y_nm: Floats,
        photons: Floats | None,
    ) -> None:
        numbers, at = np.unique(rotor, return_inverse=True)
        self.rotors: tuple[int, ...] = tuple(numbers.tolist())
        self.has_photons = photons is not None
        rows = np.bincount(at)
        self.middle_nm: Floats = np.stack(
            [np.bincount(at, weights=values) / rows for values in (x_nm, y_nm)], axis=1
        )
        light = np.ones(len(frame)) if photons is None else photons
        order = np.argsort(frame, kind="stable")
        self._frame, self._at = frame[order], at[order]
        self._x_nm, self._y_nm, self._light = x_nm[order], y_nm[order], light[order]
        self._next = 0

    def advance(self, n: int) -> tuple[Floats, Floats, Floats]:
        """Give place and light of each rotor in the next n frames.

        Returns
        -------
        x_nm, y_nm, photons
            Each (rotors, n). Where a rotor has no row, its photons are 0 and it stands in its
            middle.
        """
        first, self._next = self._next, self._next + n
        begin, end = np.searchsorted(self._frame, (first, self._next))
        rows = slice(begin, end)
        cells = (self._at[rows], self._frame[rows] - first)
        x_nm, y_nm = (np.repeat(middle[:, np.newaxis], n, axis=1) for middle in self.middle_nm.T)
        photons = np.zeros(x_nm.shape)
        x_nm[cells], y_nm[cells], photons[cells] = (
            self._x_nm[rows],
            self._y_nm[rows],
            self._light[rows],
        )
        return x_nm, y_nm, photons


class TableActor:
    """The rotors of one table: points of the first colour that stand still during an exposure.

    Photons of the table are filmed as they are. Where it has none, each rotor draws its own from
    the scene's, and its dyes bleach and blink.

    Parameters
    ----------
    scene, group
        The scene, and which of its groups of rotors has the table.
    clock
        When frames are exposed.
    rotor, pore
        Number of the first rotor and of its pore; the others follow.

    Attributes
    ----------
    rotors
        What is known of them: the mean place and light; the rest is nan.

    Raises
    ------
    TableError, ResourceError
        The table cannot be used: see :func:`read_positions`.
    """

    def __init__(self, scene: FilmScene, group: int, clock: Clock, rotor: int, pore: int) -> None:
        options, seed = scene.rotors[group], scene.film.seed
        assert options.table is not None
        self._positions = read_positions(Path(options.table), clock.n_frames)
        self.rotors: list[Rotor] = []
        self._dyes: list[Dyes] = []
        for member, (x_nm, y_nm) in enumerate(self._positions.middle_nm.tolist()):
            number, photons = rotor + member, math.nan
            if not self._positions.has_photons:
                part = float(stream(seed, Effect.ROTOR, group, member).random())
                photons = within(options.photons, part)
                row = y_nm / scene.film.pixel_size_nm
                self._dyes.append(
                    Dyes(
                        number,
                        0,
                        photons,
                        clock,
                        seed,
                        dyes=scene.dyes,
                        bleaching=scene.bleaching,
                        blinking=scene.blinking,
                        delay_s=row * clock.line_time_s,
                    )
                )
            end = End(
                **dict.fromkeys(("radius_nm", "phase_rad", "tangent_rad"), math.nan),
                photons=photons,
                channel=0,
            )
            self.rotors.append(
                Rotor(
                    number=number,
                    pore=pore + member,
                    group=group,
                    motion="table",
                    x_nm=x_nm,
                    y_nm=y_nm,
                    ends=(end,),
                    omega_rad_s=math.nan,
                    diffusion_rad2_s=math.nan,
                    start_rad=math.nan,
                )
            )

    def advance(self, n: int) -> Iterator[Light]:
        """Give the light of each rotor in the next n frames."""
        rows = zip(self.rotors, *self._positions.advance(n), strict=True)
        for member, (rotor, x_nm, y_nm, light) in enumerate(rows):
            yield Light(
                x_nm=x_nm[:, np.newaxis],
                y_nm=y_nm[:, np.newaxis],
                photons=light * self._dyes[member].advance(n)[0] if self._dyes else light,
                channel=0,
                rotor=rotor.number,
                end=0,
                theta_rad=np.full(1, np.nan),
            )


def read_positions(path: Path, n_frames: int) -> Positions:
    """Read the places of rotors from a table.

    Parameters
    ----------
    path
        CSV (also .csv.gz) or Parquet by its ending, with the columns of `POSITIONS`, photons if
        wanted; others are passed over. The whole table is held: 40 bytes a row.
    n_frames
        Frames of the film, dropped ones included.

    Raises
    ------
    TableError
        The file cannot be read, has no rows, lacks columns, or holds what cannot be filmed.
    ResourceError
        The memory of this computer cannot hold the table.
    """
    table = _read(path)
    if table.empty:
        raise TableError(f"{path} has no rows: give the place of a rotor in at least one frame")
    frame, rotor = (table[name].to_numpy() for name in ("frame", "rotor"))
    x_nm, y_nm = (table[name].to_numpy() for name in ("x_nm", "y_nm"))
    photons = table["photons"].to_numpy() if "photons" in table else None
    bad = ~(np.abs(x_nm) <= _MOST_NM) | ~(np.abs(y_nm) <= _MOST_NM)
    _refuse(path, bad, table, "x_nm and y_nm must be numbers of nanometres within a metre")
    if photons is not None:
        bad = ~((photons >= 0.0) & np.isfinite(photons))
        _refuse(path, bad, table, "photons must be 0 or more")
    _refuse(path, rotor < 0, table, "rotor must be 0 or more: leave out spots of no rotor")
    outside = frame >= n_frames
    wanted = f"frame must be below {n_frames}: raise n_frames in [film], or cut the table"
    _refuse(path, outside, table, wanted)
    twice = table.duplicated(["frame", "rotor"]).to_numpy()
    _refuse(path, twice, table, "no rotor may have two places in one frame")
    positions = Positions(frame, rotor, x_nm, y_nm, photons)
    if len(positions.rotors) > _MOST_ROTORS:
        raise TableError(
            f"{path} has {len(positions.rotors):,} rotors, more than the {_MOST_ROTORS:,} that a "
            "film may have: give the spots of one rotor the same number"
        )
    return positions


def _read(path: Path) -> pd.DataFrame:
    name = path.name.lower()
    if name.endswith(".parquet"):
        from rotortrack.exchange.parquet import read_table

        return read_table(path, POSITIONS)
    if name.endswith((".csv", ".csv.gz")):
        from rotortrack.exchange.csv import read_csv

        return read_csv(path, POSITIONS)
    raise TableError(f"{path} is neither .csv nor .parquet: save the table of positions as one")


def _refuse(path: Path, bad: NDArray[np.bool_], table: pd.DataFrame, wanted: str) -> None:
    """Raise for the first row that is bad."""
    if bad.any():
        at = int(np.argmax(bad))
        cells = ", ".join(f"{name} {table[name].iloc[at]:g}" for name in table if name in _TOLD)
        raise TableError(f"{path}, row {at + 1} ({cells}): {wanted}")


_TOLD = frozenset(POSITIONS.names)
