"""Windows with one spot each, made without the fitter's arithmetic."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from rotortrack.localise.fit import RESULT_COLUMNS, fit_chosen
from rotortrack.localise.lanes import fit_windows
from rotortrack.localise.windows import LANES, Windows


def expected_windows(x, y, photons, background, sigma, size=7):
    """(n, size, size) expected photons; x and y in pixels from the window's outer corner."""
    edges = np.arange(size + 1)
    gx = np.diff(ndtr((edges - np.asarray(x)[:, None]) / sigma), axis=1)
    gy = np.diff(ndtr((edges - np.asarray(y)[:, None]) / sigma), axis=1)
    return background + np.asarray(photons)[:, None, None] * gy[:, :, None] * gx[:, None, :]


def noisy_windows(rng, expected, read_noise_e):
    return (rng.poisson(expected) + rng.normal(0, read_noise_e, expected.shape)).astype(np.float32)


def bound(x, y, photons, background, sigma, read_noise_e, size=7, mask=None):
    """(5,) Cramer-Rao bound of x, y, photons, background and sigma by numerical derivatives.

    Pixels that `mask` (size, size) names do not count.
    """
    truth = np.array([x, y, photons, background, sigma], float)
    kept = np.ones(size * size, bool) if mask is None else ~mask.ravel()

    def model(p):
        window = expected_windows([p[0]], [p[1]], [p[2]], p[3], p[4], size)[0]
        return window.ravel()[kept]

    steps = 1e-5 * np.maximum(np.abs(truth), 1.0)
    jacobian = np.array(
        [(model(truth + step) - model(truth - step)) / (2 * step.sum()) for step in np.diag(steps)]
    )
    information = (jacobian / (model(truth) + read_noise_e**2)) @ jacobian.T
    return np.sqrt(np.diag(np.linalg.inv(information)))


def as_lanes(values, spare):
    """(batch, pixel, LANES) from (n, size, size), with what spare lanes hold."""
    n = len(values)
    batches = -(-n // LANES)
    pixels = np.prod(values.shape[1:])
    flat = np.full((batches * LANES, pixels), spare, np.float32)
    flat[:n] = values.reshape(n, pixels)
    return np.ascontiguousarray(flat.reshape(batches, LANES, pixels).transpose(0, 2, 1))


def as_windows(photons, variance):
    """Windows of (n, size, size) photons; pixels without a number are masked."""
    noise = np.broadcast_to(np.asarray(variance, np.float32), photons.shape).copy()
    masked = ~np.isfinite(photons) | np.isinf(noise)
    noise[masked] = np.inf
    data = np.where(masked, 0.0, photons)
    return Windows(as_lanes(data, 0.0), as_lanes(noise, np.inf), np.zeros(len(photons), np.int32))


def fit(photons, method, *, variance, sigma_px=1.6, scalar=False, **options):
    """Results by name and flags of (n, size, size) windows; x and y from the outer corner."""
    windows = as_windows(photons, variance)
    radius = photons.shape[1] // 2
    settings = {"free_sigma": True, "correct_bias": False} | options
    if scalar:
        results = np.empty((len(RESULT_COLUMNS), len(photons)))
        flags = np.zeros(len(photons), np.int32)
        fit_chosen(
            windows,
            np.arange(len(photons)),
            method=method,
            sigma_px=sigma_px,
            **settings,
            results=results,
            flags=flags,
        )
    else:
        results, flags = fit_windows(windows, radius, method=method, sigma_px=sigma_px, **settings)
    fitted = dict(zip(RESULT_COLUMNS, results, strict=True))
    fitted["x_px"] = fitted["x_px"] + radius + 0.5
    fitted["y_px"] = fitted["y_px"] + radius + 0.5
    return fitted, flags
