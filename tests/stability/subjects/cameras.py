"""Statistics of films of the camera itself."""

from __future__ import annotations

import numpy as np
from battery import Digits, Subject, attempt, digits, word_for

from rotortrack.cameras.camera import Camera
from rotortrack.cameras.film_statistics import film_statistics

FILM = np.random.default_rng(1).poisson(400.0, (50, 8, 8)).astype(np.uint16)


def _statistics(film):
    made = film_statistics([film])
    return np.stack([made.mean, made.variance])


def _exact():
    return digits(_statistics(FILM)[0], FILM.astype(np.int64).sum(0) / 50)


def _offset():
    far = FILM.astype(np.float64) + 1e9
    plain, moved = _statistics(FILM)[1], _statistics(far)[1]
    return digits(moved, plain)


def _round_trip(gain):
    def measure():
        camera = Camera(100.0, gain, 1.0)
        counts = np.array([[0.0, 100.0, 1e4]])
        found, refused = attempt(lambda: camera.to_photons(counts))
        assert found is not None, refused
        return Digits(digits(found, ((counts - 100.0) * gain).ravel()).value)

    return measure


SUBJECTS = (
    Subject(
        "cameras.film_statistics.film_statistics",
        film_statistics,
        own={
            "the mean, against whole numbers": _exact,
            "an offset of 1e9": _offset,
            "one frame": lambda: word_for(lambda: _statistics(FILM[:1])),
            "no frame": lambda: word_for(lambda: film_statistics([]).mean),
            "a nan": lambda: word_for(
                lambda: _statistics(np.where(FILM[3, 2, 2] == FILM, np.nan, FILM))
            ),
            **{f"photons at a gain of {gain:g}": _round_trip(gain) for gain in (1e-6, 1.0, 1e6)},
        },
    ),
)

EXEMPT = {
    "cameras.calibrate.calibrate": "fits slopes of films: tests/unit/cameras/test_calibrate.py",
    "cameras.calibrate.check_gain": "holds two numbers against each other: tests/unit/cameras",
    "cameras.line_noise.check_line_noise": "reads a movie: tests/unit/cameras/test_line_noise.py",
    "cameras.maps.write_maps": "writes a file: tests/unit/cameras/test_maps.py, tests/faults",
    "cameras.photon_transfer.gain_from_movie": "reads a movie: tests/unit/cameras",
    "cameras.pixels.check_pixels": "reads a movie: tests/unit/cameras/test_pixels.py",
}
