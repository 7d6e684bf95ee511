"""Overlapping spots: pairs that were found as one, and neighbours within one window.

A window is looked at again when its single fit's deviance is too large or when another candidate is
near. Each candidate is fitted in a window of its own, a little larger than the single fit's, its
neighbours and what else the window holds beside it. Of these emitters it reports those that lie
nearer to it than to any other candidate, so none is reported twice and no candidate depends on the
order or the number of the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.flags import FIT_FAILED, FitFlag
from rotortrack.kernels import kernel
from rotortrack.localise.emitters import MOST_EMITTERS, WIDTH, model, padded
from rotortrack.localise.fit import RESULT_COLUMNS
from rotortrack.localise.likelihood import SMALLEST_EXPECTATION
from rotortrack.localise.misfit import deviance_moments, misfit_score, pixel_moments
from rotortrack.localise.neighbours import MOST_NEIGHBOURS, drop_repeated, list_neighbours
from rotortrack.localise.overlap import SUSPICIOUS_MISFIT, disentangle
from rotortrack.localise.windows import LANES, CameraArrays, cut_windows

NEIGHBOURS_BEYOND_PX: Final = 3.5
"""Candidates this far beyond the window's reach still lend it light."""

SMALLEST_OWN_SIGNIFICANCE: Final = 3.0
"""A candidate whose light its neighbours explain, up to this many deviations, is their flank."""

_FAILED = int(FIT_FAILED)
_UNUSABLE = int(FitFlag.NOT_FINITE | FitFlag.SATURATED)
_ASTRAY = int(FitFlag.LEFT_WINDOW | FitFlag.SINGULAR)
_FEWER_PIXELS = int(FitFlag.CLIPPED | FitFlag.MASKED_PIXELS | FitFlag.ITERATION_LIMIT)
_LEFT_WINDOW = int(FitFlag.LEFT_WINDOW)
_AT_BOUND = int(FitFlag.AT_BOUND)
_JOINT = int(FitFlag.JOINT)


@dataclass(frozen=True)
class Joint:
    """Rows of a block after its overlaps were resolved.

    Attributes
    ----------
    owners
        (m,) the candidate to whose window's centre a row's position is relative; ascending.
    results, flags
        (10, m) RESULT_COLUMNS and (m,) bits of FitFlag. Rows of joint fits carry JOINT; a row that
        repeats another or whose light belongs to its neighbours carries LEFT_WINDOW.
    tried, resolved
        Windows looked at again, and those whose rows come from a joint fit.
    """

    owners: NDArray[np.intp]
    results: NDArray[np.float64]
    flags: NDArray[np.int32]
    tried: int
    resolved: int


