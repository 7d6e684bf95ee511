"""The sample data set: a short film of eight ideal rotors with its configuration and its truth."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from rotortrack.cameras.camera import Camera
from rotortrack.exchange.parquet import write_table
from rotortrack.files import atomic_path, write_text
from rotortrack.movies.write import write_movie
from rotortrack.simulate.ideal import IdealScene
from rotortrack.simulate.ideal_examples import PAPER_LIKE, example_scene
from rotortrack.simulate.ideal_film import film
from rotortrack.tables import Column, Schema

SAMPLE_SEED = 2024

SAMPLE_CAMERA = Camera(offset_adu=100.0, gain_e_per_adu=1.5, read_noise_e=1.4)
"""Noise does not compress: at 1.5 electrons a count 1600 frames take 6 MB, at 0.4545 over 8."""

TRUTH_SPOTS = Schema(
    "truth_spots",
    (
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("rotor", "int64", "", "rotor number, from 0", required=True),
        Column("x_nm", "float64", "nm", "position averaged over the exposure", required=True),
        Column("y_nm", "float64", "nm", "position averaged over the exposure", required=True),
        Column("theta_rad", "float64", "rad", "angle averaged over the exposure, not wrapped"),
        Column("photons", "float64", "photons", "expected photo-electrons, 0 when dark"),
    ),
)


def sample_scene(seed: int = SAMPLE_SEED) -> IdealScene:
    """Return what the sample shows: five driven rotors, a Brownian, a stuck, a toggling one."""
    return example_scene(
        PAPER_LIKE,
        rng=np.random.default_rng(seed),
        n_frames=1600,
        background_photons=5.0,
        photons=(600.0, 1000.0),
    )


def make_sample(folder: Path, *, seed: int = SAMPLE_SEED) -> None:
    """Write `movie.tif`, `config.toml`, `truth/spots.parquet` and `truth/rotors.csv`.

    Parameters
    ----------
    folder
        Where to write; made when missing. Files of those names are replaced.
    seed
        Of the scene and of the noise.

    Raises
    ------
    ResourceError
        The folder cannot be written.
    """
    scene = sample_scene(seed)
    movie = film(scene, SAMPLE_CAMERA, np.random.default_rng([seed, 1]))
    write_movie(
        folder / "movie.tif",
        movie.blocks(),
        shape=movie.shape,
        pixel_size_nm=scene.pixel_size_nm,
        frame_interval_s=scene.frame_interval_s,
        compression="zlib",
    )
    write_text(folder / "config.toml", _configuration(scene, SAMPLE_CAMERA))
    write_table(
        folder / "truth" / "spots.parquet",
        movie.truth_spots,
        TRUTH_SPOTS,
        {"made_by": "rotortrack simulate sample", "seed": seed},
    )
    with atomic_path(folder / "truth" / "rotors.csv") as temporary:
        movie.truth_rotors.to_csv(temporary, index=False, lineterminator="\n")


def manifest(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file under a folder, by its path from there."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _configuration(scene: IdealScene, camera: Camera) -> str:
    return f"""\
[movie]
pixel_size_nm = {scene.pixel_size_nm!r}
frame_interval_s = {scene.frame_interval_s!r}
exposure_s = {scene.exposure_s!r}
mirrored = "false"

[camera]
offset_adu = {camera.offset_adu!r}
gain_e_per_adu = {camera.gain_e_per_adu!r}
read_noise_e = {camera.read_noise_e!r}
"""
