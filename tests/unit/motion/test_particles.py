"""Tables of particles, and all of them together."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import ConfigurationError, InputError, LinkWarning
from rotortrack.motion.ensemble import Track, ensemble, track_msd
from rotortrack.motion.link_options import LinkOptions
from rotortrack.motion.particles import track_particles
from rotortrack.motion.readings import Timing
from rotortrack.motion.tables import PARTICLE_TRACKS, PARTICLES
from rotortrack.tables import LOCALISATIONS, empty

FAR = LinkOptions(memory_frames=8)
CLOCK = {"frame_interval_s": 0.01, "exposure_s": 0.01}


def test_tables_hold_what_their_schemas_say(swimming):
    table = swimming(np.random.default_rng(1), 10, 80, missing=0.1, box_nm=60_000.0)
    found = track_particles(table.sample(frac=1.0, random_state=0), FAR, **CLOCK)
    assert list(found.tracks) == PARTICLE_TRACKS.names
    assert list(found.particles) == PARTICLES.names
    assert dict(found.particles.dtypes.astype(str)) == PARTICLES.dtypes
    assert len(found.particles) == 10
    assert len(found.tracks) == len(table)
    per_particle = found.tracks.groupby("particle")["frame"]
    assert per_particle.apply(lambda f: (np.diff(f) > 0).all()).all()
    assert found.particles["n_frames"].tolist() == per_particle.size().tolist()
    span = found.particles["last_frame"] - found.particles["first_frame"] + 1
    missing = span - found.particles["n_frames"]
    assert found.particles["missing_frames"].tolist() == missing.tolist()


def test_particles_that_were_seen_too_briefly_are_counted_and_left_out(swimming):
    table = swimming(np.random.default_rng(2), 6, 60, box_nm=100_000.0)
    brief = table[(table["truth"] > 0) | (table["frame"] < 5)]
    found = track_particles(brief, LinkOptions(min_frames=6), **CLOCK)
    assert (len(found.particles), found.short) == (5, 1)


def test_spots_without_a_position_are_left_out_and_counted(swimming):
    table = swimming(np.random.default_rng(3), 3, 60, box_nm=60_000.0)
    table.loc[table.index[::20], "x_nm"] = np.nan
    found = track_particles(table, LinkOptions(), **CLOCK)
    assert found.unplaced == 9
    assert len(found.particles) == 3


@pytest.mark.parametrize("known", ["none", "uncertainty", "some"])
def test_errors_of_the_fit_may_be_absent(swimming, known):
    table = swimming(np.random.default_rng(4), 12, 200, box_nm=60_000.0)
    if known == "some":
        table.loc[::2, "x_sd_nm"] = np.nan
    else:
        table = table.drop(columns=["x_sd_nm", "y_sd_nm"])
    if known == "uncertainty":
        table["uncertainty_nm"] = 25.0
    found = track_particles(table, LinkOptions(), **CLOCK).particles
    assert found["diffusion_um2_s"].mean() == pytest.approx(0.1, rel=0.12)
    assert found["localisation_sd_nm"].mean() == pytest.approx(20.0, rel=0.2)


def test_a_spot_that_never_moves_by_a_hair_does_no_harm(swimming):
    table = swimming(np.random.default_rng(5), 2, 60, box_nm=60_000.0)
    table.loc[table["truth"] == 0, ["x_nm", "y_nm"]] = (-9e4, -9e4)
    found = track_particles(table, LinkOptions(search_range_nm=300.0), **CLOCK)
    assert len(found.particles) == 2
    assert found.particles["directed_p"].between(0, 1).all()


def test_tables_that_are_hardly_tables_of_particles_do_no_harm(swimming):
    table = swimming(np.random.default_rng(12), 4, 40, box_nm=60_000.0)
    twice = pd.concat([table, table])
    assert len(track_particles(twice, FAR, **CLOCK).particles) == 8
    fixed = table.assign(x_nm=0.0, y_nm=1e4 * table["truth"])
    found = track_particles(fixed, FAR, **CLOCK)
    assert len(found.particles) == 4
    assert found.ensemble.diffusion_nm2_s == 0.0
    absurd = table.assign(x_sd_nm=np.inf, y_sd_nm=1e-30)
    assert np.isfinite(track_particles(absurd, FAR, **CLOCK).particles["diffusion_um2_s"]).all()
    with pytest.raises(InputError, match="which no microscope sees"):
        track_particles(table.assign(x_nm=1e200), FAR, **CLOCK)


def test_no_spots_give_empty_tables():
    found = track_particles(empty(LOCALISATIONS), LinkOptions(), **CLOCK)
    assert len(found.tracks) == len(found.particles) == found.ensemble.n_particles == 0
    assert list(found.particles) == PARTICLES.names


def test_what_cannot_be_linked_is_refused_with_a_remedy(swimming):
    table = swimming(np.random.default_rng(6), 1, 10)
    with pytest.raises(ConfigurationError, match="give --search-range-nm"):
        track_particles(table, LinkOptions(), **CLOCK)
    with pytest.raises(InputError, match="2 channels"):
        track_particles(table.assign(channel=table["frame"] % 2), LinkOptions(), **CLOCK)
    with pytest.raises(ConfigurationError, match="longer than frame_interval_s"):
        track_particles(table, LinkOptions(), frame_interval_s=0.01, exposure_s=0.02)


def test_a_crowd_is_told(swimming):
    crowd = swimming(np.random.default_rng(7), 120, 30, diffusion_um2_s=4.0, box_nm=8_000.0)
    with (
        pytest.warns(LinkWarning, match="less far"),
        pytest.warns(LinkWarning, match="film faster"),
    ):
        track_particles(crowd, LinkOptions(), **CLOCK)


def tracks_of(table):
    return [
        Track(part["frame"].to_numpy(), part[["x_nm", "y_nm"]].to_numpy(), None)
        for _, part in table.groupby("truth")
    ]


def test_a_flow_is_found_and_leaves_diffusion_and_exponent_alone(swimming):
    table = swimming(np.random.default_rng(8), 80, 150, flow_nm_s=(2000.0, -1000.0))
    found = ensemble(tracks_of(table), Timing(0.01, 0.01))
    z = np.subtract(found.flow_nm_s, (2000.0, -1000.0)) / found.flow_sd_nm_s
    assert np.abs(z).max() < 3.5
    assert found.diffusion_nm2_s == pytest.approx(1e5, abs=4 * found.diffusion_sd_nm2_s)
    assert found.alpha == pytest.approx(1.0, abs=4 * found.alpha_sd)
    assert found.localisation_sd_nm == pytest.approx(20.0, rel=0.1)


def test_errors_of_the_ensemble_are_those_of_its_scatter(swimming):
    found = []
    for seed in range(60):
        diffusion = np.random.default_rng(1000 + seed).lognormal(np.log(0.1), 0.5, 40)
        table = swimming(np.random.default_rng(seed), 40, 40, diffusion_um2_s=diffusion)
        found.append(ensemble(tracks_of(table), Timing(0.01, 0.01)))
    for value, told in (
        ([e.diffusion_nm2_s for e in found], [e.diffusion_sd_nm2_s for e in found]),
        ([e.alpha for e in found], [e.alpha_sd for e in found]),
        (
            [e.msd["xy_msd_nm2"][5] for e in found],
            [e.msd["xy_msd_sd_nm2"][5] for e in found],
        ),
    ):
        assert np.sqrt(np.mean(np.square(told))) == pytest.approx(np.std(value), rel=0.3)


def test_confined_particles_have_a_lower_exponent():
    rng = np.random.default_rng(9)
    place = np.zeros((60, 200, 2))
    for k in range(1, 200):
        place[:, k] = 0.75 * place[:, k - 1] + rng.normal(0, 50, (60, 2))
    tracks = [Track(np.arange(50, 200), p[50:], None) for p in place]
    assert ensemble(tracks, Timing(0.01, 0.0)).alpha < 0.8


def test_a_single_particle_has_errors_too(swimming):
    found = ensemble(tracks_of(swimming(np.random.default_rng(10), 1, 500)), Timing(0.01, 0.01))
    assert 0.0 < found.diffusion_sd_nm2_s < 0.3 * found.diffusion_nm2_s


def test_mean_square_displacement_is_that_of_all_pairs_of_frames():
    rng = np.random.default_rng(11)
    frame = np.flatnonzero(rng.random(60) > 0.3)
    place = np.cumsum(rng.normal(0, 1, (frame.size, 2)), axis=0)
    lags = np.array([1, 3, 7, 80])
    values, pairs = track_msd(Track(frame, place, None), lags)
    for lag, value, n in zip(lags, values, pairs, strict=True):
        i, j = np.nonzero(frame[None, :] - frame[:, None] == lag)
        assert n == i.size
        expected = ((place[j] - place[i]) ** 2).sum(axis=1)
        assert np.isnan(value) if i.size == 0 else value == pytest.approx(expected.mean())
