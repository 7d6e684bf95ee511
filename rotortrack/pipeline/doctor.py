"""Whether this computer is fit for the work: versions, processors, memory, disks, kernels.

Nothing that numbers are computed with is imported at the top, so that a broken installation can be
described too.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.metadata
import importlib.util
import os
import platform
import shutil
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rotortrack.exchange.limits import memory_bytes
from rotortrack.parallel import default_workers

if TYPE_CHECKING:
    from rotortrack.pipeline.run import Draw

Level = Literal["ok", "warning", "impossible"]

_LIBRARIES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "numba": "numba",
    "pandas": "pandas",
    "pyarrow": "pyarrow",
    "tifffile": "tifffile",
    "skimage": "scikit-image",
    "matplotlib": "matplotlib",
    "pydantic": "pydantic",
    "click": "click",
    "rich": "rich",
}
"""Module and distribution of what no command can do without."""

_EXTRAS = {
    "picasso": (("h5py", "yaml"), "Picasso's .hdf5 tables"),
    "codecs": (("imagecodecs",), "TIFF files compressed by LZW, zstd and the like"),
}
"""Modules of each extra, and what needs them."""

_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
_LEAST_MEMORY_BYTES = 2e9
_LEAST_DISK_BYTES = 1e9


@dataclass(frozen=True)
class Finding:
    """One line of what the doctor found.

    Attributes
    ----------
    topic, state
        What was looked at, and how it is.
    level
        `impossible` where no work can be done.
    remedy
        What to do, as a sentence; empty where all is well.
    """

    topic: str
    state: str
    level: Level = "ok"
    remedy: str = ""


def examine(folder: Path) -> list[Finding]:
    """Look at everything that the work depends on.

    Parameters
    ----------
    folder
        Where results would be written.

    Notes
    -----
    Costs the import of all libraries, some seconds on a cold disk. Compiled kernels are for
    :func:`examine_kernels`.
    """
    libraries = _libraries()
    able = all(finding.level != "impossible" for finding in libraries)
    return [
        Finding("python", f"{platform.python_version()} ({sys.executable})"),
        *libraries,
        *_extras(),
        Finding("platform", f"{platform.platform()}, {platform.machine()}"),
        _processors(),
        *([_threads()] if able else []),
        _memory(),
        *_disks(folder, able),
    ]


def examine_kernels() -> Finding:
    """Look at the compiled kernels that are kept, once the libraries are known to work."""
    from rotortrack import kernels

    path = kernels.cache_path()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        kept = kernels.cache_folder()
    if kept is None:
        return Finding(
            "kernels",
            f"cannot be kept in {path}, so every start takes some seconds longer",
            "warning",
            "set ROTORTRACK_CACHE_DIR to a folder of your own",
        )
    count = kernels.count_compiled(kept)
    if count == 0:
        return Finding(
            "kernels",
            f"none compiled yet in {kept}",
            "warning",
            "the next run takes some seconds longer, or run `rotortrack doctor --warm` now",
        )
    return Finding("kernels", f"{count} compiled in {kept}")


def warm_up(draw: Draw | None = None) -> None:
    """Compile every kernel by running a tiny simulated film through all that there is.

    What motion needs of them depends on the rotor, so those are run by themselves.

    Parameters
    ----------
    draw
        Draws the figures too, which lets matplotlib find its fonts.

    Raises
    ------
    RotortrackError
        What any run of the workflow would raise here, such as a disk that is full.

    Notes
    -----
    Takes about two minutes when nothing is compiled yet.
    """
    import numpy as np

    from rotortrack.cameras.camera import Camera
    from rotortrack.cameras.film_statistics import film_statistics
    from rotortrack.localise.fit import METHODS
    from rotortrack.localise.lanes import fit_windows
    from rotortrack.localise.quick import QUICK_METHODS
    from rotortrack.localise.windows import camera_arrays, cut_windows
    from rotortrack.motion.estimate import compile_kernels
    from rotortrack.pipeline.run import run_movie
    from rotortrack.settings import Layer
    from rotortrack.simulate.film import warm as film
    from rotortrack.simulate.rod import warm as rod
    from rotortrack.twocolour.distance import true_distance

    compile_kernels()
    rod.compile_kernels()
    film.compile_kernels()
    true_distance(np.linspace(20.0, 40.0, 10), np.full(10, 10.0))
    with _temporary_folder() as folder, warnings.catch_warnings(record=True):
        options = _write_film(folder / "movie.tif")
        for method in (*METHODS, *QUICK_METHODS):
            chosen = {"method": method}
            # Thresholds of F1 and those that need whole planes have kernels of their own.
            if method == "lsq":
                chosen["threshold"] = "std(Wave.F1)"
            if method in QUICK_METHODS:
                chosen["threshold"] = "std(Wave.F)"
            layer = Layer("warm-up", {**options, "localise": chosen})
            run_movie(folder / "movie.tif", [layer], folder / method, draw=draw)
            draw = None
    # No fit of the film is sure to need the second tier; a window without light is.
    dark = np.zeros((1, 9, 9), np.float32)
    camera = camera_arrays(Camera(0.0, 1.0, 1.0), dark.dtype)
    windows = cut_windows(dark, camera, np.array([[0, 4, 4]], np.int32), 3)
    fit_windows(windows, 3, method="mle", sigma_px=1.6)
    for kind in (np.uint16, np.float64):
        film_statistics([np.arange(1200).reshape(3, 20, 20).astype(kind)])


def _libraries() -> list[Finding]:
    """Import every library; one that fails to is named with its own words."""
    versions, broken = [], []
    for module, name in _LIBRARIES.items():
        try:
            importlib.import_module(module)
            versions.append(f"{name} {importlib.metadata.version(name)}")
        # Whatever a broken library raises tells its state.
        except Exception as error:  # noqa: BLE001
            words = (str(error).strip().splitlines() or [type(error).__name__])[0]
            broken.append(
                Finding(
                    name,
                    f"cannot be imported ({words})",
                    "impossible",
                    "install rotortrack anew in a fresh virtual environment",
                )
            )
    own = importlib.metadata.version("rotortrack")
    return [
        Finding("rotortrack", f"{own} ({Path(__file__).parents[1]})"),
        Finding("libraries", ", ".join(versions)),
        *broken,
    ]


def _extras() -> Iterator[Finding]:
    for extra, (modules, purpose) in _EXTRAS.items():
        missing = [name for name in modules if importlib.util.find_spec(name) is None]
        if missing:
            yield Finding(
                f"extra {extra}",
                f"not installed ({', '.join(missing)}), needed for {purpose} alone",
                "warning",
                f"pip install 'rotortrack[{extra}]' if you have such files",
            )
        else:
            yield Finding(f"extra {extra}", f"installed, for {purpose}")


def _processors() -> Finding:
    usable, present = default_workers(), os.cpu_count() or 1
    if usable < present:
        return Finding("processors", f"{usable} usable of {present}")
    return Finding("processors", f"{usable} usable")


def _threads() -> Finding:
    """Tell the threads of libraries, which work beside those of --workers."""
    import numba
    import numpy as np

    configuration: Any = np.show_config(mode="dicts")
    blas = configuration.get("Build Dependencies", {}).get("blas", {}).get("name", "BLAS")
    given = [f"{name}={os.environ[name]}" for name in _THREAD_VARIABLES if name in os.environ]
    limits = ", ".join(given) or "no limit set by the environment"
    return Finding("threads", f"numba {numba.get_num_threads()}, {blas}: {limits}")


def _memory() -> Finding:
    size = memory_bytes()
    if size is None:
        return Finding("memory", "unknown, as the system does not tell")
    if size < _LEAST_MEMORY_BYTES:
        return Finding(
            "memory", f"{size / 1e9:.1f} GB", "warning", "use few --workers and small regions"
        )
    return Finding("memory", f"{size / 1e9:.1f} GB")


def _disks(folder: Path, able: bool) -> Iterator[Finding]:
    yield _disk("working folder", folder, "run from, or write with -o to, another folder")
    if able:
        from rotortrack import kernels

        yield _disk(
            "kernel cache",
            kernels.cache_path().parent,
            "set ROTORTRACK_CACHE_DIR to a folder of your own",
        )
    try:
        temporary = Path(tempfile.gettempdir())
    except FileNotFoundError:
        yield Finding("temporary folder", "none", "warning", "set TMPDIR to a folder of your own")
        return
    yield _disk("temporary folder", temporary, "set TMPDIR to a folder of your own")


def _disk(topic: str, folder: Path, otherwise: str) -> Finding:
    """Look at the free space of a folder, or of the nearest one above it that exists."""
    try:
        folder = place = folder.absolute()
        while not place.is_dir() and place != place.parent:
            place = place.parent
        free = shutil.disk_usage(place).free
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        return Finding(
            topic, f"{folder} cannot be written ({error.strerror})", "warning", otherwise
        )
    state = f"{folder}, {free / 1e9:.1f} GB free"
    if free < _LEAST_DISK_BYTES:
        return Finding(topic, state, "warning", f"free some space, or {otherwise}")
    return Finding(topic, state)


@contextlib.contextmanager
def _temporary_folder() -> Iterator[Path]:
    """Give a folder that is gone afterwards.

    Raises
    ------
    ResourceError
        There is no place for it.
    """
    from rotortrack.errors import ResourceError

    try:
        holder = tempfile.TemporaryDirectory(prefix="rotortrack-", ignore_cleanup_errors=True)
    except OSError as error:
        raise ResourceError(
            f"no temporary folder can be made ({error.strerror}): set TMPDIR to a folder of your "
            "own with free space"
        ) from error
    with holder as name:
        yield Path(name)


def _write_film(path: Path) -> dict[str, dict[str, float | int]]:
    """Write a film that reaches every stage; give the options that its analysis needs."""
    import numpy as np

    from rotortrack.cameras.camera import Camera
    from rotortrack.movies.write import write_movie
    from rotortrack.simulate.ideal_examples import example_scene
    from rotortrack.simulate.ideal_film import film

    camera = Camera(offset_adu=100.0, gain_e_per_adu=1.0, read_noise_e=1.0)
    scene = example_scene(
        ("driven", "brownian"), rng=np.random.default_rng(1), shape_px=(48, 48), n_frames=400
    )
    movie = film(scene, camera, np.random.default_rng(2))
    write_movie(path, movie.blocks(), shape=movie.shape)
    return {
        "movie": {
            "pixel_size_nm": scene.pixel_size_nm,
            "frame_interval_s": scene.frame_interval_s,
            "exposure_s": scene.exposure_s,
        },
        "camera": {"offset_adu": 100.0, "gain_e_per_adu": 1.0, "read_noise_e": 1.0},
    }
