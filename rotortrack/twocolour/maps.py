"""Maps given back from what they wrote of themselves."""

from __future__ import annotations

from typing import Any

import numpy as np

from rotortrack.twocolour.fit import Map
from rotortrack.twocolour.local_mean import LocalMeanMap
from rotortrack.twocolour.polynomial import HIGHEST_ORDER, Frame, PolynomialMap, parameters_of
from rotortrack.twocolour.thin_plate import SplineMap


def map_from_dict(content: dict[str, Any]) -> Map:
    """Make the map that `as_dict` of one of the kinds gave.

    Raises
    ------
    KeyError, TypeError, ValueError
        The content is not that of a map.
    """
    kind = content["kind"]
    if kind == "local-mean":
        return LocalMeanMap.from_dict(content)
    order = int(content["order"])
    if not 1 <= order <= HIGHEST_ORDER:
        raise ValueError(f"order {order}")
    frame = Frame(**{name: float(value) for name, value in content["frame"].items()})
    coefficients = np.array(content["coefficients_nm"], np.float64)
    if coefficients.shape != (parameters_of(order), 2) or not np.isfinite(coefficients).all():
        raise ValueError("the map's coefficients")
    if kind == "polynomial":
        return PolynomialMap(order, frame, coefficients)
    if kind == "spline":
        knots, weights = (np.array(content[name], np.float64) for name in ("knots", "weights_nm"))
        if knots.shape != weights.shape or knots.shape[1:] != (2,):
            raise ValueError("the map's knots")
        return SplineMap(order, int(content["derivative"]), frame, coefficients, knots, weights)
    raise ValueError(f"kind {kind!r}")
