"""Scans as folders: what was interrupted goes on, and ends with the same bytes."""

from __future__ import annotations

import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rotortrack import files
from rotortrack.errors import InputError, LockedError, UsageError
from rotortrack.exchange import parquet
from rotortrack.parallel import process_pool
from rotortrack.pipeline import scan_run
from rotortrack.pipeline.scan_parts import DIMENSIONS
from rotortrack.pipeline.scan_run import read_scan, run_scan
from rotortrack.simulate.archive import read_archive, write_archive
from rotortrack.simulate.scene_field import SceneField

from .rods import FakeRods, scene

RESULTS = ("runs.parquet", "shapes.npz")


def bytes_of(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in RESULTS]


def interrupted(rods: FakeRods, folder: Path, after: int, **kwargs) -> list[Path]:
    """Stop a scan after some runs and give the parts that were kept."""
    rods.stop_after = len(rods.calls) + after
    with pytest.raises(KeyboardInterrupt):
        run_scan(scene(), None, folder, workers=1, **kwargs)
    rods.stop_after = None
    return sorted((folder / "parts").glob("scan-*/*.npz"))


@pytest.fixture
def whole(rods, tmp_path) -> list[bytes]:
    """Results of a scan that nothing interrupted."""
    run_scan(scene(), None, tmp_path / "whole", workers=1)
    rods.calls.clear()
    return bytes_of(tmp_path / "whole")


def field(current_a: float = 2e-9, node: float = 1.0) -> SceneField:
    table = SimpleNamespace(
        r_nm=np.arange(2.0),
        z_nm=np.arange(2.0),
        nodes=np.full((2, 2, 8, 4), node),
        pore_radius_nm=25.0,
        membrane_nm=20.0,
        rim_radius_nm=0.0,
        current_a=current_a,
        flow_m3_s=4e-17,
        current_error_rel=1e-3,
        flow_error_rel=3e-3,
    )
    return SceneField(table, "solved", "solved for this scene", 17_000, 2.5)


@pytest.mark.usefixtures("rods")
def test_results_say_what_made_them(tmp_path):
    given = scene({"start": {"height_nm": 6.0}})
    done = run_scan(given, field(), tmp_path / "scan", workers=2)
    assert len(done.runs) == len(done.shape_nm) == len(done.turned_rad) == 12
    metadata = parquet.read_metadata(tmp_path / "scan" / "runs.parquet")
    assert metadata["table"] == "runs"
    assert metadata["units"]["torque_pn_nm"] == "pN nm"
    provenance = metadata["provenance"]
    assert provenance["options"]["start"]["height_nm"] == {"value": 6.0, "origin": "test"}
    assert provenance["options"]["rod"]["length_nm"]["origin"] == "default"
    assert "thermal" not in provenance["options"]
    assert provenance["field"]["source"] == "solved"
    facts = json.loads((tmp_path / "scan" / "scan.json").read_text())
    assert facts["state"] == "complete"
    assert facts["runs"] == sum(facts["ends"].values()) == len(facts["run_seconds"]) == 12
    assert facts["field"]["flow_error_rel"] == 3e-3
    assert not (tmp_path / "scan" / "parts").exists()


@pytest.mark.parametrize("after", [1, 5, 11])
def test_an_interrupted_scan_goes_on_and_ends_with_the_same_bytes(rods, tmp_path, whole, after):
    folder = tmp_path / "scan"
    assert interrupted(rods, folder, after)
    with pytest.raises(InputError, match="not finished"):
        read_scan(folder)
    run_scan(scene(), None, folder, workers=1)
    assert len(rods.calls) == 12
    assert bytes_of(folder) == whole


def test_a_scan_that_is_stopped_twice_goes_on_as_well(rods, tmp_path, whole):
    folder = tmp_path / "scan"
    interrupted(rods, folder, 3)
    assert len(interrupted(rods, folder, 4)) == 2
    run_scan(scene(), None, folder, workers=1)
    assert len(rods.calls) == 12
    assert bytes_of(folder) == whole


