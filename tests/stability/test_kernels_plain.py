"""Compiled kernels give what their plain Python gives, on the input that routines hand them.

Every kernel that a routine calls from Python is called twice: compiled, and as the function that
it was made of, on a copy of the same arguments. Kernels that others alone call run inside those.
"""

from __future__ import annotations

import copy
import importlib
import pkgutil
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

sys.path.insert(0, str(Path(__file__).parent))
from subjects import motion, rotors, twocolour

from rotortrack.corrections.density import neighbour_counts
from rotortrack.rotors.cluster import cluster

FOLDERS = ("corrections", "motion", "rotors", "twocolour")


def entry_kernels():
    """Give modules and names of the kernels of some folders."""
    found = []
    for folder in FOLDERS:
        package = importlib.import_module(f"rotortrack.{folder}")
        for info in pkgutil.walk_packages(package.__path__, f"rotortrack.{folder}."):
            module = importlib.import_module(info.name)
            found += [
                (module, name)
                for name, value in vars(module).items()
                if isinstance(value, CPUDispatcher)
            ]
    return found


class Twice:
    """A kernel that is called compiled and plain, and compared."""

    def __init__(self, kernel, called):
        self.kernel, self.called = kernel, called

    def __call__(self, *arguments):
        plain = copy.deepcopy(arguments)
        answer = self.kernel(*arguments)
        with np.errstate(all="ignore"):
            expected = self.kernel.py_func(*plain)
        self.called.add(self.kernel.py_func.__name__)
        for got, wanted in zip((answer, *arguments), (expected, *plain), strict=True):
            same(got, wanted)
        return answer


def same(got, wanted):
    if isinstance(wanted, tuple):
        for one, other in zip(got, wanted, strict=True):
            same(one, other)
    elif isinstance(wanted, np.ndarray | float | int | np.generic):
        # Multiply-add in one step may round otherwise than in two.
        size = float(np.nanmax(np.abs(np.nan_to_num(wanted)), initial=0.0))
        np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-13 * size)


@pytest.fixture
def both(monkeypatch):
    """Return what runs a routine by both, and gives the names of the kernels that it called."""

    def run(routine):
        # Callers of a kernel are compiled with the kernel itself, before its name is taken over.
        routine()
        called: set[str] = set()
        for module, name in entry_kernels():
            monkeypatch.setattr(module, name, Twice(getattr(module, name), called))
        routine()
        return called

    return run


def _hard(part):
    """Good rows with duplicates, a far one, and tiny ones among them."""
    made = part[:60].astype(float)
    made[7] = made[8]
    made[11] *= 1e5
    made[13] *= 1e-300
    return made


def test_lengths(both):
    def routine():
        twocolour.log_density(twocolour.LENGTHS[:60], twocolour.NOISE[:60], 60.0, 8.0)
        twocolour.log_density(_hard(twocolour.LENGTHS), twocolour.NOISE[:60], 60.0, 1e-9)

    assert "fill_log_densities" in both(routine)


def test_neighbours_and_clusters(both):
    def routine():
        neighbour_counts(_hard(rotors.X), _hard(rotors.Y), 50.0)
        cluster(_hard(rotors.X), _hard(rotors.Y), 50.0)

    assert {"_count_in_bands", "join_cells"} <= both(routine)


@pytest.mark.parametrize(
    ("method", "kernel"), [("increments", "whitened_sums"), ("circular", "filter_densities")]
)
def test_motion(both, method, kernel):
    frame = np.delete(np.arange(40), [5, 6, 20])

    def routine():
        x, y, sd = motion.X[frame], motion.Y[frame], 3.0 * motion.SD[frame]
        motion._estimate(frame, x, y, sd, method)

    assert kernel in both(routine)


def test_every_entry_kernel_of_these_folders_is_known():
    names = {name for _, name in entry_kernels()}
    assert {"fill_log_densities", "whitened_sums", "filter_densities", "join_cells"} <= names
