"""Frames to localisations, block by block.

A block is read, filtered, searched and fitted by one worker; kernels turn counts into photons as
they read them, so no copy of the frames exists. Every frame is treated on its own and every spot by
itself, so the result does not depend on the number of workers or on the block size, to the last
bit.
"""

from __future__ import annotations

import functools
import pickle
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from rotortrack import parallel
from rotortrack.cameras.camera import Camera
from rotortrack.errors import ConfigurationError, MovieError
from rotortrack.flags import FitFlag
from rotortrack.localise.detect import find_candidates
from rotortrack.localise.fit import RESULT_COLUMNS, FitMethod
from rotortrack.localise.joint import resolve
from rotortrack.localise.lanes import fit_windows
from rotortrack.localise.options import LocaliseOptions
from rotortrack.localise.precision import thunderstorm_uncertainty
from rotortrack.localise.quick import QUICK_METHODS, estimate
from rotortrack.localise.threshold import parse_threshold
from rotortrack.localise.wavelet import bspline_taps
from rotortrack.localise.windows import CameraArrays, camera_arrays, cut_windows
from rotortrack.movies.movie import Movie
from rotortrack.tables import LOCALISATIONS

if TYPE_CHECKING:
    import pandas as pd

Columns = dict[str, NDArray[Any]]

BLOCK_PIXELS = 4_000_000
"""Pixels of a block, which bounds a worker's memory."""

_DROPPED = FitFlag.LEFT_WINDOW | FitFlag.SINGULAR | FitFlag.NOT_FINITE


@dataclass(frozen=True)
class Counts:
    """What became of candidates; `flags` counts the fits that carry each flag, kept or dropped."""

    candidates: int = 0
    localisations: int = 0
    masked_pixels: int = 0
    flags: Counter[FitFlag] = field(default_factory=Counter)

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.candidates + other.candidates,
            self.localisations + other.localisations,
            self.masked_pixels + other.masked_pixels,
            self.flags + other.flags,
        )


@dataclass(frozen=True)
class Block:
    """Localisations of the frames start to stop (stop excluded), counted from the movie's first."""

    start: int
    stop: int
    columns: Columns
    counts: Counts


