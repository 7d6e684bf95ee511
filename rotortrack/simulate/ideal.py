"""Ideal scenes: rotors whose motion is known in closed form, and what is filmed around them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError

Kind = Literal["driven", "brownian", "stuck", "switching", "two_position"]

_TURNING = ("driven", "switching")
_FLIPPING = ("switching", "two_position")


@dataclass(frozen=True, kw_only=True)
class IdealRotor:
    """A bright point on a circle, x = x_c + R cos(theta), y = y_c - R sin(theta).

    ============  =============================================================================
    kind          theta(t)
    ============  =============================================================================
    driven        start + omega t + Brownian motion with D
    brownian      start + Brownian motion with D
    stuck         start
    switching     start + omega (integral of +1 or -1, flipping at events) + Brownian motion
    two_position  start, or start + pi, flipping at events, plus wobble: an Ornstein-Uhlenbeck
                  process of standard deviation `wobble_sd_rad` that diffuses with D at short times
    ============  =============================================================================

    Parameters
    ----------
    kind
        How the rotor moves.
    x_nm, y_nm
        Centre of the circle, from the outer corner of pixel (0, 0), y down.
    radius_nm
        Radius of the circle.
    photons
        Expected photo-electrons of the spot per frame.
    omega_rad_s
        Angular speed, positive counter-clockwise on the displayed image; of a switching rotor the
        speed before the first event.
    diffusion_rad2_s
        Rotational diffusion coefficient D.
    start_rad
        Angle at time 0.
    event_times_s
        When a switching or two-position rotor flips.
    event_rate_per_s
        Or how often it flips, at random (Poisson process).
    wobble_sd_rad
        Standard deviation of a two-position rotor's angle about its poses.

    Raises
    ------
    ConfigurationError
        Values out of bounds, or given to a kind of rotor that has no use for them; all listed.

    Examples
    --------
    >>> import rotortrack as rt
    >>> rotor = rt.IdealRotor(
    ...     kind="driven", x_nm=1600.0, y_nm=1600.0, radius_nm=120.0, photons=800.0,
    ...     omega_rad_s=40.0
    ... )
    >>> rotor.radius_nm
    120.0
    """

    kind: Kind
    x_nm: float
    y_nm: float
    radius_nm: float
    photons: float
    omega_rad_s: float = 0.0
    diffusion_rad2_s: float = 0.0
    start_rad: float = 0.0
    event_times_s: tuple[float, ...] = ()
    event_rate_per_s: float = 0.0
    wobble_sd_rad: float = 0.0

    def __post_init__(self) -> None:
        mistakes = list(self._mistakes())
        if mistakes:
            raise ConfigurationError(*(f"{self.kind} rotor: {mistake}" for mistake in mistakes))

    def _mistakes(self) -> Iterator[str]:
        kind = self.kind
        if kind not in get_args(Kind):
            yield f"kind must be one of {', '.join(get_args(Kind))}"
            return
        for name in (
            "radius_nm",
            "photons",
            "diffusion_rad2_s",
            "event_rate_per_s",
            "wobble_sd_rad",
        ):
            if not 0.0 <= getattr(self, name) < math.inf:
                yield f"{name} must be zero or a positive number, not {getattr(self, name):g}"
        for name in ("x_nm", "y_nm", "omega_rad_s", "start_rad"):
            if not math.isfinite(getattr(self, name)):
                yield f"{name} must be a finite number, not {getattr(self, name):g}"
        if (kind in _TURNING) != (self.omega_rad_s != 0.0):
            yield "omega_rad_s belongs to driven and switching rotors, which need it"
        if kind == "stuck" and self.diffusion_rad2_s:
            yield "diffusion_rad2_s must be 0: a stuck rotor does not move"
        if kind == "brownian" and not self.diffusion_rad2_s:
            yield "diffusion_rad2_s must be positive"
        events = bool(self.event_times_s) + bool(self.event_rate_per_s)
        if events != (kind in _FLIPPING):
            yield (
                "event_times_s or event_rate_per_s, one of them, belongs to switching and "
                "two_position rotors"
            )
        if self.wobble_sd_rad and kind != "two_position":
            yield "wobble_sd_rad belongs to two_position rotors"
        if kind == "two_position" and bool(self.wobble_sd_rad) != bool(self.diffusion_rad2_s):
            yield "wobble needs both wobble_sd_rad and diffusion_rad2_s"


@dataclass(frozen=True, kw_only=True)
class IdealScene:
    """What stands before the camera, for how long, and how it is seen.

    Parameters
    ----------
    shape_px
        Height and width of the frames.
    n_frames
        Length of the movie.
    pixel_size_nm
        Size of a pixel in the specimen.
    frame_interval_s, exposure_s
        Frame k gathers light from k * frame_interval_s for exposure_s.
    sigma_nm
        Width of a spot's Gaussian.
    background_photons
        Expected photo-electrons of background per pixel and frame.
    rotors
        The rotors, numbered from 0 in the truth tables.
    drift_nm
        How far (x, y) the field moves: two numbers reached linearly in the last frame, or a table
        of shape (n_frames, 2). Absent: the field stands still.
    dark_probability
        Chance that a rotor is dark in a frame, for each rotor and frame on its own. Zero: never.

    Raises
    ------
    ConfigurationError
        Values out of bounds or rotors centred outside the frame; all listed.

    Examples
    --------
    >>> import rotortrack as rt
    >>> rotor = rt.IdealRotor(
    ...     kind="stuck", x_nm=2600.0, y_nm=2600.0, radius_nm=120.0, photons=800.0
    ... )
    >>> scene = rt.IdealScene(
    ...     shape_px=(48, 48), n_frames=200, pixel_size_nm=108.3, frame_interval_s=0.002,
    ...     exposure_s=0.002, sigma_nm=140.0, background_photons=5.0, rotors=(rotor,)
    ... )
    >>> scene.n_frames * scene.frame_interval_s
    0.4
    """

    shape_px: tuple[int, int]
    n_frames: int
    pixel_size_nm: float
    frame_interval_s: float
    exposure_s: float
    sigma_nm: float
    background_photons: float
    rotors: tuple[IdealRotor, ...]
    drift_nm: tuple[float, float] | NDArray[np.float64] | None = None
    dark_probability: float = 0.0

    def __post_init__(self) -> None:
        mistakes = list(self._mistakes())
        if mistakes:
            raise ConfigurationError(*mistakes)

    def _mistakes(self) -> Iterator[str]:
        for name in ("pixel_size_nm", "frame_interval_s", "exposure_s", "sigma_nm"):
            if not 0.0 < getattr(self, name) < math.inf:
                yield f"{name} must be greater than 0, not {getattr(self, name):g}"
        if min(self.shape_px) < 1 or self.n_frames < 1:
            yield "shape_px and n_frames must be at least 1"
        if self.exposure_s > self.frame_interval_s * (1.0 + 1e-9):
            yield "exposure_s must not exceed frame_interval_s"
        if not 0.0 <= self.background_photons < math.inf:
            yield f"background_photons must not be negative, not {self.background_photons:g}"
        if not 0.0 <= self.dark_probability <= 1.0:
            yield f"dark_probability must lie between 0 and 1, not {self.dark_probability:g}"
        if self.drift_nm is not None:
            shape = np.shape(self.drift_nm)
            if shape not in ((2,), (self.n_frames, 2)):
                yield f"drift_nm must be two numbers or a ({self.n_frames}, 2) table, not {shape}"
            if not np.all(np.isfinite(self.drift_nm)):
                yield "drift_nm must be finite"
        height, width = self.shape_px
        for number, rotor in enumerate(self.rotors):
            x_px, y_px = rotor.x_nm / self.pixel_size_nm, rotor.y_nm / self.pixel_size_nm
            if not (0 <= x_px <= width and 0 <= y_px <= height):
                yield (
                    f"rotor {number} is centred at ({x_px:.1f}, {y_px:.1f}) px, outside the frame "
                    f"of {width} x {height} px"
                )

    def drift_by_frame_nm(self) -> NDArray[np.float64] | None:
        """Return the field's shift (x, y) in every frame, shape (n_frames, 2), if it drifts."""
        if self.drift_nm is None:
            return None
        table = np.asarray(self.drift_nm, dtype=np.float64)
        if table.shape == (2,):
            table = np.linspace(0.0, 1.0, self.n_frames)[:, np.newaxis] * table
        return table
