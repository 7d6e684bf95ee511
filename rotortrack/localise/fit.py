"""One window at a time in float64: the second tier of the fit, and the reference of the first."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FIT_FAILED, FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.bias import correct
from rotortrack.localise.gaussian import BACKGROUND, PARAMETERS, PHOTONS, SIGMA, X, Y, profile
from rotortrack.localise.least_squares import inverse_value_weights
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION
from rotortrack.localise.optimise import LEAST_SQUARES, LIKELIHOOD, optimise
from rotortrack.localise.precision import covariance
from rotortrack.localise.windows import LANES, Windows

_LSQ, _WLSQ, _MLE = range(3)
FitMethod = Literal["lsq", "wlsq", "mle"]
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
_AT_BOUND = int(FitFlag.AT_BOUND)
_FAILED = int(FIT_FAILED)


def fit_chosen(
    windows: Windows,
    chosen: NDArray[np.int64],
    *,
    method: str,
    sigma_px: float,
    free_sigma: bool,
    correct_bias: bool,
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
) -> None:
    """Fit an integrated Gaussian to chosen windows by Levenberg-Marquardt, about 10 us each.

    Every fit starts at the window's middle with the window's minimum as background, as
    ThunderSTORM's do, and each is on its own: neighbours are neither masked nor merged.

    Parameters
    ----------
    windows
        Photo-electrons and read variances.
    chosen
        (k,) windows to fit.
    method
        A key of METHODS.
    sigma_px
        Width at which fits start, or which they keep, pixels.
    free_sigma
        Whether the width is fitted.
    correct_bias
        Subtract the bias of a likelihood fit, see :mod:`bias`.
    results
        (10, n) rows RESULT_COLUMNS, of which the chosen columns are filled; x and y in pixels from
        the window's middle.
    flags
        (n,) bits of FitFlag; how the chosen fits ended is added.
    """
    _fit_chosen(
        windows.photons,
        windows.variance,
        chosen,
        METHODS[method],
        sigma_px,
        free_sigma,
        correct_bias and method == "mle",
        results,
        flags,
    )


@kernel
def _fit_chosen(
    photons: NDArray[np.float32],
    variance: NDArray[np.float32],
    chosen: NDArray[np.int64],
    method: int,
    start_sigma: float,
    free_sigma: bool,
    correct_bias: bool,
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
) -> None:
    n = int(math.sqrt(photons.shape[1]))
    data = np.empty((n, n))
    noise = np.empty((n, n))
    keep = np.empty((n, n))
    weights = np.empty((n, n))
    parameters = np.empty(PARAMETERS)
    matrix = np.empty((PARAMETERS, PARAMETERS))
    likely = method == _MLE
    for k in chosen:
        lowest = np.inf
        highest = -np.inf
        count = 0
        for i in range(n):
            for j in range(n):
                value = photons[k // LANES, i * n + j, k % LANES]
                spread = variance[k // LANES, i * n + j, k % LANES]
                data[i, j] = value
                if spread < np.inf:
                    noise[i, j] = spread
                    keep[i, j] = 1.0
                    lowest = min(lowest, value)
                    highest = max(highest, value)
                    count += 1
                else:
                    noise[i, j] = 0.0
                    keep[i, j] = 0.0
                weights[i, j] = keep[i, j]
        for c in range(results.shape[0]):
            results[c, k] = np.nan
        if count <= PARAMETERS:
            flags[k] |= _NOT_FINITE
            continue
        parameters[X] = 0.0
        parameters[Y] = 0.0
        parameters[BACKGROUND] = max(lowest, 0.0)
        parameters[PHOTONS] = max((highest - lowest) * 2.0 * math.pi * start_sigma**2, 1.0)
        parameters[SIGMA] = start_sigma
        if method == _WLSQ:
            inverse_value_weights(data, keep, weights)
        # One call for both kinds: every further one is inlined and compiled again.
        end = optimise(
            LIKELIHOOD if likely else LEAST_SQUARES,
            data,
            noise if likely else weights,
            keep,
            parameters,
            free_sigma,
        )
        if not (abs(parameters[X]) <= n // 2 and abs(parameters[Y]) <= n // 2):
            end |= _LEFT_WINDOW
        _judge(data, noise, keep, parameters, results, k)
        # The bound belongs to the corrected parameters, hence a second time.
        corrections = 1 if correct_bias and end & _FAILED == 0 else 0
        for repeat in range(corrections + 1):
            is_last = repeat == corrections
            known = covariance(
                parameters,
                noise,
                keep,
                weights,
                not likely,
                is_last or end & _AT_BOUND == 0,
                free_sigma,
                matrix,
            )
            if not known or not (matrix[X, X] > 0.0 and matrix[Y, Y] > 0.0):
                end |= _SINGULAR
                break
            if is_last:
                results[5, k] = math.sqrt(matrix[X, X])
                results[6, k] = math.sqrt(matrix[Y, Y])
            else:
                correct(parameters, noise, keep, matrix)
        for a in range(PARAMETERS):
            results[a, k] = parameters[a]
        flags[k] |= end


@kernel
def _judge(
    data: NDArray[np.float64],
    noise: NDArray[np.float64],
    keep: NDArray[np.float64],
    parameters: NDArray[np.float64],
    results: NDArray[np.float64],
    k: int,
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
    results[7, k] = math.sqrt(max(second / count - mean * mean, 0.0))
    results[8, k] = pearson
    results[9, k] = 2.0 * deviance