def localise(
    movie: Movie,
    camera: Camera,
    options: LocaliseOptions,
    *,
    pixel_size_nm: float,
    workers: int | None = None,
    block_frames: int | None = None,
    executor: Executor | None = None,
    spans: Sequence[tuple[int, int]] | None = None,
) -> Iterator[Block]:
    """Find and fit the spots of a movie.

    Parameters
    ----------
    movie
        Frames in counts; every worker reopens it for a file handle of its own.
    camera
        Counts to photo-electrons; maps must have the frames' shape.
    options
        Filter, threshold, candidates and fits.
    pixel_size_nm
        Pixel size (nm).
    workers
        Threads, or workers of the executor; all processors when not given.
    block_frames
        Frames a block; chosen for bounded memory when not given.
    executor
        Any executor to use instead of own threads, such as `parallel.process_pool`. Processes
        open the movie's file themselves; a movie in memory would go to them whole with every block.
    spans
        Ranges of frames (start, and stop excluded) to localise; all frames when not given.

    Yields
    ------
    Block
        In the order of the frames; rows are sorted by frame, then row by row of the image.

    Raises
    ------
    ConfigurationError
        The threshold is not a formula, the filter is too narrow to be one, the uncertainty is one
        for fits and there are none, or a block is to have no frame.
    MovieError
        A frame is smaller than the fit window, or cannot be read.
    CameraError
        Camera maps do not fit the frames.
    ResourceError
        A worker process was killed.
    """
    frames, height, width = movie.shape
    window = 2 * options.fit_radius_px + 1
    if min(height, width) < window:
        raise MovieError(
            f"{movie.path or 'the movie'} has frames of {width} x {height} pixels, smaller than "
            f"the fit window of {window} x {window}: choose a smaller fit_radius_px or a larger "
            "region"
        )
    if options.uncertainty != "bound" and options.method in QUICK_METHODS:
        raise ConfigurationError(
            f"uncertainty = {options.uncertainty!r} is a formula for fits, and method = "
            f"{options.method!r} makes none: choose mle, wlsq or lsq, or uncertainty = 'bound'"
        )
    if bspline_taps(options.wavelet_order, options.wavelet_scale).size == 1:
        raise ConfigurationError(
            f"wavelet_order = {options.wavelet_order} with wavelet_scale = "
            f"{options.wavelet_scale:g} makes a filter of a single pixel, in which no spot shows: "
            "choose them so that their product is above 2"
        )
    if block_frames is not None and block_frames < 1:
        raise ConfigurationError(f"block_frames is {block_frames}: give 1 or more")
    camera.check_fits(height, width)
    worker = _Worker(movie, camera, options, pixel_size_nm)
    if block_frames is None:
        block_frames = int(np.clip(BLOCK_PIXELS // (height * width), 1, 64))
    blocks = [
        (start, min(start + block_frames, last))
        for first, last in ([(0, frames)] if spans is None else spans)
        for start in range(first, last, block_frames)
    ]
    try:
        yield from parallel.map_ordered(
            worker, blocks, workers=workers or parallel.default_workers(), executor=executor
        )
    finally:
        worker.close()


def localise_all(
    movie: Movie,
    camera: Camera,
    options: LocaliseOptions | None = None,
    *,
    pixel_size_nm: float,
    workers: int | None = None,
) -> pd.DataFrame:
    """Localise a whole movie into one table of schema LOCALISATIONS.

    Parameters and errors are those of :func:`localise`.

    Examples
    --------
    >>> import numpy as np, rotortrack as rt
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
    >>> len(rt.localise_all(movie, camera, pixel_size_nm=108.3))
    200
    """
    import pandas as pd

    blocks = list(
        localise(
            movie,
            camera,
            options or LocaliseOptions(),
            pixel_size_nm=pixel_size_nm,
            workers=workers,
        )
    )
    names = [name for name in LOCALISATIONS.names if name != "rotor"]
    return pd.DataFrame(
        {name: np.concatenate([block.columns[name] for block in blocks]) for name in names}
        if blocks
        else {name: np.empty(0, LOCALISATIONS.dtypes[name]) for name in names}
    )


class _Worker:
    """Localises one block; safe to call from several threads at once."""

    def __init__(
        self, movie: Movie, camera: Camera, options: LocaliseOptions, pixel_size_nm: float
    ) -> None:
        self._movie = movie
        self._camera = camera
        self._options = options
        self._pixel_size_nm = pixel_size_nm
        self._taps = bspline_taps(options.wavelet_order, options.wavelet_scale).astype(np.float32)
        self._threshold = parse_threshold(options.threshold)
        self._arrays = camera_arrays(camera, movie.dtype)
        self._own = threading.local()
        self._opened: list[Movie] = []

    @functools.cached_property
    def _content(self) -> bytes:
        return pickle.dumps((self._movie, self._camera, self._options, self._pixel_size_nm))

    def __reduce__(self) -> tuple[Callable[[bytes], _Sent], tuple[bytes]]:
        return _Sent, (self._content,)

    def close(self) -> None:
        for movie in self._opened:
            movie.close()

    def __call__(self, frames: tuple[int, int]) -> Block:
        start, stop = frames
        options = self._options
        read = self._reader().frames(start, stop)
        missing = int(np.count_nonzero(~np.isfinite(read))) if read.dtype.kind == "f" else 0
        counts, camera = self._prepare(read)
        candidates = find_candidates(
            counts,
            camera,
            self._threshold,
            taps=self._taps,
            connectivity=options.connectivity,
            border=0 if options.clip_at_border else options.fit_radius_px,
            quantum_e=self._quantum_e,
            hidden=self._camera.hot_pixels,
        )
        results, flags = self._fit(counts, camera, candidates)
        found = len(candidates)
        if options.max_emitters > 1 and options.method not in QUICK_METHODS:
            joint = resolve(
                counts,
                camera,
                candidates,
                results,
                flags,
                options.fit_radius_px,
                max_emitters=options.max_emitters,
                sigma_px=options.initial_sigma_px,
                free_sigma=options.fit_sigma,
            )
            candidates, results, flags = candidates[joint.owners], joint.results, joint.flags
        columns = self._columns(start, candidates, results, flags)
        return Block(
            start,
            stop,
            columns,
            Counts(
                candidates=found,
                localisations=len(columns["frame"]),
                masked_pixels=missing,
                flags=Counter({flag: int(np.count_nonzero(flags & flag)) for flag in FitFlag}),
            ),
        )

    @functools.cached_property
    def _quantum_e(self) -> float:
        whole = self._movie.dtype.kind in "iu"
        return float(np.median(self._arrays.gain_e_per_adu)) if whole else 0.0

    def _prepare(self, counts: NDArray[Any]) -> tuple[NDArray[Any], CameraArrays]:
        """Give frames of one of the two types that kernels take, and the camera that reads them."""
        if not self._options.shift_negative_frames:
            kind = np.uint16 if counts.dtype == np.uint16 else np.float32
            return np.ascontiguousarray(counts, kind), self._arrays
        photons = self._camera.to_photons(counts)
        photons[~np.isfinite(photons)] = np.nan
        lowest = np.nanmin(photons, axis=(1, 2), keepdims=True, initial=0.0)
        photons -= lowest
        camera = self._arrays
        # The limit in photons of the frame that was raised most: none that is saturated is missed.
        limit = (camera.saturation_adu - camera.offset_adu) * camera.gain_e_per_adu
        one = np.ones((1, 1), np.float32)
        return photons, CameraArrays(0.0 * one, one, camera.variance_e2, limit)

    def _fit(
        self, counts: NDArray[Any], camera: CameraArrays, candidates: NDArray[np.int32]
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        options = self._options
        radius, sigma_px = options.fit_radius_px, options.initial_sigma_px
        windows = cut_windows(counts, camera, candidates, radius)
        if options.method in QUICK_METHODS:
            return estimate(
                windows,
                radius,
                method=options.method,
                sigma_px=sigma_px,
                free_sigma=options.fit_sigma,
            )
        return fit_windows(
            windows,
            radius,
            method=cast(FitMethod, options.method),
            sigma_px=sigma_px,
            free_sigma=options.fit_sigma,
            correct_bias=options.correct_bias,
        )

    def _reader(self) -> Movie:
        movie: Movie | None = getattr(self._own, "movie", None)
        if movie is None:
            movie = self._own.movie = self._movie.reopen()
            if movie is not self._movie:
                self._opened.append(movie)
        return movie

    def _frame_numbers(self, start: int, frames: NDArray[np.int32]) -> NDArray[np.int64]:
        """Give the numbers of frames of a block; dropped frames have theirs, too."""
        places = frames.astype(np.int64) + start
        numbers = self._movie.numbers
        return places + self._movie.first_frame if numbers is None else numbers[places]

    def _columns(
        self,
        start: int,
        candidates: NDArray[np.int32],
        results: NDArray[np.float64],
        flags: NDArray[np.int32],
    ) -> Columns:
        kept = flags & _DROPPED == 0
        fitted = dict(zip(RESULT_COLUMNS, results[:, kept], strict=True))
        size = self._pixel_size_nm
        # Fits count from the centre of the candidate's pixel.
        x0 = self._movie.origin_px[0] + candidates[kept, 2] + 0.5
        y0 = self._movie.origin_px[1] + candidates[kept, 1] + 0.5
        x_sd_nm = fitted["x_sd_px"] * size
        y_sd_nm = fitted["y_sd_px"] * size
        if self._options.uncertainty == "bound":
            uncertainty = np.sqrt((x_sd_nm**2 + y_sd_nm**2) / 2.0)
        else:
            uncertainty = thunderstorm_uncertainty(
                "2014" if self._options.uncertainty == "thunderstorm-2014" else "2016",
                cast(FitMethod, self._options.method),
                sigma_nm=fitted["sigma_px"] * size,
                photons=fitted["photons"],
                background_sd=fitted["background_sd"],
                pixel_size_nm=size,
            )
        values = {
            "frame": self._frame_numbers(start, candidates[kept, 0]),
            "x_nm": (fitted["x_px"] + x0) * size,
            "y_nm": (fitted["y_px"] + y0) * size,
            "photons": fitted["photons"],
            "background": fitted["background"],
            "background_sd": fitted["background_sd"],
            "sigma_nm": fitted["sigma_px"] * size,
            "x_sd_nm": x_sd_nm,
            "y_sd_nm": y_sd_nm,
            "uncertainty_nm": uncertainty,
            "chi2": fitted["chi2"],
            "log_likelihood_ratio": fitted["log_likelihood_ratio"],
            "fit_flags": flags[kept],
            "channel": np.zeros(int(kept.sum())),
        }
        return {name: value.astype(LOCALISATIONS.dtypes[name]) for name, value in values.items()}


@dataclass(frozen=True)
class _Sent:
    """A worker on its way to another process: what cannot be opened there fails the block."""

    content: bytes

    def __call__(self, frames: tuple[int, int]) -> Block:
        return _unpack(self.content)(frames)


@functools.lru_cache(maxsize=1)
def _unpack(content: bytes) -> _Worker:
    """Make the worker of a process: once, though it is sent with every block."""
    return _Worker(*pickle.loads(content))  # noqa: S301 (from the parent process)
