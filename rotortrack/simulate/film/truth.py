"""The truth beside a film: where every spot was, what every rotor was asked to do and did."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rotortrack.exchange.row_groups import RowGroupWriter
from rotortrack.files import atomic_path, write_text
from rotortrack.tables import Column, Schema
from rotortrack.toml import to_toml

if TYPE_CHECKING:
    from rotortrack.cameras.camera import Camera
    from rotortrack.simulate.film.film import Film, Seen
    from rotortrack.simulate.film.rotor import Rotor

SPOTS: Final = Schema(
    "film_spots",
    (
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("rotor", "int64", "", "rotor number, from 0", required=True),
        Column("end", "int32", "", "labelled end of the rotor, 0 or 1", required=True),
        Column("channel", "int32", "", "colour, 0 or 1", required=True),
        Column("x_nm", "float64", "nm", "on the sensor, averaged over the exposure", required=True),
        Column("y_nm", "float64", "nm", "on the sensor, averaged over the exposure", required=True),
        Column("first_x_nm", "float64", "nm", "the same in coordinates of the first colour"),
        Column("first_y_nm", "float64", "nm", "the same in coordinates of the first colour"),
        Column("theta_rad", "float64", "rad", "angle averaged over the exposure, not wrapped"),
        Column("photons", "float64", "photons", "expected photons of the spot, 0 when dark"),
    ),
)


class SpotRows:
    """Gathers where each spot was, block by block, for the writer of a table."""

    def __init__(self, writer: RowGroupWriter, recorded: NDArray[np.bool_] | None) -> None:
        self._writer = writer
        self._recorded = recorded

    def __call__(self, first: int, seen: Sequence[Seen]) -> None:
        """Add the rows of a block that begins with frame `first`."""
        if not seen:
            return
        n = seen[0].x_nm.size
        frames = np.arange(first, first + n)
        keep = np.ones(n, np.bool_) if self._recorded is None else self._recorded[frames]
        columns: dict[str, NDArray[Any]] = {"frame": np.repeat(frames[keep], len(seen))}
        for column in SPOTS.columns[1:]:
            values = [np.broadcast_to(getattr(one, column.name), n)[keep] for one in seen]
            columns[column.name] = np.stack(values, axis=1).ravel().astype(column.dtype)
        self._writer.append(columns)


def empty_spots() -> dict[str, NDArray[Any]]:
    """Give the columns of a film without rotors."""
    return {column.name: np.empty(0, column.dtype) for column in SPOTS.columns}


def rotor_table(rotors: Sequence[Rotor], realised_rad_s: Sequence[float]) -> pd.DataFrame:
    """Tell what each rotor was asked to do, and the mean speed that chance made of it.

    Parameters
    ----------
    rotors
        What was drawn.
    realised_rad_s
        Mean speed of each in the film.

    Returns
    -------
    pandas.DataFrame
        One row a rotor. `end_to_end_nm` is the distance of its two ends, nan where it has one.
    """
    rows = []
    for rotor, realised in zip(rotors, realised_rad_s, strict=True):
        first, second = rotor.ends[0], rotor.ends[1] if len(rotor.ends) == 2 else None
        apart = second and math.sqrt(
            first.radius_nm**2
            + second.radius_nm**2
            - 2.0
            * first.radius_nm
            * second.radius_nm
            * math.cos(second.phase_rad - first.phase_rad)
        )
        rows.append(
            {
                "rotor": rotor.number,
                "pore": rotor.pore,
                "group": rotor.group,
                "motion": rotor.motion,
                "x_nm": rotor.x_nm,
                "y_nm": rotor.y_nm,
                "radius_nm": first.radius_nm,
                "phase_rad": first.phase_rad,
                "second_radius_nm": second and second.radius_nm,
                "second_phase_rad": second and second.phase_rad,
                "end_to_end_nm": apart,
                "omega_rad_s": rotor.omega_rad_s,
                "realised_omega_rad_s": realised,
                "diffusion_rad2_s": rotor.diffusion_rad2_s,
                "start_rad": rotor.start_rad,
                "switch_rate_per_s": rotor.switch_rate_per_s,
                "wobble_sd_rad": rotor.wobble_sd_rad,
                "arc_rad": rotor.arc_rad,
                "breathing_sd_nm": rotor.breathing_sd_nm,
                "photons": first.photons,
                "second_photons": second and second.photons,
                "arrive_s": rotor.arrive_s,
                "leave_s": rotor.leave_s,
            }
        )
    numbers = dict.fromkeys(("second_radius_nm", "second_phase_rad", "second_photons"), np.float64)
    table = pd.DataFrame(rows, columns=list(_ROTOR_COLUMNS))
    return table.astype({**numbers, "end_to_end_nm": np.float64})


_ROTOR_COLUMNS: Final = (
    *("rotor", "pore", "group", "motion", "x_nm", "y_nm", "radius_nm", "phase_rad"),
    *("second_radius_nm", "second_phase_rad", "end_to_end_nm"),
    *("omega_rad_s", "realised_omega_rad_s", "diffusion_rad2_s", "start_rad"),
    *("switch_rate_per_s", "wobble_sd_rad", "arc_rad", "breathing_sd_nm"),
    *("photons", "second_photons", "arrive_s", "leave_s"),
)


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table whole or not at all."""
    with atomic_path(path) as temporary:
        table.to_csv(temporary, index=False, lineterminator="\n")


