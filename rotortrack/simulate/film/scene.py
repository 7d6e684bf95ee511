"""The part of a scene that is filmed, and what in it contradicts itself."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from rotortrack.settings import Options
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.options import (
    BackgroundOptions,
    BleachingOptions,
    BlinkingOptions,
    ColumnNoiseOptions,
    DriftOptions,
    DroppedOptions,
    DyesOptions,
    FiducialsOptions,
    FilmOptions,
    FlickerOptions,
    FreeRodsOptions,
    HotPixelsOptions,
    LaserOptions,
    LatticeOptions,
    PixelMapsOptions,
    PsfOptions,
    RollingShutterOptions,
    RotorsOptions,
    SensorOptions,
    SplitOptions,
    TimestampsOptions,
    VibrationOptions,
    VoltageOptions,
)

FILM_SECTIONS: dict[str, type[Options]] = {
    "film": FilmOptions,
    "lattice": LatticeOptions,
    "voltage": VoltageOptions,
    "dyes": DyesOptions,
    "bleaching": BleachingOptions,
    "blinking": BlinkingOptions,
    "background": BackgroundOptions,
    "laser": LaserOptions,
    "flicker": FlickerOptions,
    "psf": PsfOptions,
    "drift": DriftOptions,
    "vibration": VibrationOptions,
    "free_rods": FreeRodsOptions,
    "split": SplitOptions,
    "fiducials": FiducialsOptions,
    "camera": SensorOptions,
    "pixel_maps": PixelMapsOptions,
    "hot_pixels": HotPixelsOptions,
    "column_noise": ColumnNoiseOptions,
    "rolling_shutter": RollingShutterOptions,
    "dropped": DroppedOptions,
    "timestamps": TimestampsOptions,
}
"""Option class of each section; [[rotors]] stands beside them, as often as wanted."""

_NEEDS = {
    "lattice": ("rotors",),
    "dyes": ("rotors",),
    "bleaching": ("rotors",),
    "blinking": ("rotors",),
    "voltage": ("rotors",),
    "fiducials": ("split",),
    "pixel_maps": ("camera",),
    "hot_pixels": ("camera",),
    "column_noise": ("camera",),
}
"""Effects that need another."""

_TRIGGER_SAMPLES = 2
"""Samples of the trigger that each of its pulses needs at least."""

_OF_ONE_KIND = {
    "switch_rate_per_s": ("switching", "two_position"),
    "wobble_sd_rad": ("two_position", "tethered"),
    "arc_deg": ("arc",),
    "omega_rad_s": ("driven", "switching"),
    "table": ("table",),
}
"""Options that only some motions have a use for."""

_NOT_OF_TABLES = (
    *("count", "x_nm", "y_nm", "shape", "radius_nm", "ends", "diffusion_rad2_s", "start_deg"),
    *("arrive_s", "leave_s", "second_after_s", "breathing_sd_nm"),
)
"""Options for which rotors of a table have no use."""

_OF_SECOND_ENDS = ("second_radius_nm", "second_phase_deg", "second_photons")
_OF_CIRCLES = ("radius_nm", "second_radius_nm", "second_phase_deg")

_OF_THE_OTHER_MODEL = {
    "airy": ("gaussian", ("sigma_nm", "defocus_nm", "depth_nm", "astigmatism_nm")),
    "gaussian": ("airy", ("wavelength_nm", "numerical_aperture")),
}
"""Options of [psf] that its model has no use for, and whose they are."""


@dataclass(frozen=True, kw_only=True)
class FilmScene:
    """What is filmed; None is an effect that does not exist.

    Attributes
    ----------
    film
        Size and length.
    rotors
        Groups of rotors.
    lattice, ..., timestamps
        Options of each section of `FILM_SECTIONS`.

    Raises
    ------
    ConfigurationError
        By :meth:`mistakes`, which the reader of scenes lists together with those of all sections.
    """

    film: FilmOptions
    rotors: tuple[RotorsOptions, ...] = ()
    lattice: LatticeOptions | None = None
    voltage: VoltageOptions | None = None
    dyes: DyesOptions | None = None
    bleaching: BleachingOptions | None = None
    blinking: BlinkingOptions | None = None
    background: BackgroundOptions | None = None
    laser: LaserOptions | None = None
    flicker: FlickerOptions | None = None
    psf: PsfOptions | None = None
    drift: DriftOptions | None = None
    vibration: VibrationOptions | None = None
    free_rods: FreeRodsOptions | None = None
    split: SplitOptions | None = None
    fiducials: FiducialsOptions | None = None
    camera: SensorOptions | None = None
    pixel_maps: PixelMapsOptions | None = None
    hot_pixels: HotPixelsOptions | None = None
    column_noise: ColumnNoiseOptions | None = None
    rolling_shutter: RollingShutterOptions | None = None
    dropped: DroppedOptions | None = None
    timestamps: TimestampsOptions | None = None

    @property
    def field_px(self) -> tuple[int, int]:
        """Height and width of one colour's image."""
        height, width = self.film.height_px, self.film.width_px
        if self.split is None:
            return height, width
        if self.split.layout == "left-right":
            return height, width // 2
        return height // 2, width

    @property
    def names(self) -> tuple[str, ...]:
        """Sections that the scene has beside [film], in the order of the film's making."""
        named = [name for name in FILM_SECTIONS if name != "film" and getattr(self, name)]
        return (*(("rotors",) if self.rotors else ()), *named)

    def without(self, name: str) -> FilmScene:
        """Leave an effect out, and those that need it.

        Parameters
        ----------
        name
            One of `names`.
        """
        gone = {name, *(effect for effect, needed in _NEEDS.items() if name in needed)}
        changes: dict[str, Any] = {effect: None for effect in gone if effect != "rotors"}
        if "rotors" in gone:
            changes["rotors"] = ()
        if "split" in gone:
            # Without it there is no second colour.
            changes["rotors"] = tuple(replace(group, ends=1) for group in self.rotors)
        return replace(self, **changes)

    def mistakes(self, named: Collection[str] = ()) -> Iterator[str]:
        """Tell what contradicts itself, sentence by sentence.

        Parameters
        ----------
        named
            Sections of the scene beside those here: [rod], [field], and such as are None because
            they hold mistakes of their own.
        """
        for name, needed in _NEEDS.items():
            for other in needed:
                if getattr(self, name) and not (getattr(self, other) or other in named):
                    brackets = f"[[{other}]]" if other == "rotors" else f"[{other}]"
                    yield f"[{name}] needs {brackets}: add it, or leave [{name}] out"
        yield from self._mistakes_of_time()
        yield from self._mistakes_of_light()
        for number, group in enumerate(self.rotors, 1):
            for mistake in self._mistakes_of(group, named):
                yield f"[rotors {number}] {mistake}"

    def _mistakes_of_time(self) -> Iterator[str]:
        film = self.film
        if (film.exposure_s or 0.0) > film.frame_interval_s * (1.0 + 1e-9):
            yield "[film] exposure_s is longer than frame_interval_s"
        if self.rolling_shutter is not None:
            readout_s = self.rolling_shutter.line_time_s * film.height_px
            if readout_s > film.frame_interval_s * (1.0 + 1e-9):
                yield (
                    f"[rolling_shutter] line_time_s: {film.height_px} rows take {readout_s:g} s, "
                    f"longer than frame_interval_s of {film.frame_interval_s:g}"
                )
        if self.voltage is not None:
            times = self.voltage.times_s
            if len(times) != len(self.voltage.voltages_mv) or not times:
                yield (
                    f"[voltage] has {len(times)} times_s and {len(self.voltage.voltages_mv)} "
                    "voltages_mv: give as many"
                )
            if any(after <= before for before, after in itertools.pairwise(times)):
                yield "[voltage] times_s do not ascend"
            if times and times[0] != 0.0:
                yield "[voltage] times_s do not begin with 0"
            trigger_s = Clock(
                film.n_frames, film.frame_interval_s, film.exposure_s or 0.0
            ).trigger_s
            if self.voltage.sample_hz * trigger_s < _TRIGGER_SAMPLES:
                yield (
                    f"[voltage] sample_hz: the trigger is high for {trigger_s:g} s a frame and "
                    f"would be missed: give at least {_TRIGGER_SAMPLES / trigger_s:g}"
                )
            if not self.voltage.reference_mv:
                yield "[voltage] reference_mv must not be 0"
        if self.dropped is not None:
            late = [frame for frame in self.dropped.frames if frame >= film.n_frames]
            if 0 in self.dropped.frames:
                yield "[dropped] frames: frame 0 cannot be lost, a film begins with a frame"
            if late:
                yield f"[dropped] frames: {late[0]} is beyond the {film.n_frames} frames"

    def _mistakes_of_light(self) -> Iterator[str]:
        if self.dyes is not None:
            for name in ("counts", "lengths_nm"):
                if len(getattr(self.dyes, name)) != 2:
                    yield f"[dyes] {name} must be two numbers, of the first and the second end"
        if self.psf is not None:
            other, names = _OF_THE_OTHER_MODEL[self.psf.model]
            for name in _given(self.psf, names):
                yield f"[psf] {name} belongs to the model {other}"
        if self.camera is not None and self.camera.camera_maps and self.pixel_maps is not None:
            yield "[pixel_maps] makes maps, but [camera] camera_maps has some: keep one of them"
        if self.split is not None:
            side = "width_px" if self.split.layout == "left-right" else "height_px"
            if getattr(self.film, side) % 2:
                yield f"[film] {side} must be even, to be split"

    def _mistakes_of(self, group: RotorsOptions, named: Collection[str]) -> Iterator[str]:
        for name in _given(group, _OF_ONE_KIND):
            motions = _OF_ONE_KIND[name]
            if group.motion not in motions:
                yield f"{name} belongs to motion {' and '.join(motions)}, not to {group.motion}"
        if group.motion == "table":
            if group.table is None:
                yield "motion table needs table: name a file"
            for name in _given(group, _NOT_OF_TABLES):
                yield f"{name} has no use for motion table: the table tells where rotors are"
        elif group.motion != "stuck" and group.motion not in ("driven", "switching"):
            least = group.diffusion_rad2_s
            if (least[0] if isinstance(least, tuple) else least) <= 0.0:
                yield f"diffusion_rad2_s must be above 0 for motion {group.motion}"
        if group.ends == 1:
            for name in _given(group, _OF_SECOND_ENDS):
                yield f"{name} belongs to ends = 2"
        if group.shape != "circle":
            for name in _given(group, _OF_CIRCLES):
                yield f"{name} belongs to shape circle: a rod tells where its ends are"
        if group.shape == "rod":
            for name in ("rod", "field"):
                if name not in named:
                    yield f"shape rod needs [{name}]: add it"
        if group.own_rate and (group.shape == "circle" or group.motion != "driven"):
            yield "own_rate needs motion driven and the shape of a rod"
        if group.ends == 2 and self.split is None and "split" not in named:
            yield "ends = 2 needs [split], where the second colour is seen"
        yield from self._mistakes_of_places(group)

    def _mistakes_of_places(self, group: RotorsOptions) -> Iterator[str]:
        if len(group.x_nm) != len(group.y_nm):
            yield f"x_nm has {len(group.x_nm)} values, y_nm {len(group.y_nm)}: give as many"
            return
        if group.x_nm and group.count not in (None, len(group.x_nm)):
            yield f"count is {group.count}, but {len(group.x_nm)} places are given"
        height, width = (side * self.film.pixel_size_nm for side in self.field_px)
        for x_nm, y_nm in zip(group.x_nm, group.y_nm, strict=True):
            if not (0.0 <= x_nm <= width and 0.0 <= y_nm <= height):
                yield (
                    f"the pore at ({x_nm:g}, {y_nm:g}) nm is outside the frame of "
                    f"{width:.0f} x {height:.0f} nm"
                )
        if group.leave_s is not None and _least(group.leave_s) <= _most(group.arrive_s):
            yield "leave_s must be after arrive_s"


def _given(options: Options, names: Iterable[str]) -> list[str]:
    """Say which options have another value than their default."""
    defaults = type(options)()
    return [name for name in names if getattr(options, name) != getattr(defaults, name)]


def _least(value: Any) -> float:
    return float(value[0]) if isinstance(value, tuple) else float(value)


def _most(value: Any) -> float:
    return float(value[1]) if isinstance(value, tuple) else float(value)


def within(value: Any, part: float, *, logarithmic: bool = False) -> float:
    """Give the value at a part from 0 to 1 of a range [low, high]; a number stands for itself."""
    if not isinstance(value, tuple):
        return float(value)
    low, high = value
    if logarithmic and low > 0.0:
        return float(math.exp(math.log(low) + part * (math.log(high) - math.log(low))))
    return float(low + part * (high - low))
