"""Mean-square displacements and links, against trackpy's own functions on tables."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from rotortrack.motion.ensemble import Track, ensemble, track_msd
from rotortrack.motion.estimate import NOT_ESTIMATED
from rotortrack.motion.link import link
from rotortrack.motion.msd import msd
from rotortrack.motion.msd_table import ALL_ROTORS, common_lags, msd_table, rotor_msd
from rotortrack.motion.readings import Circle, Timing
from rotortrack.motion.tracks import Track as RotorTrack

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


def test_the_table_of_rotors_is_that_of_imsd_and_emsd(swimming, trackpy):
    table = swimming(np.random.default_rng(4), 6, 300)
    nothing = np.full(300, np.nan)
    tracks = {
        number: RotorTrack(
            part["frame"].to_numpy("int64"), nothing, part["x_nm"].to_numpy(),
            part["y_nm"].to_numpy(), nothing, nothing, Circle(0.0, 0.0, 40.0),
        )
        for number, part in table.groupby("truth")
    }  # fmt: skip
    lags = common_lags(tracks.values())
    angle = msd(np.arange(300.0) ** 2)
    times = {"frame_interval_s": INTERVAL_S, "exposure_s": INTERVAL_S}
    found = {n: rotor_msd(t, angle, NOT_ESTIMATED, lags, **times) for n, t in tracks.items()}
    ours = msd_table(found, frame_interval_s=INTERVAL_S)
    each = trackpy.imsd(as_trackpy(table), MICRONS, 1 / INTERVAL_S, max_lagtime=150)
    mean = trackpy.emsd(as_trackpy(table), MICRONS, 1 / INTERVAL_S, max_lagtime=150)
    assert lags.max() == 149
    for number, rows in ours.groupby("rotor"):
        theirs = (mean if number == ALL_ROTORS else each[number]).to_numpy()[lags - 1]
        assert rows["lag_s"].to_numpy() == pytest.approx(lags * INTERVAL_S, rel=1e-12)
        assert rows["xy_msd_nm2"].to_numpy() * MICRONS**2 == pytest.approx(theirs, rel=1e-8)


@pytest.mark.parametrize("memory", [0, 2])
def test_links_are_those_of_trackpys_tables(swimming, trackpy, memory):
    table = swimming(np.random.default_rng(3), 60, 60, missing=0.1, box_nm=12_000.0)
    frame, x, y = (table[name].to_numpy() for name in ("frame", "x_nm", "y_nm"))
    ours = link(frame, x, y, search_range_nm=250.0, memory_frames=memory).particle
    whole = as_trackpy(table).drop(columns="particle").assign(row=np.arange(len(table)))
    theirs = trackpy.link(whole, 250.0, memory=memory).sort_values("row")["particle"].to_numpy()
    pairs = len(set(zip(ours, theirs, strict=True)))
    assert pairs == len(set(ours)) == len(set(theirs))