def drift_table(film: Film) -> pd.DataFrame:
    """Tell where the stage stood in each frame period, vibration left out."""
    moved = np.concatenate(film.drift_nm)
    return pd.DataFrame(
        {"frame": np.arange(len(moved)), "dx_nm": moved[:, 0], "dy_nm": moved[:, 1]}
    )


def fiducial_table(film: Film) -> pd.DataFrame:
    """Tell where each point of the grid is in both colours, without the stage."""
    x_nm, y_nm, photons = film.fiducials()
    second_x_nm, second_y_nm = film.split.to_second(x_nm, y_nm)
    return pd.DataFrame(
        {
            "x_nm": x_nm,
            "y_nm": y_nm,
            "second_x_nm": second_x_nm,
            "second_y_nm": second_y_nm,
            "photons": photons[:, 0],
            "second_photons": photons[:, 1],
        }
    )


def write_configuration(path: Path, film: Film, maps: Path | None) -> None:
    """Write what `rotortrack run -c` needs to analyse the film.

    Parameters
    ----------
    path
        Where.
    film
        The film.
    maps
        Maps of its camera, where pixels differ.
    """
    options = film.scene.film
    movie: dict[str, Any] = {
        "pixel_size_nm": options.pixel_size_nm,
        "frame_interval_s": options.frame_interval_s,
        # An analysis takes an absent exposure for the frame interval; an instant is none.
        "exposure_s": options.exposure_s or options.frame_interval_s * _INSTANT,
        "mirrored": str(options.mirrored).lower(),
    }
    write_text(path, to_toml({"movie": movie, "camera": _camera_values(film, maps)}))


_INSTANT = 1e-6
"""Part of the frame interval that stands for an instant."""


def _camera_values(film: Film, maps: Path | None) -> dict[str, Any]:
    if film.sensor is None:
        return {"offset_adu": 0.0, "gain_e_per_adu": 1.0, "read_noise_e": 0.0}
    if maps is not None:
        return {"camera_maps": maps.name}
    camera: Camera = film.sensor.camera
    names = ("offset_adu", "gain_e_per_adu", "read_noise_e")
    return {name: float(getattr(camera, name)) for name in names}


def camera_arrays(camera: Camera) -> dict[str, NDArray[Any]]:
    """Give the maps of a camera by their names in a file."""
    names = ("offset_adu", "gain_e_per_adu", "read_noise_e", "saturation_adu", "hot_pixels")
    return {
        name: np.asarray(value) for name in names if (value := getattr(camera, name)) is not None
    }
