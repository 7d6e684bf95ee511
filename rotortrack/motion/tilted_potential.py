"""A potential that holds a rotor back in some directions, from where it dwells.

The angle obeys ``d theta = D (f - u'(theta)) dt + sqrt(2 D) dW`` with a tilt f (kT per rad, the
torque over kT) and a periodic potential of two harmonics,

    u(theta) = a1 cos theta + b1 sin theta + a2 cos 2 theta + b2 sin 2 theta    (kT).

Its stationary density p solves the Fokker-Planck equation ``(p' - (f - u') p)' = 0``. The five
numbers are those whose density has the observed means of cos and sin of theta and 2 theta and
whose mean speed is the observed one: without tilt this is the maximum of the likelihood of the
angles. Time averages scatter by ``2 / (D T) integral p psi_i' psi_j'``, where psi solves
``psi'' + (f - u') psi' = mean(g) - g``: errors know how slowly the rotor forgets, from the model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize, special, stats

Floats = NDArray[np.float64]

_SIZE = 65
_DRAWS = 1000
_HIGHEST = 25.0
_ORDERS = np.array([1, 1, 2, 2])
_FREEDOM = 4
_SEEN = stats.chi2.isf(0.05, _FREEDOM)


def _around(size: int) -> Floats:
    return np.asarray(np.arange(size) * (2.0 * np.pi / size), np.float64)


def _waves(theta_rad: Floats) -> Floats:
    """Evaluate the four functions in rows: cos and sin of theta and of 2 theta."""
    return np.stack(
        [np.cos(theta_rad), np.sin(theta_rad), np.cos(2.0 * theta_rad), np.sin(2.0 * theta_rad)]
    )


def _derivatives(size: int) -> tuple[Floats, Floats]:
    """First and second derivative of periodic functions on an odd number of points, exact."""
    order = np.fft.fftfreq(size, 1.0 / size)
    basis = np.fft.fft(np.eye(size), axis=0)
    first = np.fft.ifft(1j * order[:, np.newaxis] * basis, axis=0).real
    second = np.fft.ifft(-(order[:, np.newaxis] ** 2) * basis, axis=0).real
    return first, second


_THETA = _around(_SIZE)
_WAVES = _waves(_THETA)
_FIRST, _SECOND = _derivatives(_SIZE)
# d/dtheta of cos, sin, cos 2, sin 2 in terms of themselves.
_SLOPES = np.stack([-_WAVES[1], _WAVES[0], -2.0 * _WAVES[3], 2.0 * _WAVES[2]])


@dataclass(frozen=True)
class TiltedPotential:
    """Tilt and potential of a rotor with intervals of 95 %.

    Attributes
    ----------
    coefficients_kt, covariance_kt2
        (a1, b1, a2, b2) and their covariance.
    tilt_kt_rad, tilt_sd_kt_rad
        f: torque over kT that would turn a rotor without potential at f D.
    barrier_kt, barrier_interval_kt
        Highest less lowest value of u, the tilt left out, and its interval. The estimate is the
        amplitude that exceeds what chance adds, 0 if none; the interval starts at 0 unless a
        chi-square test (5 %) sees a potential.
    preferred_rad, preferred_sd_rad
        Direction in which u is lowest.
    p
        Probability of such preferences in a rotor without potential.
    """

    coefficients_kt: Floats
    covariance_kt2: Floats
    tilt_kt_rad: float
    tilt_sd_kt_rad: float
    barrier_kt: float
    barrier_interval_kt: tuple[float, float]
    preferred_rad: float
    preferred_sd_rad: float
    p: float

    def potential_kt(self, theta_rad: Floats) -> Floats:
        """Evaluate u at angles, kT."""
        values: Floats = self.coefficients_kt @ _waves(theta_rad)
        return values

    @property
    def stiffness_kt_rad2(self) -> float:
        """Largest curvature of u, kT per rad^2: a rotor forgets in ``1 / (D stiffness)``."""
        return float(np.max(-(_ORDERS**2 * self.coefficients_kt) @ _WAVES))

    def density(self, theta_rad: Floats) -> Floats:
        """Evaluate the stationary density at angles, 1/rad."""
        on_grid = _density(_drift(np.append(self.coefficients_kt, self.tilt_kt_rad)))
        waves = np.fft.fft(on_grid) / _SIZE
        order = np.fft.fftfreq(_SIZE, 1.0 / _SIZE)
        values = np.exp(1j * np.multiply.outer(theta_rad, order)) @ waves
        return np.asarray(values.real * _SIZE / (2.0 * np.pi), np.float64)

    def coherence(self, diffused_rad2: float, lag: int) -> tuple[float, float]:
        """Expect |mean exp(i turn)| of the turns over one frame and over `lag` frames.

        Parameters
        ----------
        diffused_rad2
            D times the frame interval.
        lag
            Frames.
        """
        drift = _drift(np.append(self.coefficients_kt, self.tilt_kt_rad))
        back = _density(drift) * np.exp(-1j * _THETA)
        frame = linalg.expm(diffused_rad2 * _backward(drift))
        ahead = frame @ np.exp(1j * _THETA)
        first = float(abs(back @ ahead))
        for _ in range(lag - 1):
            ahead = frame @ ahead
        return first, float(abs(back @ ahead))

    def row(self) -> dict[str, float]:
        """Columns of `tables.ROTORS`."""
        low, high = self.barrier_interval_kt
        return {
            "barrier_kt": self.barrier_kt,
            "barrier_ci_low_kt": low,
            "barrier_ci_high_kt": high,
            "preferred_rad": self.preferred_rad,
            "pinning_p": self.p,
        }


NO_POTENTIAL = TiltedPotential(
    np.full(4, math.nan),
    np.full((4, 4), math.nan),
    math.nan,
    math.nan,
    math.nan,
    (math.nan, math.nan),
    math.nan,
    math.nan,
    math.nan,
)


def fit_potential(
    theta_rad: Floats,
    *,
    omega_rad_s: float,
    diffusion_rad2_s: float,
    noise_variance_rad2: float,
    duration_s: float,
    diffusion_relative_sd: float = 0.0,
) -> TiltedPotential:
    """Fit tilt and potential to the angles of one rotor.

    Parameters
    ----------
    theta_rad
        Angles in the frames in which it was seen, shape (n,).
    omega_rad_s
        Its mean speed.
    diffusion_rad2_s
        D that acts within a few frames; that of long times is lower where a potential holds.
    noise_variance_rad2
        Variance sigma^2 of an angle's localisation noise, which lowers the observed mean of
        exp(i n theta) by ``exp(-n^2 sigma^2 / 2)``. Motion in the exposure t takes ``D t / 3`` off
        the spread within a well, so that their sum may be below zero.
    duration_s
        From the first to the last frame.
    diffusion_relative_sd
        Standard deviation of D over D.

    Returns
    -------
    TiltedPotential
        All nan where D is not known or no potential below 25 kT has these means: a stuck rotor.

    Notes
    -----
    Valid as long as the rotor does not settle within an exposure: D t times the curvature of u in
    its wells below 0.3. Cost: 6 ms. Source: Risken, The Fokker-Planck Equation (1989), chapter 11.
    """
    known = (omega_rad_s, diffusion_rad2_s, noise_variance_rad2, duration_s)
    if not all(map(math.isfinite, known)) or not diffusion_rad2_s > 0.0 or not duration_s > 0.0:
        return NO_POTENTIAL
    unblurred = np.exp(0.5 * _ORDERS**2 * noise_variance_rad2)
    waves = _waves(theta_rad)
    observed = np.append(unblurred * waves.mean(axis=1), omega_rad_s / diffusion_rad2_s)
    parameters = _solve(observed)
    if parameters is None:
        return NO_POTENTIAL
    scatter = _scatter(parameters, diffusion_rad2_s * duration_s)
    # Localisation noise is independent between frames and hardly counts.
    own = np.maximum(unblurred**2 - 1.0, 0.0) / (2.0 * theta_rad.size)
    scatter[:4, :4] += np.diag(own)
    scatter[4, 4] += (observed[4] * diffusion_relative_sd) ** 2
    response = _response(parameters)
    inverse = np.linalg.inv(response)
    covariance = inverse @ scatter @ inverse.T
    return _told(parameters, covariance)


def _told(parameters: Floats, covariance: Floats) -> TiltedPotential:
    coefficients, spread = parameters[:4], covariance[:4, :4]
    square = float(coefficients @ np.linalg.solve(spread, coefficients))
    draws = np.random.default_rng(0).multivariate_normal(
        coefficients, spread, _DRAWS, method="cholesky"
    )
    values = draws @ _WAVES
    barriers = np.ptp(values, axis=1)
    fine = _around(720)
    shape = coefficients @ _waves(fine)
    barrier = float(np.ptp(shape))
    preferred = float(fine[int(np.argmin(shape))])
    lowest = np.exp(1j * (_THETA[np.argmin(values, axis=1)] - preferred))
    low, middle, high = _amplitude(barrier, float(barriers.std()))
    return TiltedPotential(
        coefficients_kt=coefficients,
        covariance_kt2=spread,
        tilt_kt_rad=float(parameters[4]),
        tilt_sd_kt_rad=math.sqrt(covariance[4, 4]),
        barrier_kt=middle,
        barrier_interval_kt=(low if square > _SEEN else 0.0, high),
        preferred_rad=float(np.angle(np.exp(1j * preferred))),
        preferred_sd_rad=math.sqrt(-2.0 * math.log(max(abs(lowest.mean()), 1e-6))),
        p=float(stats.chi2.sf(square, _FREEDOM)),
    )


def _amplitude(size: float, sd: float) -> tuple[float, float, float]:
    """Lower end, estimate and upper end of an amplitude that noise in four dimensions enlarges.

    ``(size / sd)^2`` is chi-square with four degrees of freedom and noncentrality (true / sd)^2.
    """
    square = (size / sd) ** 2

    def noncentrality(p: float) -> float:
        if special.chdtr(_FREEDOM, square) <= p:
            return 0.0
        most = (math.sqrt(square) + 6.0) ** 2
        return float(
            optimize.brentq(lambda at: special.chndtr(square, _FREEDOM, at) - p, 1e-9, most)
        )

    low, high = (sd * math.sqrt(noncentrality(p)) for p in (0.975, 0.025))
    return low, sd * math.sqrt(max(square - (_FREEDOM - 1.0), 0.0)), high


def _drift(parameters: Floats) -> Floats:
    """Evaluate ``f - u'`` on the grid."""
    drift: Floats = parameters[4] - parameters[:4] @ _SLOPES
    return drift


