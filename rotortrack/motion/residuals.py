"""Whether a rotor drifts and diffuses steadily, and honest intervals where it does not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]

_LAGS = 20
_SLOW_WAVES = 16
_HARMONICS = 4
_LEAST_READINGS = 100
_BLOCKS = (40, 20, 10)
_SAMPLES = 2000


@dataclass(frozen=True)
class Whiteness:
    """Probabilities of residuals as uneven as these under steady drift and diffusion.

    Attributes
    ----------
    lag_p
        Ljung-Box test of 20 lags: steps that depend on those before, as in a confined rotor.
    slow_p
        Power of the 16 slowest waves: a speed that changes, as on a switch of direction.
    spread_p
        Ljung-Box test of 20 lags of the squares: restless and quiet times in turn, as in
        stick-slip.
    angle_p
        Dependence on the direction, four harmonics: preferred poses, as on a washboard.
    """

    lag_p: float
    slow_p: float
    spread_p: float
    angle_p: float

    @property
    def p(self) -> float:
        """Probability of the least likely of the four, corrected for their number."""
        return min(1.0, 4.0 * min(self.lag_p, self.slow_p, self.spread_p, self.angle_p))


UNTESTED = Whiteness(math.nan, math.nan, math.nan, math.nan)


def whiteness(deviation: Floats, ahead_rad: Floats) -> Whiteness:
    """Test the deviations of readings from their predictions by those before.

    Parameters
    ----------
    deviation
        Deviations over their standard deviations.
    ahead_rad
        Directions predicted.

    Returns
    -------
    Whiteness
        All ones for fewer than 100 readings, and where all are alike.
    """
    if deviation.size < _LEAST_READINGS or not deviation.std() > 0.0:
        return Whiteness(1.0, 1.0, 1.0, 1.0)
    scores = (deviation - deviation.mean()) / deviation.std()
    power = np.abs(np.fft.rfft(scores)[1 : _SLOW_WAVES + 1]) ** 2 / scores.size
    orders = np.arange(1, _HARMONICS + 1)[:, np.newaxis] * ahead_rad
    waves = np.concatenate([np.cos(orders), np.sin(orders)])
    waves -= waves.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(waves @ waves.T / scores.size)
    # Directions that were not visited tell nothing.
    visited = values > 1e-3
    along = (vectors[:, visited].T @ (waves @ scores)) ** 2 / (values[visited] * scores.size)
    squares = scores**2
    return Whiteness(
        lag_p=_ljung_box(scores),
        slow_p=float(stats.chi2.sf(2.0 * power.sum(), 2 * _SLOW_WAVES)),
        spread_p=_ljung_box(squares - squares.mean()),
        angle_p=float(stats.chi2.sf(along.sum(), np.count_nonzero(visited))),
    )


def _ljung_box(values: Floats) -> float:
    n = values.size
    lags = np.arange(1, _LAGS + 1)
    products = np.array([values[lag:] @ values[:-lag] for lag in lags]) / (values @ values)
    return float(stats.chi2.sf(n * (n + 2.0) * np.sum(products**2 / (n - lags)), _LAGS))


@dataclass(frozen=True)
class Resampled:
    """Intervals of 95 % and standard deviations of (omega, log D), and a test of no drift."""

    sd: Floats
    omega_interval_rad_s: tuple[float, float]
    diffusion_interval_rad2_s: tuple[float, float]
    drift_p: float


def block_bootstrap(
    log_densities: Callable[[Floats], Floats], point: Floats, covariance: Floats, seed: int
) -> Resampled:
    """Intervals that hold also where the model does not.

    The estimate solves ``sum of scores = 0``. Whole blocks of readings are drawn with replacement,
    and the estimate moves by the covariance times their scores. Of 40, 20 and 10 blocks those with
    the widest omega are taken, since blocks must outlast the memory of the rotor; Student's t
    allows for their small number.

    Parameters
    ----------
    log_densities
        Log density of each reading for (omega, log D, log factor).
    point, covariance
        Estimate and inverse information.
    seed
        Of the draws.
    """
    stride = 0.5 * np.sqrt(np.diag(covariance))
    unit = np.diag(stride)
    scores = np.stack(
        [(log_densities(point + unit[i]) - log_densities(point - unit[i])) / (2.0 * stride[i])
         for i in range(point.size)]
    )  # fmt: skip
    moves, count = max(
        (_moves(scores, covariance, count, seed) for count in _BLOCKS),
        key=lambda drawn: float(drawn[0][:, 0].std()),
    )
    freedom = count - 1.0
    wider = np.sqrt(count / freedom)
    sd = wider * moves.std(axis=0)
    t = float(stats.t.isf(0.025, freedom))
    low, high = np.quantile(moves, [0.025, 0.975], axis=0) * wider * t / stats.norm.isf(0.025)
    return Resampled(
        sd=sd[:2],
        omega_interval_rad_s=(float(point[0] + low[0]), float(point[0] + high[0])),
        diffusion_interval_rad2_s=(
            float(np.exp(point[1] + low[1])),
            float(np.exp(point[1] + high[1])),
        ),
        drift_p=2.0 * float(stats.t.sf(abs(point[0]) / sd[0], freedom)),
    )


def _moves(scores: Floats, covariance: Floats, count: int, seed: int) -> tuple[Floats, int]:
    """Draw deviations of the estimate from so many blocks."""
    blocks = np.array([part.sum(axis=1) for part in np.array_split(scores, count, axis=1)])
    blocks -= blocks.mean(axis=0)
    rng = np.random.default_rng(seed)
    draws = rng.multinomial(count, np.full(count, 1.0 / count), _SAMPLES)
    return draws @ blocks @ covariance, count
