"""What population of rotors a scan's grid of parameters stands for: a weight for each run.

A grid is chosen by whoever makes it and is not a population. Its runs are therefore weighted by a
stated rule: each cell (charge and flow) in which a rod turns has one weight, which its shapes
share. Runs that end in one shape, or in its mirror image, share that shape's weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import InputError
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.observe import DYES_NM, dye_centres_nm
from rotortrack.tables import Column, Schema
from rotortrack.twocolour.attractors import CELL, label_attractors

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Weights = Literal["cells", "shapes", "runs"]

PRIOR = Schema(
    "prior",
    (
        Column("lambda_eff", "float64", "", "part of the bare charge", required=True),
        Column("flow_ratio", "float64", "", "factor of the flow over lambda_eff", required=True),
        Column("weight", "float64", "", "how probable that cell is, on any scale", required=True),
    ),
)
"""Columns of a file that declares how probable the cells of a scan are."""

_SAME_CELL = 1e-9


@dataclass(frozen=True)
class RodPopulation:
    """The rotating rods of a scan, each with a weight.

    Attributes
    ----------
    distance_nm
        Distance of the dye centres seen from above, (rods,).
    radius_nm
        Distance of each dye centre from the pore's axis, (rods, 2).
    rate_rev_s
        Signed rate, counter-clockwise seen from cis is positive.
    weight
        Adds up to 1.
    attractor
        Equal numbers are equal shapes.
    run
        Number of the run in the scan.
    cells, attractors
        How many cells have a rotating rod; how many shapes these have.
    declared
        Whether somebody declared how probable the cells are.
    mirrored_starts
        Whether the scan has the mirror image of every start.
    """

    distance_nm: Floats
    radius_nm: Floats
    rate_rev_s: Floats
    weight: Floats
    attractor: NDArray[np.int64]
    run: NDArray[np.int64]
    cells: int
    attractors: int
    declared: bool
    mirrored_starts: bool


def rod_population(
    runs: pd.DataFrame,
    shape_nm: Floats,
    *,
    length_nm: float,
    weights: Weights = "cells",
    prior: pd.DataFrame | None = None,
    declared: bool = False,
    same_nm: float = 3.0,
    source: str = "the scan",
) -> RodPopulation:
    """Weight the rotating rods of a scan.

    Parameters
    ----------
    runs, shape_nm
        Table of schema `RUNS`, and final positions of the vertices, (runs, n, 3).
    length_nm
        Contour length of the rods.
    weights
        `cells`: each cell with a rotating rod has one weight, shared evenly by its shapes;
        `shapes`: each shape of each cell has one weight; `runs`: each run has, as in Fig. 3j.
    prior
        Weights of cells, of schema `PRIOR`, in place of those; cells without one count 0.
    declared
        Whether the weights are a population that somebody declared.
    same_nm
        Shapes of a cell closer than this are one.
    source
        Named in errors.

    Raises
    ------
    InputError
        No rod of the scan turns, or none in a cell with a weight; the prior is no set of weights.
    """
    turning = (
        (runs["end"] == RodEnd.ROTATING_STEADILY.value).to_numpy()
        & np.isfinite(runs["end_to_end_dyes_xy_nm"].to_numpy(np.float64))
        & np.isfinite(shape_nm).all(axis=(1, 2))
    )
    if not turning.any():
        raise InputError(
            f"{source} has no rod that rotates steadily: simulate other charges and flows, or for "
            "longer"
        )
    rods = runs[turning].reset_index(drop=True)
    shapes = shape_nm[turning]
    labels = label_attractors(rods, shapes, same_nm)
    if prior is not None:
        weight = _cell_weights(rods, prior, source)
        weights, declared = "cells", True
    else:
        weight = np.ones(len(rods))
    weight = _shared(rods, labels, weight, weights)
    dyes = dye_centres_nm(shapes, length_nm, DYES_NM)[..., :2]
    counted = weight > 0
    return RodPopulation(
        distance_nm=rods["end_to_end_dyes_xy_nm"].to_numpy(np.float64)[counted],
        radius_nm=np.hypot(dyes[..., 0], dyes[..., 1])[counted],
        rate_rev_s=rods["rate_rev_s"].to_numpy(np.float64)[counted],
        weight=weight[counted] / weight.sum(),
        attractor=labels[counted],
        run=rods["run"].to_numpy(np.int64)[counted],
        cells=len(rods[counted].groupby(list(CELL)).indices),
        attractors=len(np.unique(labels[counted])),
        declared=declared,
        mirrored_starts=bool(runs["mirrored"].any()),
    )


def _shared(
    rods: pd.DataFrame, labels: NDArray[np.int64], cell_weight: Floats, weights: Weights
) -> Floats:
    """Share the weight of a cell by its shapes, and that of a shape by its runs."""
    if weights == "runs":
        return cell_weight
    runs_of = np.bincount(labels)[labels]
    weight = cell_weight / runs_of
    if weights == "cells":
        for members in rods.groupby(list(CELL)).indices.values():
            weight[members] /= len(np.unique(labels[members]))
    return weight


def _cell_weights(rods: pd.DataFrame, prior: pd.DataFrame, source: str) -> Floats:
    """Look up the weight of each rod's cell."""
    declared = prior["weight"].to_numpy(np.float64)
    if not (np.isfinite(declared).all() and (declared >= 0).all()):
        raise InputError("a weight of the prior is no number of at least 0: correct its file")
    weight = np.zeros(len(rods))
    for row, share in zip(prior.itertuples(), declared, strict=True):
        close = np.ones(len(rods), bool)
        for name in CELL:
            close &= np.isclose(rods[name], getattr(row, name), rtol=_SAME_CELL, atol=0.0)
        weight[close] = share
    if not weight.sum() > 0:
        raise InputError(
            f"the prior gives no weight to a cell of {source} in which a rod rotates: name such "
            "cells by lambda_eff and flow_ratio"
        )
    return weight
