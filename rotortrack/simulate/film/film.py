"""Film a scene block by block, and tell what is true in it.

What follows time (motion, bleaching, drift, flicker) goes on in one thread, in order; rendering and
noise, which are most of the work, run in as many threads as wanted. Neither the number of threads
nor the size of the blocks changes a pixel.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotortrack import parallel
from rotortrack.simulate.film.actors import Light, RotorActor
from rotortrack.simulate.film.equipment import clock_of, equip, still_light
from rotortrack.simulate.film.optics import Spots
from rotortrack.simulate.film.population import draw_rotors
from rotortrack.simulate.film.rotor import Rotor
from rotortrack.simulate.film.scene import FilmScene

if TYPE_CHECKING:
    from rotortrack.simulate.film.sensor import Sensor
    from rotortrack.simulate.film.shapes import Shape
    from rotortrack.simulate.film.split import Split
    from rotortrack.simulate.film.table_motion import TableActor

Floats = NDArray[np.float64]

BLOCK_FRAMES = 64
_BLOCK_BYTES = 64_000_000
_PARTS_OF_A_SWING = 12


@dataclass(frozen=True)
class Seen:
    """An emitter of a rotor as it stands on the sensor: what the truth tells of it.

    Attributes
    ----------
    rotor, end, channel
        Whose light it is.
    x_nm, y_nm
        Averaged over each exposure, on the sensor, with drift; shape (n,).
    first_x_nm, first_y_nm
        The same in coordinates of the first colour.
    theta_rad, photons
        Angle averaged over the exposure; expected photons; shape (n,).
    """

    rotor: int
    end: int
    channel: int
    x_nm: Floats
    y_nm: Floats
    first_x_nm: Floats
    first_y_nm: Floats
    theta_rad: Floats
    photons: Floats


@dataclass(frozen=True)
class _Job:
    """What a thread needs to make the frames of one block."""

    first: int
    n: int
    spots: Sequence[Sequence[Spots]]
    flicker: Floats | None
    keep: NDArray[np.bool_] | None


class Film:
    """A scene in front of a running camera; its blocks are made once, in order.

    Parameters
    ----------
    scene
        What is filmed.
    shapes
        For each group of rotors the rods among which they choose; empty for circles.
    block_frames
        Frames made at a time; absent, what 64 MB hold, at most `BLOCK_FRAMES`.
    n_frames
        Frames made before it is stopped; absent, all.

    Attributes
    ----------
    rotors
        What was drawn.
    clock
        When frames are exposed.
    drift_nm
        The stage's place in each frame so far made, one (n, 2) array a block; empty without drift.

    Raises
    ------
    ConfigurationError
        The scene has no room for its rotors, or asks for what cannot be.
    """

    def __init__(
        self,
        scene: FilmScene,
        shapes: Sequence[Sequence[Shape]] = (),
        *,
        block_frames: int | None = None,
        n_frames: int | None = None,
    ) -> None:
        film = scene.film
        self.scene = scene
        self.clock = clock_of(scene)
        self._n_frames = film.n_frames if n_frames is None else min(n_frames, film.n_frames)
        image_bytes = 8 * film.height_px * film.width_px
        self._block = block_frames or max(1, min(BLOCK_FRAMES, _BLOCK_BYTES // image_bytes))
        self._equipment = equip(scene, self.clock)
        self.rotors = draw_rotors(scene, shapes or [()] * len(scene.rotors))
        self._actors = [
            RotorActor(rotor, scene, self.clock, self._equipment.drive, self._rows(rotor))
            for rotor in self.rotors
        ]
        self._tables = self._read_tables()
        self.drift_nm: list[Floats] = []
        self._base = self._make_base()

    @property
    def sensor(self) -> Sensor | None:
        """The camera; None without one: the film then holds expected photons as float32."""
        return self._equipment.sensor

    @property
    def recorded(self) -> NDArray[np.bool_] | None:
        """Which frames the camera did not lose, shape (n_frames,); None where it lost none."""
        return self._equipment.recorded

    @property
    def largest_drive(self) -> float:
        """Largest factor in magnitude by which the scene's voltage changes all speeds."""
        return 1.0 if self._equipment.drive is None else self._equipment.drive.largest

    @property
    def split(self) -> Split:
        """The second colour's optics, of a scene that has [split]."""
        assert self._equipment.split is not None
        return self._equipment.split

    def fiducials(self) -> tuple[Floats, Floats, Floats]:
        """Give the grid of a scene with [fiducials], by `fiducials.fiducial_points`."""
        from rotortrack.simulate.film.fiducials import fiducial_points

        assert self.scene.fiducials is not None
        film = self.scene.film
        return fiducial_points(
            self.scene.fiducials, self.scene.field_px, film.pixel_size_nm, film.seed
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Recorded frames, height and width."""
        film = self.scene.film
        kept = self._equipment.recorded
        n_frames = self._n_frames if kept is None else int(kept[: self._n_frames].sum())
        return n_frames, film.height_px, film.width_px

    def realised_rad_s(self) -> list[float]:
        """Mean speed of each rotor so far."""
        known = [actor.realised_rad_s for actor in self._actors]
        return known + [math.nan] * (len(self.rotors) - len(known))

    def blocks(
        self,
        *,
        workers: int = 1,
        see: Callable[[int, list[Seen]], None] | None = None,
    ) -> Iterator[NDArray[Any]]:
        """Yield the frames, (n, height, width): counts, or photons without a camera.

        Parameters
        ----------
        workers
            Threads that render.
        see
            Is called with the number of each block's first frame and what is true in the block.
        """
        yield from parallel.map_ordered(self._render, self._jobs(see), workers=workers)

    def _jobs(self, see: Callable[[int, list[Seen]], None] | None) -> Iterator[_Job]:
        n_frames = self._n_frames
        for first in range(0, n_frames, self._block):
            n = min(self._block, n_frames - first)
            lights = [light for actor in self._actors for light in actor.advance(first, n)]
            lights += [light for table in self._tables for light in table.advance(n)]
            lights += self._passing(n)
            stage_nm = None if self._equipment.stage is None else self._equipment.stage.advance(n)
            flicker = (
                None if self._equipment.flicker is None else self._equipment.flicker.advance(n)
            )
            spots: list[list[Spots]] = [[] for _ in self._equipment.optics]
            seen = []
            for light in lights:
                told = self._image(light, first, n, stage_nm, spots)
                if light.rotor >= 0 and see is not None:
                    seen.append(_flickering(told, flicker, n))
            if stage_nm is not None:
                self.drift_nm.append(stage_nm)
            if see is not None:
                see(first, seen)
            recorded = self._equipment.recorded
            keep = None if recorded is None else recorded[first : first + n]
            yield _Job(first, n, spots, flicker, keep)

    def _image(
        self,
        light: Light,
        first: int,
        n: int,
        stage_nm: Floats | None,
        spots: list[list[Spots]],
    ) -> Seen:
        """Add an emitter's images in every colour to `spots`."""
        x_nm, y_nm, photons = light.x_nm, light.y_nm, light.photons
        if stage_nm is not None:
            x_nm, y_nm = x_nm + stage_nm[:, :1], y_nm + stage_nm[:, 1:]
        if self.scene.vibration is not None and self._equipment.stage is not None:
            # What moves slowly has few parts, too few for the vibration.
            finer = self._vibration_parts // x_nm.shape[1] + 1
            x_nm, y_nm = np.repeat(x_nm, finer, axis=1), np.repeat(y_nm, finer, axis=1)
            moved = self._equipment.stage.vibration_nm(
                self._times_s(first, n, x_nm.shape[1]), self.clock.exposure_s / x_nm.shape[1]
            )
            assert moved is not None
            x_nm, y_nm = x_nm + moved[0], y_nm + moved[1]
        if self.scene.laser is not None:
            photons = photons * self._laser_at(x_nm.mean(axis=1), y_nm.mean(axis=1))
        places = [(x_nm, y_nm)]
        if self._equipment.split is not None:
            places.append(self._equipment.split.to_second(x_nm, y_nm))
        for channel, share in self._shares(light.channel):
            at_x, at_y = places[channel]
            origin_x, origin_y = self._origin_nm(channel)
            spots[channel].append(Spots(at_x - origin_x, at_y - origin_y, share * photons))
        own_x, own_y = places[light.channel]
        return Seen(
            rotor=light.rotor,
            end=light.end,
            channel=light.channel,
            x_nm=own_x.mean(axis=1),
            y_nm=own_y.mean(axis=1),
            first_x_nm=x_nm.mean(axis=1),
            first_y_nm=y_nm.mean(axis=1),
            theta_rad=np.zeros(1) if light.theta_rad is None else light.theta_rad,
            photons=photons,
        )

    def _render(self, job: _Job) -> NDArray[Any]:
        """Make the frames of one block."""
        halves = []
        for base, optics, spots in zip(self._base, self._equipment.optics, job.spots, strict=True):
            images = np.repeat(base[np.newaxis], job.n, axis=0)
            for emitter in spots:
                optics.add(images, emitter)
            halves.append(images)
        images = halves[0]
        if self.scene.split is not None:
            axis = 2 if self.scene.split.layout == "left-right" else 1
            images = np.concatenate(halves, axis=axis)
        if job.flicker is not None:
            images *= job.flicker[:, np.newaxis, np.newaxis]
        frames: NDArray[Any]
        if self._equipment.sensor is None:
            frames = images.astype(np.float32)
        else:
            frames = self._equipment.sensor.expose(images, job.first)
        return frames if job.keep is None else frames[job.keep]

    @property
    def _vibration_parts(self) -> int:
        """Parts of an exposure that follow the vibration."""
        assert self.scene.vibration is not None
        swings = self.scene.vibration.frequency_hz * self.clock.exposure_s
        return int(_PARTS_OF_A_SWING * swings)

    def _times_s(self, first: int, n: int, parts: int) -> Floats:
        """Middles of the parts of the exposures, shape (n, parts)."""
        clock = self.clock
        begin = np.arange(first, first + n)[:, np.newaxis] * clock.frame_interval_s
        times: Floats = begin + (np.arange(parts) + 0.5) * (clock.exposure_s / parts)
        return times

    def _shares(self, channel: int) -> list[tuple[int, float]]:
        """Colours in which an emitter is seen, with the part of its light."""
        if self.scene.split is None:
            return [(0, 1.0)]
        leak = self.scene.split.crosstalk[channel]
        return [(channel, 1.0 - leak), *([(1 - channel, leak)] if leak else [])]

    def _origin_nm(self, channel: int) -> tuple[float, float]:
        """Corner of a colour's half of the sensor."""
        split, film = self.scene.split, self.scene.film
        if split is None or channel == 0:
            return 0.0, 0.0
        height, width = self.scene.field_px
        if split.layout == "left-right":
            return width * film.pixel_size_nm, 0.0
        return 0.0, height * film.pixel_size_nm

    def _read_tables(self) -> list[TableActor]:
        """Read the places of rotors that move by a table, and count them among the others."""
        tables: list[TableActor] = []
        for group, options in enumerate(self.scene.rotors):
            if options.motion == "table":
                from rotortrack.simulate.film.table_motion import TableActor

                pore = 1 + max((rotor.pore for rotor in self.rotors), default=-1)
                actor = TableActor(self.scene, group, self.clock, len(self.rotors), pore)
                self.rotors = (*self.rotors, *actor.rotors)
                tables.append(actor)
        return tables

    def _passing(self, n: int) -> Iterator[Light]:
        """Give the light of rods that drift by, and of a grid that moves with the stage."""
        if self._equipment.free_rods is not None:
            for x_nm, y_nm, photons in self._equipment.free_rods.advance(n):
                yield Light(x_nm, y_nm, photons, channel=0)
        if self._equipment.stage is not None:
            yield from self._fiducials()

    def _laser_at(self, x_nm: Floats, y_nm: Floats) -> Floats:
        from rotortrack.simulate.film.illumination import laser_at

        assert self.scene.laser is not None
        film = self.scene.film
        return laser_at(self.scene.laser, self.scene.field_px, film.pixel_size_nm, x_nm, y_nm)

    def _rows(self, rotor: Rotor) -> tuple[float, ...]:
        """Rows of the sensor in which the ends of a rotor are seen."""
        below = 0.0
        if self.scene.split is not None and self.scene.split.layout == "top-bottom":
            below = float(self.scene.field_px[0])
        row = rotor.y_nm / self.scene.film.pixel_size_nm
        return tuple(row + below * end.channel for end in rotor.ends)

    def _make_base(self) -> list[Floats]:
        """Draw, once for each colour, what is the same in every frame."""
        image = still_light(self.scene)
        bases = [image.copy() for _ in self._equipment.optics]
        if self._equipment.stage is not None:
            return bases
        for light in self._fiducials():
            spots: list[list[Spots]] = [[] for _ in self._equipment.optics]
            self._image(light, 0, 1, None, spots)
            for base, optics, emitters in zip(bases, self._equipment.optics, spots, strict=True):
                for emitter in emitters:
                    optics.add(base[np.newaxis], emitter)
        return bases

    def _fiducials(self) -> Iterator[Light]:
        """Give the points of a calibration grid, each in both colours."""
        if self.scene.fiducials is not None:
            for x_nm, y_nm, photons in zip(*self.fiducials(), strict=True):
                for channel, light in enumerate(photons):
                    yield Light(np.array([[x_nm]]), np.array([[y_nm]]), np.array([light]), channel)


def _flickering(told: Seen, flicker: Floats | None, n: int) -> Seen:
    """Give every value of the truth for each frame, photons with the light's flicker."""
    values: dict[str, Any] = {
        name: np.broadcast_to(value, n)
        for name, value in vars(told).items()
        if isinstance(value, np.ndarray)
    }
    if flicker is not None:
        values["photons"] = values["photons"] * flicker
    return dataclasses.replace(told, **values)