def resolve(
    counts: NDArray[Any],
    camera: CameraArrays,
    candidates: NDArray[np.int32],
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
    radius: int,
    *,
    max_emitters: int,
    sigma_px: float,
    free_sigma: bool,
) -> Joint:
    """Fit overlapping spots together, by the likelihood, whatever fitted them singly.

    Parameters
    ----------
    counts
        (frame, height, width) raw counts, uint16 or float32.
    camera
        Of `windows.camera_arrays`.
    candidates
        (n, 3) frame, row, column; sorted.
    results, flags
        (10, n) RESULT_COLUMNS, positions relative to the middle of the candidate's window, and
        (n,) bits of FitFlag of the single fits.
    radius
        The single fits' windows are 2 * radius + 1 pixels wide.
    max_emitters
        2 or 3: the most emitters of one fit, neighbours included.
    sigma_px
        Width of a spot; a free one stays within `overlap.SIGMA_RANGE` of it, shared by the
        emitters of a fit.
    free_sigma
        Whether the width is fitted.

    Returns
    -------
    Joint
        The same rows, those of joint fits replaced, new emitters added behind their owner's.
    """
    n = len(candidates)
    # Each layout would compile the kernels anew.
    results = np.ascontiguousarray(results)
    moments = deviance_moments()
    near = np.full((n, MOST_NEIGHBOURS), -1, np.int32)
    reach = radius + NEIGHBOURS_BEYOND_PX
    # An emitter between two windows may be nearer to a candidate twice as far.
    list_neighbours(candidates, int(2 * reach), near)
    suspected = np.zeros(n, np.bool_)
    _suspect(
        results,
        flags,
        camera.variance_e2,
        candidates,
        (2 * radius + 1) ** 2 - (5 if free_sigma else 4),
        moments,
        suspected,
    )
    to_nearest = np.hypot(*(candidates[near[:, 0], 1:] - candidates[:, 1:]).T)
    has_neighbours = (near[:, 0] >= 0) & (to_nearest <= reach) & (flags & _UNUSABLE == 0)
    emitters = np.zeros((n, MOST_EMITTERS, len(RESULT_COLUMNS)))
    found = np.zeros(n, np.int32)
    ends = np.zeros(n, np.int32)
    tried = 0
    # Neighbours need the room, the others do not, and every pixel costs.
    for which, extra in ((suspected & ~has_neighbours, 1), (has_neighbours, 2)):
        members = np.flatnonzero(which)
        if not len(members):
            continue
        windows = cut_windows(counts, camera, candidates[members], radius + extra)
        _resolve(
            windows.photons,
            windows.variance,
            members,
            near,
            candidates,
            results,
            flags,
            radius,
            max_emitters,
            sigma_px,
            free_sigma,
            moments,
            emitters,
            found,
            ends,
        )
        tried += len(members)
    owners = np.repeat(np.arange(n), np.maximum(found, 1))
    place = np.arange(len(owners)) - np.searchsorted(owners, owners)
    is_joint = found[owners] > 0
    rows = results[:, owners]
    rows[:, is_joint] = emitters[owners[is_joint], place[is_joint]].T
    row_flags = flags[owners]
    row_flags[ends[owners] != 0] &= ~(_FAILED | _AT_BOUND)
    row_flags |= ends[owners]
    drop_repeated(owners, candidates, near, rows, row_flags)
    return Joint(owners, rows, row_flags, tried, int(np.count_nonzero(found)))


@kernel
def _suspect(
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
    variance: NDArray[np.float32],
    candidates: NDArray[np.int32],
    freedom: int,
    moments: NDArray[np.float64],
    suspected: NDArray[np.bool_],
) -> None:
    """Mark the fits whose deviance is too large for a window that is mostly background."""
    has_variances = variance.size > 1
    for k in range(results.shape[1]):
        if flags[k] & (_UNUSABLE | _ASTRAY):
            continue
        if flags[k] & _FEWER_PIXELS:
            suspected[k] = True
            continue
        noise = variance[candidates[k, 1], candidates[k, 2]] if has_variances else variance[0, 0]
        expected = results[3, k] + noise
        mean, spread = pixel_moments(expected, noise, moments)
        score = misfit_score(results[9, k], freedom * mean, freedom * spread)
        suspected[k] = score > SUSPICIOUS_MISFIT


