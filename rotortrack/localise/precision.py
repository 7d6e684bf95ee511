"""How certain a fit is: the Cramer-Rao bound, the sandwich covariance and the plugin's formulas."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rotortrack.kernels import kernel
from rotortrack.localise.gaussian import (
    BACKGROUND,
    PARAMETERS,
    PHOTONS,
    SIGMA,
    X,
    Y,
    pixel_gradient,
    profile,
)
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION
from rotortrack.localise.linear import invert


@kernel
def covariance(
    parameters: NDArray[np.float64],
    variance: NDArray[np.float64],
    keep: NDArray[np.float64],
    weights: NDArray[np.float64],
    weighted: bool,
    free_background: bool,
    free_sigma: bool,
    result: NDArray[np.float64],
) -> bool:
    """Covariance of the fitted parameters under Poisson and read noise.

    For the likelihood it is the inverse Fisher information, i.e. the Cramer-Rao bound,
    ``A^-1`` with ``A = sum J J^T / V`` and V = mu + read variance. For weighted squares the
    estimate is not efficient, and its covariance is the sandwich ``B^-1 C B^-1`` with
    ``B = sum w J J^T`` and ``C = sum w^2 V J J^T``, which never lies below the bound.

    Parameters
    ----------
    parameters
        (5,) x, y, photons, background, sigma.
    variance, keep, weights
        (n, n) read variance, 1 or 0 for pixels that count, weights of the squares.
    weighted
        True for squares, False for the likelihood.
    free_background, free_sigma
        False for a parameter that was not fitted; its covariances are 0.
    result
        (5, 5) receives the covariance.

    Returns
    -------
    bool
        False when the data do not determine the parameters; `result` is then not filled.
    """
    n = keep.shape[0]
    along_x = np.empty((3, n))
    along_y = np.empty((3, n))
    slope = np.empty(PARAMETERS)
    bread = np.zeros((PARAMETERS, PARAMETERS))
    filling = np.zeros((PARAMETERS, PARAMETERS))
    profile(parameters[X], parameters[SIGMA], along_x)
    profile(parameters[Y], parameters[SIGMA], along_y)
    photons = max(parameters[PHOTONS], SMALLEST_EXPECTATION)
    for i in range(n):
        for j in range(n):
            if keep[i, j] == 0.0:
                continue
            light = pixel_gradient(along_x, along_y, i, j, photons, slope)
            if not free_background:
                slope[BACKGROUND] = 0.0
            if not free_sigma:
                slope[SIGMA] = 0.0
            total = parameters[BACKGROUND] + photons * light + variance[i, j]
            total = max(total, SMALLEST_EXPECTATION)
            weight = weights[i, j] if weighted else 1.0 / total
            for a in range(PARAMETERS):
                for b in range(a + 1):
                    product = weight * slope[a] * slope[b]
                    bread[a, b] += product
                    filling[a, b] += product * weight * total
    # What was not fitted has nothing but this on its row, and gives way to 0 at the end.
    if not free_background:
        bread[BACKGROUND, BACKGROUND] = 1.0
    if not free_sigma:
        bread[SIGMA, SIGMA] = 1.0
    if not weighted:
        if not invert(bread, result):
            return False
        if not free_background:
            result[BACKGROUND, BACKGROUND] = 0.0
        if not free_sigma:
            result[SIGMA, SIGMA] = 0.0
        return True
    inverse = np.empty((PARAMETERS, PARAMETERS))
    if not invert(bread, inverse):
        return False
    for a in range(PARAMETERS):
        for b in range(a):
            filling[b, a] = filling[a, b]
    for a in range(PARAMETERS):
        for b in range(PARAMETERS):
            total = 0.0
            for c in range(PARAMETERS):
                for d in range(PARAMETERS):
                    total += inverse[a, c] * filling[c, d] * inverse[d, b]
            result[a, b] = total
    return True


def bound_nm(
    photons: float,
    *,
    background: float,
    sigma_nm: float,
    pixel_size_nm: float,
    read_noise_e: float = 0.0,
    radius_px: int = 3,
) -> float:
    """Cramer-Rao bound of a position per axis, nm, for a spot of known brightness.

    Background, photons and width are fitted too. The mean over places within a pixel, as an rms.

    Parameters
    ----------
    photons, background
        Photons of the spot, and of the background per pixel.
    sigma_nm, pixel_size_nm
        Width of the spot and side of a pixel.
    read_noise_e
        Read noise, electrons rms.
    radius_px
        Half the window of the fit.

    Returns
    -------
    float
        inf where the window tells no position.
    """
    n = 2 * radius_px + 1
    variance = np.full((n, n), read_noise_e**2)
    everything = np.ones((n, n))
    result = np.empty((PARAMETERS, PARAMETERS))
    total = 0.0
    places = (0.0, 0.25, 0.5)
    for x in places:
        for y in places:
            spot = np.array([x, y, photons, background, sigma_nm / pixel_size_nm])
            if not covariance(spot, variance, everything, everything, False, True, True, result):
                return float("inf")
            total += result[X, X] / len(places) ** 2
    return float(np.sqrt(total)) * pixel_size_nm


def thunderstorm_uncertainty(
    generation: Literal["2014", "2016"],
    method: Literal["lsq", "wlsq", "mle"],
    *,
    sigma_nm: NDArray[np.floating],
    photons: NDArray[np.floating],
    background_sd: NDArray[np.floating],
    pixel_size_nm: float,
    read_noise_e: float = 0.0,
    excess_noise: float = 1.0,
) -> NDArray[np.float64]:
    """Lateral uncertainty as the ThunderSTORM plugin computes it.

    With b the background standard deviation, a the pixel size, g the excess noise and
    ``tau = 2 pi b^2 (s^2 + a^2/12) / (N a^2)``:

    - 2014 (v1.3), any method: ``var = (g s^2 + a^2/12)/N + 8 pi s^4 b^2 / (a^2 N^2)``
      (Thompson et al., Biophys. J. 82, 2775 (2002));
    - 2016, LSQ: ``var = (g s^2 + a^2/12)/N (16/9 + 4 tau)``
      (Mortensen et al., Nature Methods 7, 377 (2010));
    - 2016, MLE and WLSQ: ``var = (g s^2 + a^2/12)/N (1 + 4 tau + sqrt(2 tau / (1 + 4 tau)))``
      (Rieger and Stallinga, ChemPhysChem 15, 664 (2014)).

    Parameters
    ----------
    generation
        Which release's formula.
    method
        How the spots were fitted.
    sigma_nm, photons, background_sd
        (n,) width (nm), photons, and standard deviation of the residuals (photons).
    pixel_size_nm
        Pixel size (nm).
    read_noise_e
        Read noise (electrons); the 2016 formula adds it linearly to `background_sd`.
    excess_noise
        2 for a camera with electron multiplication, else 1; it multiplies s^2 alone.

    Returns
    -------
    ndarray, shape (n,)
        Uncertainty in nm; nan where photons are not positive.
    """
    sigma = np.asarray(sigma_nm, np.float64)
    count = np.asarray(photons, np.float64)
    spread = np.asarray(background_sd, np.float64)
    area = pixel_size_nm**2
    with np.errstate(divide="ignore", invalid="ignore"):
        shot = (excess_noise * sigma**2 + area / 12.0) / count
        if generation == "2014":
            total = shot + 8.0 * np.pi * sigma**4 * spread**2 / (area * count**2)
        else:
            spread = spread + read_noise_e
            tau = 2.0 * np.pi * spread**2 * (sigma**2 + area / 12.0) / (count * area)
            factor = (
                16.0 / 9.0 + 4.0 * tau
                if method == "lsq"
                else 1.0 + 4.0 * tau + np.sqrt(2.0 * tau / (1.0 + 4.0 * tau))
            )
            total = shot * factor
        return np.where(count > 0.0, np.sqrt(total), np.nan)
