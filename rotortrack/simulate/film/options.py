"""Sections of a scene that is filmed; each one absent is an effect that does not exist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option

Numbers = float | tuple[float, ...]
"""One number, or the ends of a range [low, high] from which each rotor draws its own."""

Motion = Literal[
    "driven", "brownian", "switching", "two_position", "stuck", "tethered", "arc", "table"
]


def _range(value: object) -> str | None:
    if isinstance(value, tuple) and (len(value) != 2 or value[0] > value[1]):
        return f"must be a number or [low, high], not {list(value)}"
    return None


def _pair(value: tuple[float, ...]) -> str | None:
    return None if len(value) == 2 else f"must be two numbers [x, y], not {list(value)}"


@dataclass(frozen=True)
class FilmOptions(Options):
    """Size and length of the film."""

    width_px: int = option(256, "width of the frames, both colours together, px", gt=0)
    height_px: int = option(256, "height of the frames, px", gt=0)
    n_frames: int = option(2000, "frames, dropped ones included", gt=0)
    pixel_size_nm: float = option(108.3, "size of a pixel in the specimen", gt=0)
    frame_interval_s: float = option(0.002, "time from frame to frame", gt=0)
    exposure_s: float | None = option(
        None, "time for which a frame gathers light; absent: an instant, without motion blur", gt=0
    )
    seed: int = option(1, "of everything random", ge=0)
    mirrored: bool = option(
        False, "whether the optics flip the image; directions here are those on the image"
    )


@dataclass(frozen=True)
class RotorsOptions(Options):
    """A group of rotors of one kind: a table [[rotors]], of which a scene may have several."""

    motion: Motion = option("driven", "how they move")
    count: int | None = option(None, "how many; absent: as many as places are given, or one", gt=0)
    x_nm: tuple[float, ...] = option((), "places, x; absent: the lattice's, or scattered")
    y_nm: tuple[float, ...] = option((), "places, y")
    shape: str = option(
        "circle",
        "circle; rod, simulated by [rod] and its sections; or the file of a rod, or the folder of "
        "a scan, that `simulate` wrote",
    )
    radius_nm: Numbers = option((60.0, 180.0), "radius of a circle", gt=0, check=_range)
    ends: Literal[1, 2] = option(1, "labelled ends: the second shines in the second colour")
    second_radius_nm: Numbers = option(
        (60.0, 180.0), "radius of a circle's second end", gt=0, check=_range
    )
    second_phase_deg: Numbers = option(
        180.0, "angle from the first end to the second", check=_range
    )
    omega_rad_s: Numbers = option(
        (8.0, 60.0), "speed of driven and switching ones", gt=0, check=_range
    )
    own_rate: bool = option(
        False, "driven rods turn at their own simulated rate, thousands of times a second"
    )
    direction: Literal["ccw", "cw", "either"] = option("either", "where they turn, on the image")
    diffusion_rad2_s: Numbers = option(
        (0.5, 20.0),
        "rotational diffusion coefficient of all that are not stuck",
        ge=0,
        check=_range,
    )
    start_deg: float | None = option(None, "angle at the first frame; absent: any")
    switch_rate_per_s: float = option(0.5, "how often switching and two_position ones flip", gt=0)
    wobble_sd_rad: float = option(
        0.15,
        "standard deviation of the angle of two_position (about a pose) and tethered ones",
        gt=0,
    )
    arc_deg: float = option(120.0, "range of angles of arc ones", gt=0, le=360)
    photons: Numbers = option(
        (500.0, 1500.0), "photons of a fully labelled end a frame", gt=0, check=_range
    )
    second_photons: Numbers | None = option(
        None, "the same of the second end; absent: as the first's", gt=0, check=_range
    )
    arrive_s: Numbers = option(0.0, "when they dock", ge=0, check=_range)
    leave_s: Numbers | None = option(
        None, "when they are released; absent: never", gt=0, check=_range
    )
    second_after_s: Numbers | None = option(
        None, "each pore gets a second rotor of the same kind this long after", ge=0, check=_range
    )
    breathing_sd_nm: float = option(
        0.0, "how far each end moves in and out, rms; 0: as far as [thermal] makes a rod", ge=0
    )
    breathing_time_s: float = option(0.05, "correlation time of breathing", gt=0)
    table: str | None = option(
        None, "of motion table: CSV or Parquet with frame, rotor, x_nm, y_nm, photons"
    )


@dataclass(frozen=True)
class LatticeOptions(Options):
    """Pores in rows and columns."""

    pitch_nm: float = option(1500.0, "distance of neighbouring pores", gt=0)
    rotation_deg: float = option(0.0, "turn of the rows against the camera")
    occupancy: float = option(1.0, "part of the pores that may hold rotors", gt=0, le=1)
    jitter_nm: float = option(0.0, "rms displacement of a pore from its place, per axis", ge=0)


@dataclass(frozen=True)
class DyesOptions(Options):
    """Dyes of each end, along a piece of the rod."""

    counts: tuple[int, ...] = option((20, 10), "docking places of the first and second end", gt=0)
    lengths_nm: tuple[float, ...] = option((40.0, 20.0), "length of rod that they cover", ge=0)
    labelled: float = option(1.0, "part of the places that carry a dye", gt=0, le=1)
    spread: float = option(0.0, "relative standard deviation of a dye's brightness", ge=0)


@dataclass(frozen=True)
class BleachingOptions(Options):
    """Dyes (without [dyes] whole ends) go dark for ever."""

    lifetime_s: float = option(20.0, "mean time until a dye is bleached", gt=0)


@dataclass(frozen=True)
class BlinkingOptions(Options):
    """Dyes (without [dyes] whole ends) go dark for a while."""

    on_s: float = option(0.5, "mean time that a dye shines", gt=0)
    off_s: float = option(0.02, "mean time that it is dark", gt=0)


@dataclass(frozen=True)
class BackgroundOptions(Options):
    """Light without rotors."""

    photons: float = option(10.0, "photons a pixel and frame in the middle", ge=0)
    gradient: tuple[float, ...] = option(
        (0.0, 0.0), "relative change from edge to edge along x and y", ge=-2, le=2, check=_pair
    )
    texture: float = option(0.0, "relative rms of a texture that stands still", ge=0, le=0.5)
    texture_length_nm: float = option(500.0, "its correlation length", gt=0)


@dataclass(frozen=True)
class LaserOptions(Options):
    """Gaussian illumination, on rotors and background alike."""

    waist_nm: float = option(20000.0, "radius at which the light has fallen to 1/e^2", gt=0)
    centre_nm: tuple[float, ...] | None = option(
        None, "its middle; absent: of the field", check=_pair
    )


@dataclass(frozen=True)
class FlickerOptions(Options):
    """The illumination's brightness in time."""

    sd: float = option(0.02, "relative standard deviation", ge=0, le=0.3)
    time_s: float = option(
        0.0,
        "correlation time, averaged over each exposure; 0: a new brightness in each frame",
        ge=0,
    )