@kernel
def _resolve(
    photons: NDArray[np.float32],
    noise: NDArray[np.float32],
    members: NDArray[np.intp],
    near: NDArray[np.int32],
    candidates: NDArray[np.int32],
    results: NDArray[np.float64],
    flags: NDArray[np.int32],
    radius: int,
    most: int,
    sigma_px: float,
    free_sigma: bool,
    moments: NDArray[np.float64],
    emitters: NDArray[np.float64],
    found: NDArray[np.int32],
    ends: NDArray[np.int32],
) -> None:
    """Fit the windows of some candidates and fill their emitters, numbers of them, and flags."""
    pixels = photons.shape[1]
    n = int(math.sqrt(pixels) + 0.5)
    data = np.zeros(padded(n))
    variance = np.full(padded(n), np.inf)
    starts = np.empty((most, 3))
    parameters = np.empty(WIDTH)
    covariance = np.empty((WIDTH, WIDTH))
    for w in range(members.shape[0]):
        k = members[w]
        for pixel in range(pixels):
            data[pixel] = photons[w // LANES, pixel, w % LANES]
            variance[pixel] = noise[w // LANES, pixel, w % LANES]
        background = 1.0
        sigma = sigma_px
        light = 100.0
        starts[0, 0] = 0.0
        starts[0, 1] = 0.0
        if not flags[k] & _FAILED:
            starts[0, 0] = results[0, k]
            starts[0, 1] = results[1, k]
            light = results[2, k]
            background = max(results[3, k], 0.01)
            sigma = min(max(results[4, k], 0.7 * sigma_px), 1.4 * sigma_px)
        starts[0, 2] = light
        known = 1
        for other in near[k]:
            if other < 0 or known == most:
                break
            columns = candidates[other, 2] - candidates[k, 2]
            rows = candidates[other, 1] - candidates[k, 1]
            if rows * rows + columns * columns > (radius + NEIGHBOURS_BEYOND_PX) ** 2:
                break
            starts[known, 0] = columns
            starts[known, 1] = rows
            starts[known, 2] = light
            if not flags[other] & _FAILED:
                starts[known, 2] = results[2, other]
            known += 1
        count = disentangle(
            data,
            variance,
            n,
            starts,
            background,
            sigma,
            known,
            most,
            radius,
            sigma_px,
            free_sigma,
            moments,
            parameters,
            covariance,
        )
        if count > 1:
            found[k] = _report(
                k, near[k], candidates, 0.5 * n, count, parameters, covariance, emitters[k]
            )
            if found[k] == 0:
                ends[k] = _LEFT_WINDOW
                continue
            ends[k] = _JOINT | (_AT_BOUND if parameters[3 * count] == 0.0 else 0)
            _judge(data, variance, n, radius, count, parameters, emitters[k])


@kernel
def _report(
    k: int,
    near: NDArray[np.int32],
    candidates: NDArray[np.int32],
    reach: float,
    count: int,
    parameters: NDArray[np.float64],
    covariance: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> int:
    """Fill the rows of the emitters that are nearest to candidate k, the closest one first."""
    reported = 0
    distances = np.empty(count)
    for e in range(count):
        x = parameters[3 * e]
        y = parameters[3 * e + 1]
        photons = parameters[3 * e + 2]
        photons_sd = math.sqrt(covariance[3 * e + 2, 3 * e + 2])
        if photons < SMALLEST_OWN_SIGNIFICANCE * photons_sd or max(abs(x), abs(y)) > reach:
            continue
        distance = x * x + y * y
        is_own = True
        for other in near:
            if other < 0:
                break
            dx = x - (candidates[other, 2] - candidates[k, 2])
            dy = y - (candidates[other, 1] - candidates[k, 1])
            away = dx * dx + dy * dy
            if away < distance or (away == distance and other < k):
                is_own = False
        if not is_own:
            continue
        place = reported
        while place > 0 and distance < distances[place - 1]:
            distances[place] = distances[place - 1]
            for a in range(7):
                rows[place, a] = rows[place - 1, a]
            place -= 1
        distances[place] = distance
        rows[place, 0] = x
        rows[place, 1] = y
        rows[place, 2] = photons
        rows[place, 3] = parameters[3 * count]
        rows[place, 4] = parameters[3 * count + 1]
        rows[place, 5] = math.sqrt(covariance[3 * e, 3 * e])
        rows[place, 6] = math.sqrt(covariance[3 * e + 1, 3 * e + 1])
        reported += 1
    return reported


@kernel
def _judge(
    data: NDArray[np.float64],
    variance: NDArray[np.float64],
    n: int,
    radius: int,
    count: int,
    parameters: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> None:
    """Fill the residuals' standard deviation, Pearson's chi-square and the deviance.

    They are those of the single fit's window, so that they compare with other spots'.
    """
    border = n // 2 - radius
    expected = np.zeros(data.shape[0])
    slopes = np.empty((WIDTH, data.shape[0]))
    model(parameters, count, n, variance, expected, slopes)
    pixels = 0
    first = 0.0
    second = 0.0
    pearson = 0.0
    deviance = 0.0
    for i in range(border, n - border):
        for j in range(border, n - border):
            pixel = i * n + j
            if variance[pixel] < np.inf:
                mean = max(expected[pixel], SMALLEST_EXPECTATION)
                observed = max(data[pixel] + variance[pixel], 0.0)
                residual = data[pixel] + variance[pixel] - expected[pixel]
                pixels += 1
                first += residual
                second += residual * residual
                pearson += residual * residual / mean
                deviance += mean - observed
                if observed > 0.0:
                    deviance += observed * math.log(observed / mean)
    mean = first / max(pixels, 1)
    for e in range(rows.shape[0]):
        rows[e, 7] = math.sqrt(max(second / max(pixels, 1) - mean * mean, 0.0))
        rows[e, 8] = pearson
        rows[e, 9] = 2.0 * deviance