def _backward(drift: Floats) -> Floats:
    """Build the generator over D: how fast the mean of a function of the angle changes."""
    generator: Floats = _SECOND + drift[:, np.newaxis] * _FIRST
    return generator


def _density(drift: Floats) -> Floats:
    """Stationary density on the grid, its sum one."""
    density: Floats = np.linalg.solve(_backward(drift).T + 1.0, np.ones(_SIZE)).astype(np.float64)
    return density


def _expected(parameters: Floats) -> Floats:
    """Four means and the mean speed over D."""
    drift = _drift(parameters)
    density = _density(drift)
    return np.append(_WAVES @ density, drift @ density)


def _response(parameters: Floats) -> Floats:
    """Differentiate the five means (rows) by the five parameters (columns)."""
    stride = 1e-5 * (1.0 + np.abs(parameters))
    columns = [
        (_expected(parameters + shift) - _expected(parameters - shift)) / (2.0 * shift.sum())
        for shift in np.diag(stride)
    ]
    return np.stack(columns, axis=1)


def _solve(observed: Floats) -> Floats | None:
    """Find the parameters that have these means."""
    start: Floats = np.append(-2.0 * observed[:4], observed[4])

    def missing(at: Floats) -> Floats:
        return _expected(at) - observed

    found = optimize.root(missing, start, jac=_response, tol=1e-9)
    parameters = np.asarray(found.x, np.float64)
    missed = float(np.abs(missing(parameters)).max())
    if not missed < 1e-6 * (1.0 + abs(observed[4])) or np.ptp(parameters[:4] @ _WAVES) > _HIGHEST:
        return None
    return parameters


def _scatter(parameters: Floats, independent: float) -> Floats:
    """Covariance of the five time averages over ``D T = independent``."""
    drift = _drift(parameters)
    density = _density(drift)
    backward = _backward(drift)
    values = np.vstack([_WAVES, drift])
    centred = values - (values @ density)[:, np.newaxis]
    # The rank-one term picks the solution of mean zero.
    solved = np.linalg.solve(backward + density[np.newaxis, :], -centred.T)
    slopes = (_FIRST @ solved).T
    slopes[4] += 1.0
    scatter: Floats = (2.0 / independent) * (slopes * density) @ slopes.T
    return scatter
