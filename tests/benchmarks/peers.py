"""Other localisers on the benchmark's films; runs in an environment of their own.

    PEERS_PYTHON tests/benchmarks/peers.py versions
    PEERS_PYTHON tests/benchmarks/peers.py stages TOOL FOLDER NAME FOUND.npz
    PEERS_PYTHON tests/benchmarks/peers.py whole trackpy FOLDER NAME OUT

`engine.py peers` makes that environment. Imports nothing of rotortrack; each tool is called through
its own public functions, with a 7 x 7 box and one thread. `stages` passes once over the film after
warm-up and prints rates per second of this process's CPU time:

frames_per_s            finding candidates, from counts in memory
fits_per_s              fit with the errors it reports, windows already cut
localisations_per_s     everything from counts in memory to the table

Thresholds are set by hand, knowing the films (HAND_SET), except SMAPpy's, which is its default.
Picasso has per-pixel maps (its fit does, its search does not), SMAPpy one read noise for all
pixels, trackpy no noise model.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

BOX_PX = 7
BLOCK_FRAMES = 200
PIXEL_SIZE_NM = 108.3
OFFSET_ADU = 100.0
GAIN_E_PER_ADU = 0.45
READ_NOISE_E = 1.6
HAND_SET = {
    "Picasso net gradient": {"bright": 700, "maps": 700, "dim": 300},
    "trackpy minmass": {"bright": 200, "maps": 200, "dim": 100},
}
TRACKPY_FRAMES = 300
"""trackpy finds 100 frames in about 1 s: enough for its rate and its error."""

PACKAGES = ("picassosr", "smappy-smlm", "trackpy", "numpy", "numba", "scipy")
PICASSO_CAMERA = {
    "Baseline": OFFSET_ADU,
    "Sensitivity": GAIN_E_PER_ADU,
    "Gain": 1,
    "Pixelsize": PIXEL_SIZE_NM,
}

Columns = dict[str, Any]
Stages = tuple[Columns, dict[str, float]]


def versions() -> dict[str, str]:
    """Name what is installed; a package that is not, is left out."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def picasso(counts: Any, name: str, folder: Path, *, mle: bool) -> Stages:
    """Net-gradient search and a round Gaussian by maximum likelihood or least squares."""
    from picasso import localize

    maps = picasso_maps(folder, name)
    movie = _PicassoMovie(counts)
    seconds = {}
    start = time.process_time()
    gradient = HAND_SET["Picasso net gradient"][name]
    spots, _ = localize.identify(movie, gradient, BOX_PX, threaded=False)
    seconds["find"] = time.process_time() - start
    windows, variance = localize.get_spots(
        movie, spots, BOX_PX, PICASSO_CAMERA, camera_calibration=maps, return_variance=True
    )
    fit_start = time.process_time()
    theta, likelihood, iterations, chi_square = localize.fit_spots_gauss(
        windows, mle=mle, spherical=True, return_stats=True, variance=variance
    )
    table = localize.locs_from_fits_gauss(
        spots,
        theta,
        BOX_PX,
        False,
        mle=mle,
        log_likelihood=likelihood,
        iterations=iterations,
        spherical=True,
        chi_square=chi_square,
        variance=variance,
    )
    end = time.process_time()
    # Positions count from the centre of the first pixel.
    columns = {
        "frame": table["frame"],
        "x_px": table["x"] + 0.5,
        "y_px": table["y"] + 0.5,
        "photons": table["photons"],
        "x_sd_px": table["lpx"],
        "y_sd_px": table["lpy"],
    }
    return columns, {
        "frames_per_s": len(counts) / seconds["find"],
        "fits_per_s": len(table) / (end - fit_start),
        "localisations_per_s": len(table) / (end - start),
    }


class _PicassoMovie:
    """Frames in memory, as Picasso's functions ask for them."""

    use_dask = False

    def __init__(self, counts: Any) -> None:
        self._counts = counts
        self.shape, self.dtype = counts.shape, counts.dtype

    def __len__(self) -> int:
        return len(self._counts)

    def __getitem__(self, index: Any) -> Any:
        return self._counts[index]

    def __iter__(self) -> Any:
        return iter(self._counts)


def picasso_maps(folder: Path, name: str) -> dict[str, Any] | None:
    """Give a film's maps in Picasso's units: ADU, ADU^2, ADU per electron."""
    with np.load(folder / f"{name}-camera.npz") as maps:
        if not maps["read_noise_e"].ndim:
            return None
        gain = maps["gain_e_per_adu"]
        return {
            "offset": maps["offset_adu"].astype(np.float32),
            "variance": ((maps["read_noise_e"] / gain) ** 2).astype(np.float32),
            "gain": (1.0 / gain).astype(np.float32),
        }


