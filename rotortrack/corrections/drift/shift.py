"""The shift between two time bins, with its standard deviation and its evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.corrections.drift.correlation import (
    FINE_REACH,
    WINDOW_HALF,
    CoarseCorrelation,
    apply_stencil,
    count_pairs,
)
from rotortrack.corrections.drift.evidence import dense_pixels, excess_on
from rotortrack.corrections.drift.radial_symmetry import radial_symmetry_centre
from rotortrack.errors import TableError

_LARGEST_FIELD_PX = 2**24
_LAG_LIMITS_PX = (16, 256)
_RECENTRINGS = 5
_TILE_PX = 16
"""Tiles much wider than a rotor, so that few rotors lie in two of them."""
_MOST_GROUPS = 24
_LEAST_PEAK = 8.0
"""The coarse search picks the best of thousands of lags: 4 to 6 happens by chance."""


@dataclass(frozen=True)
class Shift:
    """Position of one bin relative to the reference.

    Attributes
    ----------
    px
        Shape (2,), x and y, camera pixels.
    replicates_px
        Shape (groups, 2), the same with one group of tiles of the field left out.
    peak
        Evidence for the shift, in standard deviations of positions without a common structure.
    problem
        Why the shift must not be used; None when it may.
    """

    px: NDArray[np.float64]
    replicates_px: NDArray[np.float64]
    peak: float
    problem: str | None = None


class ShiftMeasurement:
    """Measure shifts of time bins against one of them by cross-correlation.

    Parameters
    ----------
    x_px, y_px
        Shape (n,), all positions in camera pixels, finite.
    reference
        Rows of the bin that the others are compared with.
    magnification
        Fine pixels per camera pixel.

    Raises
    ------
    TableError
        The positions span more camera pixels than any camera has.
    """

    def __init__(
        self,
        x_px: NDArray[np.float64],
        y_px: NDArray[np.float64],
        reference: slice,
        magnification: float,
    ) -> None:
        # Compared as floats: a stray 1e300 would not survive the conversion to integers.
        span = np.array([np.ptp(np.floor(y_px)), np.ptp(np.floor(x_px))]) + 1
        if not span[0] * span[1] <= _LARGEST_FIELD_PX:
            raise TableError(
                f"the positions span {span[1]:.0f} x {span[0]:.0f} camera pixels, more than any "
                "camera has: check their unit and pixel_size_nm, or remove the stray rows"
            )
        self._magnification = magnification
        self._columns = _from_zero(x_px)
        self._rows = _from_zero(y_px)
        self._shape = shape = (int(span[0]), int(span[1]))
        self._reference = reference
        self._largest_lag = int(np.clip(max(shape) // 2, *_LAG_LIMITS_PX))
        self._coarse = CoarseCorrelation(
            self._columns[reference], self._rows[reference], shape, self._largest_lag
        )
        fine_columns = _from_zero(x_px * magnification)
        self._reference_dense = dense_pixels(self._columns[reference], self._rows[reference], shape)
        # Keys of different rows stay apart for lags up to the largest one.
        largest_lag_fine = int((self._largest_lag + 1) * magnification) + 2 * FINE_REACH + 1
        self._stride = int(fine_columns.max()) + 1 + 2 * largest_lag_fine
        self._keys = _from_zero(y_px * magnification) * self._stride + fine_columns
        self._groups, self._n_groups = _group_tiles(self._columns, self._rows)
        self._reference_keys, self._reference_counts = np.unique(
            self._keys[reference], return_counts=True
        )
        self._prior_px = float(max(*shape, _LAG_LIMITS_PX[0]))

    @property
    def groups(self) -> int:
        """Number of groups of tiles."""
        return self._n_groups

    def __call__(self, rows: slice, expected_px: NDArray[np.float64]) -> Shift:
        """Measure one bin.

        Parameters
        ----------
        rows
            Rows of the bin.
        expected_px
            Shape (2,), the shift of the bin before.
        """
        lag = self._coarse_lag(rows, expected_px)
        if lag is None:
            return self._unusable("its correlation peak leaves the searched lags")
        keys, first, counts = np.unique(self._keys[rows], return_index=True, return_counts=True)
        groups = self._groups[rows][first]
        centre = np.round(lag * self._magnification)
        for recentrings_left in reversed(range(_RECENTRINGS)):
            pairs = count_pairs(
                self._reference_keys,
                self._reference_counts,
                keys,
                counts,
                groups,
                self._n_groups,
                self._stride,
                int(centre[1]) * self._stride + int(centre[0]),
            )
            total = pairs.sum(axis=0)
            offset = np.array(radial_symmetry_centre(apply_stencil(total)))
            if not (np.abs(offset) <= WINDOW_HALF).all():
                return self._unusable("its correlation has no peak in the window")
            moved = np.round(centre + offset)
            settled = bool((moved == centre).all())
            if settled or not recentrings_left or not self._inside(moved / self._magnification):
                break
            centre = moved
        peak = self._evidence(rows, np.round((centre + offset) / self._magnification))
        replicates = [
            radial_symmetry_centre(apply_stencil(total - pairs[group]))
            for group in range(self._n_groups)
        ]
        return Shift(
            px=-(centre + offset) / self._magnification,
            replicates_px=-(centre + np.array(replicates)) / self._magnification,
            peak=peak,
            problem=None if peak >= _LEAST_PEAK else "its correlation peak does not stand out",
        )

    def _coarse_lag(
        self, rows: slice, expected_px: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Best lag (x, y) in camera pixels, None when its window is not inside the search."""
        correlation = self._coarse(self._columns[rows], self._rows[rows])
        axis = np.arange(-self._largest_lag, self._largest_lag + 1)
        # A lattice of rotors correlates at every pitch; the wide prior prefers the lag near the
        # one of the bin before among peaks of equal height.
        near_x, near_y = (
            np.exp(-((axis + shift) ** 2) / (2 * self._prior_px**2)) for shift in expected_px
        )
        best = np.argmax(correlation * near_y[:, np.newaxis] * near_x)
        j, i = (int(k) for k in np.unravel_index(best, correlation.shape))
        lag = np.array([axis[i], axis[j]], dtype=np.float64)
        if not self._inside(lag):
            return None
        window = correlation[
            j - WINDOW_HALF : j + WINDOW_HALF + 1, i - WINDOW_HALF : i + WINDOW_HALF + 1
        ]
        refinement = np.array(radial_symmetry_centre(window))
        refined = lag + refinement
        good = (np.abs(refinement) <= WINDOW_HALF).all() and self._inside(refined)
        return refined if good else lag

    def _evidence(self, rows: slice, lag_px: NDArray[np.float64]) -> float:
        """Localisations that fall on the dense places of the other bin, beyond chance.

        Localisations of a rotor are not independent, but those of the sparser, less clumped of two
        unrelated bins are, so the smaller of both directions is taken.
        """
        x, y = self._columns[rows], self._rows[rows]
        lag_x, lag_y = int(lag_px[0]), int(lag_px[1])
        dense = dense_pixels(x, y, self._shape)
        x_reference, y_reference = self._columns[self._reference], self._rows[self._reference]
        return min(
            excess_on(self._reference_dense, x + lag_x, y + lag_y),
            excess_on(dense, x_reference - lag_x, y_reference - lag_y),
        )

    def _inside(self, lag_px: NDArray[np.float64]) -> bool:
        return bool((np.abs(lag_px) + WINDOW_HALF <= self._largest_lag).all())

    def _unusable(self, problem: str) -> Shift:
        unknown = np.full((self._n_groups, 2), np.nan)
        return Shift(np.full(2, np.nan), unknown, np.nan, problem)


def _from_zero(positions: NDArray[np.float64]) -> NDArray[np.int64]:
    whole = np.floor(positions)
    indices: NDArray[np.int64] = (whole - whole.min()).astype(np.int64)
    return indices


def _group_tiles(
    columns: NDArray[np.int64], rows: NDArray[np.int64]
) -> tuple[NDArray[np.int64], int]:
    """Assign each localisation to one of at most 24 groups of neighbouring tiles of the field."""
    tiles_per_row = int(columns.max()) // _TILE_PX + 1
    tile = (rows // _TILE_PX) * tiles_per_row + columns // _TILE_PX
    occupied = np.bincount(tile) > 0
    rank = np.cumsum(occupied) - 1
    n_tiles = int(occupied.sum())
    n_groups = min(n_tiles, _MOST_GROUPS)
    return (rank[tile] * n_groups // n_tiles).astype(np.int64), n_groups
