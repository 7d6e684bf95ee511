"""Which localisations are precise enough to be used."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.corrections.options import QualityOptions
from rotortrack.errors import TableError


def passes_quality(localisations: pd.DataFrame, options: QualityOptions) -> NDArray[np.bool_]:
    """Tell for each row whether ``uncertainty_nm < max_uncertainty_nm``, strictly.

    A row whose uncertainty is nan fails, as in the ThunderSTORM filter `uncertainty < 50`.

    Parameters
    ----------
    localisations
        Column uncertainty_nm, nm.
    options
        The bound.

    Returns
    -------
    Shape (n,).

    Raises
    ------
    TableError
        The table has no uncertainties.
    """
    if "uncertainty_nm" not in localisations.columns:
        raise TableError(
            "the localisations have no uncertainty_nm to filter by: localise the movie again with "
            "a method that gives uncertainties (mle, lsq, wlsq), or leave the quality filter out "
            "if the table was filtered before"
        )
    uncertainty = localisations["uncertainty_nm"].to_numpy(dtype=np.float64)
    passed: NDArray[np.bool_] = uncertainty < options.max_uncertainty_nm
    return passed
