"""Fits of all candidates of a block of frames."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.gaussian import BACKGROUND, PARAMETERS, PHOTONS, SIGMA, X, Y, profile
from rotortrack.localise.least_squares import inverse_value_weights
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION
from rotortrack.localise.optimise import LEAST_SQUARES, LIKELIHOOD, optimise
from rotortrack.localise.precision import covariance

_LSQ, _WLSQ, _MLE = range(3)
METHODS: Final = {"lsq": _LSQ, "wlsq": _WLSQ, "mle": _MLE}

RESULT_COLUMNS: Final = (
    "x_px",
    "y_px",
    "photons",
    "background",
    "sigma_px",
    "x_sd_px",
    "y_sd_px",
    "background_sd",
    "chi2",
    "log_likelihood_ratio",
)

_LEFT_WINDOW = int(FitFlag.LEFT_WINDOW)
_SINGULAR = int(FitFlag.SINGULAR)
_NOT_FINITE = int(FitFlag.NOT_FINITE)
_MASKED_PIXELS = int(FitFlag.MASKED_PIXELS)


@kernel
def fit_candidates(
    photons: NDArray[np.float32],
    variance: NDArray[np.float32],
    candidates: NDArray[np.int32],
    radius: int,
    start_sigma: float,
    method: int,
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
) -> None:
    """Fit an integrated Gaussian to the window of every candidate.

    Every fit starts at the candidate's pixel with the window's minimum as background, as
    ThunderSTORM's do, and each is on its own: neighbours are neither masked nor merged.

    Parameters
    ----------
    photons
        (frame, height, width); NaN pixels carry no weight.
    variance
        (height, width) read variance in electrons^2, or (1, 1) for all pixels alike.
    candidates
        (n, 3) frame, row, column; windows must lie within the frame.
    radius
        Windows are 2 * radius + 1 pixels wide.
    start_sigma
        Width at which fits start, pixels.
    method
        A value of METHODS.
    results
        (n, 10) receives RESULT_COLUMNS; x and y in pixels from the frame's outer corner.
    flags
        (n,) receives bits of FitFlag.
    """
    n = 2 * radius + 1
    data = np.empty((n, n))
    noise = np.empty((n, n))
    keep = np.empty((n, n))
    weights = np.empty((n, n))
    parameters = np.empty(PARAMETERS)
    matrix = np.empty((PARAMETERS, PARAMETERS))
    uniform = variance.size == 1
    for k in range(candidates.shape[0]):
        frame = photons[candidates[k, 0]]
        row = candidates[k, 1]
        column = candidates[k, 2]
        lowest = np.inf
        highest = -np.inf
        masked = 0
        for i in range(n):
            for j in range(n):
                value = frame[row - radius + i, column - radius + j]
                if uniform:
                    noise[i, j] = variance[0, 0]
                else:
                    noise[i, j] = variance[row - radius + i, column - radius + j]
                if np.isfinite(value):
                    data[i, j] = value
                    keep[i, j] = 1.0
                    lowest = min(lowest, value)
                    highest = max(highest, value)
                else:
                    data[i, j] = 0.0
                    keep[i, j] = 0.0
                    masked += 1
                weights[i, j] = keep[i, j]
        for c in range(results.shape[1]):
            results[k, c] = np.nan
        if n * n - masked <= PARAMETERS:
            flags[k] = _NOT_FINITE
            continue
        parameters[X] = 0.0
        parameters[Y] = 0.0
        parameters[BACKGROUND] = max(lowest, 0.0)
        parameters[PHOTONS] = max((highest - lowest) * 2.0 * math.pi * start_sigma**2, 1.0)
        parameters[SIGMA] = start_sigma
        if method == _WLSQ:
            inverse_value_weights(data, keep, weights)
        # One call for both kinds: every further one is inlined and compiled again.
        likely = method == _MLE
        end = optimise(
            LIKELIHOOD if likely else LEAST_SQUARES,
            data,
            noise if likely else weights,
            keep,
            parameters,
        )
        if masked > 0:
            end |= _MASKED_PIXELS
        if not (abs(parameters[X]) <= radius and abs(parameters[Y]) <= radius):
            end |= _LEFT_WINDOW
        if covariance(parameters, noise, keep, weights, not likely, matrix):
            results[k, 5] = math.sqrt(matrix[X, X])
            results[k, 6] = math.sqrt(matrix[Y, Y])
        else:
            end |= _SINGULAR
        results[k, 0] = parameters[X] + column + 0.5
        results[k, 1] = parameters[Y] + row + 0.5
        results[k, 2] = parameters[PHOTONS]
        results[k, 3] = parameters[BACKGROUND]
        results[k, 4] = parameters[SIGMA]
        _judge(data, noise, keep, parameters, results[k])
        flags[k] = end


@kernel
def _judge(
    data: NDArray[np.float64],
    noise: NDArray[np.float64],
    keep: NDArray[np.float64],
    parameters: NDArray[np.float64],
    result: NDArray[np.float64],
) -> None:
    """Fill the residuals' standard deviation, Pearson's chi-square and the deviance."""
    n = data.shape[0]
    along_x = np.empty((3, n))
    along_y = np.empty((3, n))
    profile(parameters[X], parameters[SIGMA], along_x)
    profile(parameters[Y], parameters[SIGMA], along_y)
    count = 0.0
    first = 0.0
    second = 0.0
    pearson = 0.0
    deviance = 0.0
    for i in range(n):
        for j in range(n):
            if keep[i, j] == 0.0:
                continue
            model = parameters[BACKGROUND] + parameters[PHOTONS] * along_x[0, j] * along_y[0, i]
            residual = data[i, j] - model
            expected = max(model + noise[i, j], SMALLEST_EXPECTATION)
            observed = max(data[i, j] + noise[i, j], 0.0)
            count += 1.0
            first += residual
            second += residual * residual
            pearson += residual * residual / expected
            deviance += expected - observed
            if observed > 0.0:
                deviance += observed * math.log(observed / expected)
    mean = first / count
    result[7] = math.sqrt(max(second / count - mean * mean, 0.0))
    result[8] = pearson
    result[9] = 2.0 * deviance
