"""`rotortrack info` as a user calls it, on every kind of file."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotortrack.movies.timing import number_frames
from rotortrack.movies.write import write_movie
from rotortrack.pipeline.describe_movie import describe_movie
from rotortrack_cli.console import Console
from rotortrack_cli.description import show_movie

SAMPLE = Path(__file__).parents[2] / "sample_data" / "rotors"


PROTOCOL = {
    "cameraSettings": {"offset": 100.0, "photons2ADU": 2.2, "pixelSize": 108.3},
    "analysisFilter": {"name": "Wavelet filter (B-Spline)", "scale": 2.0, "order": 3},
    "analysisDetector": {"name": "Local maximum", "threshold": "std(Wave.F1)"},
    "analysisEstimator": {
        "name": "PSF: Integrated Gaussian",
        "fittingRadius": 3,
        "method": "Weighted Least squares",
        "initialSigma": 1.6,
    },
    "imageInfo": {"roiBounds": {"x": 1, "y": 2, "width": 30, "height": 40}},
}


@pytest.fixture
def faulty(tmp_path: Path) -> Path:
    """A movie whose camera adds column noise, with empty frames and dead lines."""
    rng = np.random.default_rng(1)
    counts = 200 + rng.normal(0, 3, (100, 48, 64)) + rng.normal(0, 2, (100, 1, 64))
    counts[:, :, 11] = 100
    counts[20:40] = 0
    counts[50] = 60
    counts[60, 2, 3] = 4095
    path = tmp_path / "movie.tif"
    stored = np.rint(counts).astype(np.uint16)
    write_movie(path, [stored], shape=(100, 48, 64))
    return path


def test_a_movie_is_shown_on_lines_that_fit_the_screen(call: Callable[..., Any]) -> None:
    shown = call("info", SAMPLE / "movie.tif", "-q")
    assert shown.code == 0
    assert "1600 frames of 96 x 64 pixels, uint16" in shown.out
    lines = dict(line.split(maxsplit=1) for line in shown.out.splitlines()[1:] if line.split())
    assert lines["pixel_size_nm"].startswith("108.3")
    assert lines["exposure_s"].endswith("give --exposure-s")
    for label in ("recorded", "gain", "column", "row", "counts", "empty", "dead"):
        assert label in lines
    assert max(map(len, shown.out.splitlines()[1:])) <= 100


def test_faults_are_named_and_column_noise_warns(call: Callable[..., Any], faulty: Path) -> None:
    shown = call("info", faulty, "-q")
    assert shown.code == 0
    text = " ".join(shown.out.split())
    assert "20 frames all 0 (number 20, 21, 22, 23, 24, 25, 26, 27 and 12 more)" in text
    assert "1 frame constant (number 50) of 100 looked at" in text
    assert "1 dead column (11); 48 pixels in all that never change" in text
    assert "4095 is the end of a 12-bit converter: give --saturation-adu 4095" in text
    assert shown.err.startswith("rotortrack: warning: column noise of ")
    assert shown.err.count("\n") == 1


def test_json_of_a_movie_is_complete(call: Callable[..., Any], faulty: Path) -> None:
    shown = call("info", faulty, "-q", "--json").json
    assert shown["kind"] == "movie"
    assert shown["files"] == [str(faulty)]
    assert (shown["frames"], shown["height_px"], shown["width_px"]) == (100, 48, 64)
    assert shown["column_noise"]["rms_adu"] == pytest.approx(2.0, rel=0.1)
    assert shown["pixels"]["zero_frames"] == list(range(20, 40))
    assert shown["pixels"]["dead_columns"] == [11]
    assert shown["gain_e_per_adu"] is None
    assert shown["gain_reason"]
    (warning,) = shown["warnings"]
    assert warning.startswith("column noise")


def test_a_table_is_shown_and_its_json_complete(call: Callable[..., Any]) -> None:
    path = SAMPLE / "truth" / "spots.parquet"
    shown = call("info", path)
    assert shown.code == 0
    assert "12,800 localisations in 1,600 frames" in shown.out
    assert any(line.split()[:2] == ["x_nm", "nm"] for line in shown.out.splitlines())
    told = call("info", path, "--json").json
    assert (told["kind"], told["rows"], told["frames_with_rows"]) == ("table", 12800, 1600)
    assert told["info"]["provenance"]["made_by"] == "rotortrack simulate film"
    assert {"name", "unit", "least", "largest", "missing"} <= set(told["columns"][0])


def test_camera_maps_are_shown(call: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    noise = np.random.default_rng(1).normal(1.4, 0.05, (20, 30))
    noise[3, 4] = 9
    np.savez(path, read_noise_e=noise, offset_adu=100.0)
    shown = call("info", path)
    assert "30 x 20" in shown.out
    assert "one number" in shown.out
    assert "1 hot pixel:" in shown.out
    told = call("info", path, "--json").json
    assert told["arrays"]["read_noise_e"]["outliers"] == 1


def test_a_configuration_is_shown_by_section(call: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text("[drift]\nbins = 4\n[movie]\nframes = [2, 90]\npixel_size_nm = 100\n")
    shown = call("info", path)
    assert shown.code == 0
    rows = [line.split(maxsplit=3) for line in shown.out.splitlines()]
    assert ["movie", "pixel_size_nm", "100.0"] in [row[:3] for row in rows]
    assert ["drift", "bins", "4"] in [row[:3] for row in rows]
    told = call("info", path, "--json").json
    assert told["kind"] == "configuration"
    assert told["options"] == {
        "movie": {"pixel_size_nm": 100, "frames": [2, 90]},
        "drift": {"bins": 4},
    }
    path.write_text("[drift]\nbinz = 4\n")
    wrong = call("info", path)
    assert wrong.code == 4
    assert "did you mean bins" in wrong.err


@pytest.mark.parametrize("name", ["exp-protocol.txt", "exp.json"])
def test_a_protocol_is_known_by_its_content(
    call: Callable[..., Any], tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    path.write_text(json.dumps(PROTOCOL))
    shown = call("info", path)
    assert shown.code == 0
    assert "ThunderSTORM protocol" in shown.out
    assert "not taken over" in shown.out
    assert not shown.err
    told = call("info", path, "--json").json
    assert told["kind"] == "ThunderSTORM protocol"
    assert told["options"]["movie"] == {"pixel_size_nm": 108.3}
    assert told["options"]["localise"]["method"] == "wlsq"
    assert any("region of interest" in sentence for sentence in told["left_out"])
    assert call("info", SAMPLE / "movie.tif", path).code == 2


def test_what_a_file_says_cannot_steer_the_terminal(
    call: Callable[..., Any], tmp_path: Path
) -> None:
    path = tmp_path / "evil\x1b[2J.parquet"
    path.write_bytes((SAMPLE / "truth" / "spots.parquet").read_bytes())
    shown = call("info", path)
    assert shown.code == 0
    assert "\x1b" not in shown.out + shown.err


def test_only_movies_come_in_several_files(call: Callable[..., Any]) -> None:
    shown = call("info", SAMPLE / "movie.tif", SAMPLE / "truth" / "spots.parquet")
    assert shown.code == 2
    assert "spots.parquet is no movie" in shown.err
    assert call("info").code == 2


@pytest.mark.parametrize("name", ["movie.tif", "table.parquet", "table.csv", "camera.npz"])
def test_a_missing_file_is_one_sentence(
    call: Callable[..., Any], tmp_path: Path, name: str
) -> None:
    shown = call("info", tmp_path / name, "-q")
    assert shown.code == 3
    assert name in shown.err
    assert shown.err.count("\n") == 1


def test_a_single_frame_is_one_frame(call: Callable[..., Any], tmp_path: Path) -> None:
    write_movie(tmp_path / "one.tif", [np.zeros((1, 48, 64), np.uint16)], shape=(1, 48, 64))
    shown = " ".join(call("info", tmp_path / "one.tif", "-q").out.split())
    assert "1 frame of 64 x 48 pixels" in shown
    assert shown.count("the movie has 1 frame;") == 3
    assert "1 frames" not in shown


def test_recorded_times_are_summed_up(capfd: pytest.CaptureFixture[str]) -> None:
    report = describe_movie(SAMPLE / "movie.tif", [])
    times_s = 0.002 * np.delete(np.arange(1000), [10, 500, 501])
    with_times = replace(report, times=number_frames(times_s))
    show_movie(Console(), with_times)
    shown = " ".join(capfd.readouterr().out.split())
    assert "recorded times every 2 ms, 95 % of the frames on time, 3 frames dropped" in shown
    assert "3 frames dropped in 2 places" in shown
    told = with_times.as_dict()["times"]
    assert (told["dropped_frames"], told["gaps"], told["irregular"]) == (3, 2, False)
    assert told["interval_s"] == pytest.approx(0.002)
