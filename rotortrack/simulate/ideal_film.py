"""Film an ideal scene: frames on demand, and tables of what is true in them.

Every effect draws from its own random stream, numbered by rotor or frame. So frames do not depend
on the order or the blocks in which they are asked for, adding one effect changes no other, and an
effect that the scene does not name draws nothing.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import DTypeLike, NDArray

from rotortrack.cameras.camera import Camera
from rotortrack.movies.metadata import Value
from rotortrack.movies.movie import Frames, Movie, check_range
from rotortrack.simulate.ideal import IdealRotor, IdealScene
from rotortrack.simulate.ideal_motion import exposure_angles, exposure_inward
from rotortrack.simulate.psf import add_windows, spot_images, window_corner, window_size

BLOCK_FRAMES = 128


class _Stream(enum.IntEnum):
    """First number of a random stream's key; the second is the rotor or the frame."""

    MOTION = 0
    DARK = 1
    CAMERA = 2


@dataclass(frozen=True)
class _FilmedRotor:
    """A rotor with its angles, shape (n_frames or 1, parts), and the frames in which it is lit."""

    rotor: IdealRotor
    angles: NDArray[np.float64]
    lit: NDArray[np.bool_] | None
    inward: float

    def places_nm(
        self, frames: slice, drift_nm: NDArray[np.float64] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where the spot is during the parts of each exposure: x and y, (n or 1, parts)."""
        angles = self.angles if self.angles.shape[0] == 1 else self.angles[frames]
        radius_nm = self.inward * self.rotor.radius_nm
        x_nm = self.rotor.x_nm + radius_nm * np.cos(angles)
        y_nm = self.rotor.y_nm - radius_nm * np.sin(angles)
        if drift_nm is not None:
            x_nm = x_nm + drift_nm[frames, :1]
            y_nm = y_nm + drift_nm[frames, 1:]
        return x_nm, y_nm


class IdealFilm(Movie):
    """A movie of an ideal scene, rendered when frames are asked for.

    Made by :func:`film`. Memory is that of `block_frames` frames and of the rotors' angles.

    Attributes
    ----------
    shape
        Frames, height, width.
    truth_spots
        One row a frame and rotor, by frame: `frame, rotor, x_nm, y_nm` (averaged over the exposure,
        drift included), `theta_rad` (averaged over the exposure, not wrapped), `photons` (expected;
        0 in a dark frame).
    truth_rotors
        One row a rotor: `rotor, kind, x_nm, y_nm, radius_nm, omega_rad_s, diffusion_rad2_s,
        photons`, positions without drift.
    """

    def __init__(
        self,
        scene: IdealScene,
        camera: Camera,
        entropy: int,
        *,
        block_frames: int = BLOCK_FRAMES,
        dtype: DTypeLike = np.uint16,
    ) -> None:
        camera.check_fits(*scene.shape_px)
        self.scene = scene
        self.camera = camera
        self.block_frames = block_frames
        self.shape = (scene.n_frames, *scene.shape_px)
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self.path = None
        self.paths = ()
        self.notes = ()
        self.missing_frames = 0
        self.times_s = None
        self.numbers = None
        self.origin_px = (0, 0)
        self.first_frame = 0
        self.metadata = {
            name: Value(getattr(scene, name), "simulation")
            for name in ("pixel_size_nm", "frame_interval_s", "exposure_s")
        }
        self._entropy = entropy
        self._drift_nm = scene.drift_by_frame_nm()
        self._rotors = [self._filmed(number) for number in range(len(scene.rotors))]

    def frames(self, start: int, stop: int) -> Frames:
        """Return frames `start` to `stop` (exclusive) in counts, shape (n, height, width)."""
        check_range(start, stop, self)
        counts = np.empty((stop - start, *self.shape[1:]), dtype=self.dtype)
        for first in range(start, stop, self.block_frames):
            photons = self.expected_photons(first, min(first + self.block_frames, stop))
            for frame, image in enumerate(photons, first):
                noise = self._stream(_Stream.CAMERA, frame)
                counts[frame - start] = self.camera.to_counts(image, noise, self.dtype)
        return counts

    def blocks(self) -> Iterator[Frames]:
        """Yield all frames in order, `block_frames` at a time."""
        n_frames = self.shape[0]
        for start in range(0, n_frames, self.block_frames):
            yield self.frames(start, min(start + self.block_frames, n_frames))

    def expected_photons(self, start: int, stop: int) -> NDArray[np.float64]:
        """Return the noise-free frames `start` to `stop`: expected photo-electrons per pixel."""
        check_range(start, stop, self)
        frames = np.empty((stop - start, *self.shape[1:]))
        frames[:] = self._still_image
        for filmed in self._rotors:
            if not self._is_still(filmed):
                self._draw(frames, filmed, slice(start, stop))
        return frames

    def reopen(self) -> IdealFilm:
        """Return the film itself: rendering changes no state, so workers may share it."""
        return self

    def close(self) -> None:
        """Do nothing: a film holds no file."""

    @cached_property
    def truth_spots(self) -> pd.DataFrame:
        """Where each rotor's spot truly is in each frame, averaged over the exposure."""
        n_frames, n_rotors = self.shape[0], len(self._rotors)
        truth = np.empty((4, n_frames, n_rotors))
        for number, filmed in enumerate(self._rotors):
            x_nm, y_nm = filmed.places_nm(slice(None), self._drift_nm)
            truth[0, :, number] = x_nm.mean(axis=1)
            truth[1, :, number] = y_nm.mean(axis=1)
            truth[2, :, number] = filmed.angles.mean(axis=1)
            truth[3, :, number] = filmed.rotor.photons
            if filmed.lit is not None:
                truth[3, :, number] *= filmed.lit
        frame, rotor = np.divmod(np.arange(n_frames * n_rotors), max(n_rotors, 1))
        columns = dict(zip(("x_nm", "y_nm", "theta_rad", "photons"), truth, strict=True))
        return pd.DataFrame(
            {"frame": frame, "rotor": rotor}
            | {name: values.ravel() for name, values in columns.items()}
        )

    @cached_property
    def truth_rotors(self) -> pd.DataFrame:
        """What each rotor was asked to do."""
        rotors = self.scene.rotors
        names = ("kind", "x_nm", "y_nm", "radius_nm", "omega_rad_s", "diffusion_rad2_s", "photons")
        return pd.DataFrame(
            {"rotor": np.arange(len(rotors))}
            | {name: [getattr(rotor, name) for rotor in rotors] for name in names}
        )

    @cached_property
    def _still_image(self) -> NDArray[np.float64]:
        """The background and the spots that look the same in every frame, drawn once."""
        image = np.full((1, *self.shape[1:]), float(self.scene.background_photons))
        for filmed in self._rotors:
            if self._is_still(filmed):
                self._draw(image, filmed, slice(0, 1))
        still: NDArray[np.float64] = image[0]
        return still

    def _is_still(self, filmed: _FilmedRotor) -> bool:
        return filmed.angles.shape[0] == 1 and self._drift_nm is None and filmed.lit is None

    def _draw(self, frames: NDArray[np.float64], filmed: _FilmedRotor, which: slice) -> None:
        """Add one rotor's spot to the frames numbered `which`."""
        pixel_nm, rotor = self.scene.pixel_size_nm, filmed.rotor
        sigma_px = self.scene.sigma_nm / pixel_nm
        places_x, places_y = filmed.places_nm(which, self._drift_nm)
        # The window follows the circle's centre and not the spot, so that a frame's pixels do not
        # depend on its neighbours and frames without drift share one window.
        centre_nm = np.array([[rotor.x_nm, rotor.y_nm]])
        if self._drift_nm is not None:
            centre_nm = centre_nm + self._drift_nm[which]
        size = window_size(rotor.radius_nm / pixel_nm, sigma_px)
        corners = window_corner(centre_nm / pixel_nm, size)
        windows = rotor.photons * spot_images(
            places_x / pixel_nm, places_y / pixel_nm, corners[:, 0], corners[:, 1], size, sigma_px
        )
        if filmed.lit is not None:
            windows = windows * filmed.lit[which, np.newaxis, np.newaxis]
        n_frames = frames.shape[0]
        windows = np.broadcast_to(windows, (n_frames, size, size))
        corners = np.broadcast_to(corners, (n_frames, 2))
        add_windows(frames, windows, corners[:, 0], corners[:, 1])

    def _filmed(self, number: int) -> _FilmedRotor:
        """Draw what is random about one rotor, from streams of its own."""
        scene, rotor = self.scene, self.scene.rotors[number]
        angles = exposure_angles(
            rotor,
            n_frames=scene.n_frames,
            frame_interval_s=scene.frame_interval_s,
            exposure_s=scene.exposure_s,
            rng=self._stream(_Stream.MOTION, number),
        )
        lit = None
        if scene.dark_probability:
            draws = self._stream(_Stream.DARK, number).random(scene.n_frames)
            lit = draws >= scene.dark_probability
        return _FilmedRotor(rotor, angles, lit, exposure_inward(rotor, scene.exposure_s))

    def _stream(self, effect: _Stream, number: int) -> np.random.Generator:
        seeds = np.random.SeedSequence(self._entropy, spawn_key=(int(effect), number))
        return np.random.default_rng(seeds)


def film(
    scene: IdealScene,
    camera: Camera,
    rng: np.random.Generator,
    *,
    block_frames: int = BLOCK_FRAMES,
    dtype: DTypeLike = np.uint16,
) -> IdealFilm:
    """Film a scene: the same pixels for the same scene, camera and state of `rng`.

    A frame is the background, plus for each rotor its photons times the pixel-integrated Gaussian
    averaged over the places of the exposure, then :meth:`Camera.to_counts`.

    Parameters
    ----------
    scene
        What is in front of the microscope.
    camera
        Turns photo-electrons into counts, with Poisson and read noise.
    rng
        Source of the film's seed; 16 bytes are drawn from it.
    block_frames
        Frames rendered at a time; bounds the memory and changes no pixel.
    dtype
        Type of the counts.

    Returns
    -------
    The film; its frames are rendered when asked for.

    Raises
    ------
    CameraError
        The camera's maps do not fit the frames.
    ConfigurationError
        A rotor turns too much within an exposure to be followed.

    Examples
    --------
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> rotor = rt.IdealRotor(
    ...     kind="driven", x_nm=2600.0, y_nm=2600.0, radius_nm=120.0, photons=800.0,
    ...     omega_rad_s=40.0
    ... )
    >>> scene = rt.IdealScene(
    ...     shape_px=(48, 48), n_frames=200, pixel_size_nm=108.3, frame_interval_s=0.002,
    ...     exposure_s=0.002, sigma_nm=140.0, background_photons=5.0, rotors=(rotor,)
    ... )
    >>> camera = rt.Camera(offset_adu=100.0, gain_e_per_adu=0.5, read_noise_e=1.4)
    >>> movie = rt.film(scene, camera, np.random.default_rng(1))
    >>> movie.shape
    (200, 48, 48)
    >>> len(movie.truth_spots)
    200
    """
    entropy = int.from_bytes(rng.bytes(16), "little")
    return IdealFilm(scene, camera, entropy, block_frames=block_frames, dtype=dtype)
