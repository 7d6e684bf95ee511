"""Which figures a run gets, and their files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from rotortrack.cameras.hot_pixels import hot_limit_e
from rotortrack.files import atomic_path
from rotortrack.pipeline.store import FIGURE_NAME
from rotortrack.report import words
from rotortrack.report.figures import (
    camera_maps,
    canvas,
    cumulative_angle,
    field,
    msd,
    particles,
    plan,
    rotor_sheet,
    speeds,
    voltage,
)
from rotortrack.report.figures import (
    drift as drift_figure,
)
from rotortrack.report.figures.canvas import FileFormat

if TYPE_CHECKING:
    from rotortrack.cameras.calibrate import Calibration
    from rotortrack.motion.ensemble import Ensemble
    from rotortrack.motion.plan_movie import MoviePlan

_FOLDER = "figures"


def draw_run(
    folder: Path,
    *,
    rotors: pd.DataFrame,
    tracks: pd.DataFrame,
    localisations: pd.DataFrame,
    drift: pd.DataFrame,
    frame_interval_s: float,
    pixel_size_nm: float | None = None,
    mean_image: ArrayLike | None = None,
    image_origin_px: tuple[int, int] = (0, 0),
    drift_bins: drift_figure.Bins | None = None,
    switches: pd.DataFrame | None = None,
    voltages: pd.DataFrame | None = None,
    voltage_speeds: pd.DataFrame | None = None,
    max_sheets: int = 100,
    file_format: FileFormat = "png",
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write all figures of a run into its `figures` folder, each whole or not at all.

    field, speeds, cumulative_angles, msds, drift, voltage where there is a trace, then a sheet
    `rotor-NNN` a rotor: kept rotors first, refused ones after them, up to `max_sheets`. Figures of
    an earlier run that this one does not have are removed, so that the folder never shows rotors of
    other tables.

    Parameters
    ----------
    folder
        The run folder.
    rotors, tracks, localisations, drift
        Tables of the run, with the columns of `rotortrack.tables`; each may be empty. The
        localisations carry `rotor`.
    frame_interval_s
        Time from frame to frame (s).
    pixel_size_nm, mean_image, image_origin_px
        Mean image of the movie (y, x), its pixel size (nm) and where it starts on the sensor.
    drift_bins
        Frames, dx (nm), dy (nm) of the bins behind the drift.
    switches
        Switches of speed, which are marked on the cumulative angles.
    voltages, voltage_speeds
        What a recorded trace told of the frames and rotors; the figure `voltage` shows both.
    max_sheets
        Most rotor sheets that are drawn.
    file_format
        png, svg or pdf.
    progress
        Called with the number of figures written and their total after each.

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
    curves = {number: msd.curve(part, frame_interval_s) for number, part in of_track.items()}
    listed = _sheet_rows(rotors, max_sheets)

    def figures() -> Iterator[tuple[str, Figure]]:
        yield (
            "field",
            field.figure(
                rotors,
                localisations,
                image=mean_image,
                pixel_size_nm=pixel_size_nm,
                image_origin_px=image_origin_px,
            ),
        )
        yield "speeds", speeds.figure(rotors)
        yield (
            "cumulative_angles",
            cumulative_angle.all_rotors(rotors, of_track, frame_interval_s=frame_interval_s),
        )
        yield "msds", msd.all_rotors(rotors, curves)
        yield "drift", drift_figure.figure(drift, bins=drift_bins)
        if voltages is not None and voltage_speeds is not None:
            yield (
                "voltage",
                voltage.figure(voltage_speeds, voltages, frame_interval_s=frame_interval_s),
            )
        for row in listed:
            number = int(row["rotor"])
            sheet = rotor_sheet.figure(
                of_spots.get(number, localisations.iloc[:0]),
                row,
                of_track.get(number),
                frame_interval_s=frame_interval_s,
                msd_curve=curves.get(number),
                switches=None if switches is None else switches[switches["rotor"] == number],
            )
            yield f"rotor-{number:03d}", sheet

    total = 5 + (voltages is not None and voltage_speeds is not None) + len(listed)
    written: list[Path] = []
    for stem, made in figures():
        path = target / f"{stem}.{file_format}"
        with atomic_path(path) as temporary:
            canvas.save(made, temporary, file_format)
        written.append(path)
        if progress is not None:
            progress(len(written), total)
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
    """A table's rows of each rotor in order of frames, cut out when they are asked for.

    -1 belongs to none.
    """

    def __init__(self, table: pd.DataFrame) -> None:
        self._table = table
        self._rows: dict[int, NDArray[np.intp]] = {}
        if "rotor" in table and len(table):
            numbers = table["rotor"].to_numpy(np.int64)
            order = np.lexsort((table["frame"].to_numpy(), numbers))
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
