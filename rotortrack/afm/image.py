"""Images of an atomic force microscope, read from the formats in which they are exported."""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotortrack.afm.text_matrix import parse_matrix
from rotortrack.errors import ContourWarning, ImageError
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.select import select
from rotortrack.movies.tiff import open_movie
from rotortrack.movies.wording import one_sentence

Floats = NDArray[np.float64]

ENDINGS = (".tif", ".tiff", ".png", ".npy", ".txt", ".asc", ".csv", ".dat")
_PNG = b"\x89PNG\r\n\x1a\n"
_LEAST_PIXELS = 16
_BYTES_A_NUMBER = 40
_COLOUR_WEIGHTS = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True)
class HeightImage:
    """An image as stored.

    Attributes
    ----------
    values
        Heights (y, x) in units of the file.
    pixel_size_nm
        By the file, or None.
    nm_per_unit
        Height of one unit by the file, or None.
    """

    values: Floats
    pixel_size_nm: float | None = None
    nm_per_unit: float | None = None


def read_image(path: Path, options: MovieOptions | None = None) -> HeightImage:
    """Read a TIFF file, a PNG picture, a numpy array or a text matrix, chosen by the ending.

    Parameters
    ----------
    path
        The file.
    options
        Which frame or channel of a TIFF file; the largest image that is accepted.

    Raises
    ------
    ImageError, MovieError
        It cannot be read, or is no image: too small, without relief, not all numbers finite.

    Warns
    -----
    ContourWarning
        A coloured picture, whose brightness is taken for the height.
    """
    options = options or MovieOptions()
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise ImageError(
            f"{path} has no known ending: an image is .tif, .png, .npy, or a matrix of heights as "
            ".txt, .asc, .csv or .dat"
        )
    if ending in (".tif", ".tiff"):
        image = _from_tiff(path, options)
    else:
        most = 1e6 * options.max_frame_megapixels
        with one_sentence(path, "read"):
            size = path.stat().st_size
        if size > most * _BYTES_A_NUMBER:
            raise ImageError(
                f"{path} is larger than an image of {options.max_frame_megapixels:g} megapixels: "
                "raise --max-frame-megapixels if it is one"
            )
        reader = {".png": _from_png, ".npy": _from_numpy}.get(ending, _from_text)
        image = reader(path)
    return _checked(image, path)


def _from_tiff(path: Path, options: MovieOptions) -> HeightImage:
    with open_movie(path, options) as whole:
        movie = select(whole, frames=options.frames)
        if movie.shape[0] > 1:
            raise ImageError(
                f"{path} holds {movie.shape[0]} images: choose the one of heights, such as the "
                "first by --frames 0 1"
            )
        known = movie.metadata.get("pixel_size_nm")
        return HeightImage(
            movie.frames(0, 1)[0].astype(np.float64),
            float(known.value) if known is not None else None,
        )


def _from_png(path: Path) -> HeightImage:
    from skimage.io import imread

    with one_sentence(path, "read as a picture"):
        content = path.read_bytes()
        if not content.startswith(_PNG):
            raise ImageError(f"{path} is no PNG picture: give it the ending of its format")
        picture = np.asarray(imread(io.BytesIO(content)))
    if picture.ndim == 3:
        colours = picture[..., :3] if picture.shape[2] >= 3 else picture[..., :1]
        picture = colours.astype(np.float64) @ (_COLOUR_WEIGHTS if colours.shape[2] == 3 else [1.0])
        if np.ptp(colours, axis=2).any():
            warnings.warn(
                f"{path} is coloured: brightness is taken for height, so that lengths are right "
                "but heights are not; export the data as TIFF or text instead",
                ContourWarning,
                stacklevel=4,
            )
    return HeightImage(picture.astype(np.float64))


def _from_numpy(path: Path) -> HeightImage:
    with one_sentence(path, "read as a numpy array"):
        values = np.load(path, allow_pickle=False)
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "biuf":
        raise ImageError(f"{path} holds no array of real numbers: save the heights as one")
    return HeightImage(values.astype(np.float64))


def _from_text(path: Path) -> HeightImage:
    with one_sentence(path, "read as text"):
        content = path.read_bytes()
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    read = parse_matrix(text, path)
    pixel_nm = None if read.width_nm is None else read.width_nm / read.values.shape[1]
    return HeightImage(read.values, pixel_nm, read.nm_per_unit)


def _checked(image: HeightImage, path: Path) -> HeightImage:
    """Refuse what cannot be an image of rods."""
    values = image.values
    if values.ndim != 2 or min(values.shape) < _LEAST_PIXELS:
        shape = " x ".join(map(str, values.shape))
        raise ImageError(
            f"{path} is an array of {shape}: an image has rows and columns, at least "
            f"{_LEAST_PIXELS} of each"
        )
    missing = int(np.count_nonzero(~np.isfinite(values)))
    if missing:
        raise ImageError(
            f"{path} has {missing} pixels without a finite height: crop it to the part that was "
            "scanned, or fill them"
        )
    if np.ptp(values) == 0.0:
        raise ImageError(f"{path} has the same height everywhere: choose the channel of heights")
    return image
