"""Tracks of mobile particles, the diffusion of each, and of all together."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from rotortrack.errors import ConfigurationError, InputError, LinkWarning
from rotortrack.motion.covariance import covariance_estimate, step_products
from rotortrack.motion.ensemble import Ensemble, Track, ensemble
from rotortrack.motion.free_particle import GIVEN_NOISE, fit_free_particle
from rotortrack.motion.link import link
from rotortrack.motion.link_options import LinkOptions
from rotortrack.motion.readings import Timing
from rotortrack.motion.search_range import SearchRange, choose_search_range
from rotortrack.motion.tables import PARTICLE_TRACKS, PARTICLES
from rotortrack.tables import conform

Floats = NDArray[np.float64]

NM2_PER_UM2 = 1e6
_MUCH_CONFUSED = 0.1
_FARTHEST_NM = 1e12
_LEAST_ERROR = 1e-3


@dataclass(frozen=True)
class Particles:
    """What the linking of a table found.

    Attributes
    ----------
    tracks, particles
        Tables `PARTICLE_TRACKS` and `PARTICLES`.
    ensemble
        All particles together.
    search_range_nm, chosen
        The range, and what it rests on where it was not given.
    short
        Particles that were left out because they were seen in too few frames.
    unplaced
        Spots without a position.
    """

    tracks: pd.DataFrame
    particles: pd.DataFrame
    ensemble: Ensemble
    search_range_nm: float
    chosen: SearchRange | None
    short: int
    unplaced: int


def track_particles(
    localisations: pd.DataFrame,
    options: LinkOptions,
    *,
    frame_interval_s: float,
    exposure_s: float,
) -> Particles:
    """Link localisations into particles and measure the diffusion of each and of all.

    Parameters
    ----------
    localisations
        Columns frame, x_nm, y_nm and, where known, x_sd_nm, y_sd_nm.
    options
        How they are linked.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.

    Raises
    ------
    ConfigurationError
        The exposure exceeds the frame interval; or no search range is given and the table does not
        tell one.
    InputError
        The table holds more than one channel, or is too dense to be linked.

    Warns
    -----
    LinkWarning
        Strange spots are so near that particles may be confused.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> import rotortrack as rt
    >>> rng = np.random.default_rng(1)
    >>> walks = np.cumsum(rng.normal(0.0, 60.0, (100, 5, 2)), axis=0)
    >>> walks += 4000.0 * np.arange(5)[:, np.newaxis]
    >>> spots = pd.DataFrame(
    ...     {
    ...         "frame": np.repeat(np.arange(100), 5),
    ...         "x_nm": walks[..., 0].ravel(),
    ...         "y_nm": walks[..., 1].ravel(),
    ...     }
    ... ).assign(x_sd_nm=5.0, y_sd_nm=5.0)
    >>> found = rt.track_particles(
    ...     spots, rt.LinkOptions(), frame_interval_s=0.01, exposure_s=0.01
    ... )
    >>> len(found.particles)
    5
    """
    if exposure_s > frame_interval_s:
        raise ConfigurationError(
            f"exposure_s is {exposure_s:g}, longer than frame_interval_s {frame_interval_s:g}: "
            "correct one of them"
        )
    spots = _spots(localisations)
    frame = spots["frame"].to_numpy(np.int64)
    x, y = spots["x_nm"].to_numpy(np.float64), spots["y_nm"].to_numpy(np.float64)
    chosen = None
    range_nm = options.search_range_nm
    if range_nm is None and len(spots):
        chosen = choose_search_range(frame, x, y, memory_frames=options.memory_frames)
        if chosen is None:
            raise ConfigurationError(
                "search_range_nm is not given and adjacent frames hold too few spots to tell it: "
                "give --search-range-nm"
            )
        range_nm = chosen.range_nm
        _warn_of_crowds(chosen)
    range_nm = range_nm or math.nan
    links = link(frame, x, y, search_range_nm=range_nm, memory_frames=options.memory_frames)
    sizes = np.bincount(links.particle)
    long = sizes >= options.min_frames
    number = np.where(long, np.cumsum(long) - 1, -1)[links.particle]
    tracks = spots.assign(particle=number, time_s=frame * frame_interval_s)[number >= 0]
    tracks = tracks.sort_values(["particle", "frame"], kind="stable", ignore_index=True)
    tracks = conform(tracks[[n for n in PARTICLE_TRACKS.names if n in tracks]], PARTICLE_TRACKS, "")
    timing = Timing(frame_interval_s, exposure_s)
    starts = np.flatnonzero(np.diff(tracks["particle"].to_numpy(), prepend=-1))
    stops = [*starts[1:], len(tracks)] if len(tracks) else []
    parts = [_track(tracks.iloc[start:stop]) for start, stop in zip(starts, stops, strict=True)]
    rows = [{"particle": k, **_measure(part, timing)} for k, part in enumerate(parts)]
    table = pd.DataFrame(rows, columns=PARTICLES.names)
    if len(table):
        table["directed_q"] = stats.false_discovery_control(table["directed_p"].to_numpy())
    return Particles(
        tracks=tracks,
        particles=conform(table, PARTICLES, "particles"),
        ensemble=ensemble(parts, timing),
        search_range_nm=range_nm,
        chosen=chosen,
        short=int(np.count_nonzero(~long)),
        unplaced=len(localisations) - len(spots),
    )


def _spots(localisations: pd.DataFrame) -> pd.DataFrame:
    """Spots that have a position, with the columns that linking uses."""
    if "channel" in localisations:
        channels = localisations["channel"].unique()
        if len(channels) > 1:
            raise InputError(
                f"the table holds {len(channels)} channels, whose spots must not be linked to each "
                "other: localise them one by one (--channel)"
            )
    names = ["frame", "x_nm", "y_nm"]
    names += [name for name in ("x_sd_nm", "y_sd_nm") if name in localisations]
    if "x_sd_nm" not in names and "uncertainty_nm" in localisations:
        known = localisations["uncertainty_nm"].to_numpy(np.float64)
        localisations = localisations.assign(x_sd_nm=known, y_sd_nm=known)
        names += ["x_sd_nm", "y_sd_nm"]
    places = localisations[["x_nm", "y_nm"]].to_numpy(np.float64)
    placed = np.isfinite(places).all(axis=1)
    if np.abs(places[placed]).max(initial=0.0) > _FARTHEST_NM:
        raise InputError(
            f"a position of the table lies {np.abs(places[placed]).max():.3g} nm away, which no "
            "microscope sees: export the table again with positions in nm"
        )
    spots: pd.DataFrame = localisations.loc[placed, names]
    return spots


def _warn_of_crowds(chosen: SearchRange) -> None:
    if chosen.cut:
        warnings.warn(
            f"steps reach beyond {chosen.range_nm:g} nm, where strange spots are as near: fast "
            "particles are lost and D comes out too small; film faster or with fewer particles",
            LinkWarning,
            stacklevel=3,
        )
    elif chosen.false_share > _MUCH_CONFUSED:
        warnings.warn(
            f"a strange spot lies nearer than the particle itself in {chosen.false_share:.0%} of "
            "all steps, so particles are confused: film faster or with fewer particles",
            LinkWarning,
            stacklevel=3,
        )


def _track(rows: pd.DataFrame) -> Track:
    frame = rows["frame"].to_numpy(np.int64)
    place = rows[["x_nm", "y_nm"]].to_numpy(np.float64)
    if "x_sd_nm" not in rows:
        return Track(frame, place, None)
    sd = rows[["x_sd_nm", "y_sd_nm"]].to_numpy(np.float64)
    known = np.isfinite(sd) & (sd > 0.0)
    if not known.any():
        return Track(frame, place, None)
    # An error far below the steps tells nothing more, and squares of it would underflow.
    least = _LEAST_ERROR * math.sqrt(float(np.mean(np.diff(place, axis=0) ** 2)))
    return Track(frame, place, np.maximum(np.where(known, sd, np.median(sd[known])), least))


def _measure(track: Track, timing: Timing) -> dict[str, float]:
    """Row of one particle."""
    frame, x, y = track.frame, track.place_nm[:, 0], track.place_nm[:, 1]
    seen = {
        "n_frames": frame.size,
        "first_frame": frame[0],
        "last_frame": frame[-1],
        "missing_frames": frame[-1] - frame[0] + 1 - frame.size,
        "x_nm": x.mean(),
        "y_nm": y.mean(),
        "net_nm": math.hypot(x[-1] - x[0], y[-1] - y[0]),
    }
    cve = covariance_estimate(step_products(frame, x, y), timing)
    if not track.moves:
        return {**seen, "directed_p": 1.0}
    noise = track.noise_nm2
    found = fit_free_particle(
        frame,
        x,
        y,
        noise[:, 0],
        noise[:, 1],
        timing,
        noise_log_sd=GIVEN_NOISE if track.sd_nm is not None else math.inf,
    )
    low, high = found.diffusion_interval_nm2_s
    return {
        **seen,
        "diffusion_um2_s": found.diffusion_nm2_s / NM2_PER_UM2,
        "diffusion_sd_um2_s": found.diffusion_sd_nm2_s / NM2_PER_UM2,
        "diffusion_ci_low_um2_s": low / NM2_PER_UM2,
        "diffusion_ci_high_um2_s": high / NM2_PER_UM2,
        "cve_um2_s": cve.diffusion_nm2_s / NM2_PER_UM2,
        "cve_sd_um2_s": cve.diffusion_sd_nm2_s / NM2_PER_UM2,
        "localisation_sd_nm": math.sqrt(found.noise_factor * float(noise.mean())),
        "velocity_x_nm_s": found.velocity_nm_s[0],
        "velocity_y_nm_s": found.velocity_nm_s[1],
        "velocity_sd_nm_s": math.hypot(*found.velocity_sd_nm_s) / math.sqrt(2.0),
        "directed_p": found.directed_p,
    }
