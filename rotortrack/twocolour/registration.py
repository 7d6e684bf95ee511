"""The map of the second colour onto the first: its use, its error, and its file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial import ConvexHull

from rotortrack.errors import RegistrationError
from rotortrack.files import write_text
from rotortrack.settings import read_content
from rotortrack.twocolour.fit import Map
from rotortrack.twocolour.maps import map_from_dict

Floats = NDArray[np.float64]
Region = tuple[int, int, int, int]

FORMAT: Final = "rotortrack registration"
VERSION: Final = 1

_SAME_SIZE = 1e-3
_SETTLED_NM = 1e-7
_MOST_STEPS = 50
_STEP_NM = 1.0


@dataclass(frozen=True)
class Beads:
    """The pairs of beads that a registration was made of.

    Attributes
    ----------
    first_nm, second_nm
        Places in both colours, (pairs, 2).
    left_out_nm
        What the map of all other pairs misses each by, on the first colour, (pairs, 2).
    used
        Pairs that are not taken for mismatches.
    """

    first_nm: Floats
    second_nm: Floats
    left_out_nm: Floats
    used: NDArray[np.bool_]


@dataclass(frozen=True)
class ErrorGrid:
    """The map's standard deviation per axis over the first colour's field.

    Attributes
    ----------
    x_nm, y_nm
        Columns and rows of the grid.
    sd_nm
        Shape (rows, columns).
    """

    x_nm: Floats
    y_nm: Floats
    sd_nm: Floats


@dataclass(frozen=True)
class Registration:
    """How the second colour lies on the first.

    Attributes
    ----------
    mapping
        From the second colour to the first, nm on the whole sensor.
    regions
        The parts of the sensor that show the first and the second colour, pixels.
    pixel_size_nm
        Of both.
    beads, errors
        What it was made of; its standard deviation over the field.
    target_error_nm
        Expected error of a mapped place, rms per axis over the beads' field.
    bead_noise_nm
        Noise of the distance between a bead's two places, per axis.
    systematic_nm
        Part of the beads' residuals that neighbouring beads share: what the map does not follow,
        rms per axis.
    jitter_nm
        What all beads of a film move together from one colour to the other, per axis, as when the
        colours are filmed one after the other; not part of `target_error_nm`.
    mirror
        How the second image is flipped: none, left-right or top-bottom.
    """

    mapping: Map
    regions: tuple[Region, Region]
    pixel_size_nm: float
    beads: Beads
    errors: ErrorGrid
    target_error_nm: float
    bead_noise_nm: float
    systematic_nm: float
    jitter_nm: float
    mirror: str

    @property
    def model(self) -> str:
        """The kind of the map, in words."""
        return self.mapping.name

    @property
    def n_beads(self) -> int:
        """Pairs of beads."""
        return len(self.beads.used)

    @property
    def n_outliers(self) -> int:
        """Pairs that are taken for mismatches."""
        return int((~self.beads.used).sum())

    def to_first(self, points_nm: Floats) -> Floats:
        """Map places of the second colour, nm, (points, 2), onto the first."""
        mapped: Floats = self.mapping(np.asarray(points_nm, np.float64).reshape(-1, 2))
        return mapped

    def to_second(self, points_nm: Floats) -> Floats:
        """Map places of the first colour, nm, (points, 2), onto the second: the exact inverse.

        Raises
        ------
        RegistrationError
            A place is so far outside the field that the map has no inverse there.
        """
        wanted = np.asarray(points_nm, np.float64).reshape(-1, 2)
        middle = self.beads.second_nm[self.beads.used].mean(axis=0, keepdims=True)
        slopes = self._slopes(middle)[0]
        found: Floats = middle + (wanted - self.mapping(middle)) @ np.linalg.inv(slopes)
        for _ in range(_MOST_STEPS):
            missing = wanted - self.mapping(found)
            if not missing.size or np.abs(missing).max() < _SETTLED_NM:
                return found
            step = np.einsum("ni,nij->nj", missing, np.linalg.inv(self._slopes(found)))
            if not np.isfinite(step).all():
                break
            found = found + step
        raise RegistrationError(
            "no inverse",
            "some places lie so far from the beads that the second colour has no place for them: "
            "leave them out, or film beads there",
        )

    def error_nm(self, points_nm: Floats) -> Floats:
        """Give the map's standard deviation per axis at places of the first colour, (points,).

        Outside the field it is that of the nearest place inside.
        """
        points = np.asarray(points_nm, np.float64).reshape(-1, 2)
        grid = self.errors
        inside = RegularGridInterpolator((grid.y_nm, grid.x_nm), grid.sd_nm)
        x_nm = np.clip(points[:, 0], grid.x_nm[0], grid.x_nm[-1])
        y_nm = np.clip(points[:, 1], grid.y_nm[0], grid.y_nm[-1])
        errors: Floats = inside(np.column_stack([y_nm, x_nm]))
        return errors

    def inside(self, points_nm: Floats) -> NDArray[np.bool_]:
        """Tell which places of the first colour lie among the beads, (points,)."""
        points = np.asarray(points_nm, np.float64).reshape(-1, 2)
        faces = ConvexHull(self.beads.first_nm[self.beads.used]).equations
        within: NDArray[np.bool_] = np.all(points @ faces[:, :2].T + faces[:, 2] <= 1e-6, axis=1)
        return within

    def check_regions(self, first: Region, second: Region, *, pixel_size_nm: float) -> None:
        """Refuse a recording of other parts of the sensor, or with other pixels.

        Raises
        ------
        RegistrationError
            Says what the registration was made for.
        """
        made = self.regions
        if abs(pixel_size_nm / self.pixel_size_nm - 1.0) > _SAME_SIZE:
            raise RegistrationError(
                "another pixel size",
                f"the registration was made with pixels of {self.pixel_size_nm:g} nm, the movie "
                f"has {pixel_size_nm:g} nm: register beads filmed like the movie",
            )
        if _within(first, made[0]) and _within(second, made[1]):
            return
        if _within(first, made[1]) and _within(second, made[0]):
            raise RegistrationError(
                "swapped colours",
                "the registration's first colour is the movie's second one: give --swapped to "
                "both or to none",
            )
        raise RegistrationError(
            "another region",
            f"the registration was made for {_told(made[0])} and {_told(made[1])} of the sensor, "
            f"the movie shows its colours at {_told(first)} and {_told(second)}: register beads "
            "filmed like the movie",
        )

    def write(self, path: Path) -> None:
        """Write the file, atomically.

        Raises
        ------
        ResourceError
            It cannot be written.
        """
        beads, errors = self.beads, self.errors
        content = {
            "format": FORMAT,
            "version": VERSION,
            "model": self.model,
            "target_error_nm": self.target_error_nm,
            "bead_noise_nm": self.bead_noise_nm,
            "systematic_nm": self.systematic_nm,
            "jitter_nm": self.jitter_nm,
            "beads": self.n_beads,
            "outliers": self.n_outliers,
            "mirror": self.mirror,
            "pixel_size_nm": self.pixel_size_nm,
            "first_region_px": list(self.regions[0]),
            "second_region_px": list(self.regions[1]),
            "map": self.mapping.as_dict(),
            "pairs": {
                "first_nm": beads.first_nm.tolist(),
                "second_nm": beads.second_nm.tolist(),
                "left_out_nm": beads.left_out_nm.tolist(),
                "used": beads.used.tolist(),
            },
            "error": {
                "x_nm": errors.x_nm.tolist(),
                "y_nm": errors.y_nm.tolist(),
                "sd_nm": errors.sd_nm.tolist(),
            },
        }
        write_text(path, _readable(content) + "\n")

    def _slopes(self, points: Floats) -> Floats:
        """Give the derivatives of the map by the places, (points, of, by)."""
        steps = _STEP_NM * np.eye(2)
        slopes: Floats = np.stack(
            [
                (self.mapping(points + step) - self.mapping(points - step)) / (2.0 * _STEP_NM)
                for step in steps
            ],
            axis=1,
        )
        return slopes


def read_registration(path: Path) -> Registration:
    """Read what :meth:`Registration.write` wrote.

    Raises
    ------
    RegistrationError
        The file is none, is damaged, or is of a later version.
    ConfigurationError
        It cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import rotortrack as rt
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "channels.json"
    ...     _ = path.write_text("{}")
    ...     try:
    ...         rt.read_registration(path)
    ...     except rt.RotortrackError as error:
    ...         print(type(error).__name__)
    RegistrationError
    """
    try:
        content = json.loads(read_content(path))
    except ValueError as error:
        raise _unusable(path, "is not JSON") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise _unusable(path, "is no registration")
    if content.get("version") != VERSION:
        raise _unusable(path, f"is of version {content.get('version')}, not {VERSION}")
    try:
        return _from_content(content)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise _unusable(path, f"is damaged ({type(error).__name__}: {error})") from error


def _from_content(content: dict[str, Any]) -> Registration:
    pairs, errors = content["pairs"], content["error"]
    beads = Beads(
        _array(pairs["first_nm"], 2),
        _array(pairs["second_nm"], 2),
        _array(pairs["left_out_nm"], 2),
        np.array(pairs["used"], bool),
    )
    grid = ErrorGrid(_array(errors["x_nm"]), _array(errors["y_nm"]), _array(errors["sd_nm"]))
    if grid.sd_nm.shape != (grid.y_nm.size, grid.x_nm.size):
        raise ValueError("the error's grid")
    regions = tuple(
        tuple(int(edge) for edge in content[name])
        for name in ("first_region_px", "second_region_px")
    )
    numbers = {
        name: float(content[name])
        for name in (
            *("pixel_size_nm", "target_error_nm", "bead_noise_nm", "systematic_nm"),
            "jitter_nm",
        )
    }
    return Registration(
        mapping=map_from_dict(content["map"]),
        regions=regions,  # type: ignore[arg-type]
        beads=beads,
        errors=grid,
        mirror=str(content["mirror"]),
        **numbers,
    )


def _array(values: Any, width: int = 0) -> Floats:
    array = np.array(values, np.float64)
    if not np.isfinite(array).all() or (width == 2 and array.shape[1:] != (2,)):
        raise ValueError("numbers are missing")
    return array


def _unusable(path: Path, what: str) -> RegistrationError:
    return RegistrationError(
        "no registration", f"{path} {what}: make it again with `rotortrack register`"
    )


def _within(region: Region, other: Region) -> bool:
    return all(
        other[axis] <= region[axis]
        and region[axis] + region[axis + 2] <= other[axis] + other[axis + 2]
        for axis in (0, 1)
    )


def _told(region: Region) -> str:
    x0, y0, width, height = region
    return f"x {x0} to {x0 + width}, y {y0} to {y0 + height}"


def _readable(content: dict[str, Any]) -> str:
    """Write one line a key, so that people find their way in the file."""
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items()]
    return "{\n" + ",\n".join(lines) + "\n}"
