"""Drift from cross-correlation of time bins with the first one."""

from __future__ import annotations

import collections
import warnings

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.corrections.drift.curve import curve_through, loess
from rotortrack.corrections.drift.drift import Drift, drift_table, frame_range, no_drift
from rotortrack.corrections.drift.shift import Shift, ShiftMeasurement
from rotortrack.corrections.drift.time_bins import TimeBins, split_into_bins
from rotortrack.corrections.drift.uncertainty import frame_sd, jackknife_sd, unresolved_sd
from rotortrack.corrections.options import DriftOptions
from rotortrack.errors import ConfigurationError, DriftWarning

_NOMINAL_PIXEL_NM = 100.0
_LEAST_PER_BIN = 50


def estimate_drift(
    localisations: pd.DataFrame, options: DriftOptions, *, pixel_size_nm: float | None = None
) -> Drift:
    """Estimate the drift of every frame by cross-correlation of renderings of time bins.

    Each bin of equally many localisations is compared with the first one: coarse peak of the
    correlation in camera pixels, then the centre of radial symmetry of the peak at
    ``magnification``. LOESS smooths the bins, a natural cubic spline joins them and goes straight
    on beyond the outer ones. Like the ThunderSTORM plugin's, the drift is zero at the centre of
    the *first bin*, not at the first frame.

    Parameters
    ----------
    localisations
        Columns frame, x_nm, y_nm in any order of rows; rows whose position is nan are left out.
    options
        Bins, magnification, smoothing, or method "none" for zeros.
    pixel_size_nm
        Size of the coarse rendering's pixels, nm; 100 nm, a usual camera pixel, when not given.
        The result hardly depends on it.

    Returns
    -------
    Drift for every frame from the first to the last one of the table. `sd_nm` adds the spread
    when parts of the field are left out (jackknife; it holds what rotation and localisation noise
    do) to what the bins cannot resolve in time (each bin predicted from the others). It is nan
    when one part of the field carries a bin alone.

    Raises
    ------
    TableError
        Columns are missing, or positions or frames span more than any camera or movie has.
    ConfigurationError
        `pixel_size_nm` is not positive.

    Warns
    -----
    DriftWarning
        Whenever the evidence is too weak for what was asked, with what was done instead; and when
        the drift is not clear of its own error (`min_significance`) and is not subtracted.

    Notes
    -----
    O(n log n) in the localisations and one Fourier transform of the field per bin; memory is
    linear in both. Source: ThunderSTORM (Ovesny et al., Bioinformatics 30, 2389 (2014)),
    behaviour only.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> from rotortrack.corrections.options import DriftOptions
    >>> rng = np.random.default_rng(1)
    >>> frame = np.repeat(np.arange(2000), 20)
    >>> sites = np.tile(rng.uniform(0.0, 20_000.0, (20, 2)), (2000, 1))
    >>> drifted = sites + np.column_stack([0.05 * frame, 0.0 * frame])
    >>> places = drifted + rng.normal(0.0, 8.0, sites.shape)
    >>> spots = pd.DataFrame({"frame": frame, "x_nm": places[:, 0], "y_nm": places[:, 1]})
    >>> drift = rt.estimate_drift(spots, DriftOptions(), pixel_size_nm=100.0)
    >>> bool(abs(np.ptp(drift.table["dx_nm"]) - 100.0) < 5.0)
    True
    """
    if options.method == "none":
        return no_drift(localisations, options.method)
    pixel_nm = _NOMINAL_PIXEL_NM if pixel_size_nm is None else pixel_size_nm
    if not (np.isfinite(pixel_nm) and pixel_nm > 0):
        raise ConfigurationError(f"pixel_size_nm must be greater than 0, not {pixel_nm:g}")

    all_frames = frame_range(localisations)
    frames, x_px, y_px = _sorted_positions(localisations, pixel_nm)
    bins = _choose_bins(frames, options.bins)
    if bins is None:
        return no_drift(localisations, options.method)

    shifts = _measure(x_px, y_px, bins, options.magnification)
    used = np.array([shift.problem is None for shift in shifts])
    _warn_of_unused([shift.problem for shift in shifts])
    if used.sum() < 2:
        return no_drift(localisations, options.method)

    bin_nm = np.array([shift.px for shift in shifts]) * pixel_nm
    replicates_nm = np.array([shift.replicates_px for shift in shifts]) * pixel_nm
    deviations = replicates_nm - replicates_nm.mean(axis=1, keepdims=True)
    knots = bins.centres[used]
    smoothed = _smooth(knots, bin_nm[used], options.smoothing)
    drift_nm = curve_through(knots, smoothed, all_frames.astype(np.float64))
    if deviations.shape[1] < 2:
        _warn(
            "all localisations lie in one small part of the field, so drift cannot be told from "
            "the motion of a single rotor and its standard deviation is unknown: correct with "
            "care, or with method none"
        )
    bin_sd = jackknife_sd(deviations)
    unresolved = unresolved_sd(knots, bin_nm[used], bin_sd[used])
    sd_nm = frame_sd(all_frames, knots, deviations[used], unresolved)
    significant = _stands_out(drift_nm, sd_nm, options.min_significance)
    return Drift(
        table=drift_table(all_frames, drift_nm if significant else 0.0 * drift_nm, sd_nm),
        method=options.method,
        estimated=significant,
        bin_frames=bins.centres,
        bin_dx_nm=bin_nm[:, 0],
        bin_dy_nm=bin_nm[:, 1],
        bin_sd_nm=bin_sd,
        bin_localisations=np.diff(bins.edges),
        bin_peak=np.array([shift.peak for shift in shifts]),
        bin_used=used,
    )