def smappy(counts: Any, _name: str, _folder: Path) -> Stages:
    """Difference of Gaussians, its dynamic cutoff, and a Gaussian of free width by likelihood."""
    from smappy.camera import to_photons
    from smappy.detect import DoGFilter, DynamicCutoff, PeakFinder
    from smappy.fit_rois import cut_rois
    from smappy.locs import fit_to_localizations, valid
    from smappy.metadata import CameraMetadata
    from smappy.pipeline import with_readout, without_readout
    from smappy.psf import GaussianPSF

    camera = CameraMetadata(
        conversion=GAIN_E_PER_ADU,
        offset=OFFSET_ADU,
        pixelsize_um=PIXEL_SIZE_NM / 1000.0,
        read_noise_e=READ_NOISE_E,
        em_on=False,
    )
    finder = PeakFinder(DoGFilter(1.2), DynamicCutoff(1.7), n_threads=1)
    model = GaussianPSF(1.2)
    tables, find, fit = [], 0.0, 0.0
    begin = time.process_time()
    for first in range(0, len(counts), BLOCK_FRAMES):
        start = time.process_time()
        photons = to_photons(counts[first : first + BLOCK_FRAMES], camera)
        candidates, _ = finder(photons, first_frame=first)
        find += time.process_time() - start
        windows = cut_rois(photons, candidates, BOX_PX, first_frame=first)
        start = time.process_time()
        variance = camera.readout_variance
        result = model.fit(with_readout(windows.images, variance), n_threads=1)
        without_readout(result, model, variance)
        fit += time.process_time() - start
        table = fit_to_localizations(result, windows, model, camera)
        tables.append(table[valid(table)])
    whole = time.process_time() - begin
    names = {
        "frame": "frame",
        "x_px": "x_pix",
        "y_px": "y_pix",
        "photons": "photons",
        "x_sd_px": "x_err_pix",
        "y_sd_px": "y_err_pix",
    }
    columns = {ours: np.concatenate([t[theirs] for t in tables]) for ours, theirs in names.items()}
    for axis in ("x_px", "y_px"):
        columns[axis] = columns[axis] + 0.5
    n = len(columns["frame"])
    return columns, {
        "frames_per_s": len(counts) / find,
        "fits_per_s": n / fit,
        "localisations_per_s": n / whole,
    }


def trackpy(counts: Any, name: str, _folder: Path) -> Stages:
    """Band-pass, maxima, and refined centroids: no fit, so only the whole is timed."""
    import trackpy as tp

    tp.quiet()
    start = time.process_time()
    table = tp.batch(
        counts,
        BOX_PX,
        minmass=HAND_SET["trackpy minmass"][name],
        engine="numba",
        processes=1,
    )
    seconds = time.process_time() - start
    columns = {
        "frame": table["frame"],
        "x_px": table["x"] + 0.5,
        "y_px": table["y"] + 0.5,
        # The mass of a band-passed spot is no number of photons.
        "photons": np.full(len(table), np.nan),
        "x_sd_px": table["ep"],
        "y_sd_px": table["ep"],
    }
    return columns, {"localisations_per_s": len(table) / seconds}


TOOLS: dict[str, Callable[..., Stages]] = {
    "picasso-mle": lambda *film: picasso(*film, mle=True),
    "picasso-lsq": lambda *film: picasso(*film, mle=False),
    "smappy": smappy,
    "trackpy": trackpy,
}


def stages(tool: str, folder: Path, name: str, found: Path) -> dict[str, float]:
    """Run a tool over a film, write what it found and give its rates."""
    import tifffile

    counts = tifffile.imread(folder / f"{name}.tif")
    if tool == "trackpy":
        counts = counts[:TRACKPY_FRAMES]
    TOOLS[tool](counts[:20], name, folder)
    columns, rates = TOOLS[tool](counts, name, folder)
    arrays: dict[str, Any] = {key: np.asarray(value) for key, value in columns.items()}
    np.savez(found, frames=len(counts), **arrays)
    return rates


def whole_trackpy(folder: Path, name: str, out: Path) -> None:
    """Do what a script for trackpy would: open the file, locate in every frame, write the table."""
    import tifffile
    import trackpy as tp

    tp.quiet()
    frames = tifffile.imread(folder / f"{name}.tif")
    mass = HAND_SET["trackpy minmass"][name]
    tp.batch(frames, BOX_PX, minmass=mass, engine="numba", processes=1).to_csv(out, index=False)


if __name__ == "__main__":
    # Picasso's package loads Qt, which must not look for a screen.
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    words = sys.argv[1:]
    if words[0] == "versions":
        print(json.dumps(versions()))
    elif words[0] == "stages":
        print(json.dumps(stages(words[1], Path(words[2]), words[3], Path(words[4]))))
    else:
        whole_trackpy(Path(words[2]), words[3], Path(words[4]))