def test_runs_are_kept_while_the_scan_goes_on(rods, tmp_path, monkeypatch, whole):
    monkeypatch.setattr(scan_run, "_MOST_IN_PART", 2)
    parts = interrupted(rods, tmp_path / "scan", 7)
    assert [path.name for path in parts] == [
        f"{first:08d}-{last:08d}.npz" for first, last in ((0, 1), (2, 3), (4, 5), (6, 6))
    ]
    # As after a crash in which the third part was lost.
    parts[2].unlink()
    run_scan(scene(), None, tmp_path / "scan", workers=1)
    assert len(rods.calls) == 12 + 2
    assert bytes_of(tmp_path / "scan") == whole


@pytest.mark.parametrize("workers", [2, 3])
@pytest.mark.usefixtures("rods")
def test_workers_and_executor_leave_the_bytes_as_they_are(tmp_path, whole, workers):
    run_scan(scene(), None, tmp_path / "own", workers=workers)
    with ThreadPoolExecutor(workers) as executor:
        run_scan(scene(), None, tmp_path / "given", workers=workers, executor=executor)
    assert bytes_of(tmp_path / "own") == bytes_of(tmp_path / "given") == whole


def test_a_finished_scan_is_not_made_again(rods, tmp_path):
    first = run_scan(scene(), None, tmp_path, workers=1)
    again = run_scan(scene(), None, tmp_path, workers=1)
    assert len(rods.calls) == 12
    assert again.facts == first.facts
    assert again.runs.equals(first.runs)


def _damage(path: Path, kind: str) -> None:
    arrays, about = read_archive(path, "a part", DIMENSIONS)
    rows = about["rows"]
    match kind:
        case "cut short":
            path.write_bytes(path.read_bytes()[:-100])
        case "empty":
            path.write_bytes(b"")
        case "other runs":
            later = [{**row, "run": row["run"] + 1} for row in rows]
            write_archive(path, arrays, {**about, "rows": later})
        case "a row less":
            write_archive(path, arrays, {**about, "rows": rows[1:]})
        case "numbers as text":
            told = [{**row, "rate_rev_s": "fast"} for row in rows]
            write_archive(path, arrays, {**about, "rows": told})
        case "longer rods":
            write_archive(path, {**arrays, "shape_nm": np.zeros((5, 6, 3))}, about)
        case "code":
            trap = np.array([_Trap()] * 5, dtype=object)
            np.savez(path, allow_pickle=True, **{**arrays, "time_us": trap, "about": "{}"})


class _Trap:
    def __reduce__(self):
        return (os.mkdir, ("trapped",))


@pytest.mark.parametrize(
    "kind",
    [
        *("cut short", "empty", "other runs", "a row less", "numbers as text", "longer rods"),
        "code",
    ],
)
def test_a_part_that_is_not_whole_is_made_again(rods, tmp_path, whole, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    (part,) = interrupted(rods, tmp_path / "scan", 5)
    _damage(part, kind)
    run_scan(scene(), None, tmp_path / "scan", workers=1)
    assert len(rods.calls) == 5 + 12
    assert bytes_of(tmp_path / "scan") == whole
    assert not (tmp_path / "trapped").exists()


def test_another_scan_is_not_replaced_without_being_asked(rods, tmp_path, whole):
    interrupted(rods, tmp_path / "scan", 5)
    other = scene(lambda_eff=[0.3])
    with pytest.raises(UsageError, match=r"other options.*--overwrite"):
        run_scan(other, None, tmp_path / "scan", workers=1)
    run_scan(scene(), None, tmp_path / "scan", workers=1)
    with pytest.raises(UsageError, match="--overwrite"):
        run_scan(other, None, tmp_path / "scan", workers=1)
    assert bytes_of(tmp_path / "scan") == whole
    done = run_scan(other, None, tmp_path / "scan", workers=1, overwrite=True)
    assert set(done.runs["lambda_eff"]) == {0.3}


@pytest.mark.usefixtures("rods")
def test_another_field_is_another_scan(tmp_path):
    run_scan(scene(), field(), tmp_path, workers=1)
    with pytest.raises(UsageError):
        run_scan(scene(), field(node=1.1), tmp_path, workers=1)
    with pytest.raises(UsageError):
        run_scan(scene(), None, tmp_path, workers=1)


def test_folders_with_other_results_are_refused(rods, tmp_path):
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(UsageError, match="run folder of a movie"):
        run_scan(scene(), None, tmp_path, workers=1)
    (tmp_path / "run.json").rename(tmp_path / "runs.parquet")
    with pytest.raises(UsageError, match=r"runs\.parquet"):
        run_scan(scene(), None, tmp_path, workers=1)
    assert rods.calls == []
    run_scan(scene(), None, tmp_path, workers=1, overwrite=True)


@pytest.mark.usefixtures("rods")
def test_only_one_scan_works_in_a_folder(tmp_path):
    with files.locked(tmp_path, "simulate scan"), pytest.raises(LockedError):
        run_scan(scene(), None, tmp_path, workers=1)


@pytest.mark.usefixtures("rods")
def test_links_in_place_of_the_parts_are_not_followed(tmp_path, whole):
    outside = tmp_path / "outside"
    outside.mkdir()
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "parts").symlink_to(outside)
    run_scan(scene(), None, tmp_path / "scan", workers=1)
    assert list(outside.iterdir()) == []
    assert bytes_of(tmp_path / "scan") == whole


