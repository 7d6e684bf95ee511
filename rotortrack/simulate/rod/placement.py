"""Where rods start: straight, above the membrane, at the paper's three offsets or any other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.rod.options import RodOptions, StartOptions

PLACEMENTS = ((0.0, 3.0), (40.0, 8.0), (90.0, 15.0))
"""Offsets along and across the rod, nm, of the three starts of a phase diagram: centred rods
become S shapes, those off the centre U shapes and loops."""


def place_rod(
    rod: RodOptions, start: StartOptions, *, membrane_nm: float = 0.0
) -> NDArray[np.float64]:
    """Lay a straight rod above the membrane.

    It points along x, its centre at the offsets; the tilt lifts its last vertex. Then the whole is
    turned about the pore's axis by the azimuth, and mirrored (y to -y) or not.

    Parameters
    ----------
    rod, start
        Length and number of vertices; where the rod lies.
    membrane_nm
        Thickness of the membrane, whose cis face the height is counted from.

    Returns
    -------
    ndarray
        Vertices, nm, shape (n_vertices, 3), all links of one length.
    """
    n = rod.n_vertices
    edge_nm = rod.length_nm / (n - 1)
    along = (np.arange(n) - (n - 1) / 2) * edge_nm
    tilt = math.radians(start.tilt_deg)
    directions = np.broadcast_to([math.cos(tilt), 0.0, math.sin(tilt)], (n - 1, 3))
    x = along[:, np.newaxis] * np.array([math.cos(tilt), 0.0, math.sin(tilt)])
    if start.jitter_nm > 0.0:
        noise = np.random.default_rng(start.seed).normal(0.0, start.jitter_nm, (n, 3))
        links = directions * edge_nm + np.diff(noise, axis=0)
        links *= edge_nm / np.linalg.norm(links, axis=1, keepdims=True)
        x = np.concatenate([np.zeros((1, 3)), np.cumsum(links, axis=0)])
        x -= x.mean(axis=0)
    x[:, 2] -= x[:, 2].min()
    x += [start.offset_x_nm, start.offset_y_nm, start.height_nm + membrane_nm / 2.0]
    turn = math.radians(start.azimuth_deg)
    if turn:
        cosine, sine = math.cos(turn), math.sin(turn)
        x[:, :2] = x[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    if start.mirrored:
        x[:, 1] = -x[:, 1]
    return np.ascontiguousarray(x)
