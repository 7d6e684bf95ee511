"""What stands around a scene: made only where the scene names it, and loaded only then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.optics import Optics
from rotortrack.simulate.film.scene import FilmScene

if TYPE_CHECKING:
    from rotortrack.simulate.film.free_rods import FreeRods
    from rotortrack.simulate.film.illumination import Flicker
    from rotortrack.simulate.film.legs import Drive
    from rotortrack.simulate.film.sensor import Sensor
    from rotortrack.simulate.film.split import Split
    from rotortrack.simulate.film.stage import Stage

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Equipment:
    """Microscope, light and camera of a scene; None is an effect that does not exist.

    Attributes
    ----------
    optics
        One for each colour.
    recorded
        Which frames the camera did not lose, shape (n_frames,).
    """

    optics: tuple[Optics, ...]
    drive: Drive | None
    stage: Stage | None
    flicker: Flicker | None
    free_rods: FreeRods | None
    split: Split | None
    sensor: Sensor | None
    recorded: NDArray[np.bool_] | None


def clock_of(scene: FilmScene) -> Clock:
    """Tell when the frames of a scene are exposed."""
    film = scene.film
    return Clock(
        n_frames=film.n_frames,
        frame_interval_s=film.frame_interval_s,
        exposure_s=film.exposure_s or 0.0,
        line_time_s=0.0 if scene.rolling_shutter is None else scene.rolling_shutter.line_time_s,
    )


def equip(scene: FilmScene, clock: Clock) -> Equipment:
    """Set up what the scene names.

    Raises
    ------
    ConfigurationError, CameraError
        A value or a file cannot be used.
    """
    drive = stage = flicker = free_rods = split = sensor = recorded = None
    film = scene.film
    pixel_nm, seed = film.pixel_size_nm, film.seed
    optics = [Optics(scene.psf, pixel_nm)]
    if scene.split is not None:
        from rotortrack.simulate.film.split import Split

        split = Split(scene.split, (film.height_px, film.width_px), pixel_nm)
        optics.append(Optics(scene.psf, pixel_nm, scene.split.sigma_ratio))
    if scene.voltage is not None:
        from rotortrack.simulate.film.legs import Drive

        drive = Drive.from_options(scene.voltage)
    if scene.drift is not None or scene.vibration is not None:
        from rotortrack.simulate.film.stage import Stage

        stage = Stage(scene.drift, scene.vibration, clock, seed)
    if scene.flicker is not None:
        from rotortrack.simulate.film.illumination import Flicker

        flicker = Flicker(scene.flicker, clock, seed)
    if scene.free_rods is not None:
        from rotortrack.simulate.film.free_rods import FreeRods

        free_rods = FreeRods(scene.free_rods, clock, scene.field_px, pixel_nm, seed)
    if scene.camera is not None:
        from rotortrack.simulate.film.sensor import Sensor

        sensor = Sensor(
            scene.camera,
            film.height_px,
            film.width_px,
            seed,
            pixel_maps=scene.pixel_maps,
            hot_pixels=scene.hot_pixels,
            column_noise=scene.column_noise,
        )
    if scene.dropped is not None:
        from rotortrack.simulate.film.recording import recorded_frames

        recorded = recorded_frames(scene.dropped, clock, seed)
    return Equipment(
        optics=tuple(optics),
        drive=drive,
        stage=stage,
        flicker=flicker,
        free_rods=free_rods,
        split=split,
        sensor=sensor,
        recorded=recorded,
    )


def still_light(scene: FilmScene) -> Floats:
    """Draw the background of one colour under the laser, photons, shape of the field."""
    film, shape_px = scene.film, scene.field_px
    if scene.background is None:
        return np.zeros(shape_px)
    from rotortrack.simulate.film.illumination import background_image, laser_map

    image = background_image(scene.background, shape_px, film.pixel_size_nm, film.seed)
    if scene.laser is not None:
        image = image * laser_map(scene.laser, shape_px, film.pixel_size_nm)
    return image
