"""The commands as a user calls them, on the sample movie and on tables made from it."""

from __future__ import annotations

import hashlib
import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tifffile

from rotortrack.exchange.tables import read_localisations
from rotortrack.movies.tiff import open_movie
from rotortrack_cli.main import main

SAMPLES = Path(__file__).parents[2] / "sample_data"
ROTORS = SAMPLES / "rotors"
FLAGS = (
    *("--pixel-size-nm", "108.3", "--frame-interval-s", "0.002", "--exposure-s", "0.002"),
    *("--offset-adu", "100", "--gain-e-per-adu", "1.5", "--read-noise-e", "1.4"),
)


def call(*words):
    return main([str(word) for word in words])


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "results"
    assert call("run", ROTORS / "movie.tif", *FLAGS, "-o", folder, "--quiet") == 0
    return folder


@pytest.fixture(scope="module")
def truth():
    return pd.read_csv(ROTORS / "truth" / "rotors.csv")


def nearest(rotors, truth):
    """Row of the rotors table for each true rotor; a stuck spot lies on its circle's rim."""
    x = truth["x_nm"].to_numpy()[:, None] - rotors["x_nm"].to_numpy()
    y = truth["y_nm"].to_numpy()[:, None] - rotors["y_nm"].to_numpy()
    distance = np.hypot(x, y)
    assert (distance.min(axis=1) < truth["radius_nm"] + 30).all()
    return rotors.iloc[distance.argmin(axis=1)].reset_index(drop=True)


def test_run_finds_the_sample_rotors_and_their_speeds(run_folder, truth):
    found = nearest(pd.read_csv(run_folder / "rotors.csv"), truth)
    kind = truth["motion"]
    assert (found.loc[kind == "stuck", "verdict"] == "refused").all()
    assert (found.loc[kind == "stuck", "reason"] == "immobile").all()
    driven = kind == "driven"
    assert (found.loc[driven, "verdict"] == "kept").all()
    expected = np.where(truth["omega_rad_s"] > 0, "driven_ccw", "driven_cw")[driven]
    assert found.loc[driven, "behaviour"].tolist() == expected.tolist()
    # Half of the time at half of the voltage.
    pull = (found["omega_rad_s"] - 0.75 * truth["omega_rad_s"])[driven]
    pull /= found["omega_sd_rad_s"][driven]
    assert np.abs(pull).max() < 3.5
    radius = found.loc[driven, "radius_nm"] / truth.loc[driven, "radius_nm"]
    assert np.abs(radius - 1).max() < 0.02
    assert found.loc[kind == "brownian", "behaviour"].tolist() == ["brownian"]


def test_run_writes_everything_that_the_readme_lists(run_folder):
    names = {path.name for path in run_folder.iterdir()}
    assert names == {
        *("rotors.csv", "rotors.parquet", "tracks.parquet", "localisations.parquet"),
        *("drift.csv", "decisions.parquet", "figures", "run.json", "config.resolved.toml"),
        *(
            "parts",
            "log.jsonl",
            "posterior.parquet",
            "profiles.parquet",
            "msd.parquet",
            "switches.parquet",
            "switches.csv",
        ),
    }
    figures = {path.name for path in (run_folder / "figures").iterdir()}
    assert {"field.png", "speeds.png", "cumulative_angles.png", "msds.png", "drift.png"} < figures
    assert {f"rotor-{number:03d}.png" for number in range(8)} < figures


def test_manifest_tells_inputs_origins_and_counts(run_folder):
    manifest = json.loads((run_folder / "run.json").read_text())
    digest = hashlib.sha256((ROTORS / "movie.tif").read_bytes()).hexdigest()
    assert manifest["inputs"][0]["sha256"] == digest
    assert manifest["options"]["movie"]["pixel_size_nm"] == {"value": 108.3, "origin": "flag"}
    assert manifest["options"]["density"]["radius_nm"]["origin"] == "default"
    assert manifest["counts"]["frames"] == 1600
    assert manifest["counts"]["rotors_kept"] == 7
    config = tomllib.loads((run_folder / "config.resolved.toml").read_text())
    assert config["camera"]["gain_e_per_adu"] == 1.5


