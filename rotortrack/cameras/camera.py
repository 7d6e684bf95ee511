"""Counts to photo-electrons and back.

One object serves analysis and simulation, so the two cannot drift apart. Quantum efficiency is
never applied: a photon here is a detected photo-electron.
"""

from __future__ import annotations

import dataclasses
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rotortrack.cameras.hot_pixels import hot_pixels_of
from rotortrack.cameras.maps import read_arrays
from rotortrack.cameras.models import MODELS
from rotortrack.cameras.options import CameraOptions
from rotortrack.errors import CameraError, ConfigurationError, NominalCameraWarning

Number = float | NDArray[np.floating[Any]]
"""One value for all pixels, or a map of shape (y, x)."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera by its offset, gain and read noise; each one number or a map of shape (y, x).

    Parameters
    ----------
    offset_adu
        Counts of a dark pixel, ADU.
    gain_e_per_adu
        Photo-electrons per count.
    read_noise_e
        Read noise, electrons rms.
    saturation_adu
        Largest count; None means the largest that the number type of the counts can hold.
    hot_pixels
        Map of pixels that are too noisy to be searched for spots; their noise counts in the fit.
    dead_pixels
        Map of pixels that tell nothing of the light: without a number, of infinite variance.

    Raises
    ------
    CameraError
        A value is not finite, a gain is not positive, a noise is negative, or maps differ in size.

    Examples
    --------
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> camera = rt.Camera(offset_adu=100.0, gain_e_per_adu=0.5, read_noise_e=1.4)
    >>> camera.to_photons(np.array([[100.0, 300.0]])).tolist()
    [[0.0, 100.0]]
    """

    offset_adu: Number
    gain_e_per_adu: Number
    read_noise_e: Number
    saturation_adu: Number | None = None
    hot_pixels: NDArray[np.bool_] | None = None
    dead_pixels: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        for name, wrong in _FAULTS.items():
            value = getattr(self, name)
            if value is None:
                continue
            array = np.asarray(value, np.float64)
            if array.ndim not in (0, 2) or array.size == 0:
                raise CameraError(
                    f"{name} has shape {array.shape}: give one number or a (y, x) map"
                )
            bad = ~(np.abs(array) < _BEYOND_CAMERAS) | (wrong(array) if wrong else False)
            if np.any(bad):
                raise CameraError(_fault(name, array, bad))
        for name in MASKS:
            mask = getattr(self, name)
            if mask is not None and (np.ndim(mask) != 2 or mask.dtype != np.bool_):
                raise CameraError(f"{name} is no (y, x) map of true and false: give one or none")
        if len(sizes := {size for size in self._sizes().values() if size}) > 1:
            raise CameraError(
                "camera maps differ in size: "
                + ", ".join(
                    f"{name} {size[0]} x {size[1]}" for name, size in self._sizes().items() if size
                )
                + f" (rows x columns, {len(sizes)} sizes): use maps of one calibration"
            )

    @property
    def is_scalar(self) -> bool:
        """Whether one number holds for all pixels."""
        return not any(self._sizes().values())

    @property
    def variance_e2(self) -> Number:
        """Variance of the read noise, electrons squared; infinite where a pixel is dead."""
        variance = self.read_noise_e**2
        if self.dead_pixels is None:
            return variance
        return np.where(self.dead_pixels, np.inf, variance)

    def to_photons(self, counts: NDArray[Any]) -> NDArray[np.float32]:
        """Convert counts of shape (y, x) or (frame, y, x): `(counts - offset) * gain`, float32.

        Computed in float32, so counts above 2**24 lose their last digits. Dead pixels become NaN.

        Raises
        ------
        CameraError
            Maps do not have the size of the frames.
        """
        self.check_fits(*counts.shape[-2:])
        photons: NDArray[np.float32] = np.subtract(
            counts, self.offset_adu, dtype=np.float32, casting="unsafe"
        )
        photons *= np.asarray(self.gain_e_per_adu, np.float32)
        if self.dead_pixels is not None:
            photons[..., self.dead_pixels] = np.nan
        return photons

    def to_counts(
        self,
        photons: NDArray[Any],
        rng: np.random.Generator,
        dtype: DTypeLike = np.uint16,
    ) -> NDArray[Any]:
        """Draw counts for mean photo-electrons of shape (y, x) or (frame, y, x).

        Poisson noise, normal read noise, gain, offset, rounding to whole counts, and clipping to
        the number type and the saturation.

        Parameters
        ----------
        photons
            Expected photo-electrons, not negative.
        rng
            Source of the random numbers.
        dtype
            Number type of the counts.

        Raises
        ------
        CameraError
            Maps do not have the size of the frames, or photons are negative or not finite.
        """
        self.check_fits(*photons.shape[-2:])
        if not np.all((photons >= 0) & (photons < np.inf)):
            raise CameraError("expected photons must be finite and not negative")
        electrons = rng.poisson(photons) + rng.normal(size=photons.shape) * self.read_noise_e
        counts = np.rint(electrons / self.gain_e_per_adu + self.offset_adu)
        kind = np.dtype(dtype)
        if kind.kind in "iu":
            counts = np.clip(counts, np.iinfo(kind).min, np.iinfo(kind).max)
        if self.saturation_adu is not None:
            counts = np.minimum(counts, self.saturation_adu)
        return counts.astype(kind)

    def crop(self, x0: int, y0: int, width: int, height: int) -> Camera:
        """Cut maps to a region of the sensor; numbers stay.

        Raises
        ------
        CameraError
            The region leaves the maps.
        """
        changes = {}
        for name, size in self._sizes().items():
            if size is None:
                continue
            if min(x0, y0) < 0 or y0 + height > size[0] or x0 + width > size[1]:
                raise CameraError(
                    f"{name} has {size[1]} x {size[0]} pixels, the region x {x0} to {x0 + width}, "
                    f"y {y0} to {y0 + height} leaves it: use maps of the whole sensor"
                )
            changes[name] = getattr(self, name)[y0 : y0 + height, x0 : x0 + width]
        return dataclasses.replace(self, **changes)

    def check_fits(self, height: int, width: int) -> None:
        """Refuse frames of another size than the maps.

        Raises
        ------
        CameraError
            Names both sizes.
        """
        for name, size in self._sizes().items():
            if size is not None and size != (height, width):
                raise CameraError(
                    f"{name} has {size[1]} x {size[0]} pixels (width x height) but the frames "
                    f"{width} x {height}: use maps of the region that was recorded"
                )

    def _sizes(self) -> dict[str, tuple[int, int] | None]:
        """Sizes (y, x) of the values that are maps."""
        return {
            name: (np.shape(value)[0], np.shape(value)[1]) if np.ndim(value) else None
            for name in (*_FAULTS, *MASKS)
            if (value := getattr(self, name)) is not None
        }


