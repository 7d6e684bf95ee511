"""Threads or processes, many or few, large blocks or small: the same columns to the last bit."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from rotortrack import parallel
from rotortrack.cameras.camera import Camera
from rotortrack.errors import MovieError
from rotortrack.localise.engine import _unpack, _Worker, localise
from rotortrack.localise.options import LocaliseOptions
from rotortrack.movies.movie import ArrayMovie, Movie
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie

SHAPE = (32, 40)
MAP = np.linspace(95, 105, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
CAMERA = Camera(offset_adu=MAP, gain_e_per_adu=0.5, read_noise_e=1.5)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A movie of 70 frames with three spots and noise."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    expected = np.full(SHAPE, 10.0)
    for row, column in ((8.3, 9.1), (20.6, 30.2), (24.5, 12.4)):
        expected += 80 * np.exp(-((y - row) ** 2 + (x - column) ** 2) / (2 * 1.3**2))
    counts = rng.poisson(expected, (70, *SHAPE)) * 2 + 100
    path = tmp_path_factory.mktemp("movie") / "movie.tif"
    tifffile.imwrite(path, counts.astype(np.uint16))
    return path


@pytest.fixture
def movie(path: Path) -> Iterator[Movie]:
    with open_movie(path) as movie:
        yield movie


@pytest.fixture(scope="module")
def processes() -> Iterator[Executor]:
    with parallel.process_pool(2) as pool:
        yield pool


def columns(movie: Movie, camera: Camera = CAMERA, **how: Any) -> dict[str, bytes]:
    blocks = localise(movie, camera, LocaliseOptions(), pixel_size_nm=100, **how)
    parts = [block.columns for block in blocks]
    return {name: np.concatenate([part[name] for part in parts]).tobytes() for name in parts[0]}


@pytest.fixture
def expected(movie: Movie) -> dict[str, bytes]:
    found = columns(movie, workers=1, block_frames=70)
    assert len(found["x_nm"]) >= 3 * 70 * 8
    return found


@pytest.mark.parametrize("block_frames", [1, 7, 64])
@pytest.mark.parametrize("workers", [1, 2, 3])
@pytest.mark.parametrize("give", [False, True])
def test_threads(
    movie: Movie, expected: dict[str, bytes], workers: int, block_frames: int, give: bool
) -> None:
    with ThreadPoolExecutor(workers) as pool:
        executor = pool if give else None
        found = columns(movie, workers=workers, block_frames=block_frames, executor=executor)
    assert found == expected


@pytest.mark.parametrize("block_frames", [7, 64])
@pytest.mark.parametrize("workers", [1, 3])
def test_processes(
    movie: Movie, expected: dict[str, bytes], processes: Executor, workers: int, block_frames: int
) -> None:
    found = columns(movie, workers=workers, block_frames=block_frames, executor=processes)
    assert found == expected


@pytest.mark.parametrize(
    "change", [lambda movie: select(movie, (4, 2, 30, 28), (11, 47)), lambda movie: movie]
)
def test_processes_treat_parts_of_movies_and_movies_in_memory_alike(
    path: Path, processes: Executor, change: Callable[[Movie], Movie]
) -> None:
    camera = Camera(offset_adu=100.0, gain_e_per_adu=0.5, read_noise_e=1.5)
    for movie in (open_movie(path), ArrayMovie(tifffile.imread(path))):
        with change(movie) as changed:
            here = columns(changed, camera, workers=1)
            there = columns(changed, camera, workers=2, block_frames=13, executor=processes)
        assert here == there


def test_a_failure_in_a_process_is_the_same_sentence(
    tmp_path: Path, path: Path, processes: Executor
) -> None:
    copy = tmp_path / "movie.tif"
    copy.write_bytes(path.read_bytes())
    with open_movie(copy) as movie:
        copy.unlink()
        with pytest.raises(MovieError, match=r"movie\.tif does not exist"):
            columns(movie, workers=2, executor=processes)


def test_a_worker_is_made_once_in_a_process_though_sent_with_every_block(movie: Movie) -> None:
    worker, other = (_Worker(movie, CAMERA, LocaliseOptions(), size) for size in (100.0, 50.0))
    worker((0, 1))
    sent = [pickle.loads(pickle.dumps(worker)) for _ in range(3)]
    made = [_unpack(worker.content) for worker in sent]
    assert made[0] is made[1] is made[2]
    assert made[0] is not worker
    anew = _unpack(pickle.loads(pickle.dumps(other)).content)
    assert anew is not made[0]
    worker.close()
    for copy in (made[0], anew):
        copy._movie.close()
    _unpack.cache_clear()