def _stands_out(drift_nm: NDArray[np.float64], sd_nm: NDArray[np.float64], least: float) -> bool:
    """Whether the drift is clear of its own error; warn where it is not.

    Few rotors, each on its own part of its circle in each bin, look like a drift. Subtracting that
    would bend every circle, while a drift below its error harms less than its correction.
    """
    size = float(np.sqrt(drift_nm.var(axis=0).mean()))
    error = float(np.sqrt(np.mean(sd_nm**2)))
    if np.isnan(error) or size >= least * error:
        return True
    _warn(
        f"the drift found is {size:.1f} nm rms and its own error {error:.1f} nm rms, so nothing is "
        "subtracted: stuck spots or a longer movie would tell more, and drift.min_significance = 0 "
        "subtracts it all the same"
    )
    return False


def _sorted_positions(
    localisations: pd.DataFrame, pixel_nm: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Frames and positions in camera pixels of the rows that have one, by frame."""
    x_px = localisations["x_nm"].to_numpy(dtype=np.float64) / pixel_nm
    y_px = localisations["y_nm"].to_numpy(dtype=np.float64) / pixel_nm
    frames = localisations["frame"].to_numpy(dtype=np.int64)
    usable = np.flatnonzero(np.isfinite(x_px) & np.isfinite(y_px))
    order = usable[np.argsort(frames[usable], kind="stable")]
    return frames[order], x_px[order], y_px[order]


def _choose_bins(frames: NDArray[np.int64], wanted: int) -> TimeBins | None:
    """Make as many of the wanted bins as there is evidence for; None when fewer than two."""
    affordable = min(wanted, frames.size // _LEAST_PER_BIN)
    bins = split_into_bins(frames, affordable) if affordable >= 2 else None
    if bins is None or len(bins) < 2:
        _warn(
            f"{frames.size} localisations in {np.unique(frames).size} frames are too few to "
            f"estimate drift (two time bins of {_LEAST_PER_BIN} localisations are the least): "
            "positions are not corrected"
        )
        return None
    if len(bins) < wanted:
        _warn(
            f"{frames.size} localisations in {np.unique(frames).size} frames do not fill the "
            f"{wanted} time bins asked for: drift is estimated from {len(bins)} bins"
        )
    return bins


def _measure(
    x_px: NDArray[np.float64], y_px: NDArray[np.float64], bins: TimeBins, magnification: float
) -> list[Shift]:
    """Shift of every bin relative to the first one, whose own is zero by definition."""
    measurement = ShiftMeasurement(x_px, y_px, bins.rows(0), magnification)
    shifts = [Shift(np.zeros(2), np.zeros((measurement.groups, 2)), np.nan)]
    expected = shifts[0].px
    for index in range(1, len(bins)):
        shift = measurement(bins.rows(index), expected)
        shifts.append(shift)
        if shift.problem is None:
            expected = shift.px
    return shifts


def _warn_of_unused(problems: list[str | None]) -> None:
    reasons = collections.Counter(problem for problem in problems if problem is not None)
    if not reasons:
        return
    refused = sum(reasons.values())
    done = (
        "the drift there comes from the other bins"
        if refused < len(problems) - 1
        else "positions are not corrected"
    )
    why = "; ".join(f"{count} because {reason}" for reason, count in reasons.items())
    _warn(
        f"{refused} of {len(problems)} time bins give no drift ({why}): {done}; fewer bins hold "
        "more localisations each"
    )


def _smooth(
    knots: NDArray[np.float64], values: NDArray[np.float64], smoothing: float
) -> NDArray[np.float64]:
    """LOESS per axis; a window of fewer than two bins cannot smooth and leaves them as they are."""
    # The small addition keeps 0.2 * 10 bins from being fewer than two.
    points = int(np.floor(smoothing * knots.size + 1e-9))
    if points < 2:
        _warn(
            f"smoothing {smoothing:g} of {knots.size} bins is a window of fewer than two bins: "
            f"the bins are not smoothed; a smoothing of at least {2 / knots.size:.3g} would be"
        )
        return values
    return np.column_stack([loess(knots, values[:, axis], points) for axis in range(2)])


def _warn(sentence: str) -> None:
    warnings.warn(sentence, DriftWarning, stacklevel=4)
