"""How a movie is best cut into blocks, shared among workers and stored: time against memory.

Localisations are the same to the last bit whatever is chosen, which is checked, so that what stands
in the place of an error is the peak memory of the arrays. Time is that on the clock, not of the
processors: sharing work saves no work. Groups: frames in a block on one worker, workers at blocks
of the size that is chosen by itself, and the movie's compression.
"""

from __future__ import annotations

import hashlib
import math
import tempfile
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rotortrack.tradeoff.point import Answer, Effort, Point, Progress, stamped

if TYPE_CHECKING:
    from rotortrack.cameras.camera import Camera

TITLE: Final = "blocks, workers and compression: throughput against memory"

SHAPE_PX: Final = (256, 256)
ROTORS: Final = 40
PIXEL_NM: Final = 108.3


@dataclass(frozen=True)
class Plan:
    """One way to localise the movie; None leaves the choice to the program."""

    group: str
    setting: str
    block_frames: int | None = None
    workers: int | None = 1
    compressed: bool = False
    is_default: bool = False


@dataclass(frozen=True)
class Sizes:
    """Frames of the movie, and how often each plan is timed."""

    frames: int
    repeats: int


SIZES: Final = {"quick": Sizes(256, 2), "usual": Sizes(1024, 7), "thorough": Sizes(8192, 15)}


def answer(effort: Effort, progress: Progress) -> Answer:
    """Localise one movie in all ways, in turns."""
    sizes = SIZES[effort.name]
    points = measure(sizes, plans(sizes.frames), progress)
    return stamped(
        question="blocks",
        effort=effort,
        points=points,
        error_unit="MB, peak of arrays; localisations are identical",
        seconds_unit="s per 1000 frames of 256 x 256 pixels, on the clock",
        bounds=dict.fromkeys(dict.fromkeys(point.group for point in points)),
        advice=advice(points),
    )


def plans(frames: int) -> list[Plan]:
    """List the ways that are compared on this machine."""
    from rotortrack.localise.engine import BLOCK_PIXELS
    from rotortrack.parallel import default_workers

    chosen = min(max(BLOCK_PIXELS // math.prod(SHAPE_PX), 1), 64, frames)
    sizes = sorted({1, 4, 16, chosen, 256, frames})
    most = default_workers()
    return [
        *(
            Plan("block size", f"{size} frames", size, is_default=size == chosen)
            for size in sizes
            if size <= frames
        ),
        *(
            Plan("workers", f"{count} worker{'s' * (count > 1)}", None, count, False, count == most)
            for count in sorted({1, 2, most, 2 * most})
        ),
        Plan("compression", "none", is_default=True),
        Plan("compression", "zlib", compressed=True),
    ]


def advice(points: list[Point]) -> str:
    """Say what the points mean."""
    of = {point.setting: point for point in points}
    chosen = next(p for p in points if p.group == "block size" and p.is_default)
    one = of["1 worker"]
    shared = next(p for p in points if p.group == "workers" and p.is_default)
    plain, packed = of["none"], of["zlib"]
    return (
        f"Leave blocks as they are ({chosen.error:.0f} MB a worker, {1e3 / chosen.seconds:.0f} "
        f"frames/s); all processors are {one.seconds / shared.seconds:.1f} times as fast as one, "
        f"and reading zlib takes {packed.seconds / plain.seconds:.1f} times as long as reading "
        "plain TIFF."
    )


def measure(sizes: Sizes, ways: list[Plan], progress: Progress) -> list[Point]:
    """Time every plan in turns, then measure its memory."""
    with tempfile.TemporaryDirectory(prefix="rotortrack-") as name:
        folder = Path(name)
        progress("film", 0, 0)
        camera = _film(folder, sizes.frames)
        wanted, _ = _localised(folder, camera, Plan("", ""))
        seconds: dict[Plan, list[float]] = {plan: [] for plan in ways}
        for repeat in range(sizes.repeats):
            for number, plan in enumerate(ways):
                progress("localise", repeat * len(ways) + number, sizes.repeats * len(ways))
                seconds[plan].append(_localised(folder, camera, plan)[1])
        points = []
        for number, plan in enumerate(ways):
            progress("memory", number, len(ways))
            tracemalloc.start()
            try:
                found, _ = _localised(folder, camera, plan)
                peak_mb = tracemalloc.get_traced_memory()[1] / 1e6
            finally:
                tracemalloc.stop()
            points.append(
                Point(
                    plan.setting,
                    plan.group,
                    peak_mb,
                    peak_mb,
                    peak_mb,
                    1e3 * min(seconds[plan]) / sizes.frames,
                    plan.is_default,
                    "" if found == wanted else "other localisations",
                )
            )
    return points


def _film(folder: Path, frames: int) -> Camera:
    """Write the movie plain and compressed, the same frames again and again."""
    import numpy as np

    from rotortrack.cameras.camera import Camera
    from rotortrack.movies.write import write_movie
    from rotortrack.simulate.ideal_examples import example_scene
    from rotortrack.simulate.ideal_film import film

    camera = Camera(offset_adu=100.0, gain_e_per_adu=0.45, read_noise_e=1.6)
    filmed = min(frames, 128)
    scene = example_scene(
        ("driven",) * ROTORS, rng=np.random.default_rng(1), shape_px=SHAPE_PX, n_frames=filmed
    )
    block = np.concatenate(list(film(scene, camera, np.random.default_rng(2)).blocks()))
    shape = (frames, *SHAPE_PX)
    for compressed in (False, True):
        write_movie(
            _movie(folder, compressed),
            (block[number % filmed] for number in range(frames)),
            shape=shape,
            compression="zlib" if compressed else None,
        )
    return camera


def _movie(folder: Path, compressed: bool) -> Path:
    return folder / ("zlib.tif" if compressed else "plain.tif")


def _localised(folder: Path, camera: Camera, plan: Plan) -> tuple[str, float]:
    """Localise the movie: a digest of all localisations, and the seconds on the clock."""
    from rotortrack.localise.engine import localise
    from rotortrack.localise.options import LocaliseOptions
    from rotortrack.movies.tiff import open_movie

    digests = {name: hashlib.blake2b() for name in ("frame", "x_nm", "y_nm", "photons")}
    spent_s = 0.0
    with open_movie(_movie(folder, plan.compressed)) as movie:
        blocks = localise(
            movie,
            camera,
            LocaliseOptions(),
            pixel_size_nm=PIXEL_NM,
            workers=plan.workers,
            block_frames=plan.block_frames,
        )
        begun = time.perf_counter()
        for block in blocks:
            spent_s += time.perf_counter() - begun
            for name, digest in digests.items():
                digest.update(block.columns[name].tobytes())
            begun = time.perf_counter()
        spent_s += time.perf_counter() - begun
    return "".join(digest.hexdigest() for digest in digests.values()), spent_s
