"""ThunderSTORM tables of both generations, in and out."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotortrack.errors import TableError, TableWarning
from rotortrack.exchange.tables import (
    TableInfo,
    open_writer,
    read_localisations,
    write_localisations,
)
from rotortrack.exchange.thunderstorm import read_blocks

OLD = b'"id","frame","x [nm]","y [nm]","sigma [nm]","uncertainty [nm]"\n'
NEW = b'"id","frame","x [nm]","y [nm]","sigma [nm]","uncertainty_xy [nm]"\n'


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "locs.csv"


@pytest.mark.parametrize("header", [OLD, NEW, NEW.replace(b'"', b""), b"\xef\xbb\xbf" + NEW])
@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\n\n"])
def test_both_generations_quotes_marks_and_line_ends_read_alike(
    table: Path, header: bytes, end: bytes
) -> None:
    rows = [b"1.0,1.0,10.5,20.25,130.0,8.5", b"2,3,11.5,NaN,Infinity,7.5"]
    table.write_bytes(end.join([header.strip(), *rows, b""]))
    locs = read_localisations(table)
    assert locs["frame"].tolist() == [0, 2]
    assert locs["x_nm"].tolist() == [10.5, 11.5]
    np.testing.assert_array_equal(locs["y_nm"], [20.25, np.nan])
    np.testing.assert_array_equal(locs["sigma_nm"], np.float32([130, np.inf]))
    assert locs["uncertainty_nm"].tolist() == [8.5, 7.5]


def test_only_frame_x_and_y_are_demanded_in_any_order(table: Path) -> None:
    table.write_bytes(b"\n  \ny [nm],frame,x [nm]\n2,5,1")
    locs = read_localisations(table)
    assert locs.to_dict("records") == [{"frame": 4, "x_nm": 1.0, "y_nm": 2.0}]
    table.write_bytes(b"frame,x [nm]\n1,5\n")
    with pytest.raises(TableError, match=r"lacks y \[nm\]"):
        read_localisations(table)


def test_every_known_column_reaches_its_place(table: Path) -> None:
    table.write_bytes(
        b"id,frame,x [nm],y [nm],sigma [nm],intensity [photon],offset [photon],bkgstd [photon],"
        b"chi2,uncertainty_xy [nm],detections\n7,1,1,2,3,4,5,6,7,8,1\n"
    )
    assert read_localisations(table).to_dict("records") == [
        {
            "frame": 0,
            "x_nm": 1,
            "y_nm": 2,
            "photons": 4,
            "background": 5,
            "background_sd": 6,
            "sigma_nm": 3,
            "uncertainty_nm": 8,
            "chi2": 7,
        }
    ]


def test_pixels_and_micrometres_become_nanometres(table: Path) -> None:
    table.write_text("frame,x [px],y [um],sigma [µm]\n1,2.5,0.5,0.13\n", encoding="utf-8")
    with pytest.raises(TableError, match=r"'x \[px\]' is in pixels.*--pixel-size-nm"):
        read_localisations(table)
    row = read_localisations(table, pixel_size_nm=100).iloc[0]
    assert (row["x_nm"], row["y_nm"]) == (250, 500)
    assert row["sigma_nm"] == pytest.approx(130)
    table.write_text("frame,x [px],y [um],sigma [µm]\n1,2.5,0.5,0.13\n", encoding="latin-1")
    assert read_localisations(table, pixel_size_nm=100)["sigma_nm"][0] == pytest.approx(130)


@pytest.mark.parametrize("cell", ["x", "x [furlong]"])
def test_a_length_without_a_known_unit_is_refused(table: Path, cell: str) -> None:
    table.write_text(f"frame,{cell},y [nm]\n1,2,3\n")
    with pytest.raises(TableError, match=r"write \[nm\], \[um\] or \[px\]"):
        read_localisations(table)


def test_signals_in_adu_are_left_out_and_said(table: Path) -> None:
    table.write_text("frame,x [nm],y [nm],intensity [ADU],offset [photon]\n1,2,3,4,5\n")
    with pytest.warns(TableWarning, match=r"'intensity \[ADU\]' are not in photons"):
        locs = read_localisations(table)
    assert list(locs.columns) == ["frame", "x_nm", "y_nm", "background"]


def test_unknown_columns_are_left_out_and_named(table: Path) -> None:
    table.write_text("frame,x [nm],y [nm],z [nm],note\n1,2,3,4,text\n")
    with pytest.warns(TableWarning, match=r"'z \[nm\]', 'note' were left out"):
        locs = read_localisations(table)
    assert list(locs.columns) == ["frame", "x_nm", "y_nm"]


def test_two_columns_for_one_quantity_are_refused(table: Path) -> None:
    table.write_text("frame,x [nm],y [nm],uncertainty [nm],uncertainty_xy [nm]\n1,2,3,4,5\n")
    with pytest.raises(TableError, match="two columns for uncertainty_nm"):
        read_localisations(table)


def test_rows_of_a_wrong_length_are_skipped_counted_and_located(table: Path) -> None:
    table.write_bytes(NEW + b"1,1,1,1,1,1\n   \n2,2,2\n3,3,3,3,3,3\n4,4,4,4,4,4,4\n")
    with pytest.warns(TableWarning, match=r"2 row\(s\) of .* the first in line 4; they were skip"):
        locs = read_localisations(table)
    assert locs["frame"].tolist() == [0, 2]


def test_a_quotation_mark_that_swallows_rows_is_an_error(table: Path) -> None:
    table.write_bytes(NEW + b"1,1,1,1,1,1\n" + b'2,"2,2,2,2,2\n' + b"3,3,3,3,3,3\n" * 5)
    with pytest.raises(TableError, match="mark in line 3 is never closed"):
        read_localisations(table)


def test_frames_that_start_at_0_are_kept_with_a_warning(table: Path) -> None:
    table.write_text("frame,x [nm],y [nm]\n3,1,1\n0,1,1\n")
    with pytest.warns(TableWarning, match="has a frame 0"):
        locs = read_localisations(table)
    assert locs["frame"].tolist() == [3, 0]


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        ("1.5,1,1", "the frame in line 3 is not a whole number"),
        (",1,1", "the frame in line 3 is not a whole number"),
        ("1e300,1,1", "is not a whole number"),
        ("-2,1,1", "frame -2 is negative"),
        ("1,abc,1", "a cell in line 3 is not a number"),
    ],
)
def test_cells_that_make_no_sense_name_their_line(table: Path, row: str, sentence: str) -> None:
    table.write_text(f"frame,x [nm],y [nm]\n1,1,1\n{row}\n1,1,1\n")
    with pytest.raises(TableError, match=sentence):
        read_localisations(table)


@pytest.mark.parametrize("end", ["", "\n"])
def test_a_table_without_rows_is_empty_but_whole(table: Path, end: str) -> None:
    table.write_text("frame,x [nm],y [nm],chi2" + end)
    locs = read_localisations(table)
    assert len(locs) == 0
    assert list(locs.columns) == ["frame", "x_nm", "y_nm", "chi2"]
    assert locs["frame"].dtype == np.int64


def test_a_spreadsheets_semicolons_and_decimal_commas_are_understood(table: Path) -> None:
    table.write_text("frame;x [nm];y [nm]\n1;2,5;3,25\n")
    assert read_localisations(table)["x_nm"].tolist() == [2.5]
    table.write_text("frame\tx [nm]\ty [nm]\n1\t2.5\t3.25\n")
    assert read_localisations(table)["y_nm"].tolist() == [3.25]


def test_compressed_tables_are_read_and_written_reproducibly(tmp_path: Path) -> None:
    path = tmp_path / "locs.csv.gz"
    path.write_bytes(gzip.compress(OLD + b"1,1,1,1,1,1\n1,2\n"))
    with pytest.warns(TableWarning, match="line 3"):
        locs = read_localisations(path)
    twice = []
    for name in ("a.csv.gz", "b.csv.gz"):
        write_localisations(tmp_path / name, locs, TableInfo())
        twice.append((tmp_path / name).read_bytes())
    assert twice[0] == twice[1]
    assert read_localisations(tmp_path / "a.csv.gz").equals(locs)


def test_written_tables_have_the_plugins_header_ids_and_frames(table: Path) -> None:
    block = {
        "frame": np.array([0, 4]),
        "x_nm": np.array([0.1, 1e-7]),
        "y_nm": np.array([np.nan, -np.inf]),
        "photons": np.float32([0.1, np.inf]),
        "fit_flags": np.int32([0, 1]),
        "chi2": np.float32([1, 2.5]),
        "uncertainty_nm": np.float32([8, 9]),
        "sigma_nm": np.float32([130, 131]),
        "x_sd_nm": np.float32([1, 2]),
    }
    with open_writer(table, TableInfo()) as writer:
        writer.append(block)
        writer.append({name: values[:1] for name, values in block.items()})
    assert table.read_bytes().decode() == (
        '"id","frame","x [nm]","y [nm]","sigma [nm]","intensity [photon]","chi2",'
        '"uncertainty_xy [nm]"\n'
        "1,1,0.1,NaN,130,0.1,1,8\n"
        "2,5,1e-7,-Infinity,131,Infinity,2.5,9\n"
        "3,1,0.1,NaN,130,0.1,1,8\n"
    )


def test_a_writer_that_got_no_block_leaves_a_readable_header(table: Path) -> None:
    with open_writer(table, TableInfo()):
        pass
    assert table.read_text().startswith('"id","frame","x [nm]"')
    assert len(read_localisations(table)) == 0


FLOAT32 = st.floats(width=32, allow_nan=True, allow_infinity=True)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2**40), st.floats(), FLOAT32), min_size=1, max_size=20))
def test_any_numbers_come_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, float, float]]
) -> None:
    path = tmp_path_factory.mktemp("csv") / "locs.csv"
    frames, doubles, singles = (np.array(values) for values in zip(*rows, strict=True))
    block: dict[str, NDArray[np.generic]] = {
        "frame": frames.astype(np.int64),
        "x_nm": doubles.astype(np.float64),
        "y_nm": -doubles.astype(np.float64),
        "photons": singles.astype(np.float32),
    }
    with open_writer(path, TableInfo()) as writer:
        writer.append(block)
    (back,) = read_blocks(path)
    np.testing.assert_array_equal(back["frame"], block["frame"])
    for name in ("x_nm", "y_nm", "photons"):
        assert back[name].dtype == block[name].dtype
        np.testing.assert_array_equal(back[name], block[name])


def test_writing_loads_no_pandas(table: Path) -> None:
    program = f"""
import sys
from pathlib import Path
import numpy as np
from rotortrack.exchange.tables import TableInfo, open_writer
with open_writer(Path({str(table)!r}), TableInfo()) as writer:
    writer.append({{"frame": np.arange(4), "x_nm": np.full(4, np.nan), "y_nm": np.zeros(4)}})
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)
