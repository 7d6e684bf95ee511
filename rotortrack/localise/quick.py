"""Estimates without a fit, for those who choose speed: centroid, phasor and radial symmetry.

Root mean square error over the Cramer-Rao bound, for windows of 7 x 7 pixels, sigma 1.25 px (start
1.6 px), background 8 photons and read noise 1.6 electrons:

| photons | centroid | phasor | radial symmetry |
| --- | --- | --- | --- |
| 250 | 1.47 | 1.15 | 1.05 |
| 500 | 1.36 | 1.09 | 1.06 |
| 1000 | 1.24 | 1.07 | 1.08 |
| 5000 | 1.07 | 1.07 | 1.15 |

At 100 photons the equations of the centroid do not settle in a quarter of all windows, those of the
phasor in one of twenty.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.localise.fit import RESULT_COLUMNS
from rotortrack.localise.moments import CENTROID, GIVEN, PHASOR, match_moments
from rotortrack.localise.radial import radial_centres
from rotortrack.localise.windows import Windows

QUICK_METHODS: Final = {"centroid": CENTROID, "phasor": PHASOR, "radial-symmetry": GIVEN}


def estimate(
    windows: Windows, radius: int, *, method: str, sigma_px: float, free_sigma: bool = True
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Estimate the spot of every window from a few sums or gradients.

    - ``centroid``: the first moment of the light above the background.
    - ``phasor``: the phases of the window's first Fourier coefficients (Martens et al., J. Chem.
      Phys. 148, 123311 (2018)).
    - ``radial-symmetry``: the point that the lines along all gradients pass nearest
      (Parthasarathy, Nature Methods 9, 724 (2012)).

    What the first two mean is looked up in the pixel-integrated Gaussian that fits use, so that
    neither the window's rim nor masked or clipped pixels bias them: below 0.001 px without noise.
    Radial symmetry is off by up to 0.007 px at half a pixel from the centre (sigma 1.25 px, 7 x 7
    pixels), is drawn to the centre by noise (4 % of the way at 250 photons, 20 % at 100), and
    leaves windows with masked or clipped pixels to the phasor.

    Photons, background and width come from the sums over the window, over its border pixels, and
    over the light weighted by a bell in the middle, whatever the method. They are less certain than
    those of a fit: three times the bound at 250 photons, 1.4 times from 1000, for photons.

    Parameters
    ----------
    windows
        n windows.
    radius
        They are 2 * radius + 1 pixels wide.
    method
        A key of QUICK_METHODS.
    sigma_px
        Expected width, pixels. It stays where the window tells none within a factor of 2.5.
    free_sigma
        Whether the width is estimated. If not, a wrong `sigma_px` makes photons wrong: 1.6 instead
        of 1.25 px adds 37 %.

    Returns
    -------
    results
        (10, n) RESULT_COLUMNS; x and y in pixels from the window's centre. x_sd and y_sd carry
        Poisson and read noise through the estimator to first order, log_likelihood_ratio is nan.
    flags
        (n,) the windows' bits of FitFlag, and NOT_FINITE (five or fewer pixels count), SINGULAR (no
        light above the background), LEFT_WINDOW, or ITERATION_LIMIT (the equations did not settle).
    """
    n = len(windows.flags)
    results = np.full((len(RESULT_COLUMNS), n), np.nan)
    flags = windows.flags.copy()
    kind = QUICK_METHODS[method]
    if kind == GIVEN:
        radial_centres(windows.photons, windows.variance, radius, results)
    match_moments(
        windows.photons, windows.variance, radius, kind, sigma_px, free_sigma, results, flags
    )
    return results, flags
