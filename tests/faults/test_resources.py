"""Too little memory, too few open files: exit 7, one sentence, nothing left behind."""

from __future__ import annotations

import os
import subprocess
import sys
from errno import EMFILE
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from rotortrack_cli.exits import Exit

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="the limits are set with /proc"
)

OPTIONS = ["--pixel-size-nm=100", "--offset-adu=0", "--gain-e-per-adu=1", "--read-noise-e=1"]
OPTIONS += ["--frame-interval-s=0.01", "--exposure-s=0.01", "-q"]

# Libraries and compiled code are loaded before there is too little for them.
SCRIPT = """
import os, resource, sys
from pathlib import Path
from rotortrack_cli.main import main

folder, options = Path(sys.argv[1]), sys.argv[2:]

def localise(name, workers):
    files = ["localise", folder / name, "-o", folder / f"{name}.parquet", "--workers", workers]
    print(main([*map(str, files), *options]))

def allow(what, most):
    resource.setrlimit(what, (most, resource.getrlimit(what)[1]))

localise("small.tif", 1)
"""

MEMORY = """
for room_mb, workers in [(10, 1), (20, 1), (20, 2)]:
    for name in ("plain.tif", "zlib.tif"):
        status = Path("/proc/self/status").read_text()
        in_use = int(status.split("VmSize:")[1].split()[0]) * 1024
        allow(resource.RLIMIT_AS, in_use + room_mb * 1_000_000)
        localise(name, workers)
        allow(resource.RLIMIT_AS, resource.RLIM_INFINITY)
localise("small.tif", 2)
"""

FILES = """
in_use = max(int(name) for name in os.listdir("/proc/self/fd"))
for room in range(1, 3):
    allow(resource.RLIMIT_NOFILE, in_use + room)
    localise("small.tif", 1)
allow(resource.RLIMIT_NOFILE, in_use + 100)
localise("small.tif", 1)
"""


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with a small movie and large ones."""
    folder = tmp_path_factory.mktemp("films")
    # Large enough for the kernels that large frames use.
    bead = np.full((4, 64, 64), 100, np.uint16)
    bead[:, 10:13, 10:13] += 300
    grey: dict[str, Any] = {"photometric": "minisblack"}
    tifffile.imwrite(folder / "small.tif", bead, **grey)
    large = np.full((2, 4000, 4000), 100, np.uint16)
    tifffile.imwrite(folder / "plain.tif", large, **grey)
    tifffile.imwrite(folder / "zlib.tif", large, compression="zlib", **grey)
    return folder


def run(code: str, films: Path) -> tuple[list[int], list[str]]:
    """Run a script; give the exit codes and the lines of stderr."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT + code, str(films), *OPTIONS],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [int(line) for line in done.stdout.splitlines() if line.isdigit()], (
        done.stderr.splitlines()
    )


def test_too_little_memory_for_a_frame(films: Path) -> None:
    """A frame is 32 MB."""
    codes, lines = run(MEMORY, films)
    assert codes == [Exit.DONE, *[Exit.RESOURCES] * 6, Exit.DONE]
    assert len(lines) == 6
    assert all(line.startswith("rotortrack: ") and "--workers" in line for line in lines)
    left = {path.name for path in films.iterdir()}
    assert left == {"small.tif", "plain.tif", "zlib.tif", "small.tif.parquet"}


def test_too_few_open_files(films: Path) -> None:
    codes, lines = run(FILES, films)
    assert codes == [Exit.DONE, *[Exit.RESOURCES] * 2, Exit.DONE]
    assert len(lines) == 2
    assert all(os.strerror(EMFILE) in line and "ulimit -n" in line for line in lines)
