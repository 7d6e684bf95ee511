"""An effect that a scene does not name costs nothing, and naming one changes no other's numbers."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc

import numpy as np
import pytest

from rotortrack.simulate.field import embedded, table
from rotortrack.simulate.rod import thermal as thermal_module
from rotortrack.simulate.rod.options import (
    RodOptions,
    StartOptions,
    SteppingOptions,
    ThermalOptions,
)
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.single import simulate_rod

ROD = RodOptions()
START = StartOptions(jitter_nm=0.01, seed=3)
BRIEF = SteppingOptions(duration_us=0.05, sample_us=0.01)


def test_a_free_rod_loads_no_table_and_no_finite_elements(tmp_path):
    scene = tmp_path / "free.toml"
    scene.write_text("[rod]\n[stepping]\nduration_us = 0.05\nsample_us = 0.01\n")
    code = (
        "import sys\n"
        "from rotortrack.simulate.field.table import FieldTable\n"
        "from rotortrack_cli.main import main\n"
        "FieldTable.load = None\n"
        f"ended = main(['simulate', 'rod', {str(scene)!r}, '-o', {str(tmp_path / 'rod.npz')!r},"
        " '--no-figures', '--quiet'])\n"
        "assert ended == 0, ended\n"
        "assert not {'skfem', 'matplotlib', 'pandas'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_free_rod_takes_none_of_the_memory_of_a_field(monkeypatch):
    simulate_rod(ROD, START, BRIEF)
    stored = embedded.embedded_table()
    size = stored.nodes.nbytes
    monkeypatch.setattr(table.FieldTable, "load", None)
    tracemalloc.start()
    simulate_rod(ROD, START, BRIEF)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert size > 1_000_000
    assert peak < 0.3 * size


@pytest.mark.parametrize("jitter_nm", [0.0, 0.01])
def test_noise_is_the_same_with_and_without_field_and_jitter(monkeypatch, jitter_nm):
    drawn = []
    real = thermal_module.noise_stream

    class Watched:
        def __init__(self, thermal):
            self._stream = real(thermal)

        def standard_normal(self, shape):
            block = self._stream.standard_normal(shape)
            drawn.append(block.copy())
            return block

    monkeypatch.setattr(thermal_module, "noise_stream", Watched)
    start = StartOptions(jitter_nm=jitter_nm, seed=3)
    noise = ThermalOptions(seed=7)
    for field in (None, embedded.embedded_table()):
        simulate_rod(ROD, start, BRIEF, field, noise)
    free, docked = drawn[: len(drawn) // 2], drawn[len(drawn) // 2 :]
    assert len(free) == len(docked) > 0
    for one, other in zip(free, docked, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(
        free[0].ravel()[:30], real(noise).standard_normal(free[0].shape).ravel()[:30]
    )


def test_the_start_is_the_same_with_and_without_noise_and_field():
    placed = place_rod(ROD, START, membrane_nm=20.0)
    for field, noise in (
        (embedded.embedded_table(), None),
        (embedded.embedded_table(), ThermalOptions(seed=3)),
    ):
        run = simulate_rod(ROD, START, BRIEF, field, noise).run
        np.testing.assert_array_equal(run.positions_nm[0], placed)