def test_localisations_lie_where_the_truth_says(run_folder):
    spots = read_localisations(run_folder / "localisations.parquet")
    true = pd.read_parquet(ROTORS / "truth" / "spots.parquet")
    drift = pd.read_csv(run_folder / "drift.csv").set_index("frame")
    joined = true[true["rotor"] == 0].merge(spots, on="frame", suffixes=("_true", ""))
    dx = joined["x_nm"] + drift["dx_nm"].loc[joined["frame"]].to_numpy() - joined["x_nm_true"]
    dy = joined["y_nm"] + drift["dy_nm"].loc[joined["frame"]].to_numpy() - joined["y_nm_true"]
    own = np.hypot(dx, dy) < 100
    assert own.sum() > 1590
    error = np.sqrt(((dx[own] / joined["x_sd_nm"][own]) ** 2).mean())
    assert 0.9 < error < 1.1
    assert abs(dx[own].mean()) < 1.0
    assert abs(dy[own].mean()) < 1.0


def test_the_summary_is_one_screen_with_reasons_and_speeds(tmp_path, capfd):
    code = call(
        "run", ROTORS / "movie.tif", "-c", ROTORS / "config.toml", "-o", tmp_path / "r",
        "--no-figures",
    )  # fmt: skip
    shown = capfd.readouterr()
    assert code == 0
    assert "8 found, 7 kept" in shown.out
    assert "1 immobile" in shown.out
    assert "driven_cw" in shown.out
    assert len(shown.out.splitlines()) < 40
    assert "localise: 1600 frames" in shown.err


def test_json_of_run_is_one_line(tmp_path, capfd):
    code = call(
        "run", ROTORS / "movie.tif", "-c", ROTORS / "config.toml", "-o", tmp_path / "r",
        "--no-figures", "--json", "--set", "movie.frames=[0, 300]",
    )  # fmt: skip
    shown = capfd.readouterr().out
    assert code == 0
    assert shown.count("\n") == 1
    result = json.loads(shown)
    assert {"rotors_found", "rotors_kept", "rotors", "warnings", "seconds"} <= set(result)
    assert result["rotors_found"] == len(result["rotors"]) == 8


def test_stage_by_stage_gives_what_run_gives(run_folder, tmp_path):
    config = ("-c", ROTORS / "config.toml")
    raw, still, dense = (tmp_path / f"{name}.parquet" for name in ("raw", "still", "dense"))
    assert call("localise", ROTORS / "movie.tif", *config, "-o", raw) == 0
    assert call("drift", raw, "-o", still) == 0
    assert (tmp_path / "drift.csv").is_file()
    assert call("filter", still, "-o", dense) == 0
    folder = tmp_path / "staged"
    assert call("rotors", dense, *config, "-o", folder) == 0
    assert call("motion", folder, "--no-figures") == 0
    staged = pd.read_csv(folder / "rotors.csv")
    whole = pd.read_csv(run_folder / "rotors.csv")
    pd.testing.assert_series_equal(staged["verdict"], whole["verdict"])
    pd.testing.assert_series_equal(staged["behaviour"], whole["behaviour"])
    np.testing.assert_allclose(staged["omega_rad_s"], whole["omega_rad_s"], rtol=1e-9)
    assert (folder / "tracks.parquet").is_file()


def test_localise_says_how_the_axes_were_understood(tmp_path, capfd):
    with open_movie(ROTORS / "movie.tif") as movie:
        frames = movie.frames(0, 12)
    stack = tmp_path / "stack.tif"
    tifffile.imwrite(stack, frames, imagej=True, metadata={"axes": "ZYX"})
    assert call("localise", stack, *FLAGS, "-o", tmp_path / "locs.parquet") == 0
    assert "its 12 z slices are taken as time" in capfd.readouterr().out


