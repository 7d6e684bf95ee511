"""A run stopped anywhere goes on where it was, and ends with the tables of one never stopped."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from rotortrack.cameras.camera import Camera
from rotortrack.errors import InputError, RotortrackWarning
from rotortrack.movies.write import write_movie
from rotortrack.pipeline import localise_parts, run, stages
from rotortrack.pipeline.folder_runs import motion_of_run, rotors_from_table
from rotortrack.pipeline.reproduce import reproduce
from rotortrack.pipeline.run import run_movie
from rotortrack.pipeline.state import run_state
from rotortrack.settings import Layer
from rotortrack.simulate.ideal_examples import example_scene
from rotortrack.simulate.ideal_film import film

FRAMES = 240
CAMERA = Camera(offset_adu=100.0, gain_e_per_adu=1.5, read_noise_e=1.4)
GIVEN = {
    "movie": {"pixel_size_nm": 108.3, "frame_interval_s": 0.002, "exposure_s": 0.002},
    "camera": {"offset_adu": 100.0, "gain_e_per_adu": 1.5, "read_noise_e": 1.4},
}


@pytest.fixture(autouse=True)
def _quiet(monkeypatch):
    # Parts of 64 frames, so that a short film has several.
    monkeypatch.setattr(localise_parts, "PART_PIXELS", 64 * 64 * 48)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RotortrackWarning)
        yield


@pytest.fixture(scope="module")
def movie(tmp_path_factory):
    path = tmp_path_factory.mktemp("movie") / "movie.tif"
    scene = example_scene(
        ("driven_ccw", "brownian"),
        rng=np.random.default_rng(3),
        shape_px=(48, 64),
        n_frames=FRAMES,
    )
    made = film(scene, CAMERA, np.random.default_rng(4))
    write_movie(path, made.blocks(), shape=made.shape)
    return path


def make(movie, target, **sections):
    merged = {name: {**GIVEN.get(name, {}), **values} for name, values in sections.items()}
    return run_movie(movie, [Layer("test", {**GIVEN, **merged})], target, workers=2)


@pytest.fixture(scope="module")
def undisturbed(movie, tmp_path_factory):
    target = tmp_path_factory.mktemp("undisturbed") / "run"
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("ignore", RotortrackWarning)
        patch.setattr(localise_parts, "PART_PIXELS", 64 * 64 * 48)
        make(movie, target)
    return target


def tables(folder):
    endings = {".parquet", ".csv", ".toml"}
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.suffix in endings}


def sibling(undisturbed, name):
    # Tables name their input as seen from the run folder, so only a sibling's are the same.
    return undisturbed.parent / name


@pytest.mark.parametrize("blocks", [0, 1, 2, 3])
def test_localisation_stopped_after_some_blocks_goes_on_there(
    movie, undisturbed, blocks, monkeypatch
):
    target = sibling(undisturbed, f"blocks-{blocks}")
    localise = localise_parts.localise
    spans_seen = []

    def stopping(*args, spans, **kwargs):
        spans_seen.append(spans)
        for number, block in enumerate(localise(*args, spans=spans, **kwargs)):
            if number == blocks:
                raise KeyboardInterrupt
            yield block

    with monkeypatch.context() as patch:
        patch.setattr(localise_parts, "localise", stopping)
        with pytest.raises(KeyboardInterrupt):
            make(movie, target)
    if blocks:
        state = run_state(target)
        assert not state.complete
        assert "stopped" in state.sentence
        assert f"{64 * blocks} of {FRAMES} frames" in dict(state.stages)["localise"]
    monkeypatch.setattr(
        localise_parts,
        "localise",
        lambda *args, spans, **kwargs: (
            spans_seen.append(spans) or localise(*args, spans=spans, **kwargs)
        ),
    )
    make(movie, target)
    assert spans_seen == [[(0, FRAMES)], [(64 * blocks, FRAMES)]]
    assert tables(target) == tables(undisturbed)


@pytest.mark.parametrize("stage", ["correct", "find", "move"])
def test_a_run_that_failed_in_a_later_stage_takes_over_the_earlier_ones(
    movie, undisturbed, stage, monkeypatch
):
    target = sibling(undisturbed, f"failed-{stage}")
    with monkeypatch.context() as patch:
        patch.setattr(stages, stage, fail)
        with pytest.raises(ZeroDivisionError):
            make(movie, target)
    assert "a fault" in run_state(target).sentence
    for earlier in ("correct", "find")[: ("correct", "find", "move").index(stage)]:
        monkeypatch.setattr(stages, earlier, fail)
    monkeypatch.setattr(localise_parts, "localise", fail)
    result = make(movie, target)
    assert tables(target) == tables(undisturbed)
    assert result.record.content["counts"]["frames"] == FRAMES


def fail(*_args, **_kwargs):
    raise ZeroDivisionError("a fault")


@pytest.mark.parametrize(
    ("sections", "made"),
    [
        ({}, ["move"]),
        ({"motion": {"gap_mode": "bridge"}}, ["move"]),
        ({"circle": {"method": "taubin"}}, ["find", "move"]),
        ({"quality": {"max_uncertainty_nm": 30.0}}, ["correct", "find", "move"]),
        ({"localise": {"method": "lsq"}}, ["localise", "correct", "find", "move"]),
    ],
)
def test_a_changed_option_reruns_its_stage_and_the_later_ones(
    movie, tmp_path, sections, made, monkeypatch
):
    make(movie, tmp_path / "run")
    called = []

    def noticing(name, function):
        def call(*args, **kwargs):
            called.append(name)
            return function(*args, **kwargs)

        return call

    for name in ("correct", "find", "move"):
        monkeypatch.setattr(stages, name, noticing(name, getattr(stages, name)))
    monkeypatch.setattr(localise_parts, "localise", noticing("localise", localise_parts.localise))
    again = make(movie, tmp_path / "run", **sections)
    assert called == made
    monkeypatch.undo()
    fresh = make(movie, tmp_path / "fresh", **sections)
    for name, table in fresh.tables.items():
        assert table.equals(again.tables[name].set_index(table.index)), name


def test_damaged_parts_are_made_again(movie, undisturbed):
    target = sibling(undisturbed, "damaged")
    make(movie, target)
    for path in sorted((target / "parts").rglob("*.*")):
        data = bytearray(path.read_bytes())
        data[len(data) // 3] ^= 0xFF
        path.write_bytes(data)
        make(movie, target)
        assert tables(target) == tables(undisturbed), path.name


def test_a_movie_that_changes_while_it_is_read_is_refused(movie, tmp_path, monkeypatch):
    copy = tmp_path / "movie.tif"
    copy.write_bytes(movie.read_bytes())
    localise = localise_parts.localise

    def changing(*args, **kwargs):
        yield from localise(*args, **kwargs)
        with copy.open("ab") as file:
            file.write(b"more")

    with monkeypatch.context() as patch:
        patch.setattr(localise_parts, "localise", changing)
        with pytest.raises(InputError, match="changed while it was read"):
            make(copy, tmp_path / "run")
    assert make(copy, tmp_path / "run").record.content["inputs"][0]["bytes"] == copy.stat().st_size


def test_a_finished_run_is_reproduced_and_a_tampered_one_is_not(movie, undisturbed, tmp_path):
    found = reproduce(undisturbed, tmp_path / "again")
    assert found.identical
    assert {comparison.table for comparison in found.comparisons} >= {"rotors", "tracks", "drift"}
    copy = tmp_path / "copy"
    make(movie, copy)
    rotors = copy / "rotors.parquet"
    rotors.write_bytes((tmp_path / "again" / "rotors.parquet").read_bytes())
    folder = run.RunFolder(copy)
    table = folder.read("rotors")
    table.loc[0, "radius_nm"] *= 1.001
    run.RunFolder(copy)
    from rotortrack.exchange import parquet
    from rotortrack.tables import ROTORS

    parquet.write_table(rotors, table, ROTORS, {})
    changed = reproduce(copy, tmp_path / "third")
    assert not changed.agrees
    worst = max(changed.comparisons, key=lambda comparison: comparison.difference)
    assert worst.table == "rotors"
    assert worst.worst_column == "radius_nm"


def test_a_run_from_a_table_is_reproduced_with_its_motion(undisturbed, tmp_path):
    table = undisturbed / "localisations.parquet"
    layers = [Layer("test", GIVEN)]
    rotors_from_table(table, layers, tmp_path / "run")
    motion_of_run(tmp_path / "run", [])
    assert reproduce(tmp_path / "run", tmp_path / "again").identical


def test_a_run_is_not_reproduced_from_another_movie(movie, undisturbed, tmp_path):
    other = tmp_path / "other.tif"
    data = bytearray(movie.read_bytes())
    data[len(data) // 2] ^= 1
    other.write_bytes(data)
    with pytest.raises(InputError, match="SHA-256"):
        reproduce(undisturbed, tmp_path / "again", paths=[other])
    with pytest.raises(InputError, match="not there"):
        reproduce(undisturbed, tmp_path / "again", paths=[tmp_path / "gone.tif"])
    with pytest.raises(InputError, match="into itself"):
        reproduce(undisturbed, undisturbed)
