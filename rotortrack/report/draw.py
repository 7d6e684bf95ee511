"""Which figures a run gets, and their files."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from rotortrack.cameras.hot_pixels import hot_limit_e
from rotortrack.files import atomic_path
from rotortrack.motion.msd_table import ALL_ROTORS
from rotortrack.pipeline.store import FIGURE_NAME
from rotortrack.report import words
from rotortrack.report.figures import (
    both_ends,
    camera_maps,
    canvas,
    contour,
    cumulative_angle,
    end_to_end,
    energetics,
    examples,
    field,
    frames,
    gallery,
    msd,
    particles,
    plan,
    population,
    rotor_sheet,
    scatter,
    speeds,
    voltage,
    voltage_traces,
)
from rotortrack.report.figures import (
    drift as drift_figure,
)
from rotortrack.report.figures.canvas import FileFormat, NothingToDrawError

if TYPE_CHECKING:
    from rotortrack.afm.trace import Traced
    from rotortrack.cameras.calibrate import Calibration
    from rotortrack.motion.ensemble import Ensemble
    from rotortrack.motion.plan_movie import MoviePlan
    from rotortrack.movies.movie import Movie

_FOLDER = "figures"


def draw_run(
    folder: Path,
    *,
    rotors: pd.DataFrame,
    tracks: pd.DataFrame,
    localisations: pd.DataFrame,
    drift: pd.DataFrame,
    frame_interval_s: float,
    exposure_s: float | None = None,
    pixel_size_nm: float | None = None,
    mean_image: ArrayLike | None = None,
    image_origin_px: tuple[int, int] = (0, 0),
    drift_bins: drift_figure.Bins | None = None,
    switches: pd.DataFrame | None = None,
    posterior: pd.DataFrame | None = None,
    profiles: pd.DataFrame | None = None,
    msds: pd.DataFrame | None = None,
    voltages: pd.DataFrame | None = None,
    voltage_speeds: pd.DataFrame | None = None,
    ends: pd.DataFrame | None = None,
    end_rotors: pd.DataFrame | None = None,
    pore_axis_deg: float | None = None,
    movie: Movie | None = None,
    max_sheets: int = 100,
    file_format: FileFormat = "png",
    progress: Callable[[int, int], None] | None = None,
    skipped: Callable[[str, str], None] | None = None,
) -> list[Path]:
    """Write all figures of a run into its `figures` folder, each whole or not at all.

    The README's table says what each shows. A figure whose tables or columns are missing or empty
    is not drawn. Last comes a sheet `rotor-NNN` a rotor: kept rotors first, refused ones after
    them, up to `max_sheets`. Figures of an earlier run that this one does not have are removed, so
    that the folder never shows rotors of other tables.

    Parameters
    ----------
    folder
        The run folder.
    rotors, tracks, localisations, drift
        Tables of the run, with the columns of `rotortrack.tables`; each may be empty. The
        localisations carry `rotor`.
    frame_interval_s, exposure_s
        Time from frame to frame, and exposure within it (s); without the latter there are no speeds
        in windows of time.
    pixel_size_nm, mean_image, image_origin_px
        Mean image of the movie (y, x), its pixel size (nm) and where it starts on the sensor.
    drift_bins
        Frames, dx (nm), dy (nm) of the bins behind the drift.
    switches, posterior, profiles, msds
        Further tables of the run.
    voltages, voltage_speeds
        What a recorded trace told of the frames and rotors.
    ends, end_rotors, pore_axis_deg
        End-to-end distances of frames and rotors, and the long axis of elongated pores.
    movie
        The movie, for some frames of one rotor.
    max_sheets
        Most rotor sheets that are drawn.
    file_format
        png, svg or pdf.
    progress
        Called with the number of figures dealt with and their total after each.
    skipped
        Called with the name of each figure that is not drawn, and the reason.

    Returns
    -------
    list of Path
        The files in the order of writing.

    Raises
    ------
    ResourceError
        The folder cannot be written.
    UsageError
        A mean image without a pixel size.
    """
    target = folder / _FOLDER
    of_track = _ByRotor(tracks)
    of_spots = _ByRotor(localisations)
    of_posterior = _ByRotor(posterior)
    of_profile = _ByRotor(profiles, "bin")
    of_msd = _ByRotor(msds, "lag_s")
    whole = None if msds is None else msds[msds["rotor"] == ALL_ROTORS]
    curves = {number: msd.curve(part, frame_interval_s) for number, part in of_track.items()}
    interval = {"frame_interval_s": frame_interval_s}

    def sheet(row: dict[Any, Any]) -> Figure:
        number = int(row["rotor"])
        return rotor_sheet.figure(
            of_spots.get(number, localisations.iloc[:0]),
            row,
            of_track.get(number),
            exposure_s=exposure_s,
            msd_curve=curves.get(number),
            switches=None if switches is None else switches[switches["rotor"] == number],
            posterior=of_posterior.get(number),
            angle_profile=of_profile.get(number),
            msd_table=of_msd.get(number),
            **interval,
        )

    figures: dict[str, Callable[[], Figure]] = {
        "field": lambda: field.figure(
            rotors,
            localisations,
            image=mean_image,
            pixel_size_nm=pixel_size_nm,
            image_origin_px=image_origin_px,
        ),
        "positions": lambda: gallery.figure(rotors, of_spots),
        "examples": lambda: examples.figure(
            rotors, of_track, of_spots, switches=switches, **interval
        ),
        "speeds": lambda: speeds.figure(rotors),
        "population": lambda: population.figure(rotors),
        "energetics": lambda: energetics.figure(rotors),
        "scatter": lambda: scatter.figure(rotors),
        "cumulative_angles": lambda: cumulative_angle.all_rotors(rotors, of_track, **interval),
        "msds": lambda: msd.all_rotors(rotors, curves, whole),
        "drift": lambda: drift_figure.figure(drift, bins=drift_bins),
    }
    if voltages is not None and voltage_speeds is not None:
        volts, at_volts = voltages, voltage_speeds
        figures["voltage"] = lambda: voltage.figure(at_volts, volts, **interval)
        figures["voltage_angles"] = lambda: voltage_traces.all_rotors(
            rotors, of_track, volts, **interval
        )
        if exposure_s is not None:
            exposed_s = exposure_s
            figures["voltage_examples"] = lambda: voltage_traces.examples(
                rotors, of_track, volts, exposure_s=exposed_s, switches=switches, **interval
            )
    if ends is not None and end_rotors is not None:
        of_ends, frames_of_ends, whole_ends = _ByRotor(ends), ends, end_rotors
        figures["end_to_end"] = lambda: end_to_end.histograms(frames_of_ends, whole_ends)
        figures["both_ends"] = lambda: both_ends.figure(of_ends, of_spots, rotors, whole_ends)
        figures["end_to_end_traces"] = lambda: end_to_end.traces(of_ends, whole_ends, **interval)
        figures["end_to_end_axes"] = lambda: both_ends.axes_figure(whole_ends, pore_axis_deg)
    if movie is not None and pixel_size_nm is not None:
        film, size_nm = movie, pixel_size_nm
        figures["frames"] = lambda: frames.of_movie(
            film, rotors, tracks, pixel_size_nm=size_nm, **interval
        )
    for row in _sheet_rows(rotors, max_sheets):
        figures[f"rotor-{int(row['rotor']):03d}"] = functools.partial(sheet, row)

    written: list[Path] = []
    for done, (stem, make) in enumerate(figures.items(), 1):
        try:
            made = make()
        except NothingToDrawError as reason:
            if skipped is not None:
                skipped(stem, str(reason))
        else:
            path = target / f"{stem}.{file_format}"
            with atomic_path(path) as temporary:
                canvas.save(made, temporary, file_format)
            written.append(path)
        if progress is not None:
            progress(done, len(figures))
    for path in target.iterdir():
        if FIGURE_NAME.fullmatch(path.name) and path not in written:
            path.unlink()
    return written


def draw_camera(path: Path, calibration: Calibration, file_format: FileFormat = "png") -> None:
    """Draw the maps of a calibrated camera into a file."""
    made_from = words.count(calibration.dark_frames, "dark frame")
    used = [level for level in calibration.levels if level.reason is None]
    if used:
        frames = words.count(sum(level.frames for level in used), "frame")
        made_from += f", {frames} of {words.count(len(used), 'flat')}"
    else:
        made_from += ", gain given"
    alive = ~calibration.dead_pixels
    made = camera_maps.figure(
        offset_adu=calibration.offset_adu,
        gain_e_per_adu=calibration.gain_e_per_adu,
        read_noise_e=calibration.read_noise_e,
        hot_pixels=calibration.hot_pixels,
        dead_pixels=calibration.dead_pixels,
        hot_limit_e=hot_limit_e(calibration.read_noise_e[alive]),
        made_from=made_from,
    )
    canvas.save(made, path, file_format)


def draw_particles(
    path: Path,
    tracks: pd.DataFrame,
    found: pd.DataFrame,
    whole: Ensemble,
    *,
    frame_interval_s: float,
    file_format: FileFormat = "png",
) -> None:
    """Draw mobile particles, their mean-square displacements and diffusion into a file."""
    made = particles.figure(tracks, found, whole, frame_interval_s=frame_interval_s)
    canvas.save(made, path, file_format)


def draw_contours(path: Path, traced: Traced, file_format: FileFormat = "png") -> None:
    """Draw the rods of an image of an atomic force microscope over it, into a file."""
    canvas.save(contour.figure(traced), path, file_format)


def draw_plan(path: Path, planned: MoviePlan, file_format: FileFormat = "png") -> None:
    """Draw into a file which speeds movies like the planned one resolve."""
    canvas.save(plan.figure(planned), path, file_format)


def draw_resolved(
    path: Path, rotors: pd.DataFrame, driven_z: float, file_format: FileFormat = "png"
) -> None:
    """Draw into a file what the rotors of a run resolve, and their speeds."""
    canvas.save(plan.resolved(rotors, driven_z), path, file_format)


def _sheet_rows(rotors: pd.DataFrame, most: int) -> list[dict[Any, Any]]:
    """Return the rows that get a sheet: kept rotors first, each kind by number."""
    if "verdict" not in rotors:
        return rotors.sort_values("rotor").head(most).to_dict("records")
    refused = (rotors["verdict"] != "kept").to_numpy()
    order = np.lexsort((rotors["rotor"].to_numpy(), refused))
    return rotors.iloc[order[:most]].to_dict("records")


class _ByRotor(Mapping[int, pd.DataFrame]):
    """A table's rows of each rotor in order of a column, cut out when they are asked for.

    -1 belongs to none.
    """

    def __init__(self, table: pd.DataFrame | None, sorted_by: str = "frame") -> None:
        self._table = pd.DataFrame() if table is None else table
        self._rows: dict[int, NDArray[np.intp]] = {}
        if table is not None and "rotor" in table and len(table):
            numbers = table["rotor"].to_numpy(np.int64)
            order = np.lexsort((table[sorted_by].to_numpy(), numbers))
            order = order[numbers[order] >= 0]
            found, starts = np.unique(numbers[order], return_index=True)
            parts = np.split(order, starts[1:])
            self._rows = dict(zip(found.tolist(), parts, strict=False))

    def __getitem__(self, number: int) -> pd.DataFrame:
        return self._table.iloc[self._rows[number]]

    def __contains__(self, number: object) -> bool:
        return number in self._rows

    def __iter__(self) -> Iterator[int]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
