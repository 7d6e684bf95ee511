"""`rotortrack contour` as a user calls it."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import tifffile

from rotortrack.afm.tables import CONTOURS
from rotortrack.simulate.afm import Microscope, image_rods, scatter_rods

FAST = ("--set", "contour.resamples=100", "-q")
SIZE = ("--pixel-size-nm", 5)


@pytest.fixture(scope="module")
def heights():
    rng = np.random.default_rng(1)
    scope = Microscope(shape=(360, 380))
    rods = scatter_rods(rng, 6, scope, contour_nm=450.0, persistence_nm=1200.0)
    rods.append([-60.0, 5.0] + np.linspace(0.0, 444.0, 800)[:, None] * [0.96, 0.28])
    return image_rods(rng, scope, rods, debris=[(1700.0, 1700.0, 6.0, 20.0)])


@pytest.fixture
def image(heights, tmp_path):
    path = tmp_path / "image.npy"
    np.save(path, heights)
    return path


def test_table_summary_and_picture_lie_beside_each_other(call, image, tmp_path):
    target = tmp_path / "out" / "rods.csv"
    known = ("--contour-length-nm", 450, "--nm-per-unit", 1)
    ended = call("contour", image, *SIZE, *known, "-o", target, *FAST)
    assert ended.code == 0
    assert ended.err == ""
    assert "if equilibrated in the plane" in ended.out
    assert "border" in ended.out
    rods = pd.read_csv(target)
    assert list(rods) == CONTOURS.names
    kept = rods[rods["verdict"] == "kept"]
    assert len(kept) == 6
    assert kept["contour_nm"].mean() == pytest.approx(450.0, rel=1e-6)
    assert kept["reason"].isna().all()
    assert set(rods.loc[rods["verdict"] == "refused", "reason"]) == {"border", "too_short"}
    told = json.loads(target.with_name("rods-summary.json").read_text())
    assert told["scale"] == pytest.approx(1.0, abs=0.005)
    assert told["reasons"] == {"border": 1, "too_short": 1}
    assert told["provenance"]["options"]["contour"]["contour_length_nm"]["value"] == 450
    assert target.with_name("rods.png").read_bytes().startswith(b"\x89PNG")


def test_numbers_for_other_programs(call, image, tmp_path):
    ended = call("contour", image, *SIZE, "-o", tmp_path / "rods.parquet", *FAST, "--json")
    assert ended.code == 0
    told = ended.json
    assert (told["rods"], told["refused"], told["scale"]) == (6, 2, None)
    assert told["contour_nm"] == pytest.approx(450.0, rel=0.005)
    assert told["persistence_ci_low_nm"] < told["persistence_nm"] < told["persistence_ci_high_nm"]
    assert told["persistence_is_lower_limit"] is False
    assert any("unit of its heights" in sentence for sentence in told["warnings"])
    rods = pd.read_parquet(tmp_path / "rods.parquet")
    assert list(rods) == CONTOURS.names


def test_a_tiff_tells_its_pixel_size_and_a_flag_overrules_it(call, heights, tmp_path):
    path = tmp_path / "image.tif"
    tifffile.imwrite(
        path,
        heights.astype(np.float32),
        imagej=True,
        resolution=(200.0, 200.0),
        metadata={"unit": "um"},
    )
    results = [
        call("contour", path, *size, "-o", tmp_path / "r.csv", *FAST, "--json").json
        for size in ((), ("--pixel-size-nm", 10))
    ]
    assert [result["pixel_size_nm"] for result in results] == pytest.approx([5.0, 10.0])
    assert results[1]["contour_nm"] == pytest.approx(2.0 * results[0]["contour_nm"] - 6.0, rel=1e-3)


def test_a_wrong_scale_is_told(call, image, tmp_path):
    known = ("--contour-length-nm", 450, "--pixel-size-nm", 5.5)
    ended = call("contour", image, *known, "-o", tmp_path / "rods.csv", *FAST)
    assert ended.code == 0
    assert "must be multiplied by 0.90" in ended.err or "must be multiplied by 0.91" in ended.err
    assert "applied: a pixel is 5" in ended.out


def test_a_missing_pixel_size_is_told_with_its_remedy(call, image, tmp_path):
    ended = call("contour", image, "-o", tmp_path / "rods.csv", "-q")
    assert ended.code == 4
    assert "pixel_size_nm is not known: give --pixel-size-nm" in ended.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["image.npy"]


@pytest.mark.parametrize("option", ["max_length_error=0.8", "line_order=4", "width_nm=0"])
def test_options_out_of_bounds_are_told(call, image, tmp_path, option):
    given = ("--set", f"contour.{option}")
    ended = call("contour", image, *SIZE, *given, "-o", tmp_path / "rods.csv")
    assert ended.code == 4
    assert option.split("=")[0] in ended.err


def test_what_is_no_image_is_unusable_input(call, tmp_path):
    path = tmp_path / "image.txt"
    path.write_text("nothing of the kind\n")
    ended = call("contour", path, *SIZE, "-o", tmp_path / "rods.csv", "-q")
    assert ended.code == 3
    assert ended.err.count("\n") == 1
    assert call("contour", tmp_path / "no.tif", *SIZE, "-o", tmp_path / "r.csv", "-q").code == 3


def test_targets_that_would_do_harm_are_refused(call, heights, tmp_path):
    path = tmp_path / "image.csv"
    np.savetxt(path, heights[:40, :40], delimiter=",")
    assert call("contour", path, *SIZE, "-o", path, "-q").code == 2
    assert call("contour", path, *SIZE, "-o", tmp_path / "rods.txt", "-q").code == 2
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    ended = call("contour", path, *SIZE, "-o", tmp_path / "run" / "rods.csv", "-q")
    assert ended.code == 2
    assert "is a run folder" in ended.err


def test_an_image_without_rods_gives_an_empty_table_and_code_5_only_where_asked(call, tmp_path):
    path, target = tmp_path / "noise.npy", tmp_path / "rods.csv"
    np.save(path, np.random.default_rng(0).normal(0.0, 0.2, (80, 80)))
    ended = call("contour", path, *SIZE, "-o", target, *FAST, "--json")
    assert ended.code == 0
    assert (ended.json["rods"], ended.json["persistence_nm"]) == (0, None)
    assert list(pd.read_csv(target)) == CONTOURS.names
    assert call("contour", path, *SIZE, "-o", target, *FAST, "--strict").code == 5
