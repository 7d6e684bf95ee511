"""Pictures of the pore, of a rod and of a scan show what the numbers say; animations are whole."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest
from PIL import Image

from rotortrack.errors import UsageError
from rotortrack.report import rod_animation
from rotortrack.report.figures import canvas, nanopore, rod_run, rod_scan
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.options import ScanOptions
from rotortrack.simulate.rod.observe import observe_run
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import run_rod
from rotortrack.simulate.scan import planned_runs, runs_table

FIELD = embedded_table()
ROD = RodOptions()


def words(figure):
    texts = [text.get_text() for text in figure.texts]
    for axes in figure.axes:
        texts += [axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()]
        texts += [text.get_text() for text in axes.texts]
        legend = axes.get_legend()
        texts += [text.get_text() for text in legend.get_texts()] if legend else []
    return " | ".join(texts)


@pytest.fixture(scope="module")
def run():
    start = place_rod(ROD, StartOptions(offset_x_nm=40.0, offset_y_nm=8.0), membrane_nm=20.0)
    return run_rod(ROD, SteppingOptions(duration_us=120.0), start, FIELD)


def test_the_pore_is_drawn_with_its_numbers():
    shown = words(nanopore.figure(FIELD))
    assert "100 mV" in shown
    assert "2.05 nA" in shown
    assert "flow of water" in shown


def test_a_pore_in_a_salt_gradient_and_one_at_rest_are_drawn():
    salt = dataclasses.replace(
        FIELD, voltage_v=0.0, options={**FIELD.options, "trans_mm": 550.0, "voltage_v": 0.0}
    )
    assert "diffusioosmotic" in words(nanopore.figure(salt))
    rest = FIELD.scaled(0.0)
    assert "none" in words(nanopore.figure(rest))


def test_a_rod_is_drawn_with_its_rate_and_forces(run):
    shown = words(rod_run.figure(run, observe_run(run, ROD, FIELD), FIELD))
    assert "rotating steadily" in shown
    assert "rev/s" in shown
    for part in ("electric", "flow", "tension", "net ×50"):
        assert part in shown


def test_a_free_rod_is_drawn_without_a_pore():
    start = place_rod(ROD, StartOptions())
    free = run_rod(ROD, SteppingOptions(duration_us=1.0), start)
    shown = words(rod_run.figure(free, observe_run(free, ROD)))
    assert "no force acts" in shown or "forces on the vertex" in shown


def rows(ends):
    options = ScanOptions(lambda_eff=(0.1, 0.2), flow_ratio=(100.0, 130.0))
    result = []
    for run, end in zip(planned_runs(options), ends * 12, strict=False):
        row = dict.fromkeys(
            ("rate_tip_rev_s", "rate_last_tip_rev_s", "end_to_end_nm", "end_to_end_dyes_nm",
             "end_to_end_dyes_xy_nm", "torque_pn_nm", "friction_pn_nm_s",
             "power_pn_nm_s", "deepest_nm"), 1.0,
        )  # fmt: skip
        result.append(
            {
                **row, "run": run.number, "placement": run.placement, "mirrored": run.mirrored,
                "lambda_eff": run.lambda_eff, "flow_ratio": run.flow_ratio, "end": end,
                "rate_rev_s": -3000.0, "end_to_end_xy_nm": 200.0 + run.number, "shape": "U",
                "handedness": -1, "simulated_us": 1.0, "n_steps": 1, "problem": "",
            }
        )  # fmt: skip
    return runs_table(result)


@pytest.mark.parametrize(
    ("ends", "word"),
    [
        (["rotating_steadily", "translocated", "not_docked"], "clockwise"),
        (["docked_still"], "no rod rotates steadily"),
        (["failed"], "undecided"),
    ],
)
def test_a_scan_is_drawn_whatever_its_rods_do(ends, word):
    runs = rows(ends)
    time_us = np.tile(np.linspace(0, 100, 11), (len(runs), 1))
    shown = words(rod_scan.figure(runs, time_us, -0.01 * time_us))
    assert "phase diagram" in shown
    assert word in shown


def test_an_animation_has_its_pictures(run, tmp_path):
    path = tmp_path / "rod.gif"
    rod_animation.animate(run, path, FIELD, frames=5)
    with Image.open(path) as made:
        assert made.n_frames == 5
    assert list(tmp_path.iterdir()) == [path]


def test_animations_of_other_kinds_are_refused(monkeypatch, tmp_path):
    with pytest.raises(UsageError, match=r"rod\.avi"):
        rod_animation.check_ending(tmp_path / "rod.avi")
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(UsageError, match="ffmpeg"):
        rod_animation.check_ending(tmp_path / "rod.mp4")


def test_equal_pictures_are_equal_bytes(tmp_path):
    for name in ("one.png", "two.png"):
        canvas.save_as(nanopore.figure(FIELD), tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
