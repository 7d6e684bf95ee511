"""Fixtures shared by all tests."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

# As the command line has it, and before numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas as pd
import pytest
from hypothesis import settings

# The same examples in every run, and no limit on their time.
settings.register_profile("seeded", derandomize=True, deadline=None)
settings.load_profile("seeded")

# A shell that starts the suite in its background has it ignore Ctrl-C, and all that it starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def reference_data() -> Callable[[str], Path]:
    """Give the folder of a reference data set, or skip where it is absent."""
    root = Path(
        os.environ.get("ROTORTRACK_REFERENCE_DATA") or Path(__file__).parents[2] / "shared" / "data"
    )

    def folder(name: str) -> Path:
        if not (root / name).is_dir():
            pytest.skip(f"the reference data set {name} is not on this machine")
        return root / name

    return folder


@pytest.fixture
def modes_obeyed() -> Iterator[None]:
    """Let file modes bind this thread and the processes it starts, even as root.

    Giving root another user id instead would take from it the interpreter in its own home.
    """
    if not hasattr(os, "geteuid"):
        pytest.skip("modes exist on POSIX only")
    if os.geteuid() != 0:
        yield
        return
    if sys.platform != "linux":
        pytest.skip("root may write everywhere")
    libc = ctypes.CDLL(None)
    get_secure_bits, set_secure_bits, root_is_nobody = 27, 28, 1
    read_and_write_anything = 0b110
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    powers = (ctypes.c_uint32 * 6)()
    assert libc.capget(header, powers) == 0
    bits, effective = libc.prctl(get_secure_bits), powers[0]
    if libc.prctl(set_secure_bits, bits | root_is_nobody) != 0:
        pytest.skip("root may write everywhere and may not change that")
    powers[0] = effective & ~read_and_write_anything
    assert libc.capset(header, powers) == 0
    try:
        yield
    finally:
        powers[0] = effective
        assert libc.capset(header, powers) == 0
        assert libc.prctl(set_secure_bits, bits) == 0


@pytest.fixture
def swimming() -> Callable[..., pd.DataFrame]:
    """Give `simulate(rng, particles, frames, ...)` -> localisations with the column `truth`."""

    def simulate(
        rng: np.random.Generator,
        particles: int,
        frames: int,
        *,
        diffusion_um2_s: float | np.ndarray = 0.1,
        noise_nm: float = 20.0,
        interval_s: float = 0.01,
        exposed: float = 1.0,
        missing: float = 0.0,
        box_nm: float = 20_000.0,
        flow_nm_s: tuple[float, float] = (0.0, 0.0),
    ) -> pd.DataFrame:
        parts = 16
        spread = np.sqrt(2e6 * np.broadcast_to(diffusion_um2_s, (particles,)) * interval_s / parts)
        steps = rng.normal(size=(particles, frames * parts, 2)) * spread[:, None, None]
        steps += np.array(flow_nm_s) * interval_s / parts
        path = np.cumsum(steps, axis=1) + rng.uniform(0.0, box_nm, (particles, 1, 2))
        seen = max(round(parts * exposed), 1)
        place = path.reshape(particles, frames, parts, 2)[:, :, :seen].mean(axis=2)
        place = place + rng.normal(0.0, noise_nm, place.shape)
        number, frame = np.nonzero(rng.random((particles, frames)) >= missing)
        x, y = place[number, frame].T
        sd = np.full(frame.size, noise_nm)
        table = {"frame": frame, "x_nm": x, "y_nm": y, "x_sd_nm": sd, "y_sd_nm": sd}
        return pd.DataFrame({**table, "truth": number})

    return simulate
