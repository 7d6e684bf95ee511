"""Whether a rotor drifts and diffuses steadily, and honest intervals where it does not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]

_LAGS = 20
_SLOW_WAVES = 16
_HARMONICS = 4
_LEAST_READINGS = 100
_LEAST_VARIANCE = 1e-3
_LEAST_P = 1e-300
_SUSPECT_P = 0.1
_SLOW_TURN_RAD = 8.0 * np.pi
_NULL_SAMPLES = 64
_NULL_STEPS = 500
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
        Dependence on the direction, four harmonics: preferred poses, as on a washboard. Of a rotor
        that hardly leaves its place it is far too small before `calibrated`.
    """

    lag_p: float
    slow_p: float
    spread_p: float
    angle_p: float

    @property
    def p(self) -> float:
        """Probability of the least likely of the tests made, corrected for their number.

        nan where none was made.
        """
        tests = (self.lag_p, self.slow_p, self.spread_p, self.angle_p)
        made = [p for p in tests if not math.isnan(p)]
        return min(1.0, len(made) * min(made)) if made else math.nan


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
    squares = scores**2
    return Whiteness(
        lag_p=_ljung_box(scores),
        slow_p=float(stats.chi2.sf(2.0 * power.sum(), 2 * _SLOW_WAVES)),
        spread_p=_ljung_box(squares - squares.mean()),
        angle_p=math.exp(float(_log_angle_p(scores, ahead_rad))),
    )


def calibrated(
    white: Whiteness, start_rad: float, move_rad: Floats, drift_rad: Floats, seed: int
) -> Whiteness:
    """Correct `angle_p` for a rotor that visits few directions, or few times.

    A reading off its prediction moves the next prediction after it, so that deviations depend on
    the directions around them also without a potential, the more the less the rotor turns: as in a
    regression on a random walk. Rotors without one are drawn with the same moves, and the gamma
    distribution of their -2 log(p) gives the probability. Moves are pooled into 500 steps, which
    leaves the distribution as it is as long as the drift turns the rotor but little in one.

    Parameters
    ----------
    white
        As found by `whiteness`; given back where `angle_p` is not suspect, or where the drift
        turns the rotor by four turns, since it is right then.
    start_rad
        First direction predicted.
    move_rad
        Standard deviation of the turn of the next prediction that each reading causes.
    drift_rad
        Drift from each reading to the next.
    seed
        Of the draws.

    Notes
    -----
    Cost: 10 ms.
    """
    if white.angle_p > _SUSPECT_P or abs(drift_rad.sum()) > _SLOW_TURN_RAD:
        return white
    parts = np.linspace(0, move_rad.size, _NULL_STEPS, endpoint=False).astype(np.int64)
    parts = np.unique(parts)
    move = np.sqrt(np.add.reduceat(move_rad**2, parts))
    drift = np.add.reduceat(drift_rad, parts)
    scores = np.random.default_rng(seed).standard_normal((_NULL_SAMPLES, move.size))
    scores -= scores.mean(axis=1, keepdims=True)
    scores /= scores.std(axis=1, keepdims=True)
    ahead = start_rad + np.cumsum(move * scores + drift, axis=1)
    drawn = -2.0 * _log_angle_p(scores[:, 1:], ahead[:, :-1])
    mean, variance = float(drawn.mean()), float(drawn.var(ddof=1))
    if not variance > 0.0:
        return white
    found = -2.0 * math.log(max(white.angle_p, _LEAST_P))
    angle_p = float(stats.gamma.sf(found, mean**2 / variance, scale=variance / mean))
    return replace(white, angle_p=angle_p)


def _log_angle_p(scores: Floats, ahead_rad: Floats) -> Floats:
    """Log probability of scores that depend so much on directions, shape (..., n)."""
    first = np.exp(1j * ahead_rad)
    powers = [first]
    for _ in range(_HARMONICS - 1):
        powers.append(powers[-1] * first)
    waves = np.stack([part for power in powers for part in (power.real, power.imag)], axis=-2)
    waves -= waves.mean(axis=-1, keepdims=True)
    n = scores.shape[-1]
    values, vectors = np.linalg.eigh(waves @ np.swapaxes(waves, -1, -2) / n)
    along = np.swapaxes(vectors, -1, -2) @ (waves @ scores[..., np.newaxis])
    # Directions that were not visited tell nothing.
    visited = values > _LEAST_VARIANCE
    squares = np.where(visited, along[..., 0] ** 2 / (np.where(visited, values, 1.0) * n), 0.0)
    p = stats.chi2.sf(squares.sum(axis=-1), np.maximum(visited.sum(axis=-1), 1))
    log_p: Floats = np.log(np.maximum(p, _LEAST_P))
    return log_p


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
