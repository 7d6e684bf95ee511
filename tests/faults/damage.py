"""Seeded ways of damaging a file: blind ones for any file, aimed ones for each format."""

from __future__ import annotations

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import tifffile

Rng = np.random.Generator
Damage = Callable[[bytes, Rng], bytes]

_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8}
_DESCRIPTION, _SOFTWARE, _MICROMANAGER = 270, 305, 51123
_TEXTS = (_DESCRIPTION, _SOFTWARE, _MICROMANAGER)
_RESOLUTION = (282, 283)
ESCAPES = (b"\x1b[31m", b"\x1b]0;title\x07", b"\x00", b"\xe2\x80\xae", b"\xff\xfe", b"\x7f\x08")
_ODD_NUMBERS = (
    *(b"0", b"1", b"-1", b"2", b"3", b"1.5", b"1e308", b"-1e308", b"1e400", b"1e-320", b"nan"),
    *(b"NaN", b"inf", b"-Infinity", b"9" * 30, b"9" * 5000, b"2147483648", b"4294967296"),
    *(b"9223372036854775808", b"0x10", b"1_0", b"", b" ", b"text", b'"text"', b"null", b"true"),
    *(b"[]", b"{}", b"[1, 2]", b"\xef\xbc\x91", b"1,5", b"=1+1", b"[" * 3000, *ESCAPES),
)


@dataclass(frozen=True)
class Field:
    """One entry of a TIFF directory: where it stands and where its value lies."""

    tag: int
    place: int
    kind: int
    count: int
    value: int
    size: int


@dataclass(frozen=True)
class TiffMap:
    """Where the structure of a valid TIFF file lies.

    Attributes
    ----------
    order, big
        Byte order, and whether it is a BigTIFF.
    fields
        All entries, page by page.
    links
        Places at which the offset of a directory stands: in the header, and after each directory.
    """

    order: str
    big: bool
    fields: tuple[tuple[Field, ...], ...]
    links: tuple[int, ...]

    @property
    def word(self) -> str:
        """Format of an offset."""
        return self.order + ("Q" if self.big else "I")


def map_tiff(content: bytes) -> TiffMap:
    """Walk the directories of a valid file."""
    order = "<" if content[:2] == b"II" else ">"
    big = content[2:4] in (b"+\0", b"\0+")
    word, count_format = order + ("Q" if big else "I"), order + ("Q" if big else "H")
    step, inline = (20, 8) if big else (12, 4)
    links = [8 if big else 4]
    pages = []
    (place,) = struct.unpack_from(word, content, links[0])
    while place:
        (number,) = struct.unpack_from(count_format, content, place)
        start = place + struct.calcsize(count_format)
        fields = []
        for entry in range(start, start + number * step, step):
            tag, kind = struct.unpack_from(order + "HH", content, entry)
            (count,) = struct.unpack_from(word, content, entry + 4)
            size = count * _SIZES[kind]
            value = entry + 4 + inline
            if size > inline:
                (value,) = struct.unpack_from(word, content, value)
            fields.append(Field(tag, entry, kind, count, value, size))
        pages.append(tuple(fields))
        links.append(start + number * step)
        (place,) = struct.unpack_from(word, content, links[-1])
    return TiffMap(order, big, tuple(pages), tuple(links))


def free_bytes(content: bytes) -> np.ndarray:
    """Mark the bytes of a TIFF file that say nothing about where and how the pixels lie."""
    tiff = map_tiff(content)
    free = np.zeros(len(content), bool)
    for page in tiff.fields:
        for field in page:
            if field.tag in (*_TEXTS, *_RESOLUTION):
                free[field.value : field.value + field.size] = True
                entry_end = field.place + 4 + 2 * struct.calcsize(tiff.word)
                free[field.place + 4 : entry_end] = True
    return free


def pixel_bytes(content: bytes) -> np.ndarray:
    """Mark the bytes of a TIFF file that hold pixels, compressed or not."""
    pixels = np.zeros(len(content), bool)
    with tifffile.TiffFile(io.BytesIO(content)) as tif:
        for page in tif.pages:
            for place, size in zip(page.dataoffsets, page.databytecounts, strict=True):
                pixels[place : place + size] = True
    return pixels


def flip(content: bytes, rng: Rng) -> bytes:
    """Change 1 to 8 bytes."""
    changed = np.frombuffer(content, np.uint8).copy()
    if len(changed):
        places = rng.integers(0, len(changed), rng.integers(1, 9))
        changed[places] ^= rng.integers(1, 256, len(places), dtype=np.uint8)
    return changed.tobytes()


def cut(content: bytes, rng: Rng) -> bytes:
    """Lose the end."""
    return content[: int(rng.integers(0, max(len(content), 1)))]


