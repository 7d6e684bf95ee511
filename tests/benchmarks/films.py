"""Films of spots whose truth is known: what every localiser of the benchmark is given.

    python tests/benchmarks/films.py FOLDER [NAME...]    # bright, maps, dim; all when none is named
    python tests/benchmarks/films.py FOLDER long 5       # bright over and over, 5 GB in one file

Needs numpy alone (and tifffile to write), so that the other programs' environment can import it,
too. Emitters lie anywhere, 2 px inside the frame, in Poisson numbers; photons are lognormal; a spot
is a Gaussian integrated over pixels, cut off 6 sigma from its centre. A film is drawn from its
recipe and seed alone, so that two runs see the same counts.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIZE_PX = 256
MARGIN_PX = 2.0
PIXEL_SIZE_NM = 108.3
OFFSET_ADU = 100.0
GAIN_E_PER_ADU = 0.45
READ_NOISE_E = 1.6


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """What a film shows; `photons` is their median and `log_sd` the spread of their logarithm."""

    name: str
    frames: int
    photons: float = 800.0
    log_sd: float = 0.5
    background: float = 8.0
    emitters: float = 25.0
    sigma_px: float = 1.25
    camera_maps: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Sensor:
    """Offset (ADU), gain (electrons per ADU) and read noise (electrons): numbers or maps."""

    offset_adu: Array
    gain_e_per_adu: Array
    read_noise_e: Array


@dataclass(frozen=True)
class Film:
    """Counts (frame, y, x) uint16 and the emitters: frame, place (px, outer corner 0), photons."""

    recipe: Recipe
    counts: NDArray[np.uint16]
    sensor: Sensor
    frame: NDArray[np.int64]
    x_px: Array
    y_px: Array
    photons: Array


FILMS = {
    recipe.name: recipe
    for recipe in (
        Recipe(name="bright", frames=2000, seed=1),
        Recipe(name="maps", frames=500, camera_maps=True, seed=2),
        Recipe(name="dim", frames=500, photons=250.0, log_sd=0.3, seed=3),
    )
}

PHOTONS = (100.0, 250.0, 800.0, 2000.0, 5000.0)
BACKGROUNDS = (2.0, 8.0, 20.0, 50.0)
DENSITIES = (5.0, 60.0)
SIGMAS_PX = (1.0, 1.5, 1.8)


def sweep_recipes(frames: int = 200) -> Iterator[Recipe]:
    """List what the defaults must bear: all spots of a film equally bright.

    Photons cross backgrounds; density and width vary about the middle and for dim spots.
    """
    cases: list[dict[str, Any]] = [
        {"photons": p, "background": b} for b in BACKGROUNDS for p in PHOTONS
    ]
    for photons in (250.0, 800.0):
        cases += [{"photons": photons, "emitters": density} for density in DENSITIES]
        cases += [{"photons": photons, "sigma_px": sigma} for sigma in SIGMAS_PX]
    for seed, case in enumerate(cases, start=100):
        yield Recipe(name=f"sweep-{seed}", frames=frames, log_sd=0.0, seed=seed, **case)


def make(recipe: Recipe) -> Film:
    """Draw a film; its camera maps, emitters and noise come from streams of their own."""
    maps, light, noise = (np.random.default_rng((recipe.seed, stream)) for stream in range(3))
    sensor = _mapped_sensor(maps) if recipe.camera_maps else _even_sensor()
    per_frame = light.poisson(recipe.emitters, recipe.frames)
    count = int(per_frame.sum())
    frame = np.repeat(np.arange(recipe.frames), per_frame)
    x, y = light.uniform(MARGIN_PX, SIZE_PX - MARGIN_PX, (2, count))
    photons = light.lognormal(math.log(recipe.photons), recipe.log_sd, count)
    counts = np.empty((recipe.frames, SIZE_PX, SIZE_PX), np.uint16)
    first = 0
    for index, number in enumerate(per_frame):
        own = slice(first, first + number)
        first += number
        light_e = recipe.background + spots(x[own], y[own], photons[own], recipe.sigma_px)
        electrons = noise.poisson(light_e) + sensor.read_noise_e * noise.standard_normal(
            light_e.shape
        )
        adu = np.rint(electrons / sensor.gain_e_per_adu + sensor.offset_adu)
        counts[index] = np.clip(adu, 0, 65535)
    return Film(recipe, counts, sensor, frame, x, y, photons)


def spots(x: Array, y: Array, photons: Array, sigma: float) -> Array:
    """Expect the light of one frame's emitters, (SIZE_PX, SIZE_PX) photons a pixel."""
    reach = math.ceil(6.0 * sigma)
    image = np.zeros((SIZE_PX + 2 * reach, SIZE_PX + 2 * reach))
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    along_x = _shares(x - left, sigma, reach)
    along_y = _shares(y - top, sigma, reach)
    for k, number in enumerate(photons):
        image[top[k] : top[k] + 2 * reach + 1, left[k] : left[k] + 2 * reach + 1] += (
            number * along_y[k, :, None] * along_x[k]
        )
    return image[reach:-reach, reach:-reach]


