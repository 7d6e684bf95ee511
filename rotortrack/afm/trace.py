"""From an image of an atomic force microscope to rods, their lengths and their stiffness.

Levelling, ridge filter, skeleton, centre lines, verdicts, stiffness, calibration: in this order.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.afm.calibration import Scale, commonest_length, scale_of
from rotortrack.afm.centre_line import FWHM_PER_SIGMA, Sampler
from rotortrack.afm.level import level_lines
from rotortrack.afm.options import ContourOptions
from rotortrack.afm.persistence import Persistence, estimate_persistence, turns_of
from rotortrack.afm.ridges import Ridges, centre_noise, find_ridges, measured_sigma_px
from rotortrack.afm.rod import LOST_LENGTH, NOISE_LENGTH, Rod, judge, kinked, measure, spaced_nm
from rotortrack.afm.skeleton import pieces_of
from rotortrack.afm.tables import CONTOURS
from rotortrack.afm.verdicts import KEPT, REFUSED, Reason
from rotortrack.errors import ContourWarning
from rotortrack.tables import conform

Floats = NDArray[np.float64]

_FIRST_SIGMA_PX, _FIRST_SIGMA_NM = 1.5, 8.0
_SMOOTHINGS = (1.0, 1.4, 2.0, 2.8, 4.0)
_TOLERATED_SLOPE = 0.1
"""Noise of a centre line over the length of its smoothing that is low enough: 0.2 % of length."""

_LEAST_SIGMA_PX = 0.85
"""Below it, pixels are too coarse to see where in them a rod runs."""


@dataclass(frozen=True)
class Traced:
    """What was found in an image; all lengths along the surface are calibrated ones.

    Attributes
    ----------
    rods
        Table `CONTOURS`.
    lines_nm
        Lines (n, 2) to draw, one list a rod.
    level_nm
        The levelled image (nm).
    pixel_size_nm
        Size of a pixel, calibrated.
    noise_nm, width_nm
        Noise of a pixel's height, and the usual width of a rod at half height.
    smooth_nm
        Length over which centre lines were smoothed.
    scale
        Calibration, None where no contour length is known or no rod is left.
    persistence
        None where there is no rod to tell it.
    refused
        How many were refused for which reason.
    """

    rods: pd.DataFrame
    lines_nm: list[list[Floats]]
    level_nm: Floats
    pixel_size_nm: float
    noise_nm: float
    width_nm: float
    smooth_nm: float
    scale: Scale | None
    persistence: Persistence | None
    refused: dict[str, int]


def trace_rods(
    height_nm: Floats, pixel_size_nm: float, options: ContourOptions | None = None
) -> Traced:
    """Trace the rods in an image and measure them.

    A rod's contour length is that of its smoothed centre line between the ends of its spine, plus
    its diameter, plus what smoothing took from a chain of the persistence length found.

    Parameters
    ----------
    height_nm
        Heights (y, x), at least 16 by 16.
    pixel_size_nm
        Size of a pixel (nm).
    options
        See `ContourOptions`.

    Warns
    -----
    ContourWarning
        The pixels are too coarse; the scale differs from 1; only a lower limit of the persistence
        length is found.
    """
    options = options or ContourOptions()
    turned = options.scan_axis == "y"
    image = np.asarray(height_nm, np.float64)
    level, noise_nm, sigma_px, ridges = _find(image.T if turned else image, pixel_size_nm, options)
    if turned:
        level = level.T
        ridges = Ridges(ridges.mask.T, ridges.skeleton.T, ridges.response.T)
    rods, smooth_px = _measure(level, ridges, sigma_px, pixel_size_nm, options)
    width_px = float(np.median([r.width_px for r in rods if r.reason is None] or [np.nan]))
    width_px = width_px if math.isfinite(width_px) else FWHM_PER_SIGMA * sigma_px
    judge(
        rods,
        min_length_px=_least_length_nm(options, width_px * pixel_size_nm) / pixel_size_nm,
        max_height_ratio=options.max_height_ratio,
        max_width_ratio=options.max_width_ratio,
    )
    segment_nm = options.segment_nm or 2.0 * width_px * pixel_size_nm
    left = [rod for rod in rods if rod.reason is None]
    kinked(
        left, [turns_of(spaced_nm(r, pixel_size_nm), segment_nm) for r in left], options.max_kink_sd
    )
    bent = _stiffness(rods, pixel_size_nm, segment_nm, smooth_px, options)
    stretched = _unbiased(rods, bent, smooth_px, pixel_size_nm)
    scale = _calibrate(rods, pixel_size_nm * stretched, options)
    factor = scale.factor if scale else 1.0
    size_nm = factor * pixel_size_nm
    persistence = _stiffness(rods, size_nm, factor * segment_nm, smooth_px, options)
    _warn(scale, persistence, sigma_px)
    return Traced(
        _table(rods, stretched, size_nm, options.rod_diameter_nm),
        [_lines(rod, size_nm, options.rod_diameter_nm) for rod in rods],
        level,
        size_nm,
        noise_nm,
        size_nm * width_px,
        size_nm * smooth_px,
        scale,
        persistence,
        {why.value: count for why in Reason if (count := sum(rod.reason is why for rod in rods))},
    )


def _find(
    image: Floats, pixel_size_nm: float, options: ContourOptions
) -> tuple[Floats, float, float, Ridges]:
    """Level the image and find its ridges; the width of a rod is measured where it is not given."""
    given = options.width_nm
    if given is not None:
        sigma_px = given / FWHM_PER_SIGMA / pixel_size_nm
    else:
        sigma_px = max(_FIRST_SIGMA_PX, _FIRST_SIGMA_NM / pixel_size_nm)
    grown = math.ceil(2.0 * sigma_px)
    level, noise_nm = level_lines(image, order=options.line_order, grown_px=grown)
    ridges = find_ridges(level, sigma_px, options.threshold)
    for _ in range(2 if given is None else 0):
        sigma_px = measured_sigma_px(level, ridges, sigma_px)
        ridges = find_ridges(level, max(sigma_px, 1.0), options.threshold)
    return level, noise_nm, sigma_px, ridges


def _measure(
    level: Floats, ridges: Ridges, sigma_px: float, pixel_size_nm: float, options: ContourOptions
) -> tuple[list[Rod], float]:
    """Follow all pieces, smoothed over a width or, in a noisy image, over as much as it needs."""
    pieces = pieces_of(
        ridges.mask, ridges.skeleton, max_branch_px=options.max_branch_nm / pixel_size_nm
    )
    grown = math.ceil(2.0 * sigma_px)
    crest = level[ridges.skeleton]
    height = max(float(np.median(crest)), 1e-12) if crest.size else 1.0
    if options.smooth_nm is not None:
        smooth_px = options.smooth_nm / pixel_size_nm
    else:
        for factor in _SMOOTHINGS:
            smooth_px = factor * max(sigma_px, 1.0)
            noise = centre_noise(level, ridges, sigma_px, smooth_px, grown) / height
            if noise < _TOLERATED_SLOPE * smooth_px:
                break
    noise = centre_noise(level, ridges, sigma_px, smooth_px, grown)
    sampler = Sampler(level)
    shape = (level.shape[0], level.shape[1])
    rods = [measure(piece, sampler, sigma_px, smooth_px, shape) for piece in pieces]
    for rod in rods:
        if rod.line:
            rod.noise_px = noise / max(rod.height, 0.2 * height)
    return rods, smooth_px


def _least_length_nm(options: ContourOptions, width_nm: float) -> float:
    if options.min_length_nm is not None:
        return options.min_length_nm
    known = options.contour_length_nm
    return 0.5 * known if known is not None else 5.0 * width_nm


def _stiffness(
    rods: list[Rod],
    pixel_size_nm: float,
    segment_nm: float,
    smooth_px: float,
    options: ContourOptions,
) -> Persistence | None:
    left = [rod for rod in rods if rod.reason is None]
    return estimate_persistence(
        [spaced_nm(rod, pixel_size_nm) for rod in left],
        segment_nm=segment_nm,
        smooth_nm=pixel_size_nm * smooth_px,
        noise_nm=[pixel_size_nm * rod.noise_px for rod in left],
        resamples=options.resamples,
        seed=options.seed,
    )


def _unbiased(
    rods: list[Rod], persistence: Persistence | None, smooth_px: float, pixel_size_nm: float
) -> Floats:
    """Give the lengths of all spines (pixels) without what noise adds and smoothing takes."""
    lost = 0.0
    if persistence is not None and math.isfinite(persistence.persistence_nm):
        lost = LOST_LENGTH * smooth_px * pixel_size_nm / persistence.persistence_nm
    lengths = np.array([rod.spine_px for rod in rods])
    noise = np.array([rod.noise_px for rod in rods])
    return np.asarray(lengths * (1.0 + lost) * (1.0 - NOISE_LENGTH * (noise / smooth_px) ** 2))


def _calibrate(rods: list[Rod], spines_nm: Floats, options: ContourOptions) -> Scale | None:
    """Refuse broken rods and rods in a row, and compare the others with the known length."""
    if options.contour_length_nm is None:
        return None
    known = options.contour_length_nm - options.rod_diameter_nm
    left = np.array([rod.reason is None for rod in rods], bool)
    if not left.any():
        return None
    usual = commonest_length(spines_nm[left], known)
    for rod, length in zip(rods, spines_nm, strict=True):
        if rod.reason is None and abs(length / usual - 1.0) > options.max_length_error:
            rod.reason = Reason.OTHER_LENGTH
    left = np.array([rod.reason is None for rod in rods], bool)
    return scale_of(spines_nm[left], known) if left.any() else None


def _table(rods: list[Rod], spines_px: Floats, size_nm: float, diameter_nm: float) -> pd.DataFrame:
    rows = []
    for number, (rod, spine_px) in enumerate(zip(rods, spines_px, strict=True)):
        x, y = size_nm * rod.middle_px
        apart = math.nan
        if rod.line:
            ends = rod.whole_px(diameter_nm / size_nm / 2.0)[[0, -1]]
            apart = size_nm * float(np.hypot(*(ends[1] - ends[0])))
        rows.append(
            {
                "rod": number,
                "x_nm": x,
                "y_nm": y,
                "contour_nm": size_nm * spine_px + diameter_nm,
                "end_to_end_nm": apart,
                "height_nm": rod.height,
                "width_nm": size_nm * rod.width_px,
                "branches": sum(length > rod.width_px for length in rod.piece.pruned_px),
                "verdict": REFUSED if rod.reason else KEPT,
                "reason": rod.reason.value if rod.reason else "",
            }
        )
    return conform(pd.DataFrame(rows, columns=CONTOURS.names), CONTOURS, "rods")


def _lines(rod: Rod, size_nm: float, diameter_nm: float) -> list[Floats]:
    """Give what is drawn of a rod: its centre line, or else its skeleton."""
    if rod.line:
        return [size_nm * rod.whole_px(diameter_nm / size_nm / 2.0)]
    return [size_nm * line for line in rod.piece.lines]


def _warn(scale: Scale | None, persistence: Persistence | None, sigma_px: float) -> None:
    if sigma_px < _LEAST_SIGMA_PX:
        warnings.warn(
            f"a rod is only {FWHM_PER_SIGMA * sigma_px:.2g} pixels wide, so that its place within "
            "them is not seen and lengths are biased: scan a smaller field, or with more pixels",
            ContourWarning,
            stacklevel=3,
        )
    if scale and scale.differs:
        warnings.warn(
            f"by {scale.rods} rods of known length, lengths of this image must be multiplied by "
            f"{scale.factor:.4f} +- {scale.sd:.2g}, as was done: check the microscope's "
            "calibration and pixel_size_nm, contour_length_nm and rod_diameter_nm",
            ContourWarning,
            stacklevel=3,
        )
    if persistence and persistence.is_limit:
        warnings.warn(
            "these rods bend too little to tell their persistence length, which is above "
            f"{persistence.ci_low_nm:.3g} nm (97.5 %): use more rods, or longer ones",
            ContourWarning,
            stacklevel=3,
        )
