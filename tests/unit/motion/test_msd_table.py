from types import SimpleNamespace

import numpy as np
import pytest

from rotortrack.motion.estimate import NOT_ESTIMATED
from rotortrack.motion.msd import msd
from rotortrack.motion.msd_table import ALL_ROTORS, common_lags, msd_table, rotor_msd
from rotortrack.motion.readings import Circle
from rotortrack.motion.tracks import Track

FRAME_S = 0.002
RADIUS_NM = 40.0
TIMES = {"frame_interval_s": FRAME_S, "exposure_s": 0.0}


def turning(rng, n, speed, diffusion, sigma, missing=0.0):
    path = np.cumsum(rng.normal(speed * FRAME_S, np.sqrt(2 * diffusion * FRAME_S), n))
    angle = path + rng.normal(0, sigma, n)
    angle[1:-1][rng.random(n - 2) < missing] = np.nan
    frame = np.flatnonzero(np.isfinite(angle))
    theta = angle[frame]
    x, y = RADIUS_NM * np.cos(theta), -RADIUS_NM * np.sin(theta)
    nothing = np.full(frame.size, np.nan)
    return Track(frame, theta, x, y, nothing, nothing, Circle(0.0, 0.0, RADIUS_NM)), msd(angle)


def known(speed, diffusion, sigma):
    fit = SimpleNamespace(omega_rad_s=speed, diffusion_rad2_s=diffusion)
    return SimpleNamespace(fit=fit, noise_sd_rad=sigma)


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_standard_deviations_are_those_of_many_like_rotors(missing):
    rng = np.random.default_rng(1)
    motion = (20.0, 8.0, 0.1)
    made = [turning(rng, 400, *motion, missing) for _ in range(150)]
    lags = common_lags(track for track, _ in made)
    found = {k: rotor_msd(*one, known(*motion), lags, **TIMES) for k, one in enumerate(made)}
    table = msd_table(found, frame_interval_s=FRAME_S)
    each = table[table["rotor"] != ALL_ROTORS].groupby("lag_s").mean()
    whole = table[table["rotor"] == ALL_ROTORS].set_index("lag_s")
    for value in ("angle_msd_sd_rad2", "xy_msd_sd_nm2"):
        told = each[value].to_numpy()[::6]
        assert whole[value].to_numpy()[::6] * np.sqrt(150) == pytest.approx(told, rel=0.3)
    lag = whole.index.to_numpy()
    expected = (20.0 * lag) ** 2 + 2 * 8.0 * lag + 2 * 0.1**2
    pull = (whole["angle_msd_rad2"] - expected) / whole["angle_msd_sd_rad2"]
    assert np.abs(pull).max() < 4
    assert (each["n_independent"] <= each["n_pairs"]).all()


def test_a_short_track_has_the_first_lags_of_the_common_grid():
    rng = np.random.default_rng(2)
    made = {4: turning(rng, 5000, 5.0, 2.0, 0.1), 7: turning(rng, 90, 5.0, 2.0, 0.1)}
    lags = common_lags(track for track, _ in made.values())
    assert lags.size <= 100
    assert lags[-1] == 2499
    found = {k: rotor_msd(*one, NOT_ESTIMATED, lags, **TIMES) for k, one in made.items()}
    table = msd_table(found, frame_interval_s=FRAME_S)
    assert table["rotor"].unique().tolist() == [ALL_ROTORS, 4, 7]
    short = table[table["rotor"] == 7]
    assert short["lag_s"].max() <= 44 * FRAME_S
    assert short["lag_s"].tolist() == table[table["rotor"] == 4]["lag_s"].tolist()[: len(short)]
    assert short["angle_msd_sd_rad2"].isna().all()
    whole = table[table["rotor"] == ALL_ROTORS]
    assert whole["n_independent"].tolist() == [2] * len(short) + [1] * (len(lags) - len(short))


def test_no_rotors_make_an_empty_table():
    assert len(msd_table({}, frame_interval_s=FRAME_S)) == 0
    assert common_lags([]).tolist() == [1]