def test_a_table_of_another_program_becomes_speeds(tmp_path, capfd):
    table = SAMPLES / "thunderstorm" / "localisations.csv.gz"
    folder = tmp_path / "r"
    assert call("rotors", table, "--frame-interval-s", "0.002", "-o", folder) == 0
    assert call("motion", folder, "--exposure-s", "0.002") == 0
    assert "driven" in capfd.readouterr().out
    rotors = pd.read_csv(folder / "rotors.csv")
    assert len(rotors) == 24
    assert {"driven_ccw", "driven_cw"} <= set(rotors["behaviour"])
    assert (folder / "figures" / "speeds.png").is_file()


@pytest.mark.parametrize("ending", ["csv", "hdf5"])
def test_a_run_does_not_depend_on_the_table_format(run_folder, tmp_path, ending):
    other = tmp_path / f"spots.{ending}"
    assert call("convert", run_folder / "localisations.parquet", other) == 0
    code = call(
        "rotors", other, "--frame-interval-s", "0.002", "--pixel-size-nm", "108.3",
        "-o", tmp_path / "r",
    )  # fmt: skip
    assert code == 0
    rotors = pd.read_csv(tmp_path / "r" / "rotors.csv")
    whole = pd.read_csv(run_folder / "rotors.csv")
    np.testing.assert_allclose(rotors["radius_nm"], whole["radius_fit_nm"], rtol=1e-3)


def test_the_paper_preset_runs_and_is_recorded(tmp_path):
    folder = tmp_path / "r"
    code = call(
        "run", ROTORS / "movie.tif", *FLAGS, "--preset", "paper", "-o", folder, "--no-figures"
    )
    assert code == 0
    manifest = json.loads((folder / "run.json").read_text())
    method = manifest["options"]["localise"]["method"]
    assert method == {"value": "wlsq", "origin": "preset paper"}
    assert manifest["counts"]["rotors_kept"] >= 6


def test_a_new_table_in_an_old_run_folder_leaves_nothing_of_the_old_run(run_folder, tmp_path):
    folder = tmp_path / "r"
    shutil.copytree(run_folder, folder)
    table = SAMPLES / "thunderstorm" / "localisations.csv.gz"
    words = ("rotors", table, "--frame-interval-s", "0.002", "-o", folder)
    assert call(*words) == 2
    assert (folder / "tracks.parquet").is_file()
    assert call(*words, "--overwrite") == 0
    assert not (folder / "parts").exists()
    assert not (folder / "tracks.parquet").exists()
    assert not (folder / "drift.csv").exists()
    assert not list((folder / "figures").iterdir())


def test_a_run_is_reproduced_by_one_command(run_folder, tmp_path, capfd):
    assert call("run", "--reproduce", run_folder, "--json", "--quiet") == 0
    told = json.loads(capfd.readouterr().out)
    assert told["identical"]
    assert told["tables"]["rotors"]["rows"] == 8
    copy = tmp_path / "copy"
    shutil.copytree(run_folder, copy)
    shutil.copy(copy / "decisions.parquet", copy / "tracks.parquet")
    assert call("run", ROTORS / "movie.tif", "--reproduce", copy) == 3
    shutil.copytree(run_folder, copy, dirs_exist_ok=True)
    rotors = pd.read_parquet(copy / "rotors.parquet")
    rotors["radius_nm"] += 0.1
    rotors.to_parquet(copy / "rotors.parquet")
    capfd.readouterr()
    assert call("run", ROTORS / "movie.tif", "--reproduce", copy) == 3
    shown = capfd.readouterr()
    assert "rotors: 8 rows, radius_nm differs" in shown.out
    assert "was not reproduced" in shown.err


@pytest.mark.parametrize(
    "words",
    [
        ("run",),
        ("run", "movie.tif"),
        ("run", "-o", "folder"),
        ("run", "--reproduce", "folder", "--read-noise-e", "1"),
        ("run", "--reproduce", "folder", "--overwrite"),
        ("run", "--reproduce", "folder", "--no-figures"),
    ],
)
def test_a_run_of_nothing_or_of_two_things_is_a_usage_error(words, capfd):
    assert call(*words) == 2
    assert "Traceback" not in capfd.readouterr().err


