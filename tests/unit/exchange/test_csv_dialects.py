"""Every dialect that spreadsheets and other programs make of a ThunderSTORM table."""

from __future__ import annotations

import codecs
import gzip
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import TableError, TableWarning
from rotortrack.exchange.csv import read_csv
from rotortrack.exchange.tables import TableInfo, convert, open_writer, read_localisations
from rotortrack.exchange.thunderstorm import read_blocks
from rotortrack.tables import DRIFT, ROTORS

HEADER = '"id","frame","x [nm]","y [nm]","sigma [nm]","uncertainty_xy [nm]"\n'
ROWS = "1,1,10.5,20.25,130.5,8.5\n2,1,11.5,21.75,131.25,7.5\n3,4,12,22,132,6\n"
COMMA_ROWS = ROWS.replace(",", ";").replace(".", ",")
SEMICOLON_HEADER = HEADER.replace(",", ";")
PLAIN = HEADER + ROWS

READ = {
    "as the plugin writes it": PLAIN.encode(),
    "no quotation marks": PLAIN.replace('"', "").encode(),
    "numbers in quotation marks": (
        HEADER + "".join('"' + line.replace(",", '","') + '"\n' for line in ROWS.split())
    ).encode(),
    "spaces behind commas": PLAIN.replace(",", ", ").encode(),
    "semicolons": PLAIN.replace(",", ";").encode(),
    "tabs": PLAIN.replace(",", "\t").encode(),
    "decimal comma": (SEMICOLON_HEADER + COMMA_ROWS).encode(),
    "decimal comma and tabs": (SEMICOLON_HEADER + COMMA_ROWS).replace(";", "\t").encode(),
    "quoted decimal comma": (
        HEADER + "".join('"' + line.replace(";", '","') + '"\n' for line in COMMA_ROWS.split())
    ).encode(),
    "quoted only where needed": (
        HEADER + '1,1,"10,5","20,25","130,5","8,5"\n2,1,"11,5","21,75","131,25","7,5"\n'
        "3,4,12,22,132,6\n"
    ).encode(),
    "byte order mark": codecs.BOM_UTF8 + PLAIN.encode(),
    "byte order mark and semicolons": codecs.BOM_UTF8 + (SEMICOLON_HEADER + COMMA_ROWS).encode(),
    "UTF-16, little end first": PLAIN.replace(",", "\t").encode("utf-16"),
    "UTF-16, big end first": codecs.BOM_UTF16_BE + PLAIN.encode("utf-16-be"),
    "CR": PLAIN.replace("\n", "\r").encode(),
    "CR LF": PLAIN.replace("\n", "\r\n").encode(),
    "blank lines": ("\n \n" + PLAIN.replace("\n", "\n\n")).encode(),
    "CR and blank lines": ("\r\r" + PLAIN.replace("\n", "\r\r")).encode(),
    "no end of the last line": PLAIN.rstrip().encode(),
    "spreadsheet's first line": ("sep=;\n" + SEMICOLON_HEADER + COMMA_ROWS).encode(),
    "frames and ids as 1.0": (
        HEADER + "1.0,1.0,10.5,20.25,130.5,8.5\n2.0,1.0,11.5,21.75,131.25,7.5\n3.0,4.0,12,22,132,6"
    ).encode(),
    "a comma behind every row": (HEADER + ROWS.replace("\n", ",\n")).encode(),
    "a comma behind every line": PLAIN.replace("\n", ",\n").encode(),
    "a tab behind every row": (HEADER + ROWS.replace("\n", ",\n")).replace(",", "\t").encode(),
    "duplicate ids": PLAIN.replace("\n2,", "\n1,").replace("\n3,", "\n1,").encode(),
    "the name of 2014": PLAIN.replace("uncertainty_xy", "uncertainty").encode(),
    "units in capitals": PLAIN.replace("[nm]", "[NM]").encode(),
    "micrometres": (
        'frame,"x [µm]","y [um]","sigma [nm]","uncertainty [nm]"\n'
        "1,0.0105,0.02025,130.5,8.5\n1,0.0115,0.02175,131.25,7.5\n4,0.012,0.022,132,6\n"
    ).encode("latin-1"),
    "another order": (
        b"uncertainty [nm],y [nm],sigma [nm],x [nm],frame\n"
        b"8.5,20.25,130.5,10.5,1\n7.5,21.75,131.25,11.5,1\n6,22,132,12,4\n"
    ),
}


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("ending", ["csv", "csv.gz"])
def test_a_dialect_reads_as_the_plain_table(tmp_path: Path, name: str, ending: str) -> None:
    path = tmp_path / f"table.{ending}"
    path.write_bytes(gzip.compress(READ[name]) if ending == "csv.gz" else READ[name])
    table = read_localisations(path)
    assert table["frame"].tolist() == [0, 0, 3]
    np.testing.assert_allclose(table["x_nm"], [10.5, 11.5, 12], rtol=1e-15)
    np.testing.assert_allclose(table["y_nm"], [20.25, 21.75, 22], rtol=1e-15)
    assert table["sigma_nm"].tolist() == [130.5, 131.25, 132]
    assert table["uncertainty_nm"].tolist() == [8.5, 7.5, 6]


