"""Compile all that a film needs, before it is needed."""

from __future__ import annotations

from rotortrack.simulate.film.film import Film
from rotortrack.simulate.film.options import (
    FilmOptions,
    PsfOptions,
    RotorsOptions,
    SensorOptions,
)
from rotortrack.simulate.film.scene import FilmScene


def compile_kernels() -> None:
    """Film two frames of one rotor, as a Gaussian spot and as an Airy pattern."""
    for model in ("gaussian", "airy"):
        scene = FilmScene(
            film=FilmOptions(width_px=32, height_px=32, n_frames=2),
            rotors=(RotorsOptions(x_nm=(1700.0,), y_nm=(1700.0,)),),
            psf=PsfOptions(model=model),
            camera=SensorOptions(),
        )
        for _ in Film(scene).blocks():
            pass
