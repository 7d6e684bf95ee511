"""Spots and their fits."""

from __future__ import annotations

import math

import numpy as np
from battery import Subject, attempt, digits, word_for
from scipy import special

from rotortrack.cameras.camera import Camera
from rotortrack.localise.engine import localise_all
from rotortrack.localise.fit import METHODS
from rotortrack.localise.lanes import fit_windows
from rotortrack.localise.options import LocaliseOptions
from rotortrack.localise.quick import QUICK_METHODS, estimate
from rotortrack.localise.threshold import parse_threshold
from rotortrack.localise.windows import camera_arrays, cut_windows
from rotortrack.movies.movie import ArrayMovie

CAMERA = Camera(100.0, 0.5, 1.4)
SIZE, PLACE = 15, (7.3, 6.8)


def _edges(centre, sigma):
    at = (np.arange(SIZE + 1) - centre) / (sigma * math.sqrt(2.0))
    return 0.5 * np.diff(special.erf(at))


def _image(photons=1000.0, background=10.0, sigma=1.3):
    """Give expected photo-electrons of a spot whose place is known exactly."""
    rows = _edges(PLACE[1], sigma)
    return photons * np.outer(rows, _edges(PLACE[0], sigma)) + background


def _counts(image):
    return (image / 0.5 + 100.0)[np.newaxis].astype(np.float32)


def _fitted(image, method="mle"):
    frames = _counts(np.asarray(image, float))
    windows = cut_windows(
        frames, camera_arrays(CAMERA, frames.dtype), np.array([[0, 7, 7]], np.int32), 3
    )
    call = fit_windows if method in METHODS else estimate
    return call(windows, 3, method=method, sigma_px=1.3)


def _words(method, image):
    # Quick estimates tell the place alone; the other columns are nan on purpose.
    return lambda: word_for(lambda: _fitted(image, method)[0][:2])


def _exact(method):
    def against_truth():
        found, refused = attempt(lambda: _fitted(_image(1e5, 1e-3), method)[0].ravel()[:2])
        assert found is not None, refused
        # Places count from the middle of the window.
        return digits(found, np.array(PLACE) - 7.5, 1.0)

    return against_truth


HARD = {
    "no light": np.zeros((SIZE, SIZE)),
    "one photon": _image(1.0, 0.0),
    "no background": _image(500.0, 0.0),
    "1e9 photons": _image(1e9, 10.0),
    "a spot on 1e6 photons of background": _image(500.0, 1e6),
    "a flat window": np.full((SIZE, SIZE), 50.0),
    "a single bright pixel": np.pad(np.full((1, 1), 1e3), 7, constant_values=5.0),
    "far below the offset": np.full((SIZE, SIZE), -1e3),
    "a nan pixel": np.where(np.arange(SIZE * SIZE).reshape(SIZE, SIZE) == 110, math.nan, _image()),
    "all nan": np.full((SIZE, SIZE), math.nan),
    "an infinite pixel": np.where(
        np.arange(SIZE * SIZE).reshape(SIZE, SIZE) == 110, math.inf, _image()
    ),
    "a spot narrower than a pixel": _image(1000.0, 10.0, 0.2),
    "a spot wider than the window": _image(1000.0, 10.0, 8.0),
}


def _all(frames, **options):
    movie = ArrayMovie(np.asarray(frames))
    table = localise_all(movie, CAMERA, LocaliseOptions(**options), pixel_size_nm=100.0, workers=1)
    return table[["x_nm", "y_nm", "photons"]].to_numpy()


def _film(value):
    noise = np.random.default_rng(1).poisson(20.0, (4, 40, 40)).astype(np.float32)
    frames = noise + 100.0
    frames[:, 12:27, 12:27] += _image(2000.0, 0.0) / 0.5
    if value is not None:
        frames[1, 5, 5] = value
    return lambda: word_for(lambda: _all(frames))


SUBJECTS = (
    Subject(
        "localise.lanes.fit_windows",
        fit_windows,
        own={
            **{f"an exact spot, {method}": _exact(method) for method in METHODS},
            **{
                f"{name}, {method}": _words(method, image)
                for method in METHODS
                for name, image in HARD.items()
            },
        },
    ),
    Subject(
        "localise.quick.estimate",
        estimate,
        own={
            f"{name}, {method}": _words(method, image)
            for method in QUICK_METHODS
            for name, image in HARD.items()
        },
    ),
    Subject(
        "localise.engine.localise_all",
        localise_all,
        own={
            "a film": _film(None),
            "a nan pixel": _film(math.nan),
            "an infinite pixel": _film(math.inf),
            "a pixel of 1e30": _film(1e30),
            "a dark film": lambda: word_for(lambda: _all(np.full((3, 32, 32), 100, np.uint16))),
            "a white film": lambda: word_for(lambda: _all(np.full((3, 32, 32), 65535, np.uint16))),
            "frames smaller than a window": lambda: word_for(
                lambda: _all(np.full((3, 4, 4), 100, np.uint16))
            ),
            "frames of 64-bit floats": lambda: word_for(lambda: _all(np.full((3, 32, 32), 100.0))),
        },
    ),
    Subject(
        "localise.threshold.parse_threshold",
        parse_threshold,
        own={
            "no number": lambda: word_for(lambda: [parse_threshold("nan").factor]),
            "an unknown word": lambda: word_for(lambda: [parse_threshold("std(nothing)").factor]),
        },
    ),
)

EXEMPT = {
    "localise.detect.find_candidates": "met through localise_all, frame by frame",
    "localise.engine.localise": "is localise_all block by block: test_engine.py",
    "localise.fit.fit_chosen": "the second tier of fit_windows, which its hard cases reach",
    "localise.windows.camera_arrays": "copies numbers of the camera: tests/unit/localise",
    "localise.windows.cut_windows": "cuts pixels out for fit_windows, whose cases go through it",
}
