"""A camera from a dark film and films of steady light: offset, read noise and gain of each pixel.

The dark film's mean is the offset and its variance the read noise; the gain is how the variance
grows with the light (:mod:`rotortrack.cameras.pixel_gains`).
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.cameras import film_checks
from rotortrack.cameras.camera import Camera
from rotortrack.cameras.film_statistics import FilmStatistics, Floats
from rotortrack.cameras.hot_pixels import hot_pixels_of
from rotortrack.cameras.photon_transfer import GainEstimate, warn_if_contradicted
from rotortrack.cameras.pixel_gains import Level, Mask, PixelGains, mean_slope, pixel_gains
from rotortrack.errors import CalibrationWarning, CameraError, ConfigurationError

_LEAST_RESPONSE = 0.1
_UNEVEN = 1.02
_SATURATED_SHARE = 0.5
_NON_LINEAR = 0.1
_BELIEVED = 0.5
_SOUGHT_SPREAD = 0.01


@dataclass(frozen=True)
class LevelReport:
    """One flat of the calibration.

    Attributes
    ----------
    name
        As it was given.
    frames, skipped_frames
        Frames used, and those without a picture or copied.
    signal_adu
        Median over pixels of the mean above the dark film.
    gain_e_per_adu
        By this flat alone, all pixels together.
    flicker
        Standard deviation of the light from frame to frame, relative.
    saturated_pixels
        Pixels left out because they reached the limit.
    reason
        Why the flat was left out; None where it was used.
    """

    name: str
    frames: int
    skipped_frames: int
    signal_adu: float
    gain_e_per_adu: float
    flicker: float
    saturated_pixels: int
    reason: str | None


@dataclass(frozen=True)
class Calibration:
    """What was found of a camera; maps are (y, x).

    Attributes
    ----------
    offset_adu, gain_e_per_adu, gain_sd_e_per_adu, read_noise_e
        ADU, electrons per ADU with its standard error (0 where the gain was given), electrons
        rms. Dead pixels have the sensor's medians.
    hot_pixels, dead_pixels
        Pixels too noisy to be searched for spots, and those that tell nothing of the light.
    saturation_adu
        Largest count of the converter, where it shows or was given.
    dark_frames
        Frames of the dark film that were used.
    levels
        The flats, in the order given.
    gains
        How the gains came about; None without flats.
    """

    offset_adu: Floats
    gain_e_per_adu: Floats
    gain_sd_e_per_adu: Floats
    read_noise_e: Floats
    hot_pixels: Mask
    dead_pixels: Mask
    saturation_adu: float | None
    dark_frames: int
    levels: tuple[LevelReport, ...]
    gains: PixelGains | None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give what a file of camera maps holds; float32 keeps 1e-7 of each value."""
        names = ("offset_adu", "gain_e_per_adu", "gain_sd_e_per_adu", "read_noise_e")
        arrays: dict[str, NDArray[Any]] = {
            name: getattr(self, name).astype(np.float32) for name in names
        }
        arrays |= {"hot_pixels": self.hot_pixels, "dead_pixels": self.dead_pixels}
        if self.saturation_adu is not None:
            arrays["saturation_adu"] = np.array(self.saturation_adu)
        return arrays

    def camera(self) -> Camera:
        """Give the camera that these maps describe."""
        return Camera(
            self.offset_adu,
            self.gain_e_per_adu,
            self.read_noise_e,
            self.saturation_adu,
            self.hot_pixels,
            self.dead_pixels,
        )


