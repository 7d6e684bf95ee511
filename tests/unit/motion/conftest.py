"""A turning angle simulated frame by frame, shared by the tests of motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

FRAME_S = 0.002


@pytest.fixture
def turning() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Give `simulate(rng, n, omega, diffusion, sigma, missing)` -> frames, angles."""

    def simulate(rng, n, *, omega=0.0, diffusion=0.0, sigma=0.0, missing=0.0, part_exposed=1.0):
        parts = 16
        pace = FRAME_S / parts
        path = np.cumsum(rng.normal(omega * pace, np.sqrt(2 * diffusion * pace), n * parts))
        exposed = path.reshape(n, parts)[:, : round(parts * part_exposed)].mean(axis=1)
        theta = np.angle(np.exp(1j * (exposed + rng.normal(0.0, sigma, n))))
        seen = rng.random(n) >= missing
        return np.flatnonzero(seen), theta[seen]

    return simulate
