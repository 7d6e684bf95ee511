"""Frames to localisations, block by block.

A block is read, turned into photons, filtered, searched and fitted by one worker; every frame is
treated on its own, so the result does not depend on the number of workers or on the block size, to
the last bit.
"""

from __future__ import annotations

import functools
import pickle
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotortrack import parallel
from rotortrack.cameras.camera import Camera
from rotortrack.errors import MovieError
from rotortrack.flags import FitFlag
from rotortrack.localise.candidates import local_maxima
from rotortrack.localise.fit import RESULT_COLUMNS
from rotortrack.localise.lanes import fit_windows
from rotortrack.localise.options import LocaliseOptions
from rotortrack.localise.precision import thunderstorm_uncertainty
from rotortrack.localise.threshold import parse_threshold
from rotortrack.localise.wavelet import bspline_taps, wavelet_planes
from rotortrack.localise.windows import LANES, camera_arrays, cut_windows
from rotortrack.movies.movie import Movie
from rotortrack.tables import LOCALISATIONS

if TYPE_CHECKING:
    import pandas as pd

Columns = dict[str, NDArray[Any]]

BLOCK_PIXELS = 2_000_000
"""Pixels of a block; with every plane of a frame held at once this bounds a worker's memory."""

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
        The threshold is not a formula.
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
        counts = self._reader().frames(start, stop)
        dtype = counts.dtype
        photons = self._camera.to_photons(counts)
        masked = ~np.isfinite(photons)
        any_masked = bool(masked.any())
        if any_masked:
            photons[masked] = np.nan
        lowest = np.zeros(len(photons), np.float32)
        if self._options.shift_negative_frames:
            lowest = np.nanmin(photons, axis=(1, 2), initial=0.0)
            photons -= lowest[:, None, None]
        candidates = self._candidates(photons, masked if any_masked else None)
        if counts.dtype != np.uint16:
            counts = counts.astype(np.float32)
        radius = self._options.fit_radius_px
        windows = cut_windows(counts, camera_arrays(self._camera, dtype), candidates, radius)
        if lowest.any():
            shift = np.zeros(len(windows.photons) * LANES, np.float32)
            shift[: len(candidates)] = lowest[candidates[:, 0]]
            windows.photons[:] -= shift.reshape(-1, 1, LANES) * np.isfinite(windows.variance)
        results, flags = fit_windows(
            windows,
            radius,
            method=self._options.method,
            sigma_px=self._options.initial_sigma_px,
        )
        results[:2] += candidates[:, [2, 1]].T + 0.5
        columns = self._columns(start, candidates, results, flags)
        return Block(
            start,
            stop,
            columns,
            Counts(
                candidates=len(candidates),
                localisations=len(columns["frame"]),
                masked_pixels=int(masked.sum()) if any_masked else 0,
                flags=Counter({flag: int(np.count_nonzero(flags & flag)) for flag in FitFlag}),
            ),
        )

    def _reader(self) -> Movie:
        movie: Movie | None = getattr(self._own, "movie", None)
        if movie is None:
            movie = self._own.movie = self._movie.reopen()
            if movie is not self._movie:
                self._opened.append(movie)
        return movie

    def _candidates(
        self, photons: NDArray[np.float32], masked: NDArray[np.bool_] | None
    ) -> NDArray[np.int32]:
        """Search every frame; (n, 3) frame within the block, row, column."""
        found = []
        for index, frame in enumerate(photons):
            if masked is not None and masked[index].any():
                # A hole would spread through the filter; the median leaves no false maximum.
                if masked[index].all():
                    continue
                frame = np.where(masked[index], np.float32(np.nanmedian(frame)), frame)
            planes = wavelet_planes(frame, self._taps)
            threshold = self._threshold.value(
                {"I": frame, "F": planes.f, "F1": planes.f1, "F2": planes.f2}
            )
            maxima = local_maxima(
                planes.f, threshold, self._options.connectivity, self._options.fit_radius_px
            )
            rows = np.empty((len(maxima), 3), np.int32)
            rows[:, 0] = index
            rows[:, 1:] = maxima
            found.append(rows)
        return np.concatenate(found) if found else np.empty((0, 3), np.int32)

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
        x0, y0 = self._movie.origin_px
        x_sd_nm = fitted["x_sd_px"] * size
        y_sd_nm = fitted["y_sd_px"] * size
        if self._options.uncertainty == "bound":
            uncertainty = np.sqrt((x_sd_nm**2 + y_sd_nm**2) / 2.0)
        else:
            uncertainty = thunderstorm_uncertainty(
                "2014" if self._options.uncertainty == "thunderstorm-2014" else "2016",
                self._options.method,
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
