from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from rotortrack.errors import ResourceError
from rotortrack.movies.movie import ArrayMovie
from rotortrack.pipeline.store import FIGURE_NAME
from rotortrack.report.draw import draw_run
from rotortrack.tables import DRIFT, LOCALISATIONS, ROTORS, TRACKS, empty

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import FRAME_INTERVAL_S, make_run
from mock_tables import make_whole

OVERVIEWS = [
    "field", "positions", "examples", "speeds", "population", "energetics", "scatter",
    "cumulative_angles", "msds", "drift",
]  # fmt: skip
ALWAYS = ["field", "speeds", "cumulative_angles", "msds", "drift"]


def draw(folder, run, **options):
    return draw_run(
        folder,
        rotors=run.rotors,
        tracks=run.tracks,
        localisations=run.localisations,
        drift=run.drift,
        frame_interval_s=FRAME_INTERVAL_S,
        **options,
    )


@pytest.fixture(scope="module")
def run():
    return make_run(6, 200)


def test_a_run_gets_its_overviews_and_kept_rotors_first(run, tmp_path):
    written = draw(tmp_path, run)
    sheets = [f"rotor-{n:03d}" for n in (0, 1, 2, 4, 5, 3)]
    assert [path.name for path in written] == [f"{stem}.png" for stem in OVERVIEWS + sheets]
    assert sorted(written) == sorted((tmp_path / "figures").iterdir())
    for path in written:
        assert path.read_bytes().startswith(b"\x89PNG")


def test_sheets_stop_at_the_limit_and_progress_counts_every_figure(run, tmp_path):
    calls = []
    written = draw(tmp_path, run, max_sheets=2, progress=lambda *call: calls.append(call))
    assert [path.stem for path in written[10:]] == ["rotor-000", "rotor-001"]
    assert calls == [(i, 12) for i in range(1, 13)]


def test_every_figure_of_a_whole_run_may_be_removed_by_the_next(tmp_path):
    whole = make_whole(6, 800)
    tables = whole.tables()
    movie = ArrayMovie(np.ones((800, 99, 99), np.uint16))
    shown = draw_run(
        tmp_path, **tables, frame_interval_s=FRAME_INTERVAL_S, exposure_s=FRAME_INTERVAL_S,
        pixel_size_nm=100.0, movie=movie, max_sheets=1,
    )  # fmt: skip
    voltages = ["voltage", "voltage_angles", "voltage_examples"]
    assert [path.stem for path in shown] == [*OVERVIEWS, *voltages, "frames", "rotor-000"]
    assert all(FIGURE_NAME.fullmatch(path.name) for path in shown)


def test_figures_of_an_earlier_run_go_and_foreign_files_stay(run, tmp_path):
    folder = tmp_path / "figures"
    folder.mkdir()
    for name in ("rotor-417.png", "rotor-000.svg", "my-rotor-417.png", "notes.txt"):
        (folder / name).write_text("x")
    written = draw(tmp_path, run, max_sheets=1)
    left = {path.name for path in folder.iterdir()} - {path.name for path in written}
    assert left == {"my-rotor-417.png", "notes.txt"}


def test_empty_tables_give_figures_that_say_so_or_none_with_its_reason(tmp_path):
    reasons = {}
    written = draw_run(
        tmp_path,
        rotors=empty(ROTORS),
        tracks=empty(TRACKS),
        localisations=empty(LOCALISATIONS),
        drift=empty(DRIFT),
        frame_interval_s=0.002,
        file_format="svg",
        skipped=reasons.__setitem__,
    )
    assert [path.name for path in written] == [f"{stem}.svg" for stem in ALWAYS]
    assert set(reasons) == set(OVERVIEWS) - set(ALWAYS)
    assert reasons["positions"] == "no kept rotor has a centre"
    # Glyphs are paths in the files, but the words stay beside them as comments.
    for path in written[:4]:
        assert "no rotors" in path.read_text(), path.name
    assert "no drift was estimated" in written[4].read_text()


def test_a_refused_rotor_without_circle_or_track_gets_a_sheet_with_its_reason(tmp_path):
    run = make_run(4, 200)
    run.rotors.loc[3, ["x_nm", "y_nm", "radius_nm"]] = np.nan
    run.tracks = run.tracks[run.tracks["rotor"] != 3]
    sheet = draw(tmp_path, run, file_format="svg")[-1]
    assert sheet.name == "rotor-003.svg"
    assert "Rotor 3, refused: immobile" in sheet.read_text()


def test_a_folder_that_cannot_be_made_is_one_clear_error(run, tmp_path):
    (tmp_path / "figures").write_text("a file, not a folder")
    with pytest.raises(ResourceError, match="figures"):
        draw(tmp_path, run)
