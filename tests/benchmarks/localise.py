"""Measure the localisation engine: localisations per second, and memory on a long movie.

    python tests/benchmarks/localise.py speed     # 256 x 256 px, 25 emitters a frame
    python tests/benchmarks/localise.py memory    # a sparse file of 5 GB

Speed belongs here and not in a test: machines differ and are shared.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tifffile
from scipy.special import ndtr

from rotortrack.cameras.camera import Camera
from rotortrack.localise.engine import localise
from rotortrack.localise.options import LocaliseOptions
from rotortrack.movies.movie import ArrayMovie
from rotortrack_cli.main import main as rotortrack

PIXEL_SIZE_NM = 108.3


def crowded_movie(frames: int = 500, size: int = 256, emitters: float = 25.0) -> np.ndarray:
    """Lognormal photons (median 800), background 8, sigma 1.25 px, read noise 1.6 electrons."""
    rng = np.random.default_rng(0)
    edges = np.arange(size + 1)
    movie = np.empty((frames, size, size), np.uint16)
    for frame in movie:
        count = rng.poisson(emitters)
        x, y = rng.uniform(2, size - 2, (2, count, 1))
        photons = rng.lognormal(np.log(800.0), 0.5, (count, 1))
        gx = np.diff(ndtr((edges - x) / 1.25), axis=1)
        gy = np.diff(ndtr((edges - y) / 1.25), axis=1)
        electrons = rng.poisson(8.0 + gy.T @ (photons * gx)) + rng.normal(0, 1.6, (size, size))
        frame[:] = np.clip(np.round(electrons / 0.45 + 100.0), 0, 65535)
    return movie


def speed() -> None:
    """Detect and fit after warm-up, on one and on all processors."""
    movie = ArrayMovie(crowded_movie())
    camera = Camera(offset_adu=100.0, gain_e_per_adu=0.45, read_noise_e=1.6)
    for method in ("mle", "wlsq", "lsq"):
        options = LocaliseOptions(method=method, threshold="1.2*std(Wave.F1)")
        for workers in (1, 2):
            seconds = []
            for _ in range(4):
                start = time.perf_counter()
                blocks = list(
                    localise(movie, camera, options, pixel_size_nm=PIXEL_SIZE_NM, workers=workers)
                )
                seconds.append(time.perf_counter() - start)
            found = sum(block.counts.localisations for block in blocks)
            # The first pass compiles or loads the kernels.
            best = min(seconds[1:])
            print(
                json.dumps(
                    {
                        "method": method,
                        "workers": workers,
                        "localisations": found,
                        "localisations_per_s": round(found / best),
                        "frames_per_s": round(movie.shape[0] / best),
                    }
                )
            )


def memory(gigabytes: float = 5.0) -> None:
    """Localise a sparse movie and report this process's peak resident memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.tif"
        tile = crowded_movie(frames=64)
        frames = int(gigabytes * 1e9 / tile[0].nbytes)
        # One directory and contiguous pixels beyond it: what ImageJ writes above 4 GB.
        tifffile.imwrite(
            path,
            tile[:1],
            byteorder=">",
            photometric="minisblack",
            description=f"ImageJ=1.54f\nimages={frames}\nframes={frames}\n",
            metadata=None,
        )
        with tifffile.TiffFile(path) as file:
            start = file.pages[0].dataoffsets[0]
        with path.open("r+b") as file:
            for index in range(0, frames, frames // 20):
                file.seek(start + index * tile[0].nbytes)
                file.write(tile.astype(">u2").tobytes())
            file.truncate(start + frames * tile[0].nbytes)
        begin = time.perf_counter()
        code = rotortrack(
            [
                *("localise", str(path), "-o", str(Path(folder) / "spots.parquet"), "--json"),
                *("--pixel-size-nm", str(PIXEL_SIZE_NM), "--offset-adu", "100"),
                *("--gain-e-per-adu", "0.45", "--read-noise-e", "1.6", "--quiet"),
                *("--threshold", "1.2*std(Wave.F1) + 5"),
            ]
        )
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            json.dumps(
                {
                    "exit": int(code),
                    "file_gb": round(path.stat().st_size / 1e9, 2),
                    "peak_mb": round(peak),
                    "seconds": round(time.perf_counter() - begin, 1),
                }
            )
        )


if __name__ == "__main__":
    print(f"{platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}")
    {"speed": speed, "memory": memory}[sys.argv[1]]()