def test_a_decimal_comma_need_not_be_in_the_first_row(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("frame;x [nm];y [nm]\n" + "1;2;3\n" * 200 + "1;2;3,5\n")
    assert read_localisations(path)["y_nm"].tolist() == [3] * 200 + [3.5]


def test_a_table_without_sigma_has_none(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("frame,x [nm],y [nm]\n1,2,3\n")
    assert list(read_localisations(path).columns) == ["frame", "x_nm", "y_nm"]


WARNED = {
    "short row": ("3,4\n", r"1 row\(s\) .* the first in line 5; they were skipped"),
    "long row": ("3,4,5,6,7,8,9\n", r"1 row\(s\) .* the first in line 5; they were skipped"),
    "both": ("3,4\n3,4,5,6,7,8,9\n", r"2 row\(s\) .* the first in line 5; they were skipped"),
    "a note below": ("exported in May\n", r"1 row\(s\) .* the first in line 5"),
}


@pytest.mark.parametrize("name", WARNED)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_what_is_skipped_is_counted_and_located(tmp_path: Path, name: str, end: str) -> None:
    addition, sentence = WARNED[name]
    path = tmp_path / "table.csv"
    path.write_text((PLAIN + addition).replace("\n", end), newline="")
    with pytest.warns(TableWarning, match=sentence):
        assert len(read_localisations(path)) == 3


REFUSED = {
    "empty": (b"", "is empty"),
    "only a mark": (codecs.BOM_UTF8, "is empty"),
    "blank": (b"\n\n  \n", "is empty"),
    "no header": (
        ROWS.encode(),
        r"lacks frame, x \[nm\], y \[nm\].*: its first line must name the columns",
    ),
    "commas behind some rows": ((PLAIN + "4,1,1,1,1,1,\n" * 4).encode(), "4 row.* have another"),
    "late decimal comma": (
        b"frame;x [nm];y [nm]\n" + b"1;2;3\n" * 30_000 + b"1;2;3,5\n",
        r"cell in line 30002 is not a number \(3,5: is it a decimal comma\?\)",
    ),
    "no unit": (b"frame,x,y\n1,2,3\n", r"'x' has no unit; write \[nm\]"),
    "sigma without unit": (b"frame,x [nm],y [nm],sigma\n1,2,3,4\n", "'sigma' has no unit"),
    "duplicate column": (b"frame,x [nm],y [nm],x [nm]\n1,2,3,4\n", "two columns for x_nm"),
    "both uncertainties": (
        b"frame,x [nm],y [nm],uncertainty [nm],uncertainty_xy [nm]\n1,2,3,4,5\n",
        "two columns for uncertainty_nm",
    ),
    "most rows malformed": (
        (PLAIN + "1,2\n" * 4).encode(),
        r"4 row\(s\) .* the first in line 5, and only 3 can be read",
    ),
    "unquoted decimal commas": (
        b"frame,x [nm],y [nm]\n1,10,5,20,25\n2,11,5,21,75\n",
        "decimal commas, between semicolons or in quotation marks",
    ),
    "thousands separators": (
        b"frame;x [nm];y [nm]\n1;1.234,5;1\n",
        "cell in line 2 is not a number",
    ),
    "NUL": ((PLAIN + "5,1,\0,1,1,1\n").encode(), "cell in line 5 is not a number"),
    "NUL in the header": (PLAIN.replace("x [nm]", "x \0[nm]").encode(), r"lacks x \[nm\]"),
    "text in a cell": ((PLAIN + "4,1,wide,1,1,1\n").encode(), "cell in line 5 is not a number"),
    "text in a CR table": (
        (PLAIN + "4,1,wide,1,1,1\n").replace("\n", "\r").encode(),
        "cell in line 5 is not a number",
    ),
    "quotation mark never closed": (
        (PLAIN + '4,1,"1,1,1,1\n' + ROWS * 3).encode(),
        "quotation mark in line 5 is never closed",
    ),
    "a binary row": (PLAIN.encode() + b"\xff\xfe\xfd\n" + ROWS.encode(), "line 5 .* not UTF-8"),
    "UTF-16 cut within a letter": (PLAIN.encode("utf-16")[:-1], "cannot be read as a CSV"),
    "UTF-16 without a mark": (PLAIN.encode("utf-16-le"), "lacks frame"),
    "negative frame": (PLAIN.replace("3,4,", "3,-4,").encode(), "frame -4 is negative"),
    "half a frame": (PLAIN.replace("3,4,", "3,4.5,").encode(), "frame in line 4 is not a whole"),
    "endless header": (b"frame," * 50_000, "two columns for frame"),
    "header of blanks": (b"frame,x" + b" " * 100_000 + b"[", "lacks x"),
    "thousands of columns": (b"frame" + b",intensity [ADU]" * 6_000, "lacks x"),
}


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize("ending", ["csv", "csv.gz"])
def test_what_cannot_be_read_is_one_sentence(tmp_path: Path, name: str, ending: str) -> None:
    content, sentence = REFUSED[name]
    path = tmp_path / f"table.{ending}"
    path.write_bytes(gzip.compress(content) if ending == "csv.gz" else content)
    with pytest.raises(TableError, match=sentence) as caught:
        read_localisations(path)
    assert str(path) in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 800


def test_a_header_alone_is_an_empty_table(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    for content in (HEADER, HEADER.rstrip(), HEADER + "\n\n", codecs.BOM_UTF8.decode() + HEADER):
        path.write_text(content, encoding="utf-8")
        (block,) = read_blocks(path)
        assert [len(values) for values in block.values()] == [0] * 5


def test_rows_that_are_wrong_by_the_million_are_given_up_early(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(HEADER + "1,2\n" * 1_000_000)
    with pytest.raises(TableError, match=r"10\d{4} row\(s\)"):
        read_localisations(path)


def test_frames_of_many_blocks_count_from_the_smallest_of_all(tmp_path: Path) -> None:
    rows = 120_000
    lines = [f"{frame},1.5,2.5" for frame in range(rows, 0, -1)]
    path = tmp_path / "table.csv"
    path.write_text("\n".join(["frame,x [nm],y [nm]", *lines]))
    blocks = list(read_blocks(path))
    assert len(blocks) == 1
    path.write_text("\n".join(["frame,x [nm],y [nm]", *lines * 2]))
    blocks = list(read_blocks(path))
    assert len(blocks) > 1
    frames = np.concatenate([block["frame"] for block in blocks])
    np.testing.assert_array_equal(frames[:rows], np.arange(rows)[::-1])
    path.write_text("\n".join(["frame,x [nm],y [nm]", *lines * 2, "0,1,1"]))
    with pytest.warns(TableWarning, match="has a frame 0"):
        frames = np.concatenate([block["frame"] for block in read_blocks(path)])
    assert (frames[0], frames[-1]) == (rows, 0)


def test_converting_a_table_of_any_length_takes_the_same_memory(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    rows = 100_000
    block = {
        "frame": np.arange(rows),
        **{name: rng.uniform(0, 9e3, rows) for name in ("x_nm", "y_nm", "sigma_nm", "chi2")},
    }
    peaks = []
    for blocks in (5, 20):
        path = tmp_path / f"{blocks}.csv"
        with open_writer(path, TableInfo()) as writer:
            for _ in range(blocks):
                writer.append(block)
        program = f"""
import resource
from pathlib import Path
from rotortrack.exchange.tables import convert
assert convert(Path({str(path)!r}), Path({str(path.with_suffix(".parquet"))!r})) == {blocks * rows}
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        peaks.append(int(done.stdout) * 1024)
    # The longer table is larger than this by 90 MB.
    assert peaks[1] < peaks[0] + 40e6


NUMBERS = st.floats(width=32, allow_nan=False, allow_infinity=False)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 2**40), NUMBERS, NUMBERS), min_size=1, max_size=12),
    st.sampled_from([",", ";", "\t"]),
    st.booleans(),
    st.booleans(),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]),
)
def test_any_numbers_survive_any_dialect(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[int, float, float]],
    delimiter: str,
    comma: bool,
    quoted: bool,
    end: str,
    encoding: str,
) -> None:
    def cell(number: float) -> str:
        # A dialect can be told only from numbers that show their decimal sign.
        text = f"{number:.17e}".replace(".", "," if comma else ".")
        return f'"{text}"' if quoted or (comma and delimiter == ",") else text

    path = tmp_path_factory.mktemp("csv") / "table.csv"
    lines = [delimiter.join(["frame", "x [nm]", "sigma [µm]", "y [nm]"])]
    lines += [delimiter.join([str(f), cell(x), "", cell(y)]) for f, x, y in rows]
    path.write_bytes((end.join(lines) + end).encode(encoding))
    back = read_localisations(path)
    assert back["frame"].tolist() == [frame - 1 for frame, _, _ in rows]
    assert back["x_nm"].tolist() == [x for _, x, _ in rows]
    assert back["y_nm"].tolist() == [y for _, _, y in rows]
    assert np.isnan(back["sigma_nm"]).all()


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(sorted(READ)), st.integers(0, 2**32 - 1))
def test_any_cut_or_changed_byte_reads_or_is_refused(
    tmp_path_factory: pytest.TempPathFactory, name: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    content = bytearray(READ[name])
    content[rng.integers(len(content))] = rng.integers(256)
    path = tmp_path_factory.mktemp("csv") / "table.csv"
    path.write_bytes(content[: rng.integers(1, len(content) + 1)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TableWarning)
        try:
            rows = len(read_localisations(path))
            sentence = str(path)
        except TableError as error:
            rows = 0
            sentence = str(error)
    # A changed byte may be a line end, and so make two rows of one.
    assert rows <= 4
    assert sentence.isprintable()
    assert str(path) in sentence


def test_our_own_tables_come_back_from_a_spreadsheet(tmp_path: Path) -> None:
    drift = tmp_path / "drift.csv"
    text = "frame;dx_nm;dy_nm;sd_nm\r\n0;-1,5;0,25;\r\n1;2;0,5;1\r\n"
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        drift.write_bytes(text.encode(encoding))
        table = read_csv(drift, DRIFT)
        assert table["dx_nm"].tolist() == [-1.5, 2]
        assert table["frame"].tolist() == [0, 1]
        assert np.isnan(table["sd_nm"][0])
    rotors = tmp_path / "rotors.csv"
    rotors.write_text(
        "rotor\tx_nm\ty_nm\treason\tmsd_at_bound\n0\t1,5\t2\t'=1+1; a, b\tFALSE\n"
        '1\t1\t2\t"two\nlines"\ttrue\n'
    )
    table = read_csv(rotors, ROTORS)
    assert table["reason"].tolist() == ["=1+1; a, b", "two\nlines"]
    assert table["x_nm"].tolist() == [1.5, 1]
    assert table["msd_at_bound"].tolist() == [False, True]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "it is empty"),
        (b"frame,dx_nm,dx_nm,dy_nm\n0,1,1,1\n", "column dx_nm more than once"),
        (b"frame,dx_nm,dy_nm\n0,1,\xff\n", "cannot be read"),
        (b"frame,dx_nm,dy_nm,\xff\n0,1,1,1\n", "cannot be read"),
        (b"frame,dx_nm,dy_nm\n0,1,\x1b[31m\n", "cannot be read"),
    ],
)
def test_our_own_tables_damaged_are_refused(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "drift.csv"
    path.write_bytes(content)
    with pytest.raises(TableError, match=sentence) as caught:
        read_csv(path, DRIFT)
    assert str(caught.value).isprintable()


def test_a_conversion_refused_half_way_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(HEADER + ROWS * 40_000 + "4,1,wide,1,1,1\n")
    with pytest.raises(TableError, match="cell in line 120002 is not a number"):
        convert(path, tmp_path / "out.parquet")
    assert [file.name for file in tmp_path.iterdir()] == ["table.csv"]
