"""A start of the command imports, and compiles, no more than its work needs."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

HEAVY = {
    *("matplotlib", "pandas", "pydantic", "rich", "skimage", "trackpy"),
    # numba asks scipy for its version; the parts with code in them take a while.
    *("scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.special", "scipy.stats"),
    *("numpy.testing", "numba.np.linalg", "pyarrow.compute"),
}

WATCHED = """
import json, sys
from numba.core import event
from rotortrack_cli.main import main
with event.install_recorder("numba:compile") as recorder:
    code = main(sys.argv[1:])
compiled = {str(happened.data["dispatcher"]) for _, happened in recorder.buffer}
print(json.dumps({"code": code, "compiled": sorted(compiled), "modules": sorted(sys.modules)}))
"""


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("startup") / "movie.tif"
    frames = np.random.default_rng(0).poisson(50.0, (8, 32, 40))
    frames[:, 14:17, 19:22] += 200
    tifffile.imwrite(path, frames.astype(np.uint16), photometric="minisblack")
    return path


@pytest.fixture(scope="module")
def second(movie: Path) -> dict[str, Any]:
    """Localise in two processes, and give what happened in the second one."""
    output = movie.with_name("spots.parquet")
    camera = "--pixel-size-nm 100 --offset-adu 10 --gain-e-per-adu 0.5 --read-noise-e 1.5"
    arguments = ["localise", str(movie), "-o", str(output), *camera.split(), "--quiet"]
    outcome: dict[str, Any] = {}
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", WATCHED, *arguments], capture_output=True, text=True, check=True
        )
        outcome = json.loads(done.stdout.splitlines()[-1])
        assert outcome["code"] == 0
    return outcome


def test_a_second_process_compiles_no_kernel(second: dict[str, Any]) -> None:
    assert second["compiled"] == []


def test_localising_loads_nothing_that_it_does_not_use(second: dict[str, Any]) -> None:
    assert {"numba", "pyarrow.parquet", "tifffile"} <= set(second["modules"])
    assert set(second["modules"]) & HEAVY == set()
    for package in ("rotors", "corrections", "motion", "simulate", "report"):
        inside = {name for name in second["modules"] if name.startswith(f"rotortrack.{package}.")}
        assert {name for name in inside if not name.endswith("options")} == set()


def test_a_host_program_keeps_its_own_collection_of_garbage(call: Callable[..., Any]) -> None:
    before = gc.get_threshold(), gc.get_freeze_count()
    assert call("--version").code == 0
    assert (gc.get_threshold(), gc.get_freeze_count()) == before


@pytest.mark.parametrize(("asked", "had"), [(None, "1"), ("3", "3")])
def test_blas_has_one_thread_unless_the_user_wants_more(asked: str | None, had: str) -> None:
    name = "OPENBLAS_NUM_THREADS"
    environment = {key: value for key, value in os.environ.items() if key != name}
    if asked:
        environment[name] = asked
    script = (
        f"import os, sys, rotortrack_cli.main\nprint('numpy' in sys.modules, os.environ['{name}'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment
    )
    # Once numpy is loaded it would be too late.
    assert done.stdout.split() == ["False", had]
