"""Spots beside each other are as precise as the bound of their joint model allows."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

_path = Path(__file__).parents[1] / "unit" / "localise" / "overlaps.py"
_spec = importlib.util.spec_from_file_location("overlap_helpers", _path)
overlaps = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(overlaps)


@pytest.mark.parametrize(("separation_px", "pull_alone"), [(4.0, 10.0), (5.0, 1.8), (6.0, 1.03)])
def test_neighbours_no_longer_pull_each_other(separation_px, pull_alone):
    rng = np.random.default_rng(1)
    n = 1500
    x, y, light = overlaps.some_pairs(rng, n, separation_px, (1000.0, 1000.0))
    frames = overlaps.noisy(rng, overlaps.expected_frames(x, y, light))
    pixels = np.rint(np.stack([y, x], axis=2)).astype(np.int32) + overlaps.MIDDLE
    candidates = np.array(
        [(k, *pixel) for k in range(n) for pixel in sorted(map(tuple, pixels[k]))], np.int32
    )
    results, _, joint = overlaps.resolved(frames, candidates)
    truth = np.stack([x, y], axis=2)

    def pull(values):
        place = values[:2].T + candidates[:, :0:-1] - overlaps.MIDDLE
        delta = place[:, None] - truth[candidates[:, 0]]
        nearest = np.square(delta).sum(axis=2).argmin(axis=1)
        errors = delta[np.arange(len(candidates)), nearest]
        # A fit that went astray must not hide what the others do.
        ratio = errors / values[5:7].T
        return overlaps.rms(np.clip(ratio[np.isfinite(ratio)], -20, 20))

    own = np.searchsorted(joint.owners, np.arange(len(candidates)))
    assert np.mean(joint.flags[own] & 15 == 0) > 0.99
    assert pull(results) >= pull_alone
    assert 0.95 <= pull(joint.results[:, own]) <= 1.06