def camera_from_options(options: CameraOptions) -> Camera:
    """Make the camera that the options describe.

    Three numbers, or maps, or a nominal model; a number that is given stands before the same value
    of maps or model. Maps of read noise without a map of hot pixels tell them by
    :func:`rotortrack.cameras.hot_pixels.hot_pixels_of`.

    Raises
    ------
    ConfigurationError
        Values that are nowhere given, all at once; an unknown model; maps together with a model.
    CameraError
        The file of maps cannot be read, lacks arrays or holds impossible values.

    Warns
    -----
    NominalCameraWarning
        The values are a maker's.
    """
    given = {name: value for name in _FAULTS if (value := getattr(options, name)) is not None}
    if options.camera_maps is not None and options.camera_model is not None:
        raise ConfigurationError(
            "camera_maps and camera_model are both given: keep the one that is true"
        )
    if options.camera_maps is not None:
        path = Path(options.camera_maps)
        values = {**load_maps(path), **given}
        missing = [name for name in _NEEDED if name not in values]
        if missing:
            raise CameraError(
                f"{path} lacks {', '.join(missing)}: save arrays of these names with numpy.savez, "
                f"or give {', '.join(map(_flag, missing))}"
            )
        if "hot_pixels" not in values and np.ndim(values["read_noise_e"]) == 2:
            values["hot_pixels"] = hot_pixels_of(values["read_noise_e"])
        try:
            return Camera(**values)
        except CameraError as error:
            raise CameraError(f"{path}: {error}") from error
    values = {**_model_values(options.camera_model), **given}
    missing = [name for name in _NEEDED if name not in values]
    if missing:
        raise ConfigurationError(
            *(f"{name} is not known: give {_flag(name)}" for name in missing),
            "instead of numbers, --camera-maps gives measured maps and --camera-model nominal "
            f"values of a known camera ({', '.join(MODELS)})",
        )
    return Camera(**values)


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _model_values(name: str | None) -> dict[str, Any]:
    if name is None:
        return {}
    model = MODELS.get(name.strip().lower())
    if model is None:
        raise ConfigurationError(
            f"camera_model {name!r} is not known: known are {', '.join(MODELS)}"
        )
    warnings.warn(
        f"{model.description}: offset {model.offset_adu:g} ADU, gain {model.gain_e_per_adu:g} "
        f"electrons per ADU and read noise {model.read_noise_e:g} electrons are not those of your "
        "camera: measure them, or see what `rotortrack info` finds",
        NominalCameraWarning,
        stacklevel=3,
    )
    return {field: getattr(model, field) for field in _FAULTS}


def load_maps(path: Path) -> dict[str, Any]:
    """Load the arrays that a camera has; pickled objects are never loaded.

    Parameters
    ----------
    path
        An npz file.

    Returns
    -------
    dict
        `offset_adu`, `gain_e_per_adu`, `read_noise_e` and `saturation_adu`, those that are there,
        each a float64 number or array; `hot_pixels` and `dead_pixels` as maps of true and false.

    Raises
    ------
    CameraError
        The file cannot be read as arrays by name, or one of them holds no numbers or is larger than
        a camera.
    """
    values: dict[str, Any] = dict(read_arrays(path, (*_FAULTS, *MASKS), masks=MASKS))
    for name in MASKS:
        if name in values:
            if np.ndim(values[name]) != 2 or not np.isin(values[name], (0, 1)).all():
                raise CameraError(f"{path}: {name} is no (y, x) map of 0 and 1: save it as one")
            values[name] = values[name] == 1
    return values


def _not_positive(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    return values <= 0


def _negative(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    return values < 0


_BEYOND_CAMERAS = 1e15
"""Photons are float32; products of numbers below this do not overflow there."""

_FAULTS = {
    "offset_adu": None,
    "gain_e_per_adu": _not_positive,
    "read_noise_e": _negative,
    "saturation_adu": _not_positive,
}
MASKS = ("hot_pixels", "dead_pixels")
"""Maps that tell of pixels apart."""

_NEEDED = ("offset_adu", "gain_e_per_adu", "read_noise_e")


def _fault(name: str, values: NDArray[np.float64], bad: NDArray[np.bool_]) -> str:
    if not values.ndim:
        return f"{name} is {values:g}: give a finite number that a camera can have"
    row, column = np.argwhere(bad)[0]
    return (
        f"{name} is {values[row, column]:g} at row {row}, column {column} ({bad.sum()} of "
        f"{bad.size} pixels are wrong): calibrate anew, or replace them by their neighbours' values"
    )
