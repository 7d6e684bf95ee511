import warnings

import numpy as np
import pandas as pd
import pytest

from rotortrack.corrections.drift.cross_correlation import estimate_drift
from rotortrack.corrections.drift.drift import apply_drift
from rotortrack.corrections.options import DriftOptions
from rotortrack.errors import ConfigurationError, DriftWarning, TableError

ALWAYS = DriftOptions(min_significance=0.0)
PIXEL_NM = 108.3


def rotors(rng, n=24, frames=2000, drift_nm=0.0, rate=60.0, diffusion=20.0, sd_nm=15.0):
    """Rings of turning spots on a loose lattice; rate in rad/s at 500 frames/s, one sense."""
    side = int(np.ceil(np.sqrt(n)))
    centre = np.column_stack([np.arange(n) % side, np.arange(n) // side]) * 1500.0 + 1000.0
    centre += rng.normal(0, 100, centre.shape)
    step = rng.normal(rate / 500, np.sqrt(2 * diffusion / 500), (frames, n))
    theta = rng.uniform(0, 2 * np.pi, n) + np.cumsum(step, axis=0)
    radius = rng.uniform(60, 180, n)
    drift = np.broadcast_to(np.asarray(drift_nm, dtype=float), (frames, 2))
    table = pd.DataFrame(
        {
            "frame": np.repeat(np.arange(frames), n),
            "x_nm": (centre[:, 0] + radius * np.cos(theta) + drift[:, :1]).ravel(),
            "y_nm": (centre[:, 1] + radius * np.sin(theta) + drift[:, 1:]).ravel(),
        }
    )
    table[["x_nm", "y_nm"]] += rng.normal(0, sd_nm, (len(table), 2))
    return table


def bent_drift(frames):
    t = np.linspace(0, 1, frames)
    return np.column_stack([180 * t + 20 * np.sin(4 * t), -120 * t**2])


def errors(drift, truth):
    """Error of the curve relative to the truth at the centre of the first bin, (frames, 2)."""
    difference = drift.table[["dx_nm", "dy_nm"]].to_numpy() - truth
    first = int(drift.bin_frames[0] - drift.table["frame"].iloc[0])
    return difference - (difference[first] - drift.table[["dx_nm", "dy_nm"]].to_numpy()[first])


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def test_drift_under_turning_rotors_is_found_within_its_own_error():
    ratios = []
    for seed in range(6):
        truth = bent_drift(2000)
        drift = estimate_drift(
            rotors(np.random.default_rng(seed), drift_nm=truth),
            DriftOptions(),
            pixel_size_nm=PIXEL_NM,
        )
        assert drift.estimated
        assert rms(errors(drift, truth)) < 5.0
        ratios.append(rms(errors(drift, truth)) / rms(drift.table["sd_nm"]))
    # Honest: neither boasting nor hiding behind a wide margin.
    assert 0.4 < rms(ratios) < 1.4


def test_table_without_drift_is_altered_by_no_more_than_the_error_given():
    for seed in range(4):
        table = rotors(np.random.default_rng(seed))
        drift = estimate_drift(table, ALWAYS, pixel_size_nm=PIXEL_NM)
        change = drift.table[["dx_nm", "dy_nm"]].to_numpy()
        assert rms(change) < 2 * rms(drift.table["sd_nm"])
        assert rms(change) < 5.0


def test_what_is_not_clear_of_its_error_is_not_subtracted():
    # Nine slow rotors and no drift: each sits on its own part of its circle in each bin.
    table = rotors(np.random.default_rng(4), n=9, rate=2.0, diffusion=0.1)
    with pytest.warns(DriftWarning, match="nothing is subtracted"):
        drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert not drift.estimated
    pd.testing.assert_frame_equal(apply_drift(table, drift), table)
    assert rms(drift.table["sd_nm"]) > 5.0
    forced = estimate_drift(table, ALWAYS, pixel_size_nm=PIXEL_NM)
    assert forced.estimated
    assert rms(forced.table[["dx_nm", "dy_nm"]]) > 5.0


def test_rotation_is_not_absorbed():
    table = rotors(np.random.default_rng(3), n=1, frames=4000, rate=90.0, diffusion=5.0)
    with pytest.warns(DriftWarning, match="single rotor"):
        drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert drift.table["sd_nm"].isna().all()
    corrected = apply_drift(table, drift)
    for name in ("x_nm", "y_nm"):
        assert corrected[name].std() == pytest.approx(table[name].std(), rel=0.02)


def test_common_slow_rotation_shows_in_the_error():
    # Rotors that turn less than once a bin: their angles do not average out.
    slow = rotors(np.random.default_rng(4), n=9, rate=2.0, diffusion=0.1)
    fast = rotors(np.random.default_rng(4), n=9)
    sd = [
        rms(estimate_drift(t, ALWAYS, pixel_size_nm=PIXEL_NM).table["sd_nm"]) for t in (slow, fast)
    ]
    assert sd[0] > 3 * sd[1]


def test_order_of_rows_nan_rows_and_first_frame_do_not_matter():
    rng = np.random.default_rng(5)
    table = rotors(rng, n=9, frames=1000, drift_nm=bent_drift(1000))
    plain = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    late = table.sample(frac=1.0, random_state=1)
    late["frame"] += 1_000_000
    gaps = pd.DataFrame({"frame": 1_000_400, "x_nm": [np.nan, 1.0, np.inf], "y_nm": np.nan})
    other = estimate_drift(pd.concat([late, gaps]), DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert other.table["frame"].tolist() == list(range(1_000_000, 1_001_000))
    for name in ("dx_nm", "dy_nm", "sd_nm"):
        assert other.table[name].to_numpy() == pytest.approx(plain.table[name].to_numpy(), abs=1e-6)


def test_origin_of_the_field_does_not_matter():
    table = rotors(np.random.default_rng(6), n=9, frames=1000, drift_nm=bent_drift(1000))
    moved = table.assign(x_nm=table["x_nm"] - 2000 * PIXEL_NM, y_nm=table["y_nm"] + 1e4 * PIXEL_NM)
    found = [
        estimate_drift(t, DriftOptions(), pixel_size_nm=PIXEL_NM).table for t in (table, moved)
    ]
    assert found[0]["dx_nm"].to_numpy() == pytest.approx(found[1]["dx_nm"].to_numpy(), abs=0.2)


@pytest.mark.parametrize("pixel_size_nm", [65.0, 160.0, None])
def test_result_hardly_depends_on_the_pixel_size(pixel_size_nm):
    truth = bent_drift(1000)
    table = rotors(np.random.default_rng(7), frames=1000, drift_nm=truth)
    drift = estimate_drift(table, DriftOptions(), pixel_size_nm=pixel_size_nm)
    assert rms(errors(drift, truth)) < 6.0


def test_a_jump_of_many_pixels_is_followed():
    truth = np.zeros((1000, 2))
    truth[500:] = 1300.0, -700.0
    table = rotors(np.random.default_rng(8), n=16, frames=1000, drift_nm=truth)
    drift = estimate_drift(table, DriftOptions(smoothing=0.2), pixel_size_nm=PIXEL_NM)
    assert drift.bin_dx_nm[5:] == pytest.approx(np.full(5, 1300.0), abs=15)
    assert drift.bin_dy_nm[5:] == pytest.approx(np.full(5, -700.0), abs=15)
    # The curve cannot follow a jump, and says so.
    assert drift.table["sd_nm"].min() > 50


def assert_not_corrected(table, drift):
    assert not drift.estimated
    assert (drift.table[["dx_nm", "dy_nm"]] == 0).all(axis=None)
    assert drift.table["sd_nm"].isna().all()
    pd.testing.assert_frame_equal(apply_drift(table, drift), table)


@pytest.mark.parametrize("rows", [0, 1, 99])
def test_too_few_localisations_are_a_warning_and_no_correction(rows):
    table = rotors(np.random.default_rng(9), n=4, frames=25).iloc[:rows]
    with pytest.warns(DriftWarning, match=rf"{rows} localisations .* not corrected"):
        drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert_not_corrected(table, drift)


def test_rows_of_one_frame_only_are_a_warning():
    table = rotors(np.random.default_rng(10)).assign(frame=3)
    with pytest.warns(DriftWarning, match="in 1 frames are too few"):
        drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert_not_corrected(table, drift)


def test_fewer_bins_than_asked_for_are_named():
    # 320 rows: six bins of at least 50, each of them four whole frames of 16 rows, make five.
    table = rotors(np.random.default_rng(11), n=16, frames=20)
    with pytest.warns(DriftWarning, match="time bins asked for: drift is estimated from 5 bins"):
        drift = estimate_drift(
            table, DriftOptions(smoothing=1.0, min_significance=0.0), pixel_size_nm=PIXEL_NM
        )
    assert drift.bin_frames.size == 5
    assert drift.bin_localisations.tolist() == [64] * 5


def test_bins_that_hang_on_one_rotor_have_an_unknown_error():
    table = rotors(np.random.default_rng(18), n=2, frames=2000)
    right = table["x_nm"] > 1750
    # One rotor lives to frame 999, so only the other one links the late bins to the first.
    table = table[~right | (table["frame"] < 1000)]
    drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert drift.estimated
    assert np.isfinite(drift.bin_sd_nm[:3]).all()
    assert np.isnan(drift.bin_sd_nm[-3:]).all()
    assert drift.table["sd_nm"].isna().all()


def test_positions_without_structure_are_a_warning_and_no_correction():
    rng = np.random.default_rng(12)
    table = pd.DataFrame(rng.uniform(0, 8000, (30000, 2)), columns=["x_nm", "y_nm"])
    table["frame"] = rng.integers(0, 1000, len(table))
    with pytest.warns(
        DriftWarning, match="9 of 10 time bins .* does not stand out.* not corrected"
    ):
        drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert_not_corrected(table, drift)


def test_bins_without_evidence_are_left_out_and_bridged():
    truth = bent_drift(2000)
    table = rotors(np.random.default_rng(13), drift_nm=truth)
    lost = table["frame"].between(800, 1199)
    rng = np.random.default_rng(14)
    table.loc[lost, ["x_nm", "y_nm"]] = rng.uniform(0, 8000, (lost.sum(), 2))
    with pytest.warns(DriftWarning, match="2 of 10 time bins .* from the other bins"):
        drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert drift.bin_used.tolist() == [True] * 4 + [False] * 2 + [True] * 4
    assert (drift.bin_peak[1:] > 6).tolist() == drift.bin_used[1:].tolist()
    assert rms(errors(drift, truth)) < 8.0


def test_drift_out_of_the_searched_lags_is_a_warning_and_no_correction():
    # One spot that crosses its whole field between the only two bins.
    x = np.concatenate([np.full(100, 50.0), np.full(100, 50.0 + 60 * PIXEL_NM)])
    table = pd.DataFrame({"frame": np.arange(200), "x_nm": x, "y_nm": 0.0})
    with pytest.warns(DriftWarning, match="1 of 2 time bins give no drift"):
        drift = estimate_drift(table, DriftOptions(bins=2), pixel_size_nm=PIXEL_NM)
    assert_not_corrected(table, drift)


def test_window_of_fewer_than_two_bins_is_a_warning_not_a_silent_zero():
    truth = bent_drift(1000)
    table = rotors(np.random.default_rng(15), frames=1000, drift_nm=truth)
    with pytest.warns(DriftWarning, match=r"not smoothed; a smoothing of at least 0\.4 "):
        drift = estimate_drift(table, DriftOptions(bins=5), pixel_size_nm=PIXEL_NM)
    assert drift.estimated
    assert rms(errors(drift, truth)) < 10.0


def test_all_localisations_at_one_position_do_not_drift():
    table = pd.DataFrame({"frame": np.arange(2000), "x_nm": 512.3, "y_nm": 77.7})
    with pytest.warns(DriftWarning, match="single rotor"):
        drift = estimate_drift(table, DriftOptions(), pixel_size_nm=PIXEL_NM)
    assert drift.estimated
    assert drift.table[["dx_nm", "dy_nm"]].to_numpy() == pytest.approx(0.0, abs=1e-9)


def test_method_none_is_zero_without_a_warning():
    table = rotors(np.random.default_rng(16), n=2, frames=5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drift = estimate_drift(table, DriftOptions(method="none"), pixel_size_nm=PIXEL_NM)
    assert drift.method == "none"
    assert_not_corrected(table, drift)


def test_unusable_tables_and_pixel_sizes_are_errors():
    table = rotors(np.random.default_rng(17), n=2, frames=100)
    with pytest.raises(ConfigurationError, match="pixel_size_nm"):
        estimate_drift(table, DriftOptions(), pixel_size_nm=0.0)
    with pytest.raises(TableError, match="y_nm"):
        estimate_drift(table.drop(columns="y_nm"), DriftOptions(), pixel_size_nm=PIXEL_NM)
    table.loc[0, "x_nm"] = 1e300
    with pytest.raises(TableError, match=r"camera pixels.*stray rows"):
        estimate_drift(table, DriftOptions(bins=2), pixel_size_nm=PIXEL_NM)
