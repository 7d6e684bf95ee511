"""Odd names, control codes and things that are no files reach neither the terminal nor the disk."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import json
import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import tifffile

if not sys.platform.startswith("linux"):
    pytest.skip("pipes, users and limits are made as Linux has them", allow_module_level=True)

_spec = importlib.util.spec_from_file_location("hostile", Path(__file__).with_name("hostile.py"))
hostile = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(hostile)


@pytest.fixture(autouse=True, scope="module")
def _compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    hostile.warm(tmp_path_factory.mktemp("warm"))


@pytest.fixture(autouse=True)
def _in_time() -> Iterator[None]:
    with hostile.in_time():
        yield


def test_control_codes_in_metadata_reach_no_terminal(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    texts = {
        "imagej": "ImageJ=1.54f\nimages=6\nframes=6\n"
        f"unit={hostile.ESCAPES}\nfinterval={hostile.ESCAPES}\n",
        "ome": hostile.ome("<TiffData/>").replace('"Image:0"', '"Image:0" Name="&#x9b;31m"')
        + f"<!-- {hostile.ESCAPES} -->",
        "axes": json.dumps({"shape": [2, 3, 20, 24], "axes": f"{hostile.ESCAPES[:2]}YX"}),
        "mad": hostile.ESCAPES * 1000,
    }
    for name, text in texts.items():
        path = tmp_path / f"{name}.tif"
        with tifffile.TiffWriter(path) as writer:
            for frame in hostile.FRAMES:
                writer.write(
                    frame,
                    contiguous=False,
                    metadata=None,
                    description=text.encode(),
                    software=hostile.ESCAPES.encode(),
                )
        for words in (("info", path), ("info", path, "--json")):
            hostile.call(capfd, *words)
        hostile.call(
            capfd, "localise", path, *hostile.SCALE, *hostile.CAMERA, "-o", tmp_path / "l.parquet"
        )


NAMES = {
    "escapes": f"a{hostile.ESCAPES}b",
    "line feeds": "a\nb\r\nc",
    "spaces": "  a  b ",
    "quotes": "a'b\"c`d$(touch x)",
    "markup": "[red]a[bold]<script>alert(1)<&script>",
    "formula": "=1+1",
    "option": "-o",
    "percent": "%s%n{0}{x}",
    "foreign": "фильм_ビデオ_é",
    "not UTF-8": os.fsdecode(b"a\xff\xfeb"),
}


@pytest.mark.parametrize("kind", NAMES)
def test_odd_file_names_are_read_written_and_shown_safely(
    kind: str,
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    name = NAMES[kind]
    path = hostile.movie(tmp_path / f"{name}.tif")
    assert hostile.call(capfd, "info", path)[0] == 0
    assert hostile.call(capfd, "info", path, "--json")[0] == 0
    table = tmp_path / f"{name}.csv"
    assert (
        hostile.call(capfd, "localise", path, *hostile.SCALE, *hostile.CAMERA, "-o", table)[0] == 0
    )
    table.write_text('"frame","x [nm]","y [nm]"\n1,100.5,200.5\n2,101.5,201.5\n')
    for ending in ("parquet", "csv.gz", "hdf5"):
        target = tmp_path / f"{name}.{ending}"
        assert hostile.call(capfd, "convert", table, target, "--pixel-size-nm", 100)[0] == 0
        back = tmp_path / f"{name} back.csv"
        assert hostile.call(capfd, "convert", target, back)[0] == 0
        assert len(back.read_text().splitlines()) == 3
    maps = tmp_path / f"{name}.npz"
    with maps.open("wb") as stream:
        np.savez(stream, **dict.fromkeys(hostile.MAPS, np.ones((20, 24))))
    words = ("localise", path, *hostile.SCALE, "--camera-maps", maps, "-o", tmp_path / "l.parquet")
    assert hostile.call(capfd, *words)[0] == 0
    config = tmp_path / f"{name}.toml"
    config.write_text("[localise]\nmethod = 'best'\n")
    assert hostile.call(capfd, "localise", path, "-c", config, "-o", "l.parquet")[0] == 4
    path.write_bytes(b"II*\0nothing")
    assert hostile.call(capfd, "info", path)[0] == 3
    for bad in (table, tmp_path / f"{name}.parquet", tmp_path / f"{name}.hdf5"):
        bad.write_bytes(b"nothing")
        assert hostile.call(capfd, "convert", bad, tmp_path / "out.csv")[0] == 3


@pytest.mark.parametrize("kind", NAMES)
def test_runs_of_odd_file_names_name_their_input_in_plain_json(
    kind: str, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = hostile.movie(tmp_path / f"{NAMES[kind]}.tif")
    out = tmp_path / f"{NAMES[kind]} run"
    words = ("run", path, *hostile.SCALE, *hostile.CAMERA, "-o", out, "--no-figures")
    code, _, err = hostile.call(capfd, *words)
    assert code == 0, err
    manifest = json.loads((out / "run.json").read_bytes())
    assert os.path.normpath(out / manifest["inputs"][0]["path"]) == str(path)
    assert hostile.call(capfd, "info", out)[0] == 0
    assert hostile.call(capfd, "motion", out, "--no-figures")[0] == 0
    for table in out.glob("*.csv"):
        cells = [cell for line in table.read_text().splitlines() for cell in line.split(",")]
        assert not [cell for cell in cells if cell.strip('"').startswith(("=", "+", "@", "-o"))]


def test_longest_names(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = hostile.movie(tmp_path / f"{'x' * 251}.tif")
    assert hostile.call(capfd, "info", path)[0] == 0
    for ending in (".csv", ".parquet", ".hdf5"):
        target = tmp_path / ("y" * (255 - len(ending)) + ending)
        code, _, err = hostile.call(
            capfd, "localise", path, *hostile.SCALE, *hostile.CAMERA, "-o", target
        )
        assert code == 0, err
        assert target.is_file()
    too_long = tmp_path / ("z" * 300)
    words = ("localise", path, *hostile.SCALE, *hostile.CAMERA, "-q")
    assert "too long" in hostile.refused(capfd, 7, *words, "-o", f"{too_long}.csv")
    code, _, err = hostile.call(capfd, "info", f"{too_long}.tif")
    assert code in (3, 7)
    assert "too long" in err


def test_name_with_a_nul_byte_in_a_configuration(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = hostile.movie(tmp_path / "film.tif")
    config = tmp_path / "run.toml"
    config.write_text('[camera]\ncamera_maps = "ca\\u0000mera.npz"\n')
    words = ("localise", path, *hostile.SCALE, "-c", config, "-o", tmp_path / "l.csv", "-q")
    assert "mera.npz" in hostile.refused(capfd, 3, *words)


def _absent(path: Path) -> None:
    del path


def _empty_folder(path: Path) -> None:
    path.mkdir()


def _symlink_loop(path: Path) -> None:
    path.symlink_to(path.name)


def _unreadable_content(path: Path) -> None:
    # Reading the start of its own memory fails for every user, root too.
    path.symlink_to("/proc/self/mem")


def _endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _wrong_text(path: Path) -> None:
    path.write_text("Dear all,\nplease find the data on the share.\n")


@pytest.mark.parametrize(
    "make",
    [
        *(_absent, os.mkfifo, _empty_folder, _symlink_loop, _unreadable_content, _endless),
        *(Path.touch, _wrong_text),
    ],
    ids=lambda make: make.__name__.strip("_"),
)
@pytest.mark.parametrize("reader", hostile.READERS)
def test_what_is_no_such_file_is_refused_at_once(
    reader: str, make: object, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    hostile.movie(tmp_path / "film.tif")
    words, source, code = hostile.reading(reader, tmp_path)
    make(source)
    if (reader, make) == ("config", Path.touch):
        assert hostile.call(capfd, *words)[0] == 0  # an empty configuration says nothing wrong
        return
    sentence = hostile.refused(capfd, code, *words)
    assert "input" in sentence
    assert not list(tmp_path.glob("out*"))
    assert not list(tmp_path.glob("l.csv*"))


@pytest.mark.skipif(not hasattr(os, "seteuid"), reason="users of another kind")
@pytest.mark.parametrize("reader", hostile.READERS)
def test_files_of_others_are_refused(reader: str, capfd: pytest.CaptureFixture[str]) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o777)
        hostile.movie(folder / "film.tif").chmod(0o644)
        closed = folder / "closed"
        closed.mkdir()
        (folder / "closed" / "film.tif").symlink_to(folder / "film.tif")
        given, source, _ = hostile.reading(reader, closed)
        if reader == "motion":
            source.mkdir()
        else:
            source.write_bytes(b"")
        hostile.call(capfd, *given)  # loads everything while it may
        for mode in (0o755, 0):
            with contextlib.suppress(IsADirectoryError):
                source.chmod(0)
            closed.chmod(mode)
            with _as_nobody():
                code, _, err = hostile.call(capfd, *given)
            assert code in (3, 4, 7)
            assert str(source) in err or f"{closed}" in err
        closed.chmod(stat.S_IRWXU)


@contextlib.contextmanager
def _as_nobody() -> Iterator[None]:
    """Give up the rights of root, where the tests have them."""
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(before)


def test_errno_of_a_symlink_loop_is_what_these_tests_take_it_for(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OSError, match="symbolic links") as caught:
        (tmp_path / "loop").read_bytes()
    assert caught.value.errno == errno.ELOOP
