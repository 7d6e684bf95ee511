"""Write movies as TIFF that this program and ImageJ read, frame by frame."""

from __future__ import annotations

import contextlib
import errno
import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tifffile
from numpy.typing import NDArray

from rotortrack.errors import MovieError
from rotortrack.files import atomic_path
from rotortrack.movies.movie import NUMBER_TYPES
from rotortrack.movies.write_ome import ome_description

_CLASSIC_BYTES = 2**32 - 2**24
_DIRECTORY_BYTES = 512


def write_movie(
    path: Path,
    frames: Iterable[NDArray[Any]],
    *,
    shape: tuple[int, int, int] | None = None,
    pixel_size_nm: float | None = None,
    frame_interval_s: float | None = None,
    exposure_s: float | None = None,
    times_s: NDArray[np.float64] | None = None,
    compression: Literal["zlib"] | None = None,
) -> None:
    """Write a movie atomically, holding one frame at a time.

    One page a frame. A name that ends in .ome.tif or .ome.tiff makes an OME-TIFF, which tells
    exposure and times, too, and needs `shape`. Else the first page's description carries pixel size
    and frame interval in ImageJ's words but no number of images, so that ImageJ reads the pages one
    by one: above 4 GB and for compressed pages it would otherwise look for them in the wrong
    places.

    Parameters
    ----------
    path
        Where the file appears once it is whole.
    frames
        Frames (y, x) or blocks of frames (frame, y, x), all of one size and number type.
    shape
        Frames, rows, columns. Needed to know that the file stays below 4 GB; without it, and for
        larger files, BigTIFF is written, which older versions of ImageJ open through Bio-Formats.
    pixel_size_nm, frame_interval_s, exposure_s
        Written when given; the exposure in an OME-TIFF alone.
    times_s
        When each frame was received, shape (frames,); for an OME-TIFF.
    compression
        ``zlib`` (lossless) or None.

    Raises
    ------
    MovieError
        There are no frames, they differ in size or type, they are not as many as `shape` says, or
        an OME-TIFF lacks its `shape`.
    ResourceError
        The disk is full or the folder cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import rotortrack as rt
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "movie.ome.tif"
    ...     frames = (np.full((32, 48), k, np.uint16) for k in range(10))
    ...     rt.write_movie(path, frames, shape=(10, 32, 48), pixel_size_nm=108.3)
    ...     with rt.open_movie(path) as movie:
    ...         movie.metadata["pixel_size_nm"].value
    108.3
    """
    path = Path(path)
    stream = _single_frames(frames)
    first = next(stream, None)
    if first is None:
        raise MovieError(f"{path} is not written: there are no frames")
    if first.dtype not in NUMBER_TYPES:
        raise MovieError(
            f"{path} is not written: frames of {first.dtype.name} are not supported; convert them "
            f"to one of {', '.join(kind.name for kind in NUMBER_TYPES)}"
        )
    per_micron = None if pixel_size_nm is None else (1e3 / pixel_size_nm,) * 2
    if is_ome(path):
        if shape is None:
            raise MovieError(
                f"{path} is not written: an OME-TIFF tells its number of frames at its beginning; "
                "give shape, or a name that ends in .tif alone"
            )
        description = ome_description(
            path.name,
            shape,
            first.dtype,
            pixel_size_nm=pixel_size_nm,
            frame_interval_s=frame_interval_s,
            exposure_s=exposure_s,
            times_s=times_s,
        )
    else:
        description = _description(shape, pixel_size_nm, frame_interval_s)
    # The estimate holds for compressed frames too: noise hardly shrinks.
    page_bytes = first.nbytes + _DIRECTORY_BYTES
    big = shape is None or shape[0] * page_bytes + len(description) > _CLASSIC_BYTES
    count = 0
    with (
        atomic_path(path) as temporary,
        _disk_errors_named(),
        tifffile.TiffWriter(temporary, bigtiff=big) as writer,
    ):
        for frame in itertools.chain([first], stream):
            if frame.shape != first.shape or frame.dtype != first.dtype:
                raise MovieError(
                    f"{path} is not written: frame {count} is {frame.dtype.name} of shape "
                    f"{frame.shape}, the first {first.dtype.name} of {first.shape}"
                )
            writer.write(
                np.ascontiguousarray(frame),
                photometric="minisblack",
                compression=compression,
                resolution=per_micron,
                resolutionunit="NONE",
                description=description if count == 0 else None,
                metadata=None,
                software=False,
                contiguous=False,
            )
            count += 1
        if shape is not None and (count, *first.shape) != tuple(shape):
            raise MovieError(
                f"{path} is not written: shape {tuple(shape)} was announced, but the frames "
                f"make {(count, *first.shape)}"
            )


def is_ome(path: Path) -> bool:
    """Tell whether a name asks for an OME-TIFF."""
    return path.name.lower().endswith((".ome.tif", ".ome.tiff"))


@contextlib.contextmanager
def _disk_errors_named() -> Iterator[None]:
    """Give numpy's nameless error of a short write ("n requested and m written") its number."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise OSError(errno.ENOSPC, str(error)) from error
        raise


def _single_frames(frames: Iterable[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    for block in frames:
        if block.ndim not in (2, 3):
            raise MovieError(
                f"an array of shape {block.shape} is not a frame: give (y, x) or (frame, y, x)"
            )
        yield from block if block.ndim == 3 else block[np.newaxis]


def _description(
    shape: tuple[int, int, int] | None,
    pixel_size_nm: float | None,
    frame_interval_s: float | None,
) -> str:
    lines = ["ImageJ=1.54f"]
    if shape is not None:
        lines.append(f"frames={shape[0]}")
    if pixel_size_nm is not None:
        lines.append("unit=micron")
    if frame_interval_s is not None:
        lines.append(f"finterval={frame_interval_s!r}")
    return "\n".join([*lines, "loop=false", ""])