def test_motion_records_no_option_that_changed_nothing(run_folder, tmp_path, capfd):
    folder = tmp_path / "r"
    shutil.copytree(run_folder, folder)
    assert call("motion", folder, "--preset", "paper", "--no-figures") == 0
    options = json.loads((folder / "run.json").read_text())["options"]
    assert options["localise"]["method"] == {"value": "mle", "origin": "default"}
    assert call("motion", folder, "--set", "localise.method=lsq", "--no-figures") == 4
    assert "localise.method belongs to an earlier stage" in capfd.readouterr().err
    assert call("run", ROTORS / "movie.tif", "--reproduce", folder) == 0


def test_info_tells_how_far_a_run_came(run_folder, capfd):
    assert call("info", run_folder, "--json") == 0
    told = json.loads(capfd.readouterr().out)
    assert told["state"] == "complete"
    assert told["locked_by"] is None
    assert set(told["stages"].values()) == {"finished"}


def test_motion_can_be_repeated_with_other_options(run_folder, tmp_path):
    folder = tmp_path / "r"
    shutil.copytree(run_folder, folder)
    for _ in range(2):
        words = ("--gap-mode", "bridge", "--no-figures")
        assert call("motion", folder, *words) == 0
    manifest = json.loads((folder / "run.json").read_text())
    assert manifest["options"]["motion"]["gap_mode"] == {"value": "bridge", "origin": "flag"}
    assert len(set(manifest["warnings"])) == len(manifest["warnings"])
    assert (folder / "drift.csv").is_file()


def test_info_shows_metadata_with_origins_and_the_gain(capfd):
    assert call("info", ROTORS / "movie.tif", "--json", "--gain-e-per-adu", "1.5") == 0
    shown = json.loads(capfd.readouterr().out)
    assert shown["frames"] == 1600
    assert shown["metadata"]["pixel_size_nm"]["value"] == pytest.approx(108.3)
    assert "file" in shown["metadata"]["pixel_size_nm"]["origin"]
    assert shown["gain_e_per_adu"] == pytest.approx(1.5, rel=0.1)
    assert shown["warnings"] == []


def test_info_warns_of_a_gain_that_the_noise_contradicts(capfd):
    assert call("info", ROTORS / "movie.tif", "--gain-e-per-adu", "0.5") == 0
    assert "warning" in capfd.readouterr().err


def test_info_of_a_run_shows_its_options(run_folder, capfd):
    assert call("info", run_folder) == 0
    assert "pixel_size_nm" in capfd.readouterr().out


def test_sample_data_is_what_its_manifest_says():
    manifest = tomllib.loads((SAMPLES / "MANIFEST.toml").read_text())
    for name, entry in manifest.items():
        files = {
            path.relative_to(SAMPLES / name).as_posix(): path
            for path in (SAMPLES / name).rglob("*")
            if path.is_file()
        }
        assert set(files) == set(entry["sha256"])
        for relative, path in files.items():
            assert hashlib.sha256(path.read_bytes()).hexdigest() == entry["sha256"][relative]


def test_sample_movie_is_regenerated_by_its_command(tmp_path):
    assert call("simulate", "sample", "-o", tmp_path) == 0
    assert (tmp_path / "scene.toml").read_bytes() == (ROTORS / "scene.toml").read_bytes()
    with open_movie(tmp_path / "movie.tif") as new, open_movie(ROTORS / "movie.tif") as old:
        assert new.shape == old.shape
        difference = new.frames(0, 1600).astype(int) - old.frames(0, 1600)
    assert np.abs(difference).max() <= 1
    for name in ("spots.parquet",):
        pd.testing.assert_frame_equal(
            pd.read_parquet(tmp_path / "truth" / name),
            pd.read_parquet(ROTORS / "truth" / name),
            rtol=1e-6,
        )
