"""Mean-square displacements and links, against trackpy's own functions on tables."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from rotortrack.motion.ensemble import Track, ensemble, track_msd
from rotortrack.motion.link import link
from rotortrack.motion.readings import Timing

INTERVAL_S = 0.01
MICRONS = 1e-3


@pytest.fixture
def trackpy():
    """Give trackpy, which sorts tables in a way that pandas 3 has begun to refuse."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=r"trackpy\.")
        import trackpy

        trackpy.quiet()
        yield trackpy


def as_trackpy(table):
    renamed = {"x_nm": "x", "y_nm": "y", "truth": "particle"}
    return table.rename(columns=renamed)[["frame", "x", "y", "particle"]]


def track(part):
    return Track(part["frame"].to_numpy(), part[["x_nm", "y_nm"]].to_numpy(), None)


def test_the_ensemble_is_that_of_emsd_for_tracks_of_one_length(swimming, trackpy):
    table = swimming(np.random.default_rng(1), 25, 120)
    ours = ensemble([track(p) for _, p in table.groupby("truth")], Timing(INTERVAL_S, 0.01)).msd
    theirs = trackpy.emsd(as_trackpy(table), MICRONS, 1 / INTERVAL_S, max_lagtime=60)
    expected = np.interp(ours["lag_s"], theirs.index.to_numpy(), theirs.to_numpy())
    assert ours["xy_msd_nm2"].to_numpy() * MICRONS**2 == pytest.approx(expected, rel=1e-9)


def test_single_particles_are_those_of_imsd_gaps_included(swimming, trackpy):
    table = swimming(np.random.default_rng(2), 5, 150, missing=0.2)
    theirs = trackpy.imsd(as_trackpy(table), MICRONS, 1 / INTERVAL_S, max_lagtime=40)
    for number, part in table.groupby("truth"):
        values, _ = track_msd(track(part), np.arange(1, 41))
        expected = theirs[number].to_numpy()
        assert values * MICRONS**2 == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("memory", [0, 2])
def test_links_are_those_of_trackpys_tables(swimming, trackpy, memory):
    table = swimming(np.random.default_rng(3), 60, 60, missing=0.1, box_nm=12_000.0)
    frame, x, y = (table[name].to_numpy() for name in ("frame", "x_nm", "y_nm"))
    ours = link(frame, x, y, search_range_nm=250.0, memory_frames=memory).particle
    whole = as_trackpy(table).drop(columns="particle").assign(row=np.arange(len(table)))
    theirs = trackpy.link(whole, 250.0, memory=memory).sort_values("row")["particle"].to_numpy()
    pairs = len(set(zip(ours, theirs, strict=True)))
    assert pairs == len(set(ours)) == len(set(theirs))
