"""`rotortrack run --channels` and `rotortrack end-to-end` on the two-coloured sample."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tifffile

from rotortrack.twocolour import measure

SAMPLES = Path(__file__).parents[2] / "sample_data"
MOVIE = SAMPLES / "two_colours" / "movie.tif"
CONFIG = ("-c", SAMPLES / "two_colours" / "config.toml")
SPLIT = ("--split", "left-right")
FRAMES = ("--frames", 0, 300)
TABLES = ("end_to_end", "end_to_end_rotors", "second_localisations")


@pytest.fixture(scope="module")
def channels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from rotortrack_cli.main import main

    path = tmp_path_factory.mktemp("channels") / "channels.json"
    beads = SAMPLES / "fiducials" / "movie.tif"
    words = ("register", beads, *SPLIT, "--pixel-size-nm", 108.3, "-o", path, "-q")
    assert main([str(word) for word in words]) == 0
    return path


@pytest.fixture(scope="module")
def made(channels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from rotortrack_cli.main import main

    folder = tmp_path_factory.mktemp("run") / "both"
    words = ("run", MOVIE, *CONFIG, *SPLIT, "--channels", channels, *FRAMES, "-o", folder, "-q")
    assert main([str(word) for word in words]) == 0
    return folder


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A copy of the run that a test may change."""
    return Path(shutil.copytree(made, tmp_path / "run"))


def test_distances_are_those_of_the_truth(made: Path) -> None:
    truth = pd.read_csv(SAMPLES / "two_colours" / "truth" / "rotors.csv")
    rotors = pd.read_csv(made / "rotors.csv").merge(
        pd.read_csv(made / "end_to_end_rotors.csv"), on="rotor"
    )
    assert len(rotors) == len(truth) == 4
    for _, rotor in rotors.iterrows():
        away = np.hypot(truth["x_nm"] - rotor["x_nm"], truth["y_nm"] - rotor["y_nm"])
        true = truth.loc[away.idxmin()]
        off = rotor["end_to_end_nm"] - true["end_to_end_nm"]
        assert abs(off) < 3.5 * rotor["end_to_end_sd_nm"] < 5.0
        radii = rotor[["first_radius_nm", "second_radius_nm"]] - [
            true["radius_nm"],
            true["second_radius_nm"],
        ]
        assert (radii.abs() < 4.0).all()
        assert rotor["n_frames"] > 250
        # The mean of the lengths as measured holds noise, which only adds.
        assert rotor["known_nm"] < rotor["plain_mean_nm"] * 1.02


