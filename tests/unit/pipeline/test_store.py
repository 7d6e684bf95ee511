"""The run folder gives back what was written and leaves no trace of what failed."""

from __future__ import annotations

import json
import os

import pandas as pd
import pytest

from rotortrack.errors import InputError, LockedError, ResourceError, TableError, UsageError
from rotortrack.exchange.tables import read_info
from rotortrack.exchange.writer import TableInfo
from rotortrack.pipeline import store
from rotortrack.pipeline.identity import identify
from rotortrack.pipeline.provenance import Record
from rotortrack.pipeline.store import RunFolder
from rotortrack.tables import DRIFT, LOCALISATIONS, ROTORS, TRACKS, empty

INFO = TableInfo(pixel_size_nm=108.0, frames=10, frame_interval_s=0.002, provenance={"by": "test"})
ALL = {schema.name: empty(schema) for schema in (LOCALISATIONS, ROTORS, TRACKS, DRIFT)}


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "run"
    path.mkdir()
    return RunFolder(path)


def commit(folder, tables, **options):
    folder.commit(tables, INFO, Record("test"), **options)


def names(folder):
    return {
        path.relative_to(folder.path).as_posix()
        for path in folder.path.rglob("*")
        if path.is_file()
    }


def test_empty_tables_survive_a_round_trip(folder):
    commit(folder, ALL)
    for schema in (LOCALISATIONS, ROTORS, TRACKS, DRIFT):
        again = folder.read(schema.name)
        assert len(again) == 0
        assert set(again) <= set(schema.names)
        assert {c.name for c in schema.columns if c.required} <= set(again)


def test_localisations_carry_pixel_size_and_interval(folder):
    table = pd.DataFrame({"frame": [0, 1], "x_nm": [1.5, 2.5], "y_nm": [3.0, 4.0]})
    commit(folder, {"localisations": table})
    info = read_info(folder.path / "localisations.parquet")
    assert info.pixel_size_nm == 108.0
    assert info.frame_interval_s == 0.002
    pd.testing.assert_frame_equal(folder.read("localisations"), table, check_dtype=False)


def test_nothing_of_an_earlier_run_stays_beside_the_new_one(folder):
    commit(folder, ALL)
    (folder.path / "tracks.csv").write_text("mine")
    folder.figures_path.mkdir()
    for name in ("rotor-003.png", "mine.png"):
        (folder.figures_path / name).write_text("picture")
    commit(folder, {"rotors": empty(ROTORS)}, keep=("localisations",))
    assert names(folder) == {
        *("rotors.parquet", "rotors.csv", "localisations.parquet", "run.json"),
        *("config.resolved.toml", "tracks.csv", "figures/mine.png"),
    }
    assert folder.read_manifest()["tables"] == ["localisations", "rotors"]


def test_a_failed_write_leaves_the_earlier_run_whole(folder):
    commit(folder, ALL)
    before = {name: (folder.path / name).read_bytes() for name in names(folder)}
    with pytest.raises(TableError):
        commit(folder, {"tracks": pd.DataFrame({"rotor": ["not a number"]})})
    after = {name: (folder.path / name).read_bytes() for name in before}
    assert after == before
    assert RunFolder.open(folder.path).read_manifest()["state"] == "complete"


