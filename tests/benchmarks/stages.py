"""Our own stages on one film, timed in this thread after warm-up.

    python tests/benchmarks/stages.py FOLDER NAME FOUND.npz [--even]

FOLDER holds the film (films.py). Prints one line of JSON, rates per second of this thread's CPU
time, the best of several passes:

frames_per_s
    filter and candidates of frames in memory
fits_per_s
    likelihood fits with error bars and quality, windows already cut
windows_per_s
    the same with cutting the windows from raw counts
localisations_per_s
    the whole of `rotortrack.localise.engine.localise`, one worker
alone_per_s
    the same with every spot fitted alone, close ones not taken apart

FOUND gets the localisations for score.py. --even takes one offset, gain and noise for all pixels
where the film has maps. Options of localisation are the defaults. The functions between the two
rules below are all that must follow the engine when its inside changes.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from rotortrack.cameras.camera import Camera
from rotortrack.cameras.hot_pixels import hot_pixels_of
from rotortrack.localise.detect import find_candidates
from rotortrack.localise.engine import localise
from rotortrack.localise.lanes import fit_windows
from rotortrack.localise.options import LocaliseOptions
from rotortrack.localise.threshold import parse_threshold
from rotortrack.localise.wavelet import bspline_taps
from rotortrack.localise.windows import Windows, camera_arrays, cut_windows
from rotortrack.movies.movie import ArrayMovie

PIXEL_SIZE_NM = 108.3
STAGE_FRAMES = 500
"""Enough frames for the stages: each is passed over many times."""

# -------------------------------------------------------------------------------------------------


def stages(
    counts: NDArray[np.uint16], camera: Camera, options: LocaliseOptions
) -> dict[str, tuple[int, Callable[[], Any]]]:
    """Give each rate's number of items and the call that treats them."""
    arrays = camera_arrays(camera, counts.dtype)
    threshold = parse_threshold(options.threshold)
    taps = bspline_taps(options.wavelet_order, options.wavelet_scale).astype(np.float32)
    radius = options.fit_radius_px

    def searched() -> NDArray[np.int32]:
        return find_candidates(
            counts,
            arrays,
            threshold,
            taps=taps,
            connectivity=options.connectivity,
            border=0 if options.clip_at_border else radius,
            quantum_e=float(np.median(arrays.gain_e_per_adu)),
            hidden=camera.hot_pixels,
        )

    spots = searched()
    windows = cut_windows(counts, arrays, spots, radius)

    def fitted(given: Windows = windows) -> object:
        return fit_windows(
            given,
            radius,
            method="mle",
            sigma_px=options.initial_sigma_px,
            free_sigma=options.fit_sigma,
            correct_bias=options.correct_bias,
        )

    def cut_and_fitted() -> object:
        return fitted(cut_windows(counts, arrays, spots, radius))

    return {
        "frames_per_s": (len(counts), searched),
        "fits_per_s": (len(spots), fitted),
        "windows_per_s": (len(spots), cut_and_fitted),
    }


# -------------------------------------------------------------------------------------------------


def best_seconds(call: Callable[[], object], *, passes: int, budget_s: float) -> float:
    """Time a call by this thread's CPU clock: the best of some passes, or of those in budget."""
    call()
    best = float("inf")
    begun = time.perf_counter()
    for _ in range(passes):
        start = time.thread_time()
        call()
        best = min(best, time.thread_time() - start)
        if time.perf_counter() - begun > budget_s:
            break
    return best


def open_camera(path: Path, *, even: bool) -> Camera:
    """Load the film's camera, or the one camera of all films without maps."""
    if even:
        return Camera(offset_adu=100.0, gain_e_per_adu=0.45, read_noise_e=1.6)
    with np.load(path) as maps:
        values = {name: maps[name] for name in maps.files}
        hot = hot_pixels_of(values["read_noise_e"]) if values["read_noise_e"].ndim else None
        return Camera(**values, hot_pixels=hot)


def measure(folder: Path, name: str, found: Path, *, even: bool) -> dict[str, float]:
    """Localise a film, write what was found, and time the stages."""
    counts = tifffile.imread(folder / f"{name}.tif")
    camera = open_camera(folder / f"{name}-camera.npz", even=even)
    options = LocaliseOptions()
    rates = {}
    for rate, chosen in (
        ("alone_per_s", dataclasses.replace(options, max_emitters=1)),
        ("localisations_per_s", options),
    ):

        def whole(chosen: LocaliseOptions = chosen) -> dict[str, NDArray[Any]]:
            movie = ArrayMovie(counts)
            blocks = list(localise(movie, camera, chosen, pixel_size_nm=PIXEL_SIZE_NM, workers=1))
            names = blocks[0].columns
            return {key: np.concatenate([b.columns[key] for b in blocks]) for key in names}

        spots = whole()
        rates[rate] = len(spots["frame"]) / best_seconds(whole, passes=5, budget_s=4.0)
    write(found, spots, len(counts))
    for rate, (items, call) in stages(counts[:STAGE_FRAMES], camera, options).items():
        rates[rate] = items / best_seconds(call, passes=20, budget_s=3.0)
    return rates


def write(path: Path, spots: dict[str, NDArray[Any]], frames: int) -> None:
    """Write localisations as score.py reads them."""
    np.savez(
        path,
        frame=spots["frame"],
        x_px=spots["x_nm"] / PIXEL_SIZE_NM,
        y_px=spots["y_nm"] / PIXEL_SIZE_NM,
        photons=spots["photons"],
        x_sd_px=spots["x_sd_nm"] / PIXEL_SIZE_NM,
        y_sd_px=spots["y_sd_nm"] / PIXEL_SIZE_NM,
        frames=frames,
    )


if __name__ == "__main__":
    folder, name, found = sys.argv[1:4]
    print(json.dumps(measure(Path(folder), name, Path(found), even="--even" in sys.argv)))
