"""Measure what runs that survive cost: memory on long movies, and time on the sample.

    python tests/benchmarks/runs.py memory 20 [FOLDER]   # a movie of 20 GB, 60 rotors
    python tests/benchmarks/runs.py overhead             # bookkeeping in the sample run

Speed and memory belong here and not in a test: machines differ and are shared.
"""

from __future__ import annotations

import cProfile
import json
import os
import platform
import pstats
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

SIZE_PX = 512
FILMED = 400
FLAGS = (
    *("--pixel-size-nm", "108.3", "--frame-interval-s", "0.002", "--exposure-s", "0.002"),
    *("--offset-adu", "100", "--gain-e-per-adu", "1.5", "--read-noise-e", "1.4"),
)
SAMPLE = Path(__file__).parents[2] / "sample_data" / "rotors"


def make(path: Path, gigabytes: float) -> None:
    """Write a film of 60 rotors over and over until the file is long enough."""
    import numpy as np

    from rotortrack.cameras.camera import Camera
    from rotortrack.movies.write import write_movie
    from rotortrack.simulate.ideal_examples import example_scene
    from rotortrack.simulate.ideal_film import film

    scene = example_scene(
        ("driven", "driven", "brownian") * 20,
        rng=np.random.default_rng(7),
        shape_px=(SIZE_PX, SIZE_PX),
        n_frames=FILMED,
        separation_nm=3000.0,
    )
    camera = Camera(offset_adu=100.0, gain_e_per_adu=1.5, read_noise_e=1.4)
    frames = np.concatenate(list(film(scene, camera, np.random.default_rng(8)).blocks()))
    count = max(FILMED, int(gigabytes * 1e9 / frames[0].nbytes))

    def repeated() -> Iterator[np.ndarray]:
        for start in range(0, count, FILMED):
            yield frames[: min(FILMED, count - start)]

    write_movie(path, repeated(), shape=(count, SIZE_PX, SIZE_PX))


def measured(*arguments: object) -> dict[str, float]:
    """Run a command as a process of its own: exit code, seconds, CPU seconds, peak memory."""
    start = time.perf_counter()
    code = "import sys; from rotortrack_cli.main import main; sys.exit(main())"
    words = [sys.executable, "-c", code, *map(str, arguments)]
    # A child's peak is never below its parent's size: this one imports nothing large.
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    return {
        "exit": os.waitstatus_to_exitcode(status),
        "seconds": round(time.perf_counter() - start, 1),
        "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 1),
        "peak_mb": round(usage.ru_maxrss / 1024),
    }


def memory(gigabytes: float, where: Path | None) -> None:
    """Compare `localise` and `run` on a long movie with a short one of the same field."""
    with tempfile.TemporaryDirectory(dir=where) as name:
        folder = Path(name)
        for size in (1.0, gigabytes):
            movie = folder / "movie.tif"
            subprocess.run([sys.executable, __file__, "make", movie, str(size)], check=True)
            frames = max(FILMED, int(size * 1e9 / (2 * SIZE_PX**2)))
            spots = folder / "spots.parquet"
            for command in (
                ("localise", movie, "-o", spots),
                ("run", movie, "-o", folder / f"run-{size}", "--no-figures"),
                ("run", movie, "-o", folder / f"run-{size}"),
            ):
                result = measured(*command, *FLAGS, "--quiet")
                print(
                    json.dumps(
                        {
                            "command": " ".join([command[0], *map(str, command[4:])]),
                            "file_gb": round(movie.stat().st_size / 1e9, 2),
                            "frames": frames,
                            "frames_per_s": round(frames / result["seconds"]),
                            **result,
                        }
                    ),
                    flush=True,
                )


def overhead(rounds: int = 5) -> None:
    """Time what a sample run spends on identity, hashes, parts, commits, lock, log and manifest."""
    from rotortrack_cli.main import main

    bookkeeping = ("identity.py", "keys.py", "parts.py", "store.py", "files.py", "locks.py")
    with tempfile.TemporaryDirectory() as name:
        for number in range(rounds + 1):
            profile = cProfile.Profile()
            start = time.perf_counter()
            words = ("run", SAMPLE / "movie.tif", "-c", SAMPLE / "config.toml", "--quiet", "--json")
            profile.enable()
            main([*map(str, words), "-o", str(Path(name) / str(number))])
            profile.disable()
            whole = time.perf_counter() - start
            if not number:
                continue  # compiles or loads the kernels
            stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
            spent = _outermost(stats, bookkeeping)
            print(json.dumps({"run_s": round(whole, 2), "bookkeeping_s": round(spent, 3)}))


def _outermost(stats: dict, names: tuple[str, ...]) -> float:
    """Sum the cumulative time of functions of some files over calls from other files."""
    total = 0.0
    for (file, _, _), (_, _, _, _, callers) in stats.items():
        if not file.endswith(
            tuple(f"pipeline/{n}" for n in names) + tuple(f"rotortrack/{n}" for n in names)
        ):
            continue
        for (caller, _, _), (_, _, _, cumulative) in callers.items():
            if not caller.endswith(names):
                total += cumulative
    return total


if __name__ == "__main__":
    if sys.argv[1] == "make":
        make(Path(sys.argv[2]), float(sys.argv[3]))
        sys.exit()
    print(f"{platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}")
    if sys.argv[1] == "memory":
        memory(float(sys.argv[2]), Path(sys.argv[3]) if len(sys.argv) > 3 else None)
    else:
        overhead()