@dataclass(frozen=True)
class PsfOptions(Options):
    """How a point is imaged; a Gaussian of 130 nm where the scene does not say."""

    model: Literal["gaussian", "airy"] = option("gaussian", "shape of the spot")
    sigma_nm: float = option(130.0, "width of the Gaussian in focus", gt=0)
    wavelength_nm: float = option(670.0, "of the Airy pattern", gt=0)
    numerical_aperture: float = option(1.4, "of the Airy pattern", gt=0, le=1.7)
    defocus_nm: float = option(0.0, "height of the rotors above the focus")
    depth_nm: float = option(400.0, "defocus that widens a Gaussian by sqrt(2)", gt=0)
    astigmatism_nm: float = option(
        0.0, "distance between the foci of x and y, half of it to either side"
    )


@dataclass(frozen=True)
class DriftOptions(Options):
    """The stage moves."""

    total_nm: tuple[float, ...] = option(
        (0.0, 0.0), "even drift from first to last frame, x and y", check=_pair
    )
    walk_nm: float = option(0.0, "random walk, rms step a frame and axis", ge=0)
    step_nm: tuple[float, ...] = option((0.0, 0.0), "one sudden step, x and y", check=_pair)
    step_s: float = option(0.0, "when it comes", ge=0)
    table: str | None = option(
        None, "file of a drift, CSV with frame, dx_nm and dy_nm, that is added"
    )


@dataclass(frozen=True)
class VibrationOptions(Options):
    """The stage vibrates."""

    amplitude_nm: float = option(10.0, "amplitude", ge=0)
    frequency_hz: float = option(50.0, "frequency", gt=0)
    direction_deg: float = option(0.0, "direction, counter-clockwise from x on the image")


@dataclass(frozen=True)
class SensorOptions(Options):
    """The camera; its section is [camera] as in a configuration."""

    offset_adu: float = option(100.0, "counts of a dark pixel", ge=0)
    gain_e_per_adu: float = option(0.4545, "photo-electrons per count", gt=0)
    read_noise_e: float = option(1.4, "read noise, electrons rms", ge=0)
    camera_maps: str | None = option(None, "file of maps that `rotortrack calibrate` wrote")
    quantum_efficiency: float | None = option(
        None, "detected part of the photons; absent: photons are detected ones", gt=0, le=1
    )
    bits: int = option(16, "bits of a count, at which pixels saturate", ge=8, le=16)


