"""The run folder gives back what was written and leaves no trace of what failed."""

from __future__ import annotations

import pandas as pd
import pytest

from rotortrack.errors import InputError, ResourceError, TableError
from rotortrack.exchange.tables import read_info
from rotortrack.exchange.writer import TableInfo
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.store import RunFolder
from rotortrack.settings import resolve
from rotortrack.tables import DRIFT, LOCALISATIONS, ROTORS, TRACKS, empty

INFO = TableInfo(pixel_size_nm=108.0, frames=10, frame_interval_s=0.002, provenance={"by": "test"})


def replace(folder, tables, **options):
    folder.replace(tables, INFO, Record("test"), resolve(SECTIONS, []), **options)


def test_empty_tables_survive_a_round_trip(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    schemas = (LOCALISATIONS, ROTORS, TRACKS, DRIFT)
    replace(folder, {schema.name: empty(schema) for schema in schemas})
    for schema in schemas:
        again = folder.read(schema.name)
        assert len(again) == 0
        assert set(again) <= set(schema.names)
        assert {c.name for c in schema.columns if c.required} <= set(again)


def test_localisations_carry_pixel_size_and_interval(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    table = pd.DataFrame({"frame": [0, 1], "x_nm": [1.5, 2.5], "y_nm": [3.0, 4.0]})
    replace(folder, {"localisations": table})
    info = read_info(folder.path / "localisations.parquet")
    assert info.pixel_size_nm == 108.0
    assert info.frame_interval_s == 0.002
    pd.testing.assert_frame_equal(folder.read("localisations"), table, check_dtype=False)


def test_nothing_of_an_earlier_run_stays_beside_the_new_one(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    schemas = (LOCALISATIONS, ROTORS, TRACKS, DRIFT)
    replace(folder, {schema.name: empty(schema) for schema in schemas})
    (folder.path / "tracks.csv").write_text("mine")
    folder.figures_path.mkdir()
    for name in ("rotor-003.png", "mine.png"):
        (folder.figures_path / name).write_text("picture")
    replace(folder, {"rotors": empty(ROTORS)}, keep=("localisations",))
    names = {path.relative_to(folder.path).as_posix() for path in folder.path.rglob("*.*")}
    assert names == {
        *("rotors.parquet", "rotors.csv", "localisations.parquet", "run.json"),
        *("config.resolved.toml", "tracks.csv", "figures/mine.png"),
    }


def test_a_failed_write_leaves_no_manifest_of_the_earlier_run(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    replace(folder, {"rotors": empty(ROTORS)})
    broken = pd.DataFrame({"rotor": ["not a number"]})
    with pytest.raises(TableError):
        replace(folder, {"tracks": broken})
    with pytest.raises(InputError, match=r"run\.json"):
        RunFolder.open(folder.path)


def fail_in_scratch(folder):
    with folder.scratch("part") as part:
        part.write_text("half")
        raise ZeroDivisionError


def fail_in(path):
    with RunFolder.claim(path) as folder:
        fail_in_scratch(folder)


def test_failed_work_leaves_no_folder_of_its_own(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fail_in(tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_failed_work_leaves_a_folder_that_was_there(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fail_in(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_file_named_parts_is_a_resource_error(tmp_path):
    (tmp_path / "parts").write_text("mine")
    with pytest.raises(ResourceError, match="parts"), RunFolder(tmp_path).scratch("part"):
        pass


def test_a_missing_table_and_a_foreign_folder_are_named(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    with pytest.raises(InputError, match=r"tracks\.parquet"):
        folder.read("tracks")
    with pytest.raises(InputError, match=r"run\.json"):
        RunFolder.open(tmp_path)


def test_a_file_in_the_way_is_a_resource_error(tmp_path):
    (tmp_path / "run").write_text("in the way")
    with pytest.raises(ResourceError, match="run"):
        RunFolder.create(tmp_path / "run")
