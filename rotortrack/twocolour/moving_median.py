"""The moving median of distances, as MATLAB's movmedian takes it (Fig. S7)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def moving_median(values: Floats, window: int = 40) -> Floats:
    """Give the median of the values around each one.

    An even window takes half of it before a value and one less behind it (of 40: 20 before, 19
    behind, and the value itself); an odd one as many before as behind. At the ends the window
    shrinks to what is there. Values that are nan are left out; where nothing is left stands nan.

    Parameters
    ----------
    values
        Shape (n,), in order of frames. Frames without a value have no row, so that a window is so
        many values, not so much time.
    window
        How many values.

    Returns
    -------
    Shape (n,).

    Raises
    ------
    ValueError
        The window is smaller than 1.
    """
    if window < 1:
        raise ValueError(f"a window holds at least one value, not {window}")
    values = np.asarray(values, np.float64)
    behind = (window - 1) // 2
    # pandas looks back alone: the series is continued by as many missing values as lie behind.
    longer = pd.Series(np.concatenate([values, np.full(behind, np.nan)]))
    medians = longer.rolling(window, min_periods=1).median().to_numpy()
    smooth: Floats = medians[behind:]
    return smooth
