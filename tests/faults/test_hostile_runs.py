"""Code in data is never run, and a run folder made elsewhere is only data."""

from __future__ import annotations

import importlib.util
import json
import os
import pickle
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from rotortrack_cli.main import main

if not sys.platform.startswith("linux"):
    pytest.skip("pipes, users and limits are made as Linux has them", allow_module_level=True)

_spec = importlib.util.spec_from_file_location("hostile", Path(__file__).with_name("hostile.py"))
hostile = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(hostile)


@pytest.fixture(autouse=True, scope="module")
def _compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    hostile.warm(tmp_path_factory.mktemp("warm"))


@pytest.fixture(autouse=True)
def _in_time() -> Iterator[None]:
    with hostile.in_time():
        yield


class Bomb:
    """Leaves a folder behind when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.trace),)


def test_pickles_as_camera_maps_are_never_loaded(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    trace = tmp_path / "trace"
    objects = np.array([[Bomb(trace)]], object)
    forms = {
        "npz": lambda path: np.savez(path, **dict.fromkeys(hostile.MAPS, objects)),
        "npy": lambda path: np.save(path, objects),
        "pickle": lambda path: path.write_bytes(pickle.dumps(Bomb(trace))),
    }
    for kind, save in forms.items():
        path = tmp_path / f"{kind}.{'npy' if kind == 'npy' else 'npz'}"
        save(path)
        assert path.name in hostile.refused(capfd, 3, *hostile.with_maps(tmp_path, path))
        assert not trace.exists()


@pytest.mark.parametrize("reader", ["info", "convert csv", "convert parquet", "config", "motion"])
def test_pickles_under_other_names_are_never_loaded(
    reader: str, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    hostile.movie(tmp_path / "film.tif")
    words, source, code = hostile.reading(reader, tmp_path)
    if reader == "motion":
        source.mkdir()
        source /= "run.json"
    source.write_bytes(pickle.dumps(Bomb(tmp_path / "trace")))
    hostile.refused(capfd, code, *words)
    assert not (tmp_path / "trace").exists()


def test_picasso_files_reach_no_other_file_and_run_no_code(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = np.zeros(3, [("frame", "u4"), ("x", "f4"), ("y", "f4")])
    (tmp_path / "inside").mkdir()
    with h5py.File(tmp_path / "secret.hdf5", "w") as file:
        file["locs"] = rows
    path = tmp_path / "inside" / "table.hdf5"
    words = ("convert", path, tmp_path / "out.csv", "-q", "--pixel-size-nm", 100)
    with h5py.File(path, "w") as file:
        file["locs"] = h5py.ExternalLink("../secret.hdf5", "/locs")
    assert "table.hdf5" in hostile.refused(capfd, 3, *words)
    with h5py.File(path, "w") as file:
        file["group/locs"] = rows
        file["locs"] = h5py.SoftLink("/group/locs")
    assert "table.hdf5" in hostile.refused(capfd, 3, *words)
    with h5py.File(path, "w") as file:
        file["locs"] = rows
    trace = tmp_path / "trace"
    path.with_suffix(".yaml").write_text(f"Pixelsize: !!python/object/apply:os.mkdir [{trace}]\n")
    assert "table.yaml" in hostile.refused(capfd, 3, *words)
    assert not trace.exists()
    assert not (tmp_path / "out.csv").exists()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Make the files of a run folder."""
    folder = tmp_path_factory.mktemp("runs")
    rng = np.random.default_rng(3)
    angle = np.cumsum(rng.normal(0.3, 0.2, 300))
    rows = [
        f"{frame},{1000 + 40 * np.cos(a):.2f},{1000 + 40 * np.sin(a):.2f}"
        for frame, a in enumerate(angle, start=1)
    ]
    table = folder / "l.csv"
    table.write_text("\n".join(['"frame","x [nm]","y [nm]"', *rows, ""]))
    words = ("rotors", table, "--frame-interval-s", "0.002", "-o", folder / "run", "-q")
    assert main([str(word) for word in words]) == 0
    shutil.copytree(folder / "run", folder / "other")
    assert main(["motion", str(folder / "other"), "--no-figures", "-q"]) == 0
    return {path.name: path.read_bytes() for path in (folder / "run").iterdir() if path.is_file()}


def crafted(folder: Path, run: dict[str, bytes], manifest: object) -> Path:
    folder.mkdir(exist_ok=True)
    for name, content in run.items():
        (folder / name).write_bytes(content)
    text = manifest if isinstance(manifest, str) else json.dumps(manifest)
    (folder / "run.json").write_text(text)
    return folder


def test_run_folder_that_was_moved_is_taken(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, run: dict[str, bytes]
) -> None:
    folder = crafted(tmp_path / "run", run, run["run.json"].decode())
    assert hostile.call(capfd, "info", folder)[0] == 0
    assert hostile.call(capfd, "motion", folder, "--no-figures")[0] == 0