def test_tables_figures_and_the_registration_lie_in_the_folder(made: Path, channels: Path) -> None:
    manifest = json.loads((made / "run.json").read_text())
    assert set(TABLES) <= set(manifest["tables"])
    assert (made / "registration.json").read_bytes() == channels.read_bytes()
    for name in ("end_to_end", "both_ends", "end_to_end_traces", "end_to_end_axes"):
        assert (made / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert {"channels", "ends"} <= set(manifest["options"])
    frames = pd.read_parquet(made / "end_to_end.parquet")
    assert not frames.duplicated(["rotor", "frame"]).any()
    assert np.allclose(frames["distance_nm"], np.hypot(frames["dx_nm"], frames["dy_nm"]))


def test_a_run_of_one_colour_names_nothing_of_the_second(
    call: Callable[..., Any], tmp_path: Path
) -> None:
    region = ("--region", 0, 0, 64, 64)
    words = ("run", MOVIE, *CONFIG, *region, *FRAMES, "--no-figures", "-o", tmp_path / "one")
    assert call(*words).code == 0
    manifest = json.loads((tmp_path / "one" / "run.json").read_text())
    assert not {"channels", "ends"} & set(manifest["options"])
    assert not set(TABLES) & set(manifest["tables"])
    shown = call("end-to-end", tmp_path / "one")
    assert shown.code == 3
    assert "shows one colour" in shown.err


def test_what_is_kept_is_taken_over_and_the_same_comes_again(
    call: Callable[..., Any], run: Path, channels: Path
) -> None:
    before = {name: (run / f"{name}.parquet").read_bytes() for name in TABLES}
    part = next((run / "parts").glob("second-*/*.parquet"))
    kept = part.stat().st_mtime_ns
    words = ("run", MOVIE, *CONFIG, *SPLIT, "--channels", channels, *FRAMES, "-o", run)
    assert call(*words, "--no-figures").code == 0
    assert part.stat().st_mtime_ns == kept
    assert {name: (run / f"{name}.parquet").read_bytes() for name in TABLES} == before


def test_a_run_is_reproduced_without_the_registration_it_was_made_with(
    call: Callable[..., Any], run: Path, tmp_path: Path
) -> None:
    movie = tmp_path / "movie.tif"
    shutil.copy(MOVIE, movie)
    manifest = json.loads((run / "run.json").read_text())
    manifest["options"]["channels"]["registration"]["value"] = str(tmp_path / "gone.json")
    (run / "run.json").write_text(json.dumps(manifest))
    shown = call("run", movie, "--reproduce", run, "--json")
    assert shown.code == 0, shown.err
    assert shown.json["identical"]
    assert set(TABLES) <= set(shown.json["tables"])


def test_end_to_end_measures_again_by_other_options(call: Callable[..., Any], run: Path) -> None:
    shown = call("end-to-end", run, "--median-frames", 7, "--pore-axis-deg", 30, "--json")
    assert shown.code == 0, shown.err
    assert len(shown.json["rotors"]) == 4
    assert -1 <= shown.json["alignment"] <= 1
    manifest = json.loads((run / "run.json").read_text())
    assert manifest["options"]["ends"]["median_frames"]["value"] == 7
    assert {"tracks", "rotors", *TABLES} <= set(manifest["tables"])
    assert manifest["steps"] == ["run", "end-to-end"]


def test_a_note_is_taken_once_however_often_distances_are_measured(
    call: Callable[..., Any], run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measure, "_notes", lambda rotors, _: iter([f"{len(rotors)} of them"]))
    for _ in range(2):
        assert call("end-to-end", run, "--no-figures").code == 0
    assert json.loads((run / "run.json").read_text())["notes"].count("4 of them") == 1


def test_motion_measures_distances_again(call: Callable[..., Any], run: Path) -> None:
    (run / "end_to_end.parquet").unlink()
    assert call("motion", run, "--no-figures").code == 0
    assert len(pd.read_parquet(run / "end_to_end.parquet"))


def test_the_summary_shows_distances(call: Callable[..., Any], run: Path) -> None:
    shown = call("end-to-end", run, "--no-figures")
    assert "end-to-end nm" in shown.out
    assert "registration checked by turning rotors" in shown.out


REFUSED = [
    (SPLIT, "channels.registration", 4),
    (("--channels", "CHANNELS"), "does not say where the second colour is", 4),
    (("--channels", "no.json", *SPLIT), "no.json", 3),
    (("--channels", "CHANNELS", *SPLIT, "--swapped"), "swapped", 3),
    (("--channels", "CHANNELS", "--split", "top-bottom"), "made for", 3),
    (
        (
            "--channels",
            "CHANNELS",
            "--first-region",
            0,
            0,
            64,
            64,
            "--second-region",
            70,
            0,
            32,
            32,
        ),
        "same size",
        4,
    ),
    (("--channels", "CHANNELS", "--second-channel", 1), "channel", 3),
]


@pytest.mark.parametrize(
    ("words", "told", "code"), REFUSED, ids=[case[1].replace(" ", "-") for case in REFUSED]
)
def test_what_cannot_be_is_one_sentence(
    call: Callable[..., Any],
    channels: Path,
    tmp_path: Path,
    words: tuple[object, ...],
    told: str,
    code: int,
) -> None:
    given = [channels if word == "CHANNELS" else word for word in words]
    shown = call("run", MOVIE, *CONFIG, *given, "-o", tmp_path / "run")
    assert shown.code == code, shown.err
    assert told in shown.err
    assert "Traceback" not in shown.err


def test_a_colour_that_is_dark_is_named(
    call: Callable[..., Any], channels: Path, tmp_path: Path
) -> None:
    frames = tifffile.imread(MOVIE)[:60].copy()
    frames[:, :, 64:] = 100
    tifffile.imwrite(tmp_path / "dark.tif", frames)
    words = ("run", tmp_path / "dark.tif", *CONFIG, *SPLIT, "--channels", channels)
    shown = call(*words, "-o", tmp_path / "run")
    assert shown.code == 3
    assert "the second colour shows no spot" in shown.err


def test_two_files_are_two_colours(call: Callable[..., Any], made: Path, tmp_path: Path) -> None:
    frames = tifffile.imread(MOVIE)[:300]
    for name, part in (("first", frames[:, :, :64]), ("second", frames[:, :, 64:])):
        tifffile.imwrite(tmp_path / f"{name}.tif", part)
    second = ("--second-movie", tmp_path / "second.tif")
    beads = tifffile.imread(SAMPLES / "fiducials" / "movie.tif")
    for name, part in (("beads1", beads[:, :, :64]), ("beads2", beads[:, :, 64:])):
        tifffile.imwrite(tmp_path / f"{name}.tif", part)
    own = tmp_path / "own.json"
    words = ("register", tmp_path / "beads1.tif", "--second", tmp_path / "beads2.tif")
    assert call(*words, "--pixel-size-nm", 108.3, "-o", own).code == 0
    words = ("run", tmp_path / "first.tif", *CONFIG, *second, "--channels", own)
    assert call(*words, "--no-figures", "-o", tmp_path / "run").code == 0
    one = pd.read_csv(made / "end_to_end_rotors.csv")
    other = pd.read_csv(tmp_path / "run" / "end_to_end_rotors.csv")
    assert np.allclose(one["end_to_end_nm"], other["end_to_end_nm"], atol=0.3)