def calibrate(
    dark: FilmStatistics,
    flats: Sequence[tuple[str, FilmStatistics]] = (),
    *,
    gain_e_per_adu: float | None = None,
    saturation_adu: float | None = None,
) -> Calibration:
    """Calibrate a camera.

    Parameters
    ----------
    dark
        Film without light.
    flats
        Name and statistics of each film of steady light, taken with the offset `dark.mean`; one
        suffices, several brightnesses are better.
    gain_e_per_adu
        The gain of all pixels, needed without flats and else held against theirs.
    saturation_adu
        Largest count; by default that of the number type, or of a converter of fewer bits whose
        last count was reached.

    Raises
    ------
    CameraError
        Too few frames, sizes that differ, flats not brighter than the dark film, or no flat from
        which a gain can be told.
    ConfigurationError
        Neither flats nor a gain.

    Warns
    -----
    CalibrationWarning
        Films that are doubtful, flats left out, or gains known worse than pixels differ.
    GainWarning
        The given gain contradicts the flats.

    Notes
    -----
    A pixel is dead when it has no number, when it answers light with less than a tenth of its
    surroundings' counts, or when its count never changes: in no film, or without flats in the dark
    one where most pixels' noise is above half a count. Hot pixels: see
    :func:`rotortrack.cameras.hot_pixels.hot_pixels_of`. The read noise holds the rounding to whole
    counts, as the counts of a movie do.
    """
    check_gain(len(flats), gain_e_per_adu)
    film_checks.check_dark(dark)
    for name, film in flats:
        film_checks.check_size(name, film, dark)
    limit = film_checks.saturation(dark, [film for _, film in flats], saturation_adu)
    dead = ~np.isfinite(dark.mean) | (dark.mean > (limit + float(np.nanmedian(dark.mean))) / 2)
    typical2 = film_checks.typical(dark.variance, ~dead)
    if flats:
        answering = _answers([film for _, film in flats], dark, limit)
        dead |= ~answering
    elif typical2 > 0.25:
        dead |= dark.constant
    if dead.all():
        raise CameraError("no pixel varies as a camera's pixels do: give films from the camera")
    # A pixel that never left its count has a noise below rounding, not none.
    variance = np.where(dark.constant & ~dead, typical2, dark.variance)
    dark = dataclasses.replace(dark, variance=variance.astype(np.float32))
    among = ~dead & ~hot_pixels_of(np.sqrt(dark.variance))
    reports: tuple[LevelReport, ...] = ()
    gains = None
    shape = dark.mean.shape
    gain, gain_sd = np.full(shape, gain_e_per_adu or math.nan), np.zeros(shape)
    if flats:
        gains, reports = _gains(flats, dark, among, limit)
        gain, gain_sd = gains.gain_e_per_adu, gains.sd
        if gain_e_per_adu is not None:
            frames = sum(report.frames for report in reports if report.reason is None)
            measured = GainEstimate(gains.mean_e_per_adu, gains.mean_sd, frames // 2)
            warn_if_contradicted(measured, gain_e_per_adu)
    film_checks.warn_of_light(dark, among, 1 / float(np.median(gain)))
    read_noise = np.sqrt(dark.variance.astype(np.float64)) * gain
    hot = hot_pixels_of(np.where(dead, np.nan, read_noise)) & ~dead
    film_checks.warn_of_noise(read_noise[~dead], hot[~dead])
    offset = dark.mean.astype(np.float64)
    for values in (offset, gain, gain_sd, read_noise):
        values[dead] = np.median(values[~dead])
    known = limit if saturation_adu is not None or limit < film_checks.most(dark) else None
    return Calibration(
        offset_adu=offset,
        gain_e_per_adu=gain,
        gain_sd_e_per_adu=gain_sd,
        read_noise_e=read_noise,
        hot_pixels=hot,
        dead_pixels=dead,
        saturation_adu=known,
        dark_frames=dark.frames,
        levels=reports,
        gains=gains,
    )


def check_gain(flats: int, gain_e_per_adu: float | None) -> None:
    """Refuse a calibration without flats and without a gain.

    Raises
    ------
    ConfigurationError
        Says what to give.
    """
    if not flats and gain_e_per_adu is None:
        raise ConfigurationError(
            "the gain is not known: give films of steady light (FLAT) behind the dark one, or "
            "--gain-e-per-adu"
        )


def _answers(flats: Sequence[FilmStatistics], dark: FilmStatistics, limit: float) -> Mask:
    """Tell which pixels answer the brightest light that does not saturate their surroundings."""
    answered = np.zeros(dark.mean.shape, np.bool_)
    asked = answered.copy()
    for film in flats:
        signal = film.mean - dark.mean
        around = film_checks.surroundings(signal)
        lit = (around > 0) & (film_checks.surroundings(film.largest) < limit)
        # A pixel at the limit answered.
        moved = ~film.constant | (film.largest >= limit)
        answered |= lit & moved & (signal >= _LEAST_RESPONSE * around)
        asked |= lit
    return answered | ~asked


def _gains(
    flats: Sequence[tuple[str, FilmStatistics]], dark: FilmStatistics, among: Mask, limit: float
) -> tuple[PixelGains, tuple[LevelReport, ...]]:
    """Find the gains by those flats that are sound, and report all."""
    nothing = np.zeros_like(dark.mean)
    bottom = Level(nothing, dark.variance, dark.frames - 1.0, np.isfinite(dark.mean))
    levels = [_level(name, film, dark, among, limit) for name, film in flats]
    slopes = [mean_slope(level, bottom, among) for level in levels]
    reasons = _unsound(flats, levels, slopes, among, limit)
    reports = tuple(
        LevelReport(
            name=name,
            frames=film.frames,
            skipped_frames=film.skipped,
            signal_adu=film_checks.typical(film.mean - dark.mean, among),
            gain_e_per_adu=1 / slope if slope > 0 else math.nan,
            flicker=float(film.levels.std() / film.levels.mean()),
            saturated_pixels=int(np.sum(film.largest >= limit)),
            reason=reason,
        )
        for (name, film), (slope, _), reason in zip(flats, slopes, reasons, strict=True)
    )
    for report in reports:
        if report.reason is not None:
            warnings.warn(
                f"{report.name} is left out: {report.reason}", CalibrationWarning, stacklevel=3
            )
    used = [place for place, reason in enumerate(reasons) if reason is None]
    if not used:
        raise CameraError(
            "no flat tells the gain (" + "; ".join(f"{r.name}: {r.reason}" for r in reports) + "): "
            "film steady light well above the dark level and below the largest count"
        )
    weights = [1 / slopes[place][1] ** 2 for place in used]
    slope = float(np.average([slopes[place][0] for place in used], weights=weights))
    gains = pixel_gains([levels[place] for place in used], bottom, slope, among)
    _warn_of_few_frames(gains, sum(flats[place][1].frames for place in used))
    return gains, reports


def _level(
    name: str, film: FilmStatistics, dark: FilmStatistics, among: Mask, limit: float
) -> Level:
    film_checks.check_flat(name, film, dark, among)
    variance, freedom = film.variance, film.frames - 1.0
    usable = np.isfinite(film.mean) & np.isfinite(dark.mean) & (film.largest < limit)
    chosen = among & usable
    whole, successive = (
        float(np.sum(values[chosen], dtype=np.float64))
        for values in (film.variance, film.successive)
    )
    if whole > _UNEVEN * successive:
        excess = whole / successive - 1
        warnings.warn(
            f"the light on {name} changes slowly and unevenly (its variance is {excess:.0%} above "
            "that of successive frames): differences of successive frames are used, which are less "
            "certain; let lamp and camera warm up",
            CalibrationWarning,
            stacklevel=4,
        )
        # Neighbouring differences share a frame.
        variance, freedom = film.successive, 2 * (film.frames - 1.0) ** 2 / (3 * film.frames - 4)
    spread = float(film.levels.var() / film.levels.mean() ** 2)
    return Level(film.mean - dark.mean, variance, freedom / (1 + spread), usable)


def _unsound(
    flats: Sequence[tuple[str, FilmStatistics]],
    levels: Sequence[Level],
    slopes: Sequence[tuple[float, float]],
    among: Mask,
    limit: float,
) -> list[str | None]:
    """Say of each flat why it cannot be used, None where it can."""
    reasons: list[str | None] = []
    for (_, film), (slope, error) in zip(flats, slopes, strict=True):
        share = float(np.mean(film.largest[among] >= limit))
        if share > _SATURATED_SHARE:
            reasons.append(f"{share:.0%} of its pixels are saturated (at {limit:g} ADU)")
        elif not slope > 5 * error:
            reasons.append("its variance is not above that of the dark film")
        else:
            reasons.append(None)
    sound = [place for place, reason in enumerate(reasons) if reason is None]
    if len(sound) < 2:
        return reasons
    # Of two that disagree the brighter one is the nearer to where counts stop to follow the light.
    signals = [film_checks.typical(levels[place].signal, among) for place in sound]
    by_signal = [sound[k] for k in np.argsort(signals)]
    middle = (
        float(np.median([slopes[place][0] for place in sound]))
        if len(sound) > 2
        else slopes[by_signal[0]][0]
    )
    for place in sound:
        slope, error = slopes[place]
        if abs(slope - middle) > max(_NON_LINEAR * middle, 5 * error):
            reasons[place] = (
                f"by its variance the gain is {1 / slope:.4g} electrons per ADU, by the other "
                f"flats {1 / middle:.4g}, so its counts do not follow the light"
            )
    return reasons


def _warn_of_few_frames(gains: PixelGains, frames: int) -> None:
    """Say when pixels' own gains are known worse than pixels differ."""
    if gains.own_weight >= _BELIEVED:
        return
    spread = gains.pixel_spread
    needed = frames * (gains.own_error / (spread or _SOUGHT_SPREAD)) ** 2
    if spread:
        found = (
            f"pixels differ by {spread:.2%}, so {gains.own_weight:.0%} of a pixel's own deviation "
            "is kept and the rest drawn to its column, its row and the sensor"
        )
    else:
        found = "pixels do not differ beyond it, so all of a column and row have one gain"
    columns = math.hypot(gains.column_spread, gains.row_spread)
    if not spread and not columns:
        found = "neither pixels nor columns differ beyond it, so all have one gain"
    warnings.warn(
        f"{frames} flat frames tell a pixel's own gain to {gains.own_error:.1%}; {found}; about "
        f"{_round(needed)} frames would tell it to {spread or _SOUGHT_SPREAD:.2%}",
        CalibrationWarning,
        stacklevel=4,
    )


def _round(number: float) -> int:
    """Round up to two digits."""
    scale = 10.0 ** max(0, math.floor(math.log10(max(number, 1))) - 1)
    return int(math.ceil(number / scale) * scale)
