"""`rotortrack plan` as a user calls it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotortrack_cli.main import main

ROTORS = Path(__file__).parents[2] / "sample_data" / "rotors"
ROTOR = ("--diffusion-rad2-s", 60, "--radius-nm", 100, "--frame-interval-s", 0.002)
LIGHT = ("--photons", 800, "--background", 5, "--sigma-nm", 130, "--pixel-size-nm", 108)


def test_a_plan_is_one_screen_and_one_advice(call):
    ended = call("plan", *ROTOR, *LIGHT, "--duration-s", 16, "--speed-deg-s", 720)
    assert ended.code == 0
    assert "Diffusion alone makes an error of 157 deg/s in 16 s" in ended.out
    assert len(ended.out.splitlines()) < 24


def test_numbers_for_other_programs(call):
    told = call("plan", *ROTOR, *LIGHT, "--frames", 8000, "--speed-deg-s", 720, "--json").json
    assert told["speed_sd_deg_s"] == pytest.approx(np.degrees(np.sqrt(2 * 60 / 16)), rel=0.01)
    assert told["smallest_speed_deg_s"] == pytest.approx((3.0 + 1.645) * 156.9, rel=0.02)
    assert told["duration_needed_s"] == pytest.approx(
        2 * 60 * 4.645**2 / (4 * np.pi) ** 2, rel=0.03
    )
    assert told["photons_needed"] is None
    assert told["localisation_sd_nm"] == pytest.approx(5.8, rel=0.05)
    assert told["advice"].endswith("record 16.4 s.")


def test_fewer_errors_ask_for_less(call):
    arguments = ("plan", *ROTOR, *LIGHT, "--frames", 8000, "--json")
    strict = call(*arguments).json
    lenient = call(*arguments, "--driven-z", 2).json
    assert lenient["smallest_speed_deg_s"] < strict["smallest_speed_deg_s"]
    assert strict["power"] is None


def test_all_that_is_missing_is_listed_at_once(call):
    ended = call("plan", "--speed-deg-s", 720)
    assert ended.code == 4
    for word in ("frame-interval-s", "diffusion-rad2-s", "radius-nm", "duration-s", "photons"):
        assert f"--{word}" in ended.err
    assert len(ended.err.splitlines()) == 5


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("--frames", 10, "--duration-s", 1), 4, "both given"),
        (("--duration-s", 0.001), 4, "holds 0 frames"),
        (("--frames", 100, "--exposure-s", 0.1), 4, "longer than frame_interval_s"),
        (("--frames", 100, "-o", "plan.gif"), 2, ".png, .svg or .pdf"),
        (("--frames", 100, "--detection", 1.5), 4, "detection must be at most 1"),
    ],
)
def test_mistakes_are_told(call, words, code, sentence):
    ended = call("plan", *ROTOR, *LIGHT, *words)
    assert ended.code == code
    assert sentence in ended.err


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_a_figure_is_drawn_where_asked(call, tmp_path, ending):
    target = tmp_path / f"plan.{ending}"
    words = (*ROTOR, "--localisation-sd-nm", 10, "--frames", 500, "--speed-deg-s", 900)
    assert call("plan", *words, "-o", target).code == 0
    assert target.stat().st_size > 5_000


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan") / "run"
    words = ["run", ROTORS / "movie.tif", "-c", ROTORS / "config.toml", "--no-figures", "-q"]
    assert main([str(word) for word in (*words, "-o", folder)]) == 0
    return folder


def test_a_run_tells_what_its_rotors_resolve(call, run_folder, tmp_path):
    target = tmp_path / "resolved.png"
    rows = call("plan", run_folder, "-o", target, "--json").json["rotors"]
    assert len(rows) >= 6
    assert target.is_file()
    for row in rows:
        assert row["expected_sd_deg_s"] == pytest.approx(row["speed_sd_deg_s"], rel=0.02)
        assert row["smallest_5_deg_s"] < row["smallest_deg_s"]
        assert row["smallest_deg_s"] == pytest.approx(5.145 * row["expected_sd_deg_s"], rel=0.15)


def test_a_longer_movie_of_the_same_rotors_resolves_slower_ones(call, run_folder):
    short = call("plan", run_folder, "--json").json["rotors"]
    long = call("plan", run_folder, "--duration-s", 4 * 3.2, "--json").json["rotors"]
    for one, other in zip(short, long, strict=True):
        assert other["smallest_deg_s"] == pytest.approx(one["smallest_deg_s"] / 2, rel=0.1)
    shown = call("plan", run_folder).out
    assert "Half of the rotors resolve" in shown
    assert max(map(len, shown.splitlines())) <= 130


def test_what_is_no_run_is_told(call, tmp_path):
    ended = call("plan", tmp_path)
    assert ended.code == 3
    assert "is not a run folder" in ended.err
