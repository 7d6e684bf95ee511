"""`rotortrack tradeoff --on MOVIE`: what it measures, asks and refuses."""

from __future__ import annotations

import json

import pytest
import tifffile

from rotortrack.tradeoff.questions import drift, localiser
from rotortrack.tradeoff.questions import filter as spot_filter

CAMERA = ("--offset-adu", 100, "--gain-e-per-adu", 0.46, "--read-noise-e", 1.6)
ALONE = ("--set", "localise.max_emitters=1")


@pytest.fixture
def movie(tmp_path):
    path = tmp_path / "movie.tif"
    tifffile.imwrite(path, spot_filter.filmed(spot_filter.Film(500.0, 6.0), 40)[1])
    return path


def test_both_questions_are_asked_about_what_the_movie_holds(call, movie, tmp_path, monkeypatch):
    monkeypatch.setitem(localiser.SIZES, "quick", localiser.Sizes(200, 1))
    monkeypatch.setitem(drift.SIZES, "quick", drift.Sizes(1, 1))
    flags = ("--pixel-size-nm", 100, *CAMERA, *ALONE, "--quick", "-o", tmp_path / "told")
    done = call("tradeoff", "--on", movie, *flags)
    assert done.code == 0
    assert "40 of 40 frames" in done.out
    answers = {
        name: json.loads((tmp_path / "told" / f"{name}.json").read_text("utf-8"))
        for name in ("localiser", "drift")
    }
    groups = [point["group"] for point in answers["localiser"]["points"]]
    assert {group.partition(":")[0] for group in groups} == {"faint", "usual", "bright"}
    assert answers["drift"]["points"][0]["group"].startswith("40 frames")
    assert (tmp_path / "told" / "localiser.png").exists()


def test_other_questions_are_not_asked_about_a_movie(call, movie):
    done = call("tradeoff", "circle", "--on", movie, "--pixel-size-nm", 100, *CAMERA)
    assert done.code == 2
    assert "localiser and drift, not with circle" in " ".join(done.err.split())


def test_a_movie_without_pixel_size_and_camera_says_what_to_give(call, movie):
    done = call("tradeoff", "--on", movie)
    assert done.code == 4
    assert "--pixel-size-nm" in " ".join(done.err.split())