@pytest.mark.usefixtures("rods")
def test_what_else_lies_in_the_folder_stays(tmp_path):
    (tmp_path / "parts" / "drawings").mkdir(parents=True)
    (tmp_path / "notes.txt").write_text("mine")
    run_scan(scene(), None, tmp_path, workers=1, overwrite=True)
    assert (tmp_path / "parts" / "drawings").is_dir()
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("name", ["scan.json", "runs.parquet", "shapes.npz"])
@pytest.mark.usefixtures("rods")
def test_a_folder_that_lacks_a_result_is_no_scan(tmp_path, name):
    run_scan(scene(), None, tmp_path, workers=1)
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(InputError):
        read_scan(tmp_path)


@pytest.mark.usefixtures("rods")
def test_shapes_of_other_runs_are_refused(tmp_path):
    run_scan(scene(), None, tmp_path / "a", workers=1)
    run_scan(scene(lambda_eff=[0.3]), None, tmp_path / "b", workers=1)
    (tmp_path / "b" / "shapes.npz").replace(tmp_path / "a" / "shapes.npz")
    with pytest.raises(InputError, match="other runs"):
        read_scan(tmp_path / "a")


def test_processes_give_the_same_bytes_as_this_one(tmp_path):
    free = {"rod": {"n_vertices": 7}, "stepping": {"duration_us": 1.0}, "start": {"jitter_nm": 1.0}}
    given = scene(free, lambda_eff=[0.1], flow_ratio=[90])
    run_scan(given, None, tmp_path / "here", workers=1)
    with process_pool(1) as executor:
        run_scan(given, None, tmp_path / "there", workers=1, executor=executor)
    assert bytes_of(tmp_path / "here") == bytes_of(tmp_path / "there")


def test_noise_is_that_of_the_seed_and_of_the_run(tmp_path):
    noisy = {
        "rod": {"n_vertices": 7},
        "stepping": {"duration_us": 0.5},
        "thermal": {"step_us": 1e-3, "seed": 4},
    }
    shapes = []
    for folder, change in (("a", {}), ("b", {}), ("c", {"seed": 5})):
        sections = {**noisy, "thermal": {**noisy["thermal"], **change}}
        given = scene(sections, lambda_eff=[0.1], flow_ratio=[90])
        shapes.append(run_scan(given, None, tmp_path / folder, workers=1).shape_nm)
    np.testing.assert_array_equal(shapes[0], shapes[1])
    assert not np.array_equal(shapes[0], shapes[2])
    first, second = shapes[0] - shapes[0].mean(axis=1, keepdims=True)
    assert not np.allclose(first, second)
