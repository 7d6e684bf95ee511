"""Score localisations against the truth of a film.

    python tests/benchmarks/score.py TRUTH.npz FOUND.npz     # one line of JSON

FOUND holds frame, x_px, y_px (outer corner of the frame 0), photons, the reported x_sd_px and
y_sd_px (nan where a program reports none), and the number of `frames` looked at, from the first.
Found and true spots are paired one to one within 250 nm, the closest first. Errors are taken over
isolated emitters: no other within 9 px, 6 px from the frame's edge, paired and off by less than
1 px.

The bound of an emitter is the Cramer-Rao bound of x, y, photons, background and sigma from its true
values, in the 7 x 7 pixels about the one that holds it, for Poisson light with the pixel's own read
variance v: Fisher information sum(dmu dmu' / (mu + v)). `error_over_bound` is the rms, over
emitters and both axes, of error over own bound (1 where a fit is efficient), `pull` the rms of
error over reported standard deviation (1 where it is honest), `bias_*_px` the mean error with
its standard error, and `photon_bias` the median relative error of the photons with its own; the
mean, `photon_bias_mean`, is ruled by the few fits that take background for a broad spot.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

Array = NDArray[np.float64]

PIXEL_SIZE_NM = 108.3
MATCH_PX = 250.0 / PIXEL_SIZE_NM
ISOLATION_PX = 9.0
EDGE_PX = 6.0
LARGEST_ERROR_PX = 1.0
RADIUS_PX = 3
SIZE_PX = 256

_MEDIAN_OVER_MEAN = math.sqrt(math.pi / 2.0)
"""Standard error of a normal sample's median over that of its mean."""


def score(truth: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, float]:
    """Score found spots; keys as in the module's description."""
    true, hit = match(truth, found)
    kept = isolated(truth)[true]
    delta = np.array([found[axis][hit] - truth[axis][true] for axis in ("x_px", "y_px")])
    kept &= np.hypot(*delta) < LARGEST_ERROR_PX
    true, hit, delta = true[kept], hit[kept], delta[:, kept]
    n_true, n_found, n_paired = len(truth["frame"]), len(found["frame"]), kept.size
    limit = bound(truth, true)
    reported = np.array([found[name][hit] for name in ("x_sd_px", "y_sd_px")])
    photons = found["photons"][hit] / truth["photons"][true] - 1.0
    root = math.sqrt(max(len(true), 1))
    return {
        "true": n_true,
        "found": n_found,
        "recall": n_paired / max(n_true, 1),
        "precision": n_paired / max(n_found, 1),
        "isolated": len(true),
        "rmse_px": _rms(delta),
        "bound_px": _rms(limit),
        "error_over_bound": _rms(delta / limit),
        "pull": _rms(delta / reported),
        "bias_x_px": _mean(delta[0]),
        "bias_y_px": _mean(delta[1]),
        "bias_se_px": _rms(delta) / root,
        "photon_bias": float(np.median(photons)) if photons.size else math.nan,
        "photon_bias_se": _MEDIAN_OVER_MEAN * _spread(photons) / root,
        "photon_bias_mean": _mean(photons),
    }


def match(truth: Mapping[str, Any], found: Mapping[str, Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Pair found with true spots of the same frame, the closest first; give both's indices."""
    if not len(found["frame"]) or not len(truth["frame"]):
        return np.empty(0, int), np.empty(0, int)
    trees = [
        # Frames lie further apart than any pair.
        cKDTree(np.column_stack([spots["x_px"], spots["y_px"], 10.0 * MATCH_PX * spots["frame"]]))
        for spots in (truth, found)
    ]
    near = trees[0].sparse_distance_matrix(trees[1], MATCH_PX, output_type="ndarray")
    free = [np.ones(tree.n, bool) for tree in trees]
    pairs = []
    for i, j, _ in np.sort(near, order=["v", "i", "j"]).tolist():
        if free[0][i] and free[1][j]:
            free[0][i] = free[1][j] = False
            pairs.append((i, j))
    true, hit = np.array(pairs, int).reshape(-1, 2).T
    return true, hit


def isolated(truth: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Tell the emitters that nothing disturbs."""
    x, y = truth["x_px"], truth["y_px"]
    lonely = np.ones(len(x), bool)
    tree = cKDTree(np.column_stack([x, y, 10.0 * ISOLATION_PX * truth["frame"]]))
    lonely[tree.query_pairs(ISOLATION_PX, output_type="ndarray").ravel()] = False
    nearest_edge = np.minimum.reduce([x, y, SIZE_PX - x, SIZE_PX - y])
    inside: NDArray[np.bool_] = nearest_edge >= EDGE_PX
    return lonely & inside


def bound(truth: Mapping[str, Any], which: NDArray[Any]) -> Array:
    """Give the Cramer-Rao standard deviations of x and y in px, shape (2, n)."""
    x, y, photons = (np.asarray(truth[key])[which] for key in ("x_px", "y_px", "photons"))
    background, sigma = float(truth["background"]), float(truth["sigma_px"])
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    reach = np.arange(-RADIUS_PX, RADIUS_PX + 1)
    read = np.broadcast_to(np.asarray(truth["read_noise_e"]), (SIZE_PX, SIZE_PX))
    variance = read[row[:, None, None] + reach[:, None], column[:, None, None] + reach] ** 2
    gx, dx, sx = _profile(x - column, sigma)
    gy, dy, sy = _profile(y - row, sigma)

    def plane(along_y: Array, along_x: Array) -> Array:
        return photons[:, None, None] * along_y[:, :, None] * along_x[:, None, :]

    light = plane(gy, gx)
    gradient = np.stack(
        [
            plane(gy, dx),
            plane(dy, gx),
            light / photons[:, None, None],
            np.ones_like(light),
            plane(gy, sx) + plane(sy, gx),
        ]
    )
    weight = 1.0 / (background + light + variance)
    information = np.einsum("anij,bnij,nij->nab", gradient, gradient, weight)
    covariance = np.linalg.inv(information)
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, :2].T)


def _profile(place: Array, sigma: float) -> tuple[Array, Array, Array]:
    """Share of each pixel along one axis, and its derivatives by place and by sigma, (n, 7)."""
    t = (np.arange(-RADIUS_PX, RADIUS_PX + 2) - place[:, None]) / sigma
    density = np.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi)
    return (
        np.diff(ndtr(t), axis=1),
        -np.diff(density, axis=1) / sigma,
        -np.diff(t * density, axis=1) / sigma,
    )


def first_frames(truth: Mapping[str, Any], frames: int) -> dict[str, Any]:
    """Leave the emitters of later frames out."""
    kept = truth["frame"] < frames
    rows = ("frame", "x_px", "y_px", "photons")
    return {**truth, **{name: truth[name][kept] for name in rows}}


def score_files(truth: Path, found: Path) -> dict[str, float]:
    """Score a file of found spots, which says how many frames were looked at."""
    with np.load(truth) as known, np.load(found) as spots:
        return score(first_frames(known, int(spots["frames"])), dict(spots))


def _mean(values: Array) -> float:
    return float(np.mean(values)) if values.size else math.nan


def _spread(values: Array) -> float:
    """Give half the width that holds 68.3 %: the standard deviation of a normal sample."""
    if not values.size:
        return math.nan
    return 0.5 * float(np.diff(np.quantile(values, [0.1587, 0.8413]))[0])


def _rms(values: Array) -> float:
    return math.sqrt(_mean(values**2))


if __name__ == "__main__":
    scores = score_files(Path(sys.argv[1]), Path(sys.argv[2]))
    print(json.dumps({key: None if math.isnan(v) else v for key, v in scores.items()}))
