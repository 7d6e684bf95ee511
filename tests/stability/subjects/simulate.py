"""Rods and their films; closed forms and spots have their cases in `cases/simulate.py`."""

from __future__ import annotations

import numpy as np
from battery import Subject, digits, word_for

from rotortrack.simulate.film.optics import gaussian_widths_nm
from rotortrack.simulate.film.options import PsfOptions
from rotortrack.simulate.rod.balance import force_balance
from rotortrack.simulate.rod.observe import dye_centres_nm
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.parameters import rod_parameters
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import run_rod

ROD = RodOptions()


def _straight(n=51):
    return np.column_stack([np.linspace(-225.0, 225.0, n), np.zeros(n), np.full(n, 300.0)])


def _bending(vertices):
    balance = force_balance(vertices, ROD, None)
    return np.concatenate(
        [np.ravel(value) for value in vars(balance).values() if isinstance(value, np.ndarray)]
    )


def _placed(**changes):
    return lambda: word_for(lambda: place_rod(ROD, StartOptions(**changes)))


def _ran(vertices, **changes):
    stepping = SteppingOptions(duration_us=0.01, sample_us=0.01, **changes)
    return word_for(lambda: run_rod(ROD, stepping, vertices, None).positions_nm[-1])


def _turned_dyes():
    line = _straight()
    line[:, 1] = 20.0 * np.sin(line[:, 0] / 100.0)
    cosine, sine = np.cos(1.0), np.sin(1.0)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return digits(
        dye_centres_nm(line @ turn.T, 450.0, (40.0, 20.0)),
        dye_centres_nm(line, 450.0, (40.0, 20.0)) @ turn.T,
    )


SUBJECTS = (
    Subject(
        "simulate.rod.balance.force_balance",
        force_balance,
        own={
            "a straight rod": lambda: digits(_bending(_straight())[:153], np.zeros(153), 1.0),
            "a rod of two points": lambda: word_for(lambda: _bending(_straight(2))),
            "all at one place": lambda: word_for(lambda: _bending(np.zeros((51, 3)))),
            "a nan": lambda: word_for(
                lambda: _bending(np.where(np.arange(153).reshape(51, 3) == 9, np.nan, _straight()))
            ),
        },
    ),
    Subject(
        "simulate.rod.observe.dye_centres_nm",
        dye_centres_nm,
        own={"rotation": _turned_dyes},
    ),
    Subject(
        "simulate.rod.parameters.rod_parameters",
        rod_parameters,
        own={"the defaults": lambda: word_for(lambda: rod_parameters(ROD, None))},
    ),
    Subject(
        "simulate.rod.placement.place_rod",
        place_rod,
        own={
            "on the axis": _placed(offset_x_nm=0.0, offset_y_nm=0.0),
            "upright": _placed(tilt_deg=90.0),
            "far aside": _placed(offset_x_nm=1e5),
        },
    ),
    Subject(
        "simulate.rod.run.run_rod",
        run_rod,
        own={
            "a straight rod in no flow": lambda: _ran(_straight()),
            "all at one place": lambda: _ran(np.zeros((51, 3))),
            "a nan": lambda: _ran(np.full((51, 3), np.nan)),
            "by the paper's steps": lambda: _ran(_straight(), method="paper"),
        },
    ),
    Subject(
        "simulate.film.optics.gaussian_widths_nm",
        gaussian_widths_nm,
        own={"the defaults": lambda: word_for(lambda: gaussian_widths_nm(PsfOptions()))},
    ),
)

EXEMPT = {
    "simulate.archive.read_archive": "reads a file: tests/unit/simulate/test_archive.py",
    "simulate.archive.write_archive": "writes a file: tests/unit/simulate/test_archive.py",
    "simulate.field.solve.as_solution": "packs a solved field: tests/unit/simulate/field",
    "simulate.field.solve.field_grid": "lays a mesh: tests/unit/simulate/field",
    "simulate.field.table.tabulate": "samples a solved field: tests/unit/simulate/field",
    "simulate.ideal_examples.example_scene": "draws rotors for scenes: tests/unit/simulate",
    "simulate.rod.relative_equilibrium.find_equilibrium": "tests/unit/simulate/rod, by Newton",
    "simulate.scan.phase_diagram": "draws letters: tests/unit/simulate/test_scan.py",
    "simulate.scan.runs_table": "makes a table of rows: tests/unit/simulate/test_scan.py",
}