@dataclass(frozen=True)
class PixelMapsOptions(Options):
    """Pixels of an sCMOS sensor differ."""

    offset_sd_adu: float = option(2.0, "standard deviation of offsets", ge=0)
    gain_sd: float = option(0.01, "relative standard deviation of gains", ge=0, le=0.2)
    read_noise_sd: float = option(0.25, "standard deviation of the log of read noises", ge=0, le=2)


@dataclass(frozen=True)
class HotPixelsOptions(Options):
    """Some pixels are noisy."""

    fraction: float = option(1e-3, "part of the pixels", gt=0, le=0.5)
    read_noise_e: float = option(20.0, "their read noise, electrons rms", gt=0)


@dataclass(frozen=True)
class ColumnNoiseOptions(Options):
    """Noise that a column's pixels share in a frame, as fast modes have it."""

    sd_adu: float = option(0.5, "standard deviation", ge=0)


@dataclass(frozen=True)
class RollingShutterOptions(Options):
    """Rows begin their exposure one after the other, the first row first."""

    line_time_s: float = option(1e-5, "time from row to row", gt=0)


@dataclass(frozen=True)
class DroppedOptions(Options):
    """Frames that the camera lost."""

    fraction: float = option(0.0, "part of the frames, at random", ge=0, le=0.9)
    frames: tuple[int, ...] = option((), "or which", ge=0)


@dataclass(frozen=True)
class TimestampsOptions(Options):
    """Times of the frames in the file, as the computer noted them."""

    jitter_s: float = option(1e-4, "error of a noted time, rms", ge=0)


@dataclass(frozen=True)
class VoltageOptions(Options):
    """Voltage in time; speeds are proportional to it."""

    times_s: tuple[float, ...] = option((0.0,), "when each value begins, from 0", ge=0)
    voltages_mv: tuple[float, ...] = option((100.0,), "values")
    reference_mv: float = option(100.0, "where rotors have their omega_rad_s")
    sample_hz: float = option(10000.0, "samples of trigger and voltage a second in daq.csv", gt=0)
    noise_mv: float = option(0.2, "noise of the recorded voltage, rms", ge=0)


@dataclass(frozen=True)
class SplitOptions(Options):
    """The second colour beside, or below, the first on one sensor."""

    layout: Literal["left-right", "top-bottom"] = option("left-right", "where the second colour is")
    shift_nm: tuple[float, ...] = option((0.0, 0.0), "shift of its image", check=_pair)
    scale: float = option(1.0, "magnification against the first", gt=0.8, le=1.2)
    rotation_deg: float = option(0.0, "turn against the first")
    shear: float = option(0.0, "shear, nm/nm", ge=-0.1, le=0.1)
    radial_nm: float = option(0.0, "radial distortion at the edge of the field")
    keystone_nm: float = option(0.0, "keystone distortion at the edge of the field")
    mirrored: bool = option(False, "whether the second image is flipped left to right")
    sigma_ratio: float = option(1.0, "width of its spots over that of the first's", gt=0)
    crosstalk: tuple[float, ...] = option(
        (0.0, 0.0),
        "part of the first's light in the second, and of the second's in the first",
        ge=0,
        le=0.9,
        check=_pair,
    )


@dataclass(frozen=True)
class FiducialsOptions(Options):
    """A grid of points that shine in both colours, for calibration."""

    pitch_nm: float = option(1500.0, "distance of neighbouring points", gt=0)
    rotation_deg: float = option(2.0, "turn of the rows against the camera")
    jitter_nm: float = option(20.0, "rms displacement of a point from its place, per axis", ge=0)
    missing: float = option(0.05, "part of the points that are missing", ge=0, le=0.9)
    photons: Numbers = option(
        (10000.0, 30000.0), "photons of a point a frame and colour", gt=0, check=_range
    )


@dataclass(frozen=True)
class FreeRodsOptions(Options):
    """Rods that drift by without docking."""

    count: int = option(5, "how many at any time, in the field and 2 um around it", gt=0)
    photons: Numbers = option((300.0, 1000.0), "photons a frame", gt=0, check=_range)
    diffusion_um2_s: float = option(3.0, "translational diffusion coefficient", gt=0)
    flow_um_s: tuple[float, ...] = option((0.0, 0.0), "drift velocity, x and y", check=_pair)
