"""Bombs, XML and companion names: declared sizes are weighed, and no other file is opened."""

from __future__ import annotations

import gzip
import importlib.util
import io
import os
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tifffile

if not sys.platform.startswith("linux"):
    pytest.skip("pipes, users and limits are made as Linux has them", allow_module_level=True)

_spec = importlib.util.spec_from_file_location("hostile", Path(__file__).with_name("hostile.py"))
hostile = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(hostile)


@pytest.fixture(autouse=True)
def _in_time() -> Iterator[None]:
    with hostile.in_time():
        yield


def test_declared_frame_beyond_the_limit_is_refused_before_decoding(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "bomb.tif"
    packed = zlib.compress(bytes(2**20))
    tifffile.imwrite(
        path,
        iter([packed]),
        shape=(20000, 20000),
        dtype=np.uint16,
        compression="zlib",
        rowsperstrip=20000,
        photometric="minisblack",
    )
    assert path.stat().st_size < 10_000
    sentence = hostile.refused(capfd, 3, "info", path)
    assert "20000 x 20000" in sentence
    assert "bomb.tif" in sentence


def test_frame_that_expands_far_beyond_its_size_is_decoded_in_bounded_memory(
    tmp_path: Path,
) -> None:
    path = tmp_path / "bomb.tif"
    packed = zlib.compress(bytes(60 * 2**20), 9)
    tifffile.imwrite(
        path,
        iter([packed] * 5),
        shape=(5, 64, 64),
        dtype=np.uint16,
        compression="zlib",
        rowsperstrip=64,
        photometric="minisblack",
    )
    program = 'print("exit", main(["info", sys.argv[1]]))'
    assert "exit 3" in hostile.limited(program, path) or "exit 0" in hostile.limited(program, path)


def test_packed_table_that_expands_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.csv.gz"
    rows = b"1,100.0,200.0\n" * 2**16
    with gzip.open(path, "wb", 9) as stream:
        stream.write(b'"frame","x [nm]","y [nm]"\n')
        for _ in range(400):
            stream.write(rows)
    assert path.stat().st_size < 4e6
    words = '"--frame-interval-s", "0.002", "-o", sys.argv[1] + ".out"'
    shown = hostile.limited(f'print("exit", main(["rotors", sys.argv[1], {words}]))', path)
    assert "exit 3" in shown
    assert "bomb.csv.gz" in shown


@pytest.mark.parametrize("content", [b"0", b'"', b",", b"\n", b"1,2\n"])
def test_packed_bytes_that_are_no_table_are_refused_in_bounded_memory(
    content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "bomb.csv.gz"
    with gzip.open(path, "wb", 6) as stream:
        stream.write(b'"frame","x [nm]","y [nm]"\n')
        for _ in range(300):
            stream.write(content * (2**20 // len(content)))
    shown = hostile.limited(
        'print("exit", main(["convert", sys.argv[1], sys.argv[1] + ".csv"]))', path
    )
    assert "exit 3" in shown


def test_parquet_that_repeats_one_value_without_end(tmp_path: Path) -> None:
    path = tmp_path / "bomb.parquet"
    rows = 2**24
    column = pa.chunked_array([pa.array(np.zeros(rows))] * 4)
    table = pa.table({"frame": column.cast(pa.int64()), "x_nm": column, "y_nm": column})
    pq.write_table(table, path, compression="zstd")
    assert path.stat().st_size < 1e6
    words = '"--frame-interval-s", "0.002", "-o", sys.argv[1] + ".out"'
    assert "exit 3" in hostile.limited(
        f'print("exit", main(["rotors", sys.argv[1], {words}]))', path
    )


def test_camera_maps_that_declare_more_than_memory(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "camera.npz"
    header = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (2**20, 2**20)}
    np.lib.format.write_array_header_1_0(header, shape)
    _save_zip(path, {f"{name}.npy": header.getvalue() for name in hostile.MAPS})
    assert "camera.npz" in hostile.refused(capfd, 3, *hostile.with_maps(tmp_path, path))


def test_packed_camera_maps_stay_in_bounded_memory(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    shape = {"descr": "<f8", "fortran_order": False, "shape": (8192, 8192)}
    content = io.BytesIO()
    np.lib.format.write_array_header_1_0(content, shape)
    _save_zip(path, {"offset_adu.npy": content.getvalue() + bytes(2**29)})
    assert path.stat().st_size < 4e6
    words = [str(word) for word in hostile.with_maps(tmp_path, path)]
    assert "exit 3" in hostile.limited(f'print("exit", main({words!r}))', path)


def _save_zip(path: Path, files: dict[str, bytes]) -> None:
    import zipfile

    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in files.items():
            archive.writestr(name, content)


def with_description(path: Path, text: str) -> Path:
    with tifffile.TiffWriter(path) as writer:
        for index, frame in enumerate(hostile.FRAMES):
            description = None if index else text.encode()
            writer.write(frame, contiguous=False, metadata=None, description=description)
    return path


def test_entities_of_ome_xml_neither_blow_up_nor_read_files(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    secret = tmp_path / "secret"
    secret.write_text(hostile.CANARY)
    laughs = '<!ENTITY a0 "ha">' + "".join(
        f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12)
    )
    for head in (
        f"<!DOCTYPE OME [{laughs}]>",
        f'<!DOCTYPE OME [<!ENTITY a11 SYSTEM "{secret.as_uri()}">]>',
        f'<!DOCTYPE OME [<!ENTITY % a SYSTEM "{secret.as_uri()}"> %a; <!ENTITY a11 "x">]>',
        f'<!DOCTYPE OME SYSTEM "{secret.as_uri()}">',
    ):
        text = hostile.ome("<TiffData/>", head).replace('"Image:0"', '"Image:0" Name="&a11;"')
        path = with_description(tmp_path / "movie.tif", text)
        hostile.OPENED.clear()
        code, out, err = hostile.call(capfd, "info", path)
        assert code in (0, 3)
        assert hostile.CANARY not in out + err
        assert str(secret) not in hostile.OPENED


@pytest.mark.parametrize(
    "companion", ["../{}", "{folder}/{}", "sub/../../{}", "..\\{}", "{}\0.tif"]
)
def test_companions_outside_the_folder_are_never_opened(
    companion: str, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    inside = tmp_path / "inside"
    (inside / "sub").mkdir(parents=True)
    outside = hostile.movie(tmp_path / "other.ome.tif")
    name = companion.format(outside.name, folder=tmp_path)
    uuids = "".join(
        f'<TiffData FirstT="{first}" IFD="0" PlaneCount="6"><UUID FileName="{file}">'
        f"urn:uuid:{first}</UUID></TiffData>"
        for first, file in ((0, "movie.ome.tif"), (6, name))
    )
    text = hostile.ome(uuids).replace('SizeT="6"', 'SizeT="12"')
    path = with_description(inside / "movie.ome.tif", text.replace("\0", "&#0;"))
    hostile.OPENED.clear()
    code, _, err = hostile.call(capfd, "info", path)
    # XML cannot spell a NUL byte: such a description is not well-formed, and says nothing.
    assert code == (0 if "\0" in companion else 3)
    assert "movie.ome.tif" in err or code == 0
    assert not [name for name in hostile.OPENED if Path(name).name == outside.name]


def test_companion_that_is_a_pipe_or_a_folder_or_itself_is_refused(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "pipe.ome.tif")
    (tmp_path / "folder.ome.tif").mkdir()
    (tmp_path / "loop.ome.tif").symlink_to("loop.ome.tif")
    for name in ("pipe", "folder", "loop", "absent"):
        uuids = "".join(
            f'<TiffData FirstT="{first}" IFD="0" PlaneCount="6"><UUID FileName="{file}.ome.tif">'
            f"urn:uuid:{first}</UUID></TiffData>"
            for first, file in ((0, "movie"), (6, name))
        )
        text = hostile.ome(uuids).replace('SizeT="6"', 'SizeT="12"')
        path = with_description(tmp_path / "movie.ome.tif", text)
        assert name in hostile.refused(capfd, 3, "info", path)


def test_place_that_a_flipped_bit_moved_is_noticed_in_plain_pixels(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for page, shift in ((0, -100), (2, 1), (3, 960), (5, -2)):
        path = hostile.movie(tmp_path / "movie.tif", metadata=None)
        with tifffile.TiffFile(path) as tif:
            tag = tif.pages[page].aspage().tags["StripOffsets"]
            place, moved = tag.valueoffset, tag.value[0] + shift
        content = bytearray(path.read_bytes())
        content[place : place + 4] = moved.to_bytes(4, "little")
        path.write_bytes(content)
        if shift == 960:
            # Two frames in one place may be meant: some writers store equal frames once.
            assert hostile.call(capfd, "info", path)[0] == 0
        else:
            assert "overlap" in hostile.refused(capfd, 3, "info", path)


def test_ome_description_that_is_no_xml_is_said_to_be_unused(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = with_description(tmp_path / "movie.tif", hostile.ome("<TiffData/></Pixel>"))
    code, _, err = hostile.call(capfd, "info", path)
    assert code == 0
    assert "OME description" in err
