"""Decoding of stored pieces, bounded in memory."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from typing import Any

import tifffile

Decode = Callable[..., Any]
"""Turns the bytes of one piece into pixels: ``decode(data, piece, jpegtables=...)``."""

# imagecodecs, or the module that stands in for it.
_CODECS = vars(tifffile.tifffile)["imagecodecs"]
_DEFLATE = (tifffile.COMPRESSION.ADOBE_DEFLATE, tifffile.COMPRESSION.DEFLATE)
# Codecs that tifffile borrows from Python, which do not stop at the size of a piece.
_UNBOUNDED = (tifffile.COMPRESSION.LZMA, tifffile.COMPRESSION.ZSTD)
# Deflate grows data by no more than this factor; less than this many bytes do no harm.
_MOST_GROWTH = 1032
_HARMLESS_BYTES = 2**26


def decoder(page: tifffile.TiffPage, itemsize: int) -> Decode:
    """Give the function that decodes the pieces of `page`.

    imagecodecs stops at the size of a piece. Python's zlib, which stands in where imagecodecs is
    not installed, would inflate a megabyte of a hostile file to a gigabyte.

    Raises
    ------
    ImportError
        The codec needs imagecodecs.
    """
    if _CODECS.__name__ == "imagecodecs":
        return page.decode
    if page.compression in _UNBOUNDED:
        raise ImportError("imagecodecs")
    if page.compression not in _DEFLATE:
        return page.decode
    decode, size = page.decode, math.prod(page.chunks) * itemsize

    def bounded(data: bytes, piece: int, *, jpegtables: bytes | None) -> Any:
        if len(data) * _MOST_GROWTH > _HARMLESS_BYTES:
            data = deflate_again(data, size)
        return decode(data, piece, jpegtables=jpegtables)

    return bounded


def deflate_again(data: bytes, size: int) -> bytes:
    """Inflate no more than `size` bytes, and pack them without compression for tifffile.

    Raises
    ------
    ValueError
        There are more bytes.
    zlib.error
        The data are damaged.
    """
    inflate = zlib.decompressobj()
    raw = inflate.decompress(data, size)
    if not inflate.eof and inflate.decompress(inflate.unconsumed_tail, 1):
        raise ValueError(f"a piece of {size} bytes holds more")
    return zlib.compress(raw, 0)
