"""Angles about the fitted circle, steps by the published 180-degree rule, cumulative angle.

Angles are counter-clockwise as seen on the displayed image: x points right and y points down, so
``theta = atan2(-(y - y_c), x - x_c)``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.errors import TableError
from rotortrack.flags import FitFlag
from rotortrack.tables import TRACKS, conform
from rotortrack.units import TURN_RAD

Floats = NDArray[np.float64]
GapMode = Literal["drop", "bridge", "model"]


MOST_FRAMES = 20_000_000
"""Eleven hours at 500 frames/s; a longer gap is a mistake in the table, not a movie."""


def angle(x_nm: Floats, y_nm: Floats, centre_x_nm: Floats, centre_y_nm: Floats) -> Floats:
    """Angle of points about a centre, in (-pi, pi] rad, counter-clockwise on the displayed image.

    Parameters
    ----------
    x_nm, y_nm
        Positions in nm, y down.
    centre_x_nm, centre_y_nm
        Centre of the circle in nm, one for all points or one a point.
    """
    return np.arctan2(-(y_nm - centre_y_nm), x_nm - centre_x_nm)


def step(theta_rad: Floats, next_theta_rad: Floats) -> Floats:
    """Step between two angles in (-pi, pi], exactly as published.

    ``a = (next - theta) mod 2 pi``; up to and including 180 degrees it counts as a
    counter-clockwise step ``a``, above as a clockwise step ``a - 2 pi``. `numpy.unwrap` differs
    at the tie.
    """
    forward = np.mod(next_theta_rad - theta_rad, TURN_RAD)
    return np.where(forward <= np.pi, forward, forward - TURN_RAD)


def consecutive_steps(
    theta_rad: Floats,
    frame: NDArray[np.int64],
    gap_mode: GapMode,
    turn_per_frame_rad: float | None = None,
) -> Floats:
    """Give the steps between all consecutive rows of one rotor, across gaps too.

    Adjacent frames follow the 180-degree rule. Across a gap of n frames "bridge" follows it too,
    as if the frames were adjacent, and misses turns; "drop" takes the step that lies nearest to n
    times the mean step between adjacent frames; "model" the one nearest to n times the turn that
    is given, of which adjacent frames need tell nothing.

    Parameters
    ----------
    theta_rad, frame
        Angles (rad) and frames, ascending, shape (n,).
    gap_mode
        How gaps are crossed.
    turn_per_frame_rad
        Expected turn in one frame for "model", omega dt; without it, "model" is as "drop".

    Returns
    -------
    ndarray, shape (n - 1,)
        Steps, rad.
    """
    steps = step(theta_rad[:-1], theta_rad[1:])
    apart = np.diff(frame)
    adjacent = apart == 1
    known = turn_per_frame_rad is not None and np.isfinite(turn_per_frame_rad)
    if gap_mode == "model" and known:
        turn = turn_per_frame_rad
    elif gap_mode == "bridge" or not adjacent.any():
        return steps
    else:
        turn = float(np.angle(np.exp(1j * steps[adjacent]).mean()))
    expected = turn * apart
    nearest = expected + np.angle(np.exp(1j * (steps - expected)))
    return np.where(adjacent, steps, nearest)


def unbroken_angle(
    frame: NDArray[np.int64],
    theta_rad: Floats,
    gap_mode: GapMode = "drop",
    turn_per_frame_rad: float | None = None,
) -> Floats:
    """Cumulative angle in every frame from the first to the last, nan where there is none.

    Gaps are crossed as in `consecutive_steps`.
    """
    if not frame.size:
        return np.empty(0)
    cumulative = np.full(int(frame[-1] - frame[0]) + 1, np.nan)
    turned = np.cumsum(consecutive_steps(theta_rad, frame, gap_mode, turn_per_frame_rad))
    cumulative[frame - frame[0]] = np.concatenate(([0.0], turned))
    return cumulative


def fitted_radius(rotors: pd.DataFrame) -> pd.Series[float]:
    """Radius of the circle through the positions, before any correction for blur, nm."""
    return rotors["radius_fit_nm" if "radius_fit_nm" in rotors else "radius_nm"]


def angle_sd(
    theta_rad: Floats, x_sd_nm: Floats, y_sd_nm: Floats, uncertainty_nm: Floats, radius_nm: Floats
) -> Floats:
    """Give the standard deviation of an angle: the position's along the tangent, over the radius.

    Where x_sd_nm or y_sd_nm is nan, uncertainty_nm (the rms of both) stands for the tangent's.
    The result, in rad, is of first order, hence good below about 0.3.
    """
    tangent_nm = np.hypot(np.sin(theta_rad) * x_sd_nm, np.cos(theta_rad) * y_sd_nm)
    return np.where(np.isnan(tangent_nm), uncertainty_nm, tangent_nm) / radius_nm


def build_tracks(
    localisations: pd.DataFrame,
    rotors: pd.DataFrame,
    *,
    frame_interval_s: float,
    gap_mode: GapMode,
) -> pd.DataFrame:
    """Build one row a rotor and frame, with angle, step and cumulative angle.

    Parameters
    ----------
    localisations
        Clustered localisations: the column `rotor`, and `FitFlag.DUPLICATE` set on all but one
        row of a rotor and frame; flagged rows are not used.
    rotors
        Table with the circles. A rotor without a circle (radius nan) gets no rows, because its
        angles have no centre; a refused rotor does get them, to show why it was refused.
    frame_interval_s
        Time between frame starts, s.
    gap_mode
        "drop", "model": `step_rad` is the step from the adjacent frame and nan after a gap; the
        speed that "model" goes by is not known yet, so that it crosses gaps here as "drop" does.
        "bridge": `step_rad` is the step from the last frame before, however long ago.

    Returns
    -------
    DataFrame
        Columns of `tables.TRACKS`, sorted by rotor and frame. `cumulative_rad` is the running
        sum of :func:`consecutive_steps`, so that it can be drawn without breaks.

    Raises
    ------
    TableError
        The column `rotor` is missing, a rotor has two usable rows in one frame, or frame numbers
        jump by more than MOST_FRAMES.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> turn = 0.08 * np.arange(200)
    >>> noise = np.random.default_rng(1).normal(0.0, 8.0, (2, 200))
    >>> spots = pd.DataFrame(
    ...     {
    ...         "frame": np.arange(200),
    ...         "x_nm": 500.0 + 120.0 * np.cos(turn) + noise[0],
    ...         "y_nm": 500.0 - 120.0 * np.sin(turn) + noise[1],
    ...     }
    ... ).assign(uncertainty_nm=8.0, x_sd_nm=8.0, y_sd_nm=8.0, photons=500.0)
    >>> found = rt.find_rotors(spots)
    >>> judged = rt.screen(found.localisations, found.rotors, n_frames=200)
    >>> tracks = rt.build_tracks(
    ...     found.localisations, judged.rotors, frame_interval_s=0.002, gap_mode="drop"
    ... )
    >>> round(tracks["cumulative_rad"].iloc[-1], 1)
    np.float64(16.1)
    """
    if "rotor" not in localisations.columns:
        raise TableError("the localisations lack the column rotor: cluster them first")
    circles = rotors.set_index("rotor")[["x_nm", "y_nm"]]
    circles["radius_nm"] = fitted_radius(rotors).to_numpy()
    circles = circles[circles["radius_nm"].notna()]
    rows = _usable(localisations, circles.index.to_numpy())
    rotor, frame = (localisations[name].to_numpy("int64")[rows] for name in ("rotor", "frame"))
    same_rotor = rotor[1:] == rotor[:-1]
    frames_apart = np.diff(frame)
    if np.any(same_rotor & (frames_apart == 0)):
        where = int(np.flatnonzero(same_rotor & (frames_apart == 0))[0])
        raise TableError(
            f"rotor {rotor[where]} has several localisations in frame {frame[where]}: cluster "
            "again, so that all but one are flagged as duplicates"
        )
    if rotor.size and np.any(frames_apart[same_rotor] > MOST_FRAMES):
        raise TableError(
            f"frame numbers jump by more than {MOST_FRAMES} frames within a rotor: check the "
            "column frame"
        )
    circle = circles.index.get_indexer(pd.Index(rotor))
    centre_x, centre_y, radius = (
        circles[name].to_numpy("float64")[circle] for name in ("x_nm", "y_nm", "radius_nm")
    )
    x, y = _column(localisations, "x_nm", rows), _column(localisations, "y_nm", rows)
    theta = angle(x, y, centre_x, centre_y)
    x_sd, y_sd = _column(localisations, "x_sd_nm", rows), _column(localisations, "y_sd_nm", rows)
    uncertainty = _column(localisations, "uncertainty_nm", rows)
    sd = angle_sd(theta, x_sd, y_sd, uncertainty, radius)
    del circle, centre_x, centre_y, radius
    bridged = np.full(rotor.size, np.nan)
    for part in np.split(np.arange(rotor.size), np.flatnonzero(~same_rotor) + 1):
        bridged[part[1:]] = consecutive_steps(theta[part], frame[part], gap_mode)
    steps = bridged.copy()
    if gap_mode != "bridge":
        steps[1:][frames_apart != 1] = np.nan
    cumulative = pd.Series(np.nan_to_num(bridged)).groupby(rotor).cumsum().to_numpy("float64")
    table = pd.DataFrame(
        {
            "rotor": rotor,
            "frame": frame,
            "time_s": frame * frame_interval_s,
            "x_nm": x,
            "y_nm": y,
            "x_sd_nm": np.where(np.isnan(x_sd), uncertainty, x_sd),
            "y_sd_nm": np.where(np.isnan(y_sd), uncertainty, y_sd),
            "theta_rad": theta,
            "theta_sd_rad": sd,
            "step_rad": steps,
            "cumulative_rad": cumulative,
            "used": np.ones(rotor.size, bool),
        },
        copy=False,
    )
    return conform(table, TRACKS, "tracks")


def _usable(localisations: pd.DataFrame, rotors: NDArray[np.int64]) -> NDArray[np.intp]:
    """Find the rows of some rotors, one a frame, by rotor and frame."""
    rotor = localisations["rotor"].to_numpy()
    usable = np.isin(rotor, rotors[rotors >= 0])
    if "fit_flags" in localisations.columns:
        usable &= (localisations["fit_flags"].to_numpy() & int(FitFlag.DUPLICATE)) == 0
    rows = np.flatnonzero(usable)
    return rows[np.lexsort((localisations["frame"].to_numpy()[rows], rotor[rows]))]


def _column(localisations: pd.DataFrame, name: str, rows: NDArray[np.intp]) -> Floats:
    """Return rows of a column as float64, nan where a foreign table does not have it."""
    if name not in localisations.columns:
        return np.full(len(rows), np.nan)
    return localisations[name].to_numpy()[rows].astype(np.float64, copy=False)
