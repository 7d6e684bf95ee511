"""Configuration files that are none: exit code 4 and one sentence, before any input is opened."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from rotortrack_cli.flags import Given, gather
from rotortrack_cli.main import main


def refused(capfd: pytest.CaptureFixture[str], path: Path) -> list[str]:
    code = main(["localise", "absent.tif", "-c", str(path), "-o", "out.parquet"])
    shown = capfd.readouterr()
    lines = shown.err.splitlines()
    assert code == 4, shown.err
    assert all(line.startswith("rotortrack: ") and len(line) < 1000 for line in lines), shown.err
    assert "Traceback" not in shown.err
    return lines


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"[localise]\nwavelet_ordr = 3\n", "did you mean wavelet_order"),
        (b"[localise]\nwavelet_order = 'three'\n", "wavelet_order is 'three'"),
        (b"[localise]\nwavelet_order = 99\n", "at most 10"),
        (b"[drift]\nbins = 99999999999999999999\n", "below 2**53"),
        (b"[localise]\nmethod = '\xff'\n", "not UTF-8"),
        (b"[localise]\nmethod = '\0'\n", "not valid TOML"),
        (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "not UTF-8"),
        (b"x = " + b"[" * 100_000, "nested more deeply"),
        (b"[localise]\n" + b"a." * 200_000 + b"a = 1", "dots in line 2"),
        (b"#" * 1_100_000, "larger than 1 MB"),
        (b"{" + b'"a": {' * 50_000, "ThunderSTORM protocol"),
        (b'{"version": 1}', "no ThunderSTORM protocol"),
    ],
    ids=[
        *("key", "type", "bound", "whole", "latin", "nul", "png", "deep", "dots", "huge"),
        *("json", "other json"),
    ],
)
def test_a_bad_configuration_is_one_sentence(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, content: bytes, part: str
) -> None:
    path = tmp_path / "run.toml"
    path.write_bytes(content)
    (line,) = refused(capfd, path)
    assert part in line
    assert str(path) in line


def test_all_mistakes_are_listed_but_not_thousands(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "run.toml"
    path.write_text("[localise]\nmethod = 'best'\n[camera]\noffset_adu = inf\n[densty]\n")
    assert len(refused(capfd, path)) == 3
    path.write_text("[localise]\n" + "".join(f"option_{i} = 1\n" for i in range(30_000)))
    assert len(refused(capfd, path)) == 21


def test_what_is_no_file_is_refused_without_waiting(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path, Path("/dev/zero"), tmp_path / "absent.toml"):
        (line,) = refused(capfd, path)
        assert str(path) in line


@pytest.mark.parametrize("value", ["[" * 5_000, "9" * 5_000, "{a." + "a." * 50_000, "0x" * 9_000])
def test_an_assignment_made_to_exhaust_the_parser_is_refused(
    capfd: pytest.CaptureFixture[str], value: str
) -> None:
    words = ["localise", "absent.tif", "-o", "out.parquet", "--set", f"drift.bins={value}"]
    assert main(words) == 4
    assert "[drift] bins" in capfd.readouterr().err


def test_a_protocol_is_a_configuration_and_what_it_lacks_is_warned_of(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "movie-protocol.txt"
    parts = {
        "version": "ThunderSTORM (dev-2016-09-10-b1)",
        "cameraSettings": {"pixelSize": 108.0, "photons2ADU": 0.5, "offset": 100.0, "gain": 1.0},
        "analysisFilter": {"name": "Median filter"},
    }
    path.write_text(json.dumps(parts))
    words = ["localise", str(tmp_path / "absent.tif"), "-c", str(path), "-o", "out.parquet"]
    assert main(words) == 3
    shown = capfd.readouterr().err
    assert "warning: protocol movie-protocol.txt: its filter 'Median filter' does not" in shown
    with pytest.warns(UserWarning, match="Median filter"):
        (layer,) = gather(
            Given(preset=None, config=path, assignments=(), flags={}, workers=None, strict=False)
        )
    assert layer.origin == "protocol movie-protocol.txt"
    assert layer.values["camera"] == {"offset_adu": 100.0, "gain_e_per_adu": 0.5}
    parts["cameraSettings"]["photons2ADU"] = -1
    path.write_text(json.dumps(parts))
    lines = refused(capfd, path)
    assert "protocol movie-protocol.txt: [camera] gain_e_per_adu must be greater" in lines[-1]
