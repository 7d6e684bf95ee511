"""Standard deviation of a drift curve, from the field's parts and from the bins themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.corrections.drift.curve import curve_through

_SD_POINTS_PER_BIN = 16


def jackknife_sd(deviations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Estimate a standard deviation per axis from delete-one replicates.

    Parameters
    ----------
    deviations
        Shape (n, groups, 2), replicates minus their mean over groups.

    Returns
    -------
    Shape (n,), rms of x and y; nan where a replicate is missing or there is but one.
    """
    groups = deviations.shape[1]
    if groups < 2:
        return np.full(deviations.shape[0], np.nan)
    variance = (groups - 1) / groups * (deviations**2).sum(axis=1)
    return np.asarray(np.sqrt(variance.mean(axis=1)))


def unresolved_sd(
    knots: NDArray[np.float64], values: NDArray[np.float64], sd: NDArray[np.float64]
) -> float:
    """Estimate the drift between bins that no curve can know, by predicting each from the others.

    A rough path deviates at the middle of a gap by half the variance that it has in a gap of
    twice the length; the noise of the bins is taken off. Two bins cannot tell: nan.

    Parameters
    ----------
    knots, values, sd
        Centres (n,), drift (n, 2) and its standard deviation (n,) of the bins.
    """
    if knots.size < 3:
        return float("nan")
    variance = np.nan_to_num(sd**2)
    excess = []
    for left_out in range(1, knots.size - 1):
        others = np.arange(knots.size) != left_out
        # The curve is linear in the bins, so its values for unit bins are the weights.
        weights = curve_through(
            knots[others], np.eye(knots.size - 1), knots[left_out : left_out + 1]
        )[0]
        residual = weights @ values[others] - values[left_out]
        noise = variance[left_out] + weights**2 @ variance[others]
        excess.append(np.mean(residual**2) - noise)
    return float(np.sqrt(max(0.0, float(np.mean(excess))) / 2))


def frame_sd(
    frames: NDArray[np.int64],
    knots: NDArray[np.float64],
    deviations: NDArray[np.float64],
    unresolved: float,
) -> NDArray[np.float64]:
    """Estimate the standard deviation per axis of the curve at every frame.

    What the bins cannot resolve counts in full between them and more beyond the outer ones.

    Parameters
    ----------
    frames, knots
        Shape (m,) and (n,), ascending.
    deviations
        Shape (n, groups, 2), replicates of the bins minus their mean over groups.
    unresolved
        Result of `unresolved_sd`, in the unit of the deviations.

    Returns
    -------
    Shape (m,), nan when the replicates do not tell.
    """
    groups = deviations.shape[1]
    if groups < 2 or not np.isfinite(deviations).all():
        return np.full(frames.size, np.nan)
    # The deviation of a curve is the curve of the deviations; it bends no faster than the bins.
    coarse = np.unique(
        np.append(
            np.linspace(frames[0], frames[-1], min(frames.size, knots.size * _SD_POINTS_PER_BIN)),
            knots,
        )
    )
    curves = curve_through(knots, deviations.reshape(knots.size, -1), coarse)
    jackknife = jackknife_sd(curves.reshape(coarse.size, groups, 2))
    spacing = float(np.mean(np.diff(knots)))
    beyond = np.abs(coarse - np.clip(coarse, knots[0], knots[-1]))
    sd = np.hypot(jackknife, unresolved * (1 + 2 * beyond / spacing))
    return np.asarray(np.interp(frames, coarse, sd), dtype=np.float64)
