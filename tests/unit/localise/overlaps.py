"""Frames of overlapping spots made without the fitter's arithmetic, and their single fits."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from rotortrack.cameras.camera import Camera
from rotortrack.localise.emitters import WIDTH, fit_emitters, padded
from rotortrack.localise.fit import RESULT_COLUMNS
from rotortrack.localise.joint import resolve
from rotortrack.localise.windows import LANES, camera_arrays, cut_windows

READ_NOISE_E = 1.6
BACKGROUND = 8.0
SIGMA_PX = 1.25
SIZE = 21
MIDDLE = SIZE // 2
RADIUS = 3


def expected_frames(x, y, photons, background=BACKGROUND, sigma=SIGMA_PX, size=SIZE):
    """(n, size, size) expected photons of (n, k) emitters; positions from the middle pixel."""
    edges = np.arange(size + 1) - size / 2
    gx = np.diff(ndtr((edges - np.asarray(x)[..., None]) / sigma), axis=-1)
    gy = np.diff(ndtr((edges - np.asarray(y)[..., None]) / sigma), axis=-1)
    return background + np.einsum("nk,nki,nkj->nij", photons, gy, gx)


def noisy(rng, expected, read_noise_e=READ_NOISE_E):
    return (rng.poisson(expected) + rng.normal(0, 1, expected.shape) * read_noise_e).astype(
        np.float32
    )


def some_pairs(rng, n, separation_px, photons):
    """(n, 2) x, y of pairs in all directions about the middle, and their (n, 2) photons."""
    angle = rng.uniform(0, 2 * np.pi, n)
    along = 0.5 * separation_px * np.array([np.cos(angle), np.sin(angle)])
    centre = rng.uniform(-0.5, 0.5, (2, n))
    x, y = np.stack([centre + along, centre - along], axis=2)
    return x, y, np.broadcast_to(np.asarray(photons, float), (n, 2))


def brightest(frames, reach=2):
    """(n, 3) candidates: the pixel near the middle with the brightest 3 x 3 neighbourhood."""
    near = slice(MIDDLE - reach - 1, MIDDLE + reach + 2)
    view = np.lib.stride_tricks.sliding_window_view(frames[:, near, near], (3, 3), axis=(1, 2))
    row, column = np.divmod(view.sum(axis=(3, 4)).reshape(len(frames), -1).argmax(1), 2 * reach + 1)
    return np.stack(
        [np.arange(len(frames)), row + MIDDLE - reach, column + MIDDLE - reach], axis=1
    ).astype(np.int32)


def camera(read_noise_e=READ_NOISE_E):
    return camera_arrays(Camera(0.0, 1.0, read_noise_e), np.dtype(np.float32))


def single_fits(frames, arrays, candidates, radius=RADIUS):
    """Results (10, n) and flags (n,) of one emitter a window."""
    n = 2 * radius + 1
    windows = cut_windows(frames, arrays, candidates, radius)
    results = np.full((len(RESULT_COLUMNS), len(candidates)), np.nan)
    flags = windows.flags.copy()
    lower = np.array([-n / 2, -n / 2, 1e-3, 0.0, 0.3] + [0.0] * (WIDTH - 5))
    upper = np.array([n / 2, n / 2, np.inf, np.inf, 5.0] + [0.0] * (WIDTH - 5))
    data, variance = np.zeros(padded(n)), np.full(padded(n), np.inf)
    covariance = np.empty((WIDTH, WIDTH))
    for k in range(len(candidates)):
        data[: n * n] = windows.photons[k // LANES, :, k % LANES]
        variance[: n * n] = windows.variance[k // LANES, :, k % LANES]
        start = np.zeros(WIDTH)
        lowest, highest = data[: n * n].min(), data[: n * n].max()
        start[2:5] = max(highest - lowest, 1.0) * 10.0, max(lowest, 0.1), 1.3
        end, deviance = fit_emitters(data, variance, n, 1, 5, lower, upper, start, covariance)
        flags[k] |= end
        results[:5, k] = start[:5]
        if end == 0:
            results[5:7, k] = np.sqrt(np.diag(covariance)[:2])
        results[9, k] = deviance
    return results, flags


def resolved(frames, candidates, *, arrays=None, radius=RADIUS, most=3, sigma=1.6, free=True):
    """Single fits, then the joint ones."""
    arrays = camera() if arrays is None else arrays
    results, flags = single_fits(frames, arrays, candidates, radius)
    joint = resolve(
        frames,
        arrays,
        candidates,
        results,
        flags,
        radius,
        max_emitters=most,
        sigma_px=sigma,
        free_sigma=free,
    )
    return results, flags, joint


def positions(joint, candidates):
    """(m, 2) x, y from the middle pixel of the frame."""
    return np.stack(
        [
            joint.results[0] + candidates[joint.owners, 2] - MIDDLE,
            joint.results[1] + candidates[joint.owners, 1] - MIDDLE,
        ],
        axis=1,
    )


def pair_errors(joint, candidates, x, y):
    """(pairs, 2 emitters, 2 axes) errors and reported deviations of frames with two good rows."""
    good = joint.flags & 15 == 0
    place = positions(joint, candidates)[good]
    sd = joint.results[5:7].T[good]
    frame = candidates[joint.owners, 0][good]
    errors, deviations = [], []
    for k in np.flatnonzero(np.bincount(frame, minlength=len(x)) == 2):
        truth = np.stack([x[k], y[k]], axis=1)
        rows = np.flatnonzero(frame == k)
        if ((place[rows] - truth) ** 2).sum() > ((place[rows[::-1]] - truth) ** 2).sum():
            rows = rows[::-1]
        errors.append(place[rows] - truth)
        deviations.append(sd[rows])
    return np.array(errors), np.array(deviations)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))
