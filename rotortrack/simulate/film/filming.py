"""From a scene to a movie file, with the truth beside it."""

from __future__ import annotations

import contextlib
import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from rotortrack.errors import AliasingWarning
from rotortrack.exchange.row_groups import open_row_groups
from rotortrack.files import make_folder, write_text
from rotortrack.movies.write import is_ome, write_movie
from rotortrack.parallel import default_workers
from rotortrack.simulate.film import truth
from rotortrack.simulate.film.film import Film
from rotortrack.tables import schema_metadata
from rotortrack.toml import to_toml

if TYPE_CHECKING:
    from rotortrack.simulate.film.shapes import Shape
    from rotortrack.simulate.scene import Scene

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Filmed:
    """A film on disk.

    Attributes
    ----------
    movie, truth
        The movie file and the folder beside it.
    frames, rotors
        How many were recorded and drawn.
    effects
        Sections of the scene that acted.
    seconds
        How long it took.
    """

    movie: Path
    truth: Path
    frames: int
    rotors: int
    effects: tuple[str, ...]
    seconds: float


def truth_folder(movie: Path) -> Path:
    """Give the folder of the truth beside a movie: its name without .tif or .ome.tif, and `.truth`.

    Other points in a name stay, so that films of 0.5 V and 0.7 V have folders of their own.
    """
    name = movie.stem
    return movie.with_name((name[: -len(".ome")] if is_ome(movie) else name) + ".truth")


def film_scene(
    scene: Scene,
    movie: Path,
    *,
    truth_in: Path | None = None,
    shapes: Sequence[Sequence[Shape]] | None = None,
    workers: int | None = None,
    compress: bool = False,
    progress: Progress | None = None,
) -> Filmed:
    """Film a scene.

    Parameters
    ----------
    scene
        With a section [film].
    movie
        A TIFF file; one that ends in .ome.tif holds the time of every frame. Beside it appears the
        folder :func:`truth_folder`, with `rotors.csv`, `spots.parquet`, `scene.toml`, `config.toml`
        (for `rotortrack run -c`), and where the scene has them `drift.csv`, `fiducials.csv`,
        `camera.npz` and `daq.csv`.
    truth_in
        Another folder for what lies beside the movie.
    shapes
        What :func:`shapes_for` gave for this scene; absent, it is asked.
    workers
        Threads that render; the result does not depend on it. Absent, all processors.
    compress
        Compress the movie without loss: a third smaller, and half as fast.
    progress
        Called with a stage's name, frames done and frames in all.

    Returns
    -------
    Filmed

    Raises
    ------
    ConfigurationError
        The scene has no [film], no room for its rotors, or asks for what cannot be.
    ResourceError
        The disk is full or the folder cannot be written.
    """
    begun = time.perf_counter()
    scene.require("film")
    assert scene.film is not None
    film = Film(scene.film, shapes_for(scene) if shapes is None else shapes)
    warn_of_aliases(film)
    folder = truth_in or truth_folder(movie)
    source = {"made_by": "rotortrack simulate film", "seed": scene.film.film.seed}
    metadata = schema_metadata(truth.SPOTS, source)
    with _made(folder), open_row_groups(folder / "spots.parquet", truth.SPOTS, metadata) as writer:
        rows = truth.SpotRows(writer, film.recorded)
        blocks = film.blocks(workers=workers or default_workers(), see=rows)
        write_movie(
            movie,
            _told(blocks, film.shape[0], progress),
            shape=film.shape,
            pixel_size_nm=scene.film.film.pixel_size_nm,
            frame_interval_s=scene.film.film.frame_interval_s,
            exposure_s=scene.film.film.exposure_s,
            times_s=_noted_times(film) if is_ome(movie) else None,
            compression="zlib" if compress else None,
        )
        if writer.is_empty:
            writer.append(truth.empty_spots())
    _write_beside(scene, film, folder)
    return Filmed(
        movie=movie,
        truth=folder,
        frames=film.shape[0],
        rotors=len(film.rotors),
        effects=scene.film.names,
        seconds=time.perf_counter() - begun,
    )