@pytest.mark.parametrize("renames", range(9))
def test_a_commit_cut_short_between_two_renames_is_carried_out_later(folder, renames, monkeypatch):
    commit(folder, ALL)
    whole = names(folder)
    left = renames
    replace = type(folder.path).replace

    def stop_after_some(path, target):
        nonlocal left
        if path.parent.name == "commit" and target.parent == folder.path:
            if left == 0:
                raise KeyboardInterrupt
            left -= 1
        return replace(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(type(folder.path), "replace", stop_after_some)
        try:
            rotors = pd.DataFrame({"rotor": [7], "x_nm": 1.0, "y_nm": 2.0})
            commit(folder, {**ALL, "rotors": rotors})
        except KeyboardInterrupt:
            with pytest.raises(InputError):
                RunFolder.open(folder.path)
        else:
            assert renames >= 7
    with RunFolder.claim(folder.path, "test"):
        pass
    assert names(folder) == whole
    assert RunFolder.open(folder.path).read("rotors")["rotor"].tolist() == [7]


def test_unfinished_work_is_told_and_hides_no_finished_results(folder):
    record = Record("run")
    folder.note_unfinished(record, "localise", "begun")
    with pytest.raises(InputError, match="not finished"):
        RunFolder.open(folder.path)
    commit(folder, ALL)
    folder.note_unfinished(record, "motion", "stopped")
    unfinished = RunFolder.open(folder.path).read_manifest()["unfinished"]
    told = {key: unfinished[key] for key in ("command", "stage", "reason")}
    assert told == {"command": "run", "stage": "motion", "reason": "stopped"}
    folder.note_finished(record)
    assert "unfinished" not in folder.read_manifest()
    events = [
        json.loads(line)["event"] for line in (folder.path / "log.jsonl").read_text().splitlines()
    ]
    assert events == ["begun", "stopped", "finished"]


def fail_in(path, name=None):
    with RunFolder.claim(path, "test") as folder:
        folder.note_unfinished(Record("run"), "localise", "begun")
        if name:
            (path / "parts").mkdir()
            (path / "parts" / name).write_text("work")
        raise ZeroDivisionError


def test_failed_work_leaves_no_folder_of_its_own_but_work_that_took_time(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fail_in(tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(ZeroDivisionError):
        fail_in(tmp_path / "run", "part")
    assert (tmp_path / "run" / "parts" / "part").is_file()


def test_a_claimed_folder_is_refused_to_others_and_free_afterwards(tmp_path):
    with (
        RunFolder.claim(tmp_path, "first"),
        pytest.raises(LockedError, match="first"),
        RunFolder.claim(tmp_path, "second"),
    ):
        pass
    with RunFolder.claim(tmp_path, "third"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_results_of_another_movie_are_not_replaced_by_mistake(tmp_path):
    movies = [tmp_path / name for name in ("a.tif", "b.tif")]
    for path in movies:
        path.write_text(path.name)
    a, b = map(identify, movies)
    run = tmp_path / "run"
    record = Record("run")
    record.inputs([a], run)
    with RunFolder.claim(run, "run", [a]) as folder:
        folder.note_unfinished(record, "localise", "begun")
    os.utime(movies[0], (1, 1))
    with RunFolder.claim(run, "run", [identify(movies[0])]):
        pass
    with pytest.raises(UsageError, match=r"a\.tif"), RunFolder.claim(run, "run", [b]):
        pass
    with RunFolder.claim(run, "run", [b], overwrite=True):
        pass


def test_a_stopped_replacement_keeps_its_work(tmp_path):
    movies = [tmp_path / name for name in ("a.tif", "b.tif")]
    for path in movies:
        path.write_text(path.name)
    a, b = map(identify, movies)
    run = tmp_path / "run"
    work = run / "parts" / "localise-0123456789abcdef" / "00000000-00000000.parquet"
    record = Record("run")
    record.inputs([a], run)
    content = {**record.content, "state": "complete", "tables": []}
    for _ in range(2):
        with RunFolder.claim(run, "run", [b], overwrite=True) as folder:
            if work.is_file():
                break
            folder.manifest_path.write_text(json.dumps(content))
            work.parent.mkdir(parents=True)
            work.write_text("of b")
            folder.note_unfinished(Record("run"), "localise", "stopped")
    assert work.is_file()


def test_a_missing_table_and_a_foreign_folder_are_named(folder):
    with pytest.raises(InputError, match=r"tracks\.parquet"):
        folder.read("tracks")
    with pytest.raises(InputError, match=r"run\.json"):
        RunFolder.open(folder.path)


def test_a_file_in_the_way_is_a_resource_error(tmp_path):
    (tmp_path / "run").write_text("in the way")
    with pytest.raises(ResourceError, match="run"), RunFolder.claim(tmp_path / "run", "test"):
        pass


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "[" * 100_000,
        '{"state": "complete"}',
        '{"state": "complete", "inputs": 3}',
        "\x00",
        "9" * 5000,
    ],
)
def test_what_is_no_manifest_is_refused_in_one_sentence(folder, content):
    (folder.path / store.MANIFEST).write_text(content)
    with pytest.raises(InputError, match=r"run\.json") as caught:
        RunFolder.open(folder.path)
    assert "\n" not in str(caught.value)


def refused_for(path, movie, match, **options):
    with (
        pytest.raises(UsageError, match=match),
        RunFolder.claim(path, "run", [identify(movie)], **options),
    ):
        pass


def test_a_finished_run_is_not_replaced_by_another_movie_of_the_same_name(tmp_path):
    movie, run = tmp_path / "movie.tif", tmp_path / "run"
    movie.write_text("first")
    record = Record("run")
    record.inputs([identify(movie)], run)
    with RunFolder.claim(run, "run", [identify(movie)]) as folder:
        folder.commit(ALL, INFO, record)
    movie.write_text("second")
    refused_for(run, movie, r"movie\.tif, not of")
    with RunFolder.claim(run, "run", [identify(movie)], overwrite=True):
        pass


@pytest.mark.parametrize("content", [None, "{", '{"inputs": []}'])
def test_results_of_nobody_knows_what_are_not_replaced(tmp_path, content):
    movie, run = tmp_path / "movie.tif", tmp_path / "run"
    movie.write_text("first")
    run.mkdir()
    (run / "drift.csv").write_text("the user's own")
    if content is not None:
        (run / "run.json").write_text(content)
    refused_for(run, movie, "--overwrite")
    assert (run / "drift.csv").read_text() == "the user's own"


def test_a_table_is_not_replaced_by_what_is_made_from_it(tmp_path):
    table = tmp_path / "localisations.parquet"
    table.write_text("rows")
    refused_for(tmp_path, table, "would be replaced", overwrite=True)
