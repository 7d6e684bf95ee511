"""What a drift estimate is, and its subtraction from a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.errors import TableError

_MOST_FRAMES = 100_000_000
"""Frame numbers further apart than this are not frame numbers of one movie."""


@dataclass(frozen=True, kw_only=True)
class Drift:
    """Drift of every frame, and the evidence for it, bin by bin.

    Attributes
    ----------
    table
        Columns of the DRIFT schema, one row a frame from the first to the last of the
        localisations; to be subtracted from positions. It is zero at the centre of the first bin.
    method
        How it was estimated.
    estimated
        False when the table holds zeros because nothing was, or could be, estimated well enough.
    bin_frames
        Shape (bins,), centres of the time bins.
    bin_dx_nm, bin_dy_nm
        Shape (bins,), position of each bin relative to the first one, before smoothing; nan where
        it could not be found.
    bin_sd_nm
        Shape (bins,), standard deviation per axis of that position, nan where unknown.
    bin_localisations
        Shape (bins,), localisations in each bin.
    bin_peak
        Shape (bins,), how far the correlation peak stands out: localisations that the shift lays
        on dense places of the first bin (and the reverse; the smaller counts) beyond chance, in
        standard deviations; nan for the first bin.
    bin_used
        Shape (bins,), whether the bin took part in the curve.
    """

    table: pd.DataFrame
    method: str
    estimated: bool
    bin_frames: NDArray[np.float64]
    bin_dx_nm: NDArray[np.float64]
    bin_dy_nm: NDArray[np.float64]
    bin_sd_nm: NDArray[np.float64]
    bin_localisations: NDArray[np.int64]
    bin_peak: NDArray[np.float64]
    bin_used: NDArray[np.bool_]


def no_drift(localisations: pd.DataFrame, method: str) -> Drift:
    """Build a drift of zero, not estimated, for every frame of a table.

    Raises
    ------
    TableError
        The frame numbers cannot belong to one movie.
    """
    frames = frame_range(localisations)
    nothing = np.empty(0)
    return Drift(
        table=drift_table(frames, np.zeros((frames.size, 2)), np.full(frames.size, np.nan)),
        method=method,
        estimated=False,
        bin_frames=nothing,
        bin_dx_nm=nothing,
        bin_dy_nm=nothing,
        bin_sd_nm=nothing,
        bin_localisations=np.empty(0, dtype=np.int64),
        bin_peak=nothing,
        bin_used=np.empty(0, dtype=np.bool_),
    )


def frame_range(localisations: pd.DataFrame) -> NDArray[np.int64]:
    """List every frame number from the first to the last of a table, empty for an empty one.

    Raises
    ------
    TableError
        Columns are missing or the frame numbers cannot belong to one movie.
    """
    require_columns(localisations, "frame", "x_nm", "y_nm")
    if localisations.empty:
        return np.empty(0, dtype=np.int64)
    frames = localisations["frame"].to_numpy()
    if not np.isfinite(frames).all():
        raise TableError("the localisations have rows without a frame number: remove those rows")
    first, last = int(frames.min()), int(frames.max())
    if last - first >= _MOST_FRAMES:
        raise TableError(
            f"the localisations span the frames {first} to {last}, too many for one movie: check "
            "the column frame"
        )
    return np.arange(first, last + 1, dtype=np.int64)


def require_columns(localisations: pd.DataFrame, *names: str) -> None:
    """Raise TableError unless a table has the columns."""
    missing = [name for name in names if name not in localisations.columns]
    if missing:
        raise TableError(
            f"the localisations lack the column(s) {', '.join(missing)}: give a table that has "
            "them, such as localisations.parquet or a ThunderSTORM CSV"
        )


def drift_table(
    frames: NDArray[np.int64], drift_nm: NDArray[np.float64], sd_nm: NDArray[np.float64]
) -> pd.DataFrame:
    """Assemble the DRIFT table from frames (n,), drift (n, 2) and standard deviation (n,)."""
    return pd.DataFrame(
        {"frame": frames, "dx_nm": drift_nm[:, 0], "dy_nm": drift_nm[:, 1], "sd_nm": sd_nm}
    )


def apply_drift(localisations: pd.DataFrame, drift: Drift) -> pd.DataFrame:
    """Subtract the drift of its frame from every position.

    Rows, their order, index and all other columns stay; the input is not changed. Frames outside
    the drift table, which happens when drift was estimated from the better localisations only,
    take the drift of the nearest frame in it.

    Parameters
    ----------
    localisations
        Columns frame, x_nm, y_nm and any others.
    drift
        What `estimate_drift` returned.

    Examples
    --------
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> from rotortrack.corrections.drift.drift import no_drift
    >>> spots = pd.DataFrame({"frame": [0, 1], "x_nm": [10.0, 12.0], "y_nm": [5.0, 5.0]})
    >>> drift = no_drift(spots, "by hand")
    >>> drift.table["dx_nm"] = [0.0, 2.0]
    >>> rt.apply_drift(spots, drift)["x_nm"].tolist()
    [10.0, 10.0]
    """
    require_columns(localisations, "frame", "x_nm", "y_nm")
    if drift.table.empty or localisations.empty:
        return localisations.copy()
    table = drift.table
    first = int(table["frame"].iloc[0])
    row = np.clip(localisations["frame"].to_numpy(dtype=np.int64) - first, 0, len(table) - 1)
    # The other columns are shared, not copied: a night's localisations fill much of the memory.
    return localisations.assign(
        x_nm=localisations["x_nm"].to_numpy() - table["dx_nm"].to_numpy()[row],
        y_nm=localisations["y_nm"].to_numpy() - table["dy_nm"].to_numpy()[row],
    )