VALUES = (
    None,
    True,
    -1,
    1.5,
    1e308,
    10**400,
    "",
    "x",
    hostile.ESCAPES,
    [],
    [1],
    [[]],
    {},
    {"x": 1},
)


def test_wrong_values_in_a_manifest_end_in_a_sentence(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, run: dict[str, bytes]
) -> None:
    whole = json.loads(run["run.json"])
    rng = np.random.default_rng(8)
    places: list[tuple[str, ...]] = [(key,) for key in (*whole, "unfinished", "keys") * 7]
    options = [(section, name) for section, part in whole["options"].items() for name in part]
    for section, name in options:
        places += [("options", section, name, part) for part in ("value", "origin")]
    for number, (*path, last) in enumerate(places):
        manifest = json.loads(run["run.json"])
        target = manifest
        for key in path:
            target = target[key]
        target[last] = VALUES[rng.integers(len(VALUES))]
        folder = crafted(tmp_path / "run", run, manifest)
        hostile.call(capfd, "info", folder, *(["--json"] if number % 3 == 0 else []))
        if number % 8 == 0:
            hostile.call(capfd, "motion", folder, "--no-figures", "-q")


def test_huge_and_deep_manifests_end_in_a_sentence(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, run: dict[str, bytes]
) -> None:
    manifest = json.loads(run["run.json"])
    for text in (
        "[" * 10**6,
        '{"a":' * 10**5,
        json.dumps({**manifest, "notes": ["x" * (70 * 2**20)]}),
        json.dumps(manifest)[:-2] + ', "counts": ' + "[" * 900 + "]" * 900 + "}",
        json.dumps({**manifest, "counts": {"frames": "9" * 9}}).replace(
            '"' + "9" * 9 + '"', "9" * 9999
        ),
        "\ufeff" + json.dumps(manifest),
        json.dumps(manifest).replace("rotors", "\x00"),
    ):
        folder = crafted(tmp_path / "run", run, text)
        assert "run.json" in hostile.refused(capfd, 3, "info", folder)
        assert "run.json" in hostile.refused(capfd, 3, "motion", folder, "-q")


def test_large_manifest_is_read_in_bounded_memory(tmp_path: Path, run: dict[str, bytes]) -> None:
    manifest = json.loads(run["run.json"])
    manifest["inputs"] = [{"path": "x" * 400, "bytes": 1, "sha256": "0"}] * 10**5
    folder = crafted(tmp_path / "run", run, manifest)
    assert folder.joinpath("run.json").stat().st_size > 40e6
    program = "import contextlib, io\nwith contextlib.redirect_stdout(io.StringIO()):\n"
    program += '    code = main(["info", sys.argv[1]])\nprint("exit", code)'
    assert "exit" in hostile.limited(program, folder)


def test_input_paths_and_names_of_a_manifest_are_never_opened_or_written(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, run: dict[str, bytes]
) -> None:
    victim = tmp_path / "victim.parquet"
    victim.write_text(hostile.CANARY)
    for path in (str(victim), "../victim.parquet", f"file://{victim}"):
        manifest = json.loads(run["run.json"])
        manifest["inputs"] = [{**manifest["inputs"][0], "path": path}]
        manifest["tables"] = ["../victim", str(victim.with_suffix("")), "rotors"]
        folder = crafted(tmp_path / "run", run, manifest)
        staged = folder / "parts" / "commit"
        staged.mkdir(parents=True)
        (staged / "run.json").write_text(json.dumps(manifest))
        hostile.OPENED.clear()
        for words in (("info", folder), ("motion", folder, "--no-figures", "-q")):
            _, out, err = hostile.call(capfd, *words)
            assert hostile.CANARY not in out + err
        assert str(victim) not in [str(Path(name).resolve()) for name in hostile.OPENED]
        assert victim.read_text() == hostile.CANARY


def test_links_within_a_run_folder_do_not_lead_writes_out_of_it(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, run: dict[str, bytes]
) -> None:
    folder = crafted(tmp_path / "run", run, run["run.json"].decode())
    victim = tmp_path / "victim"
    victim.write_text(hostile.CANARY)
    for name in ("tracks.parquet", "rotors.csv", "config.resolved.toml"):
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(victim)
    assert hostile.call(capfd, "motion", folder, "--no-figures", "-q")[0] == 0
    assert victim.read_text() == hostile.CANARY


def test_negative_counts_in_a_manifest_do_no_harm(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, run: dict[str, bytes]
) -> None:
    manifest = json.loads(run["run.json"])
    manifest["counts"] = dict.fromkeys([*manifest["counts"], hostile.ESCAPES], -(10**9))
    manifest["warnings"] = [hostile.ESCAPES, "x\ny\r\nz"]
    folder = crafted(tmp_path / "run", run, manifest)
    assert hostile.call(capfd, "info", folder)[0] == 0
    hostile.call(capfd, "motion", folder, "--no-figures")
