"""A grid of points that shine in both colours: what two colours are registered with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.options import FiducialsOptions, LatticeOptions
from rotortrack.simulate.film.places import lattice
from rotortrack.simulate.film.scene import within
from rotortrack.simulate.film.streams import Effect, stream

Floats = NDArray[np.float64]

_MARGIN_NM = 500.0


def fiducial_points(
    options: FiducialsOptions, shape_px: tuple[int, int], pixel_size_nm: float, seed: int
) -> tuple[Floats, Floats, Floats]:
    """Draw the points of a grid.

    Parameters
    ----------
    options
        Pitch, rotation, jitter, and how many are missing.
    shape_px, pixel_size_nm
        Field of the first colour.
    seed
        Of the film.

    Returns
    -------
    x_nm, y_nm, photons
        Places in the first colour, (points,), and photons a frame in each colour, (points, 2).
    """
    grid = LatticeOptions(
        pitch_nm=options.pitch_nm, rotation_deg=options.rotation_deg, jitter_nm=options.jitter_nm
    )
    size_nm = (shape_px[1] * pixel_size_nm, shape_px[0] * pixel_size_nm)
    places = lattice(grid, size_nm, _MARGIN_NM, seed)
    rng = stream(seed, Effect.FIDUCIALS)
    there = rng.random(len(places)) >= options.missing
    photons = np.array(
        [[within(options.photons, part) for part in row] for row in rng.random((len(places), 2))]
    ).reshape(-1, 2)
    return places[there, 0], places[there, 1], photons[there]