def _shares(place: Array, sigma: float, reach: int) -> Array:
    """Share of a Gaussian in each of the pixels around the one that holds its centre."""
    edges = np.arange(-reach, reach + 2) - place[:, None]
    return np.diff(0.5 * _erf(edges / (sigma * math.sqrt(2.0))), axis=1)


_erf = np.vectorize(math.erf, otypes=[float])


def _even_sensor() -> Sensor:
    return Sensor(*map(np.asarray, (OFFSET_ADU, GAIN_E_PER_ADU, READ_NOISE_E)))


def _mapped_sensor(rng: np.random.Generator) -> Sensor:
    """Draw maps of an sCMOS sensor: rms read noise 1.6 electrons, hot pixels included."""
    shape = (SIZE_PX, SIZE_PX)
    read = rng.lognormal(math.log(1.2), 0.35, shape)
    hot = rng.random(shape) < 0.01
    read[hot] = rng.uniform(4.0, 12.0, int(hot.sum()))
    offset = rng.normal(OFFSET_ADU, 1.5, shape)
    return Sensor(offset, GAIN_E_PER_ADU * rng.normal(1.0, 0.01, shape), read)


def paths(folder: Path, recipe: Recipe) -> tuple[Path, Path, Path]:
    """Name the files of a film: movie, truth, camera."""
    return (
        folder / f"{recipe.name}.tif",
        folder / f"{recipe.name}-truth.npz",
        folder / f"{recipe.name}-camera.npz",
    )


def write(folder: Path, recipe: Recipe) -> None:
    """Write a film, one TIFF page a frame, unless the folder holds it from this recipe."""
    import tifffile

    movie, truth, camera = paths(folder, recipe)
    written = json.dumps(dataclasses.asdict(recipe))
    if truth.exists():
        with np.load(truth) as held:
            if str(held["recipe"]) == written:
                return
        truth.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    film = make(recipe)
    with tifffile.TiffWriter(movie) as file:
        for frame in film.counts:
            file.write(frame, photometric="minisblack", contiguous=False, metadata=None)
    maps = dataclasses.asdict(film.sensor)
    np.savez(camera, **maps)
    # Last, since its presence says that the others are whole.
    np.savez(
        truth,
        recipe=written,
        frame=film.frame,
        x_px=film.x_px,
        y_px=film.y_px,
        photons=film.photons,
        background=recipe.background,
        sigma_px=recipe.sigma_px,
        **maps,
    )


def write_long(folder: Path, gigabytes: float) -> None:
    """Repeat the bright film in one file as ImageJ writes it above 4 GB: pixels after one page."""
    import tifffile

    write(folder, FILMS["bright"])
    counts = tifffile.imread(paths(folder, FILMS["bright"])[0]).astype(">u2")
    total = int(gigabytes * 1e9 / counts[0].nbytes)
    path = folder / "long.tif"
    tifffile.imwrite(
        path,
        counts[:1],
        byteorder=">",
        photometric="minisblack",
        description=f"ImageJ=1.54f\nimages={total}\nframes={total}\n",
        metadata=None,
    )
    with tifffile.TiffFile(path) as file:
        start = file.pages[0].dataoffsets[0]
    with path.open("r+b") as raw:
        raw.seek(start)
        for first in range(0, total, len(counts)):
            raw.write(counts[: total - first].data)


if __name__ == "__main__":
    where, names = Path(sys.argv[1]), sys.argv[2:]
    if names[:1] == ["long"]:
        write_long(where, float(names[1]))
    else:
        for name in names or FILMS:
            write(where, FILMS[name])
