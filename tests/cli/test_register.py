"""`rotortrack register` on films of beads."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from rotortrack.twocolour.registration import read_registration

SAMPLES = Path(__file__).parents[2] / "sample_data"
BEADS = SAMPLES / "fiducials" / "movie.tif"
WHERE = ("--split", "left-right", "--pixel-size-nm", 108.3)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from rotortrack_cli.main import main

    path = tmp_path_factory.mktemp("register") / "channels.json"
    assert main([str(word) for word in ("register", BEADS, *WHERE, "-o", path, "-q")]) == 0
    return path


def test_the_sample_is_registered_as_its_truth_says(made: Path) -> None:
    truth = pd.read_csv(SAMPLES / "fiducials" / "truth" / "fiducials.csv")
    found = read_registration(made)
    inside = found.inside(truth[["x_nm", "y_nm"]].to_numpy())
    places = truth[["x_nm", "y_nm"]].to_numpy()
    missed = found.to_first(truth[["second_x_nm", "second_y_nm"]].to_numpy()) - places
    assert inside.sum() > 40
    error_nm = float(np.sqrt(np.mean(missed[inside] ** 2)))
    assert error_nm < 0.6
    # What is told holds for this one film: chance alone makes such a ratio.
    assert 0.5 < error_nm / found.target_error_nm < 1.6


def test_pictures_lie_beside(made: Path) -> None:
    for name in ("channels.overlay.png", "channels.residuals.png"):
        assert (made.parent / name).read_bytes().startswith(b"\x89PNG")


def test_json_tells_the_numbers(call: Callable[..., Any], tmp_path: Path) -> None:
    shown = call("register", BEADS, *WHERE, "-o", tmp_path / "c.json", "--json")
    assert shown.code == 0
    assert {"target_error_nm", "bead_noise_nm", "systematic_nm", "beads", "model"} <= set(
        shown.json
    )
    assert shown.json["beads"] == json.loads((tmp_path / "c.json").read_text())["beads"]


def test_a_table_is_mapped_onto_the_first_colour(
    call: Callable[..., Any], made: Path, tmp_path: Path
) -> None:
    source, target = tmp_path / "second.parquet", tmp_path / "mapped.parquet"
    words = ("-c", SAMPLES / "two_colours" / "config.toml", "--region", 64, 0, 64, 64)
    assert call("localise", SAMPLES / "two_colours" / "movie.tif", *words, "-o", source).code == 0
    assert call("register", made, "--apply", source, "-o", target).code == 0
    before, after = pd.read_parquet(source), pd.read_parquet(target)
    assert len(before) == len(after)
    expected = read_registration(made).to_first(before[["x_nm", "y_nm"]].to_numpy())
    np.testing.assert_array_equal(after[["x_nm", "y_nm"]].to_numpy(), expected)
    pd.testing.assert_series_equal(before["photons"], after["photons"])


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        ((BEADS, "--pixel-size-nm", 108.3), 4, "does not say where the second colour is"),
        ((BEADS, *WHERE, "--second-channel", 1), 4, "keep one of them"),
        ((BEADS, *WHERE, "--second", BEADS), 4, "keep one of them"),
        ((BEADS, *WHERE, "--model", "local-mean", "--neighbours", 60), 3, "too few beads"),
        ((SAMPLES / "none.tif", *WHERE), 3, "none.tif"),
    ],
)
def test_what_cannot_be_registered_is_told(
    call: Callable[..., Any], tmp_path: Path, words: tuple[object, ...], code: int, sentence: str
) -> None:
    shown = call("register", *words, "-o", tmp_path / "c.json")
    assert shown.code == code
    assert sentence in shown.err
    assert list(tmp_path.iterdir()) == []


def test_the_result_must_be_json(call: Callable[..., Any], tmp_path: Path) -> None:
    shown = call("register", BEADS, *WHERE, "-o", tmp_path / "c.npz")
    assert shown.code == 2
    assert "does not end in .json" in shown.err
