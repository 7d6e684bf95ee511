"""Unusable input ends in one clear sentence, the right exit code, and no half-written result."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from scipy.special import ndtr

from rotortrack_cli.main import main

CAMERA = ("--offset-adu", "100", "--gain-e-per-adu", "0.5", "--read-noise-e", "1.5")
SCALE = ("--pixel-size-nm", "100", "--frame-interval-s", "0.002")


def write(path, frames):
    tifffile.imwrite(path, frames, photometric="minisblack")
    return path


def spots(frames=4, shape=(24, 30), places=((10.0, 12.0),), photons=3000.0, dtype=np.uint16):
    rng = np.random.default_rng(11)
    expected = np.full(shape, 5.0)
    for x, y in places:
        gx = np.diff(ndtr((np.arange(shape[1] + 1) - x) / 1.3))
        gy = np.diff(ndtr((np.arange(shape[0] + 1) - y) / 1.3))
        expected += photons * gy[:, None] * gx
    return (rng.poisson(expected, (frames, *shape)) * 2 + 100).astype(dtype)


def call(capfd, *words):
    code = main([str(word) for word in words])
    shown = capfd.readouterr()
    assert "Traceback" not in shown.err + shown.out
    return code, shown


def refused(capfd, code, *words):
    """Call, assert the exit code and one sentence; give the sentence."""
    ended, shown = call(capfd, *words)
    errors = [line for line in shown.err.splitlines() if "warning:" not in line]
    assert ended == code, shown.err
    assert len(errors) == 1, shown.err
    assert errors[0].startswith("rotortrack: ")
    return errors[0]


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def test_text_renamed_tif(capfd, tmp_path, out):
    path = tmp_path / "notes.tif"
    path.write_text("not a movie")
    assert "notes.tif" in refused(capfd, 3, "run", path, *SCALE, *CAMERA, "-o", out)
    assert not out.exists()


def test_corrupt_tiff(capfd, tmp_path, out):
    path = write(tmp_path / "cut.tif", spots(frames=50))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert "cut.tif" in refused(capfd, 3, "localise", path, *SCALE, *CAMERA, "-o", out)
    assert not out.exists()


def test_missing_file_and_folder(capfd, tmp_path, out):
    assert "none.tif" in refused(capfd, 3, "run", tmp_path / "none.tif", *SCALE, *CAMERA, "-o", out)
    (tmp_path / "folder.tif").mkdir()
    refused(capfd, 3, "run", tmp_path / "folder.tif", *SCALE, *CAMERA, "-o", out)


def test_empty_file(capfd, tmp_path, out):
    path = tmp_path / "empty.tif"
    path.touch()
    assert "empty.tif" in refused(capfd, 3, "run", path, *SCALE, *CAMERA, "-o", out)


def test_frame_smaller_than_the_fit_window(capfd, tmp_path):
    path = write(tmp_path / "small.tif", np.full((5, 6, 30), 100, np.uint16))
    sentence = refused(
        capfd, 3, "localise", path, *SCALE, *CAMERA, "-o", tmp_path / "l.csv", "--quiet"
    )
    assert "30 x 6" in sentence
    assert not (tmp_path / "l.csv").exists()
    refused(capfd, 3, "run", path, *SCALE, *CAMERA, "-o", tmp_path / "run", "--quiet")
    assert not (tmp_path / "run").exists()


def test_missing_values_are_listed_together(capfd, tmp_path, out):
    path = write(tmp_path / "movie.tif", spots())
    code, shown = call(capfd, "run", path, "-o", out)
    assert code == 4
    for flag in ("--pixel-size-nm", "--frame-interval-s", "--offset-adu", "--read-noise-e"):
        assert flag in shown.err
    assert not out.exists()


def test_all_mistakes_of_a_configuration_are_listed_at_once(capfd, tmp_path, out):
    path = write(tmp_path / "movie.tif", spots())
    config = tmp_path / "run.toml"
    config.write_text(
        "[localise]\nwavelet_ordr = 3\nmethod = 'best'\nfit_radius_px = -1\n[densty]\nradius_nm=5\n"
    )
    code, shown = call(capfd, "run", path, *SCALE, *CAMERA, "-c", config, "-o", out)
    assert code == 4
    for word in ("wavelet_order", "method", "fit_radius_px", "density"):
        assert word in shown.err
    assert len(shown.err.splitlines()) == 4
    assert not out.exists()


def test_wrong_threshold(capfd, tmp_path):
    path = write(tmp_path / "movie.tif", spots())
    sentence = refused(
        capfd, 4, "localise", path, *SCALE, *CAMERA, "--threshold", "std(Wave.F7)",
        "-o", tmp_path / "l.csv", "--quiet",
    )  # fmt: skip
    assert "Wave.F7" in sentence


def test_maps_of_another_size(capfd, tmp_path):
    path = write(tmp_path / "movie.tif", spots())
    maps = tmp_path / "camera.npz"
    wrong = np.ones((9, 8))
    np.savez(maps, offset_adu=wrong, gain_e_per_adu=wrong, read_noise_e=wrong)
    sentence = refused(
        capfd, 3, "localise", path, *SCALE, "--camera-maps", maps, "-o", tmp_path / "l.csv",
        "--quiet",
    )  # fmt: skip
    assert "8 x 9" in sentence
    assert "30 x 24" in sentence


def test_maps_of_another_size_are_refused_with_a_region_too(capfd, tmp_path):
    path = write(tmp_path / "movie.tif", spots())
    large = np.ones((80, 120))
    np.savez(tmp_path / "c.npz", offset_adu=large, gain_e_per_adu=large, read_noise_e=large)
    sentence = refused(
        capfd, 3, "localise", path, *SCALE, "--camera-maps", tmp_path / "c.npz",
        "--region", 2, 2, 20, 20, "-o", tmp_path / "l.csv", "--quiet",
    )  # fmt: skip
    assert "120 x 80" in sentence


def test_maps_lie_where_the_configuration_lies(capfd, tmp_path, monkeypatch):
    path = write(tmp_path / "movie.tif", spots())
    folder = tmp_path / "setup"
    folder.mkdir()
    right = np.ones((24, 30))
    np.savez(folder / "camera.npz", offset_adu=right, gain_e_per_adu=right, read_noise_e=right)
    (folder / "run.toml").write_text("[camera]\ncamera_maps = 'camera.npz'\n")
    monkeypatch.chdir(tmp_path)
    words = ("localise", path, *SCALE, "-c", "setup/run.toml", "-o", tmp_path / "l.parquet")
    assert call(capfd, *words)[0] == 0


def test_unwritable_target(capfd, tmp_path):
    path = write(tmp_path / "movie.tif", spots())
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    refused(capfd, 7, "localise", path, *SCALE, *CAMERA, "-o", blocked / "l.parquet", "--quiet")
    refused(capfd, 7, "run", path, *SCALE, *CAMERA, "-o", blocked, "--quiet")
    assert blocked.read_text() == "in the way"


def test_unknown_table_ending(capfd, tmp_path):
    path = write(tmp_path / "movie.tif", spots())
    assert "l.xls" in refused(
        capfd, 3, "localise", path, *SCALE, *CAMERA, "-o", tmp_path / "l.xls", "--quiet"
    )


@pytest.mark.parametrize(
    "frames",
    [
        pytest.param(np.full((30, 24, 30), 100, np.uint16), id="nothing"),
        pytest.param(
            np.random.default_rng(1).poisson(110, (30, 24, 30)).astype(np.uint16), id="noise"
        ),
        pytest.param(np.zeros((30, 24, 30), np.uint16), id="zeros"),
        pytest.param(spots(frames=1), id="one frame"),
        pytest.param(
            np.concatenate([spots(frames=1), np.full((20, 24, 30), 100, np.uint16)]), id="one spot"
        ),
        pytest.param(spots(frames=2), id="two frames"),
    ],
)
def test_too_little_gives_valid_empty_tables(capfd, tmp_path, out, frames):
    import pandas as pd

    path = write(tmp_path / "movie.tif", frames)
    words = ("run", path, *SCALE, *CAMERA, "-o", out, "--quiet")
    code, shown = call(capfd, *words)
    assert code == 0, shown.err
    rotors = pd.read_csv(out / "rotors.csv")
    assert (rotors["verdict"] == "refused").all()
    assert len(pd.read_parquet(out / "tracks.parquet").columns) > 5
    assert (out / "figures" / "field.png").is_file()
    code, shown = call(capfd, *words, "--strict")
    assert code == 5


def test_everything_filtered_out(capfd, tmp_path, out):
    path = write(tmp_path / "movie.tif", spots(frames=40))
    code, shown = call(
        capfd, "run", path, *SCALE, *CAMERA, "-o", out, "--set", "quality.max_uncertainty_nm=0.001"
    )
    assert code == 0, shown.err
    assert "0 precise" in shown.out


def test_pixels_without_a_number_and_negative_ones(capfd, tmp_path, out):
    frames = spots(frames=40, dtype=np.float32)
    frames[:, 3, 3] = np.nan
    frames[5, 12, 10] = np.inf
    frames[:, 20] = -400.0
    path = write(tmp_path / "movie.tif", frames)
    code, shown = call(capfd, "run", path, *SCALE, *CAMERA, "-o", out)
    assert code == 0, shown.err
    assert "pixels without a number" in shown.out


def test_saturated_spots_are_counted(capfd, tmp_path):
    frames = spots(frames=10)
    frames[:, 12, 9] = 65535
    path = write(tmp_path / "movie.tif", frames)
    code, shown = call(capfd, "localise", path, *SCALE, *CAMERA, "-o", tmp_path / "l.parquet")
    assert code == 0
    assert "10 saturated" in shown.out


def test_motion_wants_a_run_folder(capfd, tmp_path):
    assert "run.json" in refused(capfd, 3, "motion", tmp_path)


def test_a_forged_manifest_is_refused(capfd, tmp_path):
    whole = (
        '{"state": "complete", "steps": [], "tables": [], "versions": {}, "inputs": [], '
        '"notes": [], "warnings": [], "counts": {}, "seconds": {}, "options": '
    )
    for text in ("[]", "{", '{"options": 3}', whole + "[]}", whole + '{"movie": {"frames": 1}}}'):
        (tmp_path / "run.json").write_text(text)
        refused(capfd, 3, "motion", tmp_path)
        refused(capfd, 3, "info", tmp_path)


def test_drift_never_overwrites_a_drift_table(capfd, tmp_path):
    table = tmp_path / "l.csv"
    table.write_text('"frame","x [nm]","y [nm]"\n1,100.0,200.0\n')
    assert "drift.csv" in refused(capfd, 2, "drift", table, "-o", tmp_path / "drift.csv")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    refused(capfd, 2, "drift", table, "-o", tmp_path / "run" / "l.csv")


def test_absurd_frame_numbers(capfd, tmp_path, out):
    rng = np.random.default_rng(5)
    angle = rng.uniform(0, 6.28, 300)
    frame = np.arange(300) * 3_000_000_000
    rows = [
        f"{f},{1000 + 90 * np.cos(a):.2f},{1000 + 90 * np.sin(a):.2f}"
        for f, a in zip(frame, angle, strict=True)
    ]
    table = tmp_path / "l.csv"
    table.write_text("\n".join(['"frame","x [nm]","y [nm]"', *rows]))
    words = ("rotors", table, "--frame-interval-s", "0.002", "-o", out, "--quiet")
    assert call(capfd, *words)[0] == 0
    assert "frame" in refused(capfd, 3, "motion", out, "--quiet")


def test_a_table_without_positions(capfd, tmp_path, out):
    path = tmp_path / "table.csv"
    path.write_text('"frame","sigma [nm]"\n1,100\n')
    assert "table.csv" in refused(
        capfd, 3, "rotors", path, "--frame-interval-s", "0.002", "-o", out
    )
    assert not out.exists()


def test_a_failed_run_leaves_the_tables_of_the_last_one(capfd, tmp_path, out):
    good = write(tmp_path / "good.tif", spots(frames=40))
    assert call(capfd, "run", good, *SCALE, *CAMERA, "-o", out, "--no-figures")[0] == 0
    before = contents(out)
    bad = tmp_path / "bad.tif"
    bad.write_text("no")
    assert call(capfd, "run", bad, *SCALE, *CAMERA, "-o", out, "--no-figures")[0] == 3
    assert contents(out) == before


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
