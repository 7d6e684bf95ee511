"""Kept work comes back as it was; what is damaged, foreign or out of place does not come back."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import TableError
from rotortrack.files import make_folder
from rotortrack.pipeline.parts import (
    Checkpoint,
    FramePart,
    Parts,
    frame_parts,
    missing_frames,
    read_frame_parts,
    remove_work,
    write_frame_part,
)
from rotortrack.pipeline.provenance import Noted
from rotortrack.tables import LOCALISATIONS, Column, Schema

KEYS = {"check": "0" * 16, "localise": "1" * 16, "correct": "2" * 16, "rotors": "3" * 16}
SCHEMAS = {"marks": Schema("marks", (Column("mark", "bool", "", "", required=True),))}
MARKS = pd.DataFrame({"mark": [True, False, True]})


def columns(start, stop):
    """One spot a frame."""
    frame = np.arange(start, stop)
    values = {name: np.full(len(frame), 1.5) for name in LOCALISATIONS.names if name != "rotor"}
    values |= {"frame": frame, "fit_flags": frame % 3, "channel": 0 * frame}
    return {name: value.astype(LOCALISATIONS.dtypes[name]) for name, value in values.items()}


def load(parts, unpack=lambda kept: kept):
    return parts.load("correct", SCHEMAS, unpack)


def test_a_stage_comes_back_with_what_was_noted(tmp_path):
    parts = Parts(tmp_path, KEYS)
    assert load(parts) is None
    parts.save("correct", SCHEMAS, Checkpoint({"marks": MARKS}, {"dense": 3}), Noted(["a note"]))
    kept, noted = load(parts)
    pd.testing.assert_frame_equal(kept.tables["marks"], MARKS)
    assert kept.facts["dense"] == 3
    assert noted.notes == ["a note"]
    assert load(Parts(tmp_path, {**KEYS, "correct": "4" * 16})) is None


@pytest.mark.parametrize("name", ["done.json", "marks.parquet"])
@pytest.mark.parametrize("content", [b"", b"{}", b"[1]", b"\xff\xfe", b"{" * 100_000])
def test_a_damaged_stage_is_made_again(tmp_path, name, content):
    parts = Parts(tmp_path, KEYS)
    parts.save("correct", SCHEMAS, Checkpoint({"marks": MARKS}, {}), Noted())
    (parts.folder("correct") / name).write_bytes(content)
    assert load(parts) is None


def test_what_cannot_be_unpacked_is_made_again(tmp_path):
    parts = Parts(tmp_path, KEYS)
    parts.save("correct", SCHEMAS, Checkpoint({"marks": MARKS}, {}), Noted())
    assert load(parts, lambda kept: kept.facts["missing"]) is None


@given(cuts=st.sets(st.integers(1, 49)), kept=st.integers(0, 2**12))
def test_kept_and_missing_frames_make_up_the_movie(cuts, kept):
    edges = [0, *sorted(cuts), 50]
    ranges = list(itertools.pairwise(edges))
    have = [r for index, r in enumerate(ranges) if kept >> index % 13 & 1]
    parts = [FramePart(None, start, stop, 0, {}) for start, stop in have]
    seen = [f for start, stop in [*have, *missing_frames(parts, 50)] for f in range(start, stop)]
    assert sorted(seen) == list(range(50))


def test_frames_come_back_in_order_whatever_the_order_of_writing(tmp_path):
    for start, stop in ((20, 30), (0, 10), (10, 20)):
        block = columns(start, stop)
        write_frame_part(tmp_path, start, stop, [block], {"counts": {"candidates": 1}})
    found = frame_parts(tmp_path, 30)
    assert [(part.start, part.stop, part.rows) for part in found] == [
        *((0, 10, 10), (10, 20, 10), (20, 30, 10)),
    ]
    assert missing_frames(found, 40) == [(30, 40)]
    table = read_frame_parts(found)
    expected = columns(0, 30)
    assert list(table) == [name for name in LOCALISATIONS.names if name != "rotor"]
    for name, values in expected.items():
        assert table[name].dtype == LOCALISATIONS.dtypes[name]
        np.testing.assert_array_equal(table[name], values)


def test_parts_without_spots_and_movies_without_frames_join(tmp_path):
    write_frame_part(tmp_path, 0, 5, [columns(0, 0)], {})
    assert len(read_frame_parts(frame_parts(tmp_path, 5))) == 0
    assert len(read_frame_parts([])) == 0


def test_overlapping_foreign_and_damaged_parts_do_not_count(tmp_path):
    write_frame_part(tmp_path, 0, 10, [columns(0, 10)], {})
    write_frame_part(tmp_path, 5, 15, [columns(5, 15)], {})
    write_frame_part(tmp_path, 90, 110, [columns(90, 110)], {})
    (tmp_path / "00000015-00000019.parquet").write_bytes(b"PAR1 and no more")
    (tmp_path / "mine.parquet").write_text("mine")
    found = frame_parts(tmp_path, 100)
    assert [(part.start, part.stop) for part in found] == [(0, 10)]


def test_damage_within_a_part_is_found_when_it_is_read(tmp_path):
    write_frame_part(tmp_path, 0, 2000, [columns(0, 2000)], {})
    (part,) = frame_parts(tmp_path, 2000)
    data = bytearray(part.path.read_bytes())
    data[len(data) // 4] ^= 0xFF
    part.path.write_bytes(data)
    with pytest.raises(TableError):
        read_frame_parts(frame_parts(tmp_path, 2000))


def test_tidying_removes_other_work_and_nothing_else(tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "precious").write_text("mine")
    parts = Parts(tmp_path / "run", KEYS)
    for name in ("localise-" + "9" * 16, "rotors-" + "9" * 16, "commit", "mine"):
        make_folder(parts.root / name)
    make_folder(parts.folder("localise"))
    (parts.root / ("correct-" + "9" * 16)).symlink_to(outside)
    parts.tidy()
    left = {path.name for path in parts.root.iterdir()}
    assert left == {"mine", parts.folder("localise").name, "correct-" + "9" * 16}
    assert (outside / "precious").is_file()


def test_a_parts_folder_that_is_a_link_is_left_alone(tmp_path):
    outside = tmp_path / "outside"
    make_folder(outside / ("rotors-" + "9" * 16))
    (tmp_path / "parts").symlink_to(outside)
    remove_work(tmp_path / "parts")
    assert len(list(outside.iterdir())) == 1