@contextlib.contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Make a folder, and take it away again where nothing came of it."""
    was_there = folder.exists()
    make_folder(folder)
    try:
        yield
    except BaseException:
        if not was_there:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def warn_of_aliases(film: Film) -> None:
    """Warn of rotors that turn more than half a turn a frame, or within an exposure a good part.

    Warns
    -----
    AliasingWarning
        How the fastest one will be seen.
    """
    clock = film.clock
    # What turns by a table has no speed of its own.
    speeds = [abs(rotor.omega_rad_s) for rotor in film.rotors if rotor.motion != "table"]
    omega = film.largest_drive * max(speeds, default=0.0)
    step = omega * clock.frame_interval_s
    blur = 0.5 * omega * clock.exposure_s
    ring = abs(math.sin(blur) / blur) if blur > 0.0 else 1.0
    if step <= math.pi and ring >= _SEEN_RING:
        return
    seen = math.remainder(step, 2.0 * math.pi) / clock.frame_interval_s
    warnings.warn(
        f"a rotor of {omega / (2.0 * math.pi):.4g} turns a second is seen to turn at "
        f"{abs(seen) / (2.0 * math.pi):.3g} by {1.0 / clock.frame_interval_s:.4g} frames a second, "
        f"on a ring of {ring:.1%} of its radius: set omega_rad_s to that of measured rotors, or "
        "shorten frame_interval_s and exposure_s",
        AliasingWarning,
        stacklevel=3,
    )


_SEEN_RING = 0.8
"""Below this part of its radius a blurred ring is warned of."""


def shapes_for(scene: Scene) -> list[Sequence[Shape]]:
    """Simulate or load the rods of each group of rotors; empty for circles."""
    assert scene.film is not None
    shapes: dict[str, Sequence[Shape]] = {"circle": ()}
    for group in scene.film.rotors:
        if group.shape not in shapes:
            from rotortrack.simulate.film.shapes import shapes_of

            shapes[group.shape] = shapes_of(group.shape, scene)
    return [shapes[group.shape] for group in scene.film.rotors]


def _told(
    blocks: Iterator[NDArray[Any]], frames: int, progress: Progress | None
) -> Iterator[NDArray[Any]]:
    done = 0
    for block in blocks:
        done += len(block)
        yield block
        if progress is not None:
            progress("film", done, frames)


def _noted_times(film: Film) -> NDArray[Any] | None:
    """Tell the times that the file holds: those of its recorded frames, if any are to be noted."""
    scene = film.scene
    if scene.timestamps is None and scene.dropped is None:
        return None
    from rotortrack.simulate.film.recording import noted_times

    times: NDArray[Any] = noted_times(scene.timestamps, film.clock, scene.film.seed)
    return times if film.recorded is None else times[film.recorded]


_OF_EFFECTS = ("drift.csv", "fiducials.csv", "camera.npz", "daq.csv")
"""Files that not every scene has."""


def _write_beside(scene: Scene, film: Film, folder: Path) -> None:
    # An earlier film's must not be taken for this one's.
    for name in _OF_EFFECTS:
        (folder / name).unlink(missing_ok=True)
    table = truth.rotor_table(film.rotors, film.realised_rad_s())
    truth.write_csv(folder / "rotors.csv", table)
    if film.drift_nm:
        truth.write_csv(folder / "drift.csv", truth.drift_table(film))
    if film.scene.fiducials is not None:
        truth.write_csv(folder / "fiducials.csv", truth.fiducial_table(film))
    maps = None
    if film.sensor is not None and not film.sensor.camera.is_scalar:
        from rotortrack.cameras.maps import write_maps

        maps = folder / "camera.npz"
        write_maps(maps, truth.camera_arrays(film.sensor.camera), {"made_by": "a simulated film"})
    if film.scene.voltage is not None:
        from rotortrack.simulate.film.recording import write_daq

        write_daq(
            folder / "daq.csv",
            film.scene.voltage,
            film.clock,
            film.recorded,
            film.scene.film.seed,
        )
    truth.write_configuration(folder / "config.toml", film, maps)
    write_text(folder / "scene.toml", to_toml(scene.as_dict()))
