"""The run folder gives back what was written and leaves no trace of what failed."""

from __future__ import annotations

import pandas as pd
import pytest

from rotortrack.errors import InputError, ResourceError
from rotortrack.exchange.tables import read_info
from rotortrack.exchange.writer import TableInfo
from rotortrack.pipeline.store import RunFolder
from rotortrack.tables import DRIFT, LOCALISATIONS, ROTORS, TRACKS, empty

INFO = TableInfo(pixel_size_nm=108.0, frames=10, frame_interval_s=0.002, provenance={"by": "test"})


@pytest.mark.parametrize("schema", [LOCALISATIONS, ROTORS, TRACKS, DRIFT], ids=lambda s: s.name)
def test_empty_tables_survive_a_round_trip(tmp_path, schema):
    folder = RunFolder.create(tmp_path / "run")
    folder.write(schema.name, empty(schema), INFO)
    again = folder.read(schema.name)
    assert len(again) == 0
    assert set(again) <= set(schema.names)
    assert {c.name for c in schema.columns if c.required} <= set(again)


def test_localisations_carry_pixel_size_and_interval(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    table = pd.DataFrame({"frame": [0, 1], "x_nm": [1.5, 2.5], "y_nm": [3.0, 4.0]})
    folder.write("localisations", table, INFO)
    info = read_info(folder.path / "localisations.parquet")
    assert info.pixel_size_nm == 108.0
    assert info.frame_interval_s == 0.002
    pd.testing.assert_frame_equal(folder.read("localisations"), table, check_dtype=False)


def test_scratch_leaves_no_folder_when_a_stage_fails(tmp_path):
    folder = RunFolder.create(tmp_path / "run")

    def fail() -> None:
        with folder.scratch("part") as part:
            part.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert not folder.path.exists()


def test_scratch_keeps_a_folder_that_holds_results(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    (folder.path / "notes.txt").write_text("mine")
    with folder.scratch("part") as part:
        part.write_text("half")
    assert [path.name for path in folder.path.iterdir()] == ["notes.txt"]


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