def _block(content: bytes, rng: Rng) -> tuple[int, int]:
    start = int(rng.integers(0, max(len(content), 1)))
    return start, min(len(content), start + int(2 ** rng.uniform(1, 11)))


def zero(content: bytes, rng: Rng) -> bytes:
    """Read a block as zeros, as from a bad sector."""
    start, stop = _block(content, rng)
    return content[:start] + bytes(stop - start) + content[stop:]


def repeat(content: bytes, rng: Rng) -> bytes:
    """Write a block twice."""
    start, stop = _block(content, rng)
    return content[:stop] + content[start:]


def swap(content: bytes, rng: Rng) -> bytes:
    """Exchange two neighbouring blocks."""
    start, middle = _block(content, rng)
    stop = min(len(content), 2 * middle - start)
    return content[:start] + content[middle:stop] + content[start:middle] + content[stop:]


def insert(content: bytes, rng: Rng) -> bytes:
    """Put garbage in between."""
    start, _ = _block(content, rng)
    return content[:start] + rng.bytes(int(rng.integers(1, 300))) + content[start:]


BLIND: tuple[Damage, ...] = (flip, flip, flip, cut, zero, repeat, swap, insert)


def tiff_field(content: bytes, rng: Rng) -> bytes:
    """Change one value, count, type or tag of one directory, or the way to another directory."""
    tiff = map_tiff(content)
    changed = bytearray(content)
    if rng.random() < 0.15:
        place = int(rng.choice(tiff.links))
        _put(changed, place, tiff.word, rng, content)
        return bytes(changed)
    page = tiff.fields[0] if rng.random() < 0.6 else tiff.fields[rng.integers(len(tiff.fields))]
    field = page[rng.integers(len(page))]
    match rng.choice(["value", "value", "value", "count", "kind", "tag"]):
        case "value":
            kind = {1: "B", 2: "B", 3: "H"}.get(field.kind, "Q" if field.kind == 16 else "I")
            step = struct.calcsize(kind)
            index = int(rng.integers(max(field.size // step, 1)))
            _put(changed, field.value + index * step, tiff.order + kind, rng, content)
        case "count":
            _put(changed, field.place + 4, tiff.word, rng, content)
        case "kind":
            struct.pack_into(tiff.order + "H", changed, field.place + 2, int(rng.integers(0, 20)))
        case "tag":
            tags = [0, 254, 256, 257, 258, 259, 270, 273, 277, 278, 279, 284, 317, 320, 322, 338]
            tag = int(rng.choice([*tags, 339, 347, 513, 33628, 33629, 34412, 50838, 51123]))
            struct.pack_into(tiff.order + "H", changed, field.place, tag)
    return bytes(changed)


def _put(changed: bytearray, place: int, form: str, rng: Rng, content: bytes) -> None:
    """Write an odd number of the format `form`."""
    bits = 8 * struct.calcsize(form)
    (old,) = struct.unpack_from(form, changed, place)
    odd = [0, 1, 2, 3, old - 1, old + 1, 2 * old, old // 2, 2**bits - 1, 2 ** (bits - 1), place]
    odd += [len(content), len(content) - 1, 8, 65535, 5, 7, 8, 32946, 34712, 50000, 2**31, 10**6]
    struct.pack_into(form, changed, place, int(odd[rng.integers(len(odd))]) % 2**bits)


def tiff_text(content: bytes, rng: Rng) -> bytes:
    """Change the text of a description and hang the new text behind the file."""
    tiff = map_tiff(content)
    page = tiff.fields[0 if rng.random() < 0.8 else rng.integers(len(tiff.fields))]
    fields = [field for field in page if field.tag in _TEXTS]
    if not fields:
        return flip(content, rng)
    field = fields[rng.integers(len(fields))]
    text = change_text(content[field.value : field.value + field.size].rstrip(b"\0"), rng) + b"\0"
    text += bytes(8)  # never so short that it would have to stand in the entry itself
    changed = bytearray(content)
    struct.pack_into(tiff.word, changed, field.place + 4, len(text))
    place = field.place + 4 + struct.calcsize(tiff.word)
    struct.pack_into(tiff.word, changed, place, len(content))
    return bytes(changed) + text


def change_text(text: bytes, rng: Rng) -> bytes:
    """Put something odd in the place of one to three numbers or words."""
    for _ in range(int(rng.integers(1, 4))):
        pattern = rb"-?\d+(?:\.\d+)?" if rng.random() < 0.8 else rb"\w+"
        found = [*re.finditer(pattern, text)]
        if not found:
            return text + _ODD_NUMBERS[rng.integers(len(_ODD_NUMBERS))]
        match = found[rng.integers(len(found))]
        odd = _ODD_NUMBERS[rng.integers(len(_ODD_NUMBERS))]
        text = text[: match.start()] + odd + text[match.end() :]
    return text


def text_lines(content: bytes, rng: Rng) -> bytes:
    """Lose, double or exchange lines."""
    lines = content.splitlines(keepends=True)
    first, second = (int(n) for n in rng.integers(0, max(len(lines), 1), 2))
    match rng.integers(3):
        case 0:
            del lines[first : first + 1]
        case 1:
            lines.insert(second, lines[first] if lines else b"")
        case _ if lines:
            lines[first], lines[second] = lines[second], lines[first]
    return b"".join(lines)


def parquet_footer(content: bytes, rng: Rng) -> bytes:
    """Change the length of the footer, or bytes within it."""
    changed = bytearray(content)
    if rng.random() < 0.2:
        _put(changed, len(content) - 8, "<I", rng, content)
        return bytes(changed)
    (size,) = struct.unpack_from("<I", content, len(content) - 8)
    for place in rng.integers(len(content) - 8 - size, len(content) - 8, rng.integers(1, 5)):
        changed[place] ^= int(rng.integers(1, 256))
    return bytes(changed)


def gzip_frame(content: bytes, rng: Rng) -> bytes:
    """Change the header, the checksum or the length of a gzip file."""
    changed = bytearray(content)
    place = int(rng.choice([2, 3, 8, 9, len(content) - 8, len(content) - 4]))
    if place > 9:
        _put(changed, place, "<I", rng, content)
    else:
        changed[place] = int(rng.integers(256))
    return bytes(changed)


def gzip_inside(content: bytes, rng: Rng) -> bytes:
    """Damage what is packed, and pack it again, perhaps in two members."""
    inside = zlib.decompress(content, 31)
    inside = _one_of((change_text, text_lines, *BLIND), rng)(inside, rng)
    parts = [inside] if rng.random() < 0.8 else [inside[:999], inside[999:]]
    packers = [zlib.compressobj(4, zlib.DEFLATED, 31) for _ in parts]
    return b"".join(
        packer.compress(part) + packer.flush() for packer, part in zip(packers, parts, strict=True)
    )


def hdf5_head(content: bytes, rng: Rng) -> bytes:
    """Change numbers of the superblock or of the first object headers."""
    changed = bytearray(content)
    form = str(rng.choice(["<B", "<H", "<I", "<Q"]))
    reach = 96 if rng.random() < 0.3 else 4096
    _put(changed, int(rng.integers(8, min(reach, len(content) - 8))), form, rng, content)
    return bytes(changed)


def npz_header(content: bytes, rng: Rng) -> bytes:
    """Change the header of one array, its name in the archive, or how it is packed."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(stream, "w") as new:
        names = old.namelist()
        chosen = names[rng.integers(len(names))]
        for name in names:
            data = old.read(name)
            kind = zipfile.ZIP_DEFLATED if rng.random() < 0.3 else zipfile.ZIP_STORED
            if name == chosen:
                match rng.integers(4):
                    case 0:
                        name = ("../" + name, "/etc/" + name, name.upper(), "x")[rng.integers(4)]
                    case 1:
                        data = _one_of(BLIND, rng)(data, rng)
                    case 2:
                        types = (b"'|O'", b"'<c8'", b"'|S9'", b"'<U9'", b"'<m8'", b"'>f8'", b"'x'")
                        new_type = types[rng.integers(len(types))]
                        data = data[:10] + re.sub(rb"'<f\d'", new_type, data[10:128]) + data[128:]
                    case _:
                        data = data[:10] + change_text(data[10:128], rng) + data[128:]
            new.writestr(zipfile.ZipInfo(name), data, kind)
    return stream.getvalue()


def _one_of(ways: Sequence[Damage], rng: Rng) -> Damage:
    return ways[rng.integers(len(ways))]


_TEXT: tuple[Damage, ...] = (change_text, change_text, text_lines)
AIMED: dict[str, tuple[Damage, ...]] = {
    ".tif": (tiff_field, tiff_field, tiff_text),
    ".parquet": (parquet_footer,),
    ".csv": _TEXT,
    ".yaml": _TEXT,
    ".toml": _TEXT,
    ".json": _TEXT,
    ".gz": (gzip_frame, gzip_inside),
    ".hdf5": (hdf5_head,),
    ".npz": (npz_header,),
}
"""Ways that know the format, by the ending of the name."""


def damage(name: str, content: bytes, rng: Rng) -> tuple[str, bytes]:
    """Damage a file in a way that is chosen by `rng`; give the way's name and the new content."""
    aimed = AIMED.get(f".{name.rpartition('.')[2]}", ())
    ways = aimed if aimed and rng.random() < 0.55 else BLIND
    way = _one_of(ways, rng)
    changed = way(content, rng)
    if rng.random() < 0.1:
        changed = flip(changed, rng)
    return way.__name__, changed
