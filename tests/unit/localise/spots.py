"""Windows with one spot each, made without the fitter's arithmetic."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr


def expected_windows(x, y, photons, background, sigma, size=7):
    """(n, size, size) expected photons; x and y in pixels from the window's outer corner."""
    edges = np.arange(size + 1)
    gx = np.diff(ndtr((edges - np.asarray(x)[:, None]) / sigma), axis=1)
    gy = np.diff(ndtr((edges - np.asarray(y)[:, None]) / sigma), axis=1)
    return background + np.asarray(photons)[:, None, None] * gy[:, :, None] * gx[:, None, :]


def noisy_windows(rng, expected, read_noise_e):
    return (rng.poisson(expected) + rng.normal(0, read_noise_e, expected.shape)).astype(np.float32)


def bound(x, y, photons, background, sigma, read_noise_e, size=7):
    """(5,) Cramer-Rao bound of x, y, photons, background and sigma by numerical derivatives."""
    truth = np.array([x, y, photons, background, sigma], float)

    def model(p):
        return expected_windows([p[0]], [p[1]], [p[2]], p[3], p[4], size)[0].ravel()

    steps = 1e-5 * np.maximum(np.abs(truth), 1.0)
    jacobian = np.array(
        [(model(truth + step) - model(truth - step)) / (2 * step.sum()) for step in np.diag(steps)]
    )
    information = (jacobian / (model(truth) + read_noise_e**2)) @ jacobian.T
    return np.sqrt(np.diag(np.linalg.inv(information)))
