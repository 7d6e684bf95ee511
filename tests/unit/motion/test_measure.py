import warnings

import numpy as np
import pandas as pd
import pytest

from rotortrack import tables
from rotortrack.errors import AngleWarning, ConfigurationError, ExposureWarning, TableError
from rotortrack.motion.angles import unbroken_angle
from rotortrack.motion.measure import measure_motion, measure_rotor
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.tables import POSTERIOR
from rotortrack.motion.tracks import used_tracks

FRAME_S = 0.002
MEASURED = ["omega_rad_s", "omega_sd_rad_s", "speed_deg_s", "speed_ci_low_deg_s", "rev_per_s"]


def tracks_table(*rotors):
    """Tracks of rotors given as (number, frames, angles)."""
    parts = [
        pd.DataFrame(
            {
                "rotor": number,
                "frame": frame,
                "x_nm": 1.0 + 30.0 * np.cos(theta),
                "y_nm": 2.0 - 30.0 * np.sin(theta),
                "x_sd_nm": 3.0,
                "y_sd_nm": 3.0,
                "theta_rad": theta,
                "used": True,
            }
        )
        for number, frame, theta in rotors
    ]
    return pd.concat(parts, ignore_index=True)


def rotors_table(*numbers, **columns):
    table = pd.DataFrame({"rotor": numbers, "x_nm": 1.0, "y_nm": 2.0, "radius_nm": 30.0})
    return table.assign(**columns)


def measure(tracks, rotors, exposure_s=FRAME_S, **options):
    found = measure_motion(
        tracks,
        rotors,
        MotionOptions(**options),
        frame_interval_s=FRAME_S,
        exposure_s=exposure_s,
    )
    return found.rotors


def track_of(frame, theta):
    return used_tracks(tracks_table((0, frame, theta)), rotors_table(0))[0]


def measure_one(track, **options):
    return measure_rotor(
        track, MotionOptions(**options), frame_interval_s=FRAME_S, exposure_s=FRAME_S
    )


@pytest.fixture
def driven_and_stuck(turning):
    rng = np.random.default_rng(9)
    return tracks_table(
        (4, *turning(rng, 4000, omega=-20.0, diffusion=2.0, sigma=0.1)),
        (7, *turning(rng, 4000, sigma=0.1)),
        (9, *turning(rng, 4000, diffusion=10.0, sigma=0.1)),
    )


def test_every_motion_column_is_filled_consistently(driven_and_stuck):
    found = measure(driven_and_stuck, rotors_table(9, 4, 7)).set_index("rotor")
    assert found["behaviour"].to_dict() == {9: "brownian", 4: "driven_cw", 7: "stuck"}
    row = found.loc[4]
    assert abs(row["omega_rad_s"] + 20.0) < 3.5 * row["omega_sd_rad_s"] < 4.0
    assert row["speed_deg_s"] == pytest.approx(np.rad2deg(row["omega_rad_s"]))
    assert row["rev_per_s"] == pytest.approx(row["speed_deg_s"] / 360.0)
    half = 0.5 * (row["speed_ci_high_deg_s"] - row["speed_ci_low_deg_s"])
    assert half == pytest.approx(1.96 * np.rad2deg(row["omega_sd_rad_s"]), rel=0.01)
    assert row["diffusion_rad2_s"] == pytest.approx(2.0, abs=4 * row["diffusion_sd_rad2_s"])
    assert row["msd_speed_deg_s"] == pytest.approx(-row["speed_deg_s"], rel=0.1)
    assert row["msd_lag_min_s"] == FRAME_S
    assert row["msd_lag_max_s"] == pytest.approx(999 * FRAME_S)
    assert row["n_steps"] == 3999
    assert row["step_sd_rad"] == pytest.approx(np.sqrt(4 * FRAME_S * 2 / 3 + 0.02), rel=0.05)
    assert row["radius_fit_nm"] == 30.0
    # About 1 - D t / 6 - (omega t)^2 / 24 of the true radius is seen.
    assert row["radius_nm"] == pytest.approx(30.0 / (1 - 0.002 * 2 / 6 - 0.04**2 / 24), rel=2e-4)


def test_measuring_twice_corrects_the_radius_once(driven_and_stuck):
    once = measure(driven_and_stuck, rotors_table(9, 4, 7))
    pd.testing.assert_frame_equal(measure(driven_and_stuck, once), once)


def test_msd_crosses_gaps_as_fast_as_the_rotor_turns(turning):
    # 600 rad/s and every third frame missing: a gap hides 2.4 rad, more than the rule can tell.
    rng = np.random.default_rng(10)
    track = tracks_table((1, *turning(rng, 4000, omega=600.0, diffusion=5.0, missing=0.35)))
    row = measure(track, rotors_table(1)).iloc[0]
    assert row["omega_rad_s"] == pytest.approx(600.0, abs=4 * row["omega_sd_rad_s"])
    assert row["msd_speed_deg_s"] == pytest.approx(np.rad2deg(600.0), rel=0.01)


def test_bridging_gaps_that_hide_turns_is_warned_about(turning):
    rng = np.random.default_rng(11)
    track = tracks_table((1, *turning(rng, 4000, omega=600.0, diffusion=5.0, missing=0.35)))
    with pytest.warns(AngleWarning, match="use a shorter frame interval"):
        found = measure(track, rotors_table(1), gap_mode="bridge")
    # The likelihood does not bridge gaps.
    assert found["behaviour"].tolist() == ["driven_ccw"]


def test_the_radius_is_left_alone_where_the_motion_is_not_understood():
    rng = np.random.default_rng(13)
    random_angles = tracks_table((1, np.arange(500), rng.uniform(-np.pi, np.pi, 500)))
    with pytest.warns(AngleWarning):
        row = measure(random_angles, rotors_table(1)).iloc[0]
    assert row["behaviour"] == "unclassified"
    assert row["radius_nm"] == row["radius_fit_nm"] == 30.0


def test_a_toggling_rotor_is_called_so():
    rng = np.random.default_rng(12)
    for _ in range(10):
        pose = np.pi * (np.cumsum(rng.random(2000) < 0.01) % 2)
        theta = np.angle(np.exp(1j * (pose + rng.normal(0.0, 0.15, 2000))))
        found = measure(tracks_table((1, np.arange(2000), theta)), rotors_table(1))
        assert found["behaviour"].tolist() == ["toggling"]


def test_columns_and_types_are_those_of_the_schema(driven_and_stuck):
    rotors = rotors_table(4, 7, verdict="kept", note="mine", omega_rad_s=99.0)
    found = measure(driven_and_stuck, rotors)
    known = [name for name in tables.ROTORS.names if name in found]
    assert list(found) == [*known, "note"]
    assert found["msd_at_bound"].dtype == bool
    assert found["n_steps"].dtype == np.int64
    assert set(MEASURED) < set(found)
    assert not (found["omega_rad_s"] == 99.0).any()


def test_refused_rotors_are_not_measured(driven_and_stuck):
    rotors = rotors_table(4, 7, 9, verdict=["kept", "refused", "kept"], reason=["", "immobile", ""])
    refused = measure(driven_and_stuck, rotors).set_index("rotor").loc[7]
    assert refused[MEASURED].isna().all()
    assert np.isnan(refused["msd_speed_deg_s"])
    assert np.isnan(refused["residuals_p"])
    assert refused["speed_reason"] == "not_measured"
    assert refused["behaviour"] == "unclassified"
    assert refused["n_steps"] == 0
    assert not refused["msd_at_bound"]


def test_rotors_without_a_track_and_with_a_single_frame_get_nan():
    found = measure(tracks_table((0, [5], [0.3])), rotors_table(0, 1))
    assert found[MEASURED].isna().all(axis=None)
    assert found["behaviour"].tolist() == ["unclassified", "unclassified"]


def test_empty_tables_give_an_empty_table_with_all_columns():
    found = measure(tables.empty(tables.TRACKS), tables.empty(tables.ROTORS))
    assert found.empty
    assert list(found) == tables.ROTORS.names


@pytest.mark.parametrize("frames", [[0, 1], [0, 9], [0, 1, 2], [3, 4, 6, 7, 9, 10]])
def test_very_short_tracks_stay_unclassified_without_failing(frames):
    theta = np.linspace(0.0, 1.0, len(frames)) ** 2
    found = measure(tracks_table((0, frames, theta)), rotors_table(0))
    assert found["behaviour"].tolist() == ["unclassified"]


def test_unused_rows_do_not_enter(driven_and_stuck):
    broken = driven_and_stuck.copy()
    wrong = broken["frame"].between(1000, 1100)
    broken.loc[wrong, "theta_rad"] = 0.0
    broken.loc[wrong, "used"] = False
    without = driven_and_stuck[~wrong]
    rotors = rotors_table(4, 7, 9)
    pd.testing.assert_frame_equal(measure(broken, rotors), measure(without, rotors))


def test_the_order_of_rows_does_not_matter(driven_and_stuck):
    rotors = rotors_table(4, 7, 9)
    shuffled = driven_and_stuck.sample(frac=1.0, random_state=3)
    pd.testing.assert_frame_equal(measure(shuffled, rotors), measure(driven_and_stuck, rotors))


def test_a_missing_exposure_is_the_frame_interval_with_a_warning(driven_and_stuck):
    rotors = rotors_table(4)
    with pytest.warns(ExposureWarning, match="give exposure_s"):
        found = measure(driven_and_stuck, rotors, exposure_s=None)
    pd.testing.assert_frame_equal(found, measure(driven_and_stuck, rotors))


def test_an_exposure_longer_than_the_frame_interval_is_an_error(driven_and_stuck):
    with pytest.raises(ConfigurationError, match=r"0\.003, longer than frame_interval_s 0\.002"):
        measure(driven_and_stuck, rotors_table(4), exposure_s=0.003)


def test_tracks_without_angles_are_an_error():
    tracks = tables.empty(tables.TRACKS).drop(columns="theta_rad")
    with pytest.raises(TableError, match="theta_rad"):
        measure(tracks, rotors_table(0))


def test_wide_steps_are_warned_of_once_with_the_rotors_named(turning):
    rng = np.random.default_rng(1)
    wide = [(n, *turning(rng, 300, diffusion=400.0)) for n in (3, 8)]
    narrow = (5, *turning(rng, 300, diffusion=10.0))
    tracks = tracks_table(*wide, narrow)
    with pytest.warns(AngleWarning, match=r"2 rotor\(s\).*: 3, 8;") as caught:
        measure(tracks, rotors_table(3, 5, 8))
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        measure(tracks, rotors_table(3, 5, 8, verdict=["refused", "kept", "refused"]))


def test_the_options_choose_the_lags_and_the_noise_term_of_the_msd_fit(turning):
    track = track_of(*turning(np.random.default_rng(5), 4000, omega=10.0, diffusion=2.0, sigma=0.3))
    plain = measure_one(track, msd_lags=50).msd_fit
    noisy = measure_one(track, msd_lags=50, msd_noise=True).msd_fit
    assert plain.lag_max_s == noisy.lag_max_s == pytest.approx(50 * FRAME_S)
    assert noisy.noise_sd_rad == pytest.approx(0.3, rel=0.05)
    assert plain.noise_sd_rad == 0.0
    assert plain.diffusion_rad2_s > 1.3 * noisy.diffusion_rad2_s


def test_unbroken_angle_counts_on_across_gaps():
    angle = unbroken_angle(np.array([3, 4, 7]), np.array([3.0, -3.0, -2.5]))
    expected = [0.0, 2 * np.pi - 6.0, np.nan, np.nan, 2 * np.pi - 5.5]
    np.testing.assert_allclose(angle, expected)


def test_the_paper_s_estimator_gives_an_unsigned_speed_without_an_error(driven_and_stuck):
    rotors = rotors_table(4)
    paper = measure(driven_and_stuck, rotors, estimator="paper").iloc[0]
    best = measure(driven_and_stuck, rotors).iloc[0]
    assert paper["speed_method"] == "paper"
    assert best["speed_method"] == "increments"
    assert paper["speed_deg_s"] == paper["msd_speed_deg_s"] == best["msd_speed_deg_s"] > 0.0
    assert paper["diffusion_rad2_s"] == paper["msd_diffusion_rad2_s"]
    unknown = ["omega_sd_rad_s", "speed_ci_low_deg_s", "diffusion_sd_rad2_s"]
    assert paper[unknown].isna().all()
    assert paper["behaviour"] == best["behaviour"] == "driven_cw"


def test_false_discovery_rates_belong_to_the_measured_rotors(driven_and_stuck):
    found = measure(driven_and_stuck, rotors_table(4, 7, 9, 11)).set_index("rotor")
    assert np.isnan(found.loc[11, "drift_q"])
    p, q = (found.loc[[4, 7, 9], name].to_numpy() for name in ("drift_p", "drift_q"))
    assert (q >= p).all()
    assert q[0] == pytest.approx(3.0 * p[0])


def test_the_posterior_has_a_row_for_every_frame_also_those_missing(turning):
    frame, theta = turning(
        np.random.default_rng(6), 800, omega=9.0, diffusion=2.0, sigma=0.1, missing=0.2
    )
    frame = frame + 50
    found = measure_motion(
        tracks_table((3, frame, theta)),
        rotors_table(3),
        MotionOptions(),
        frame_interval_s=FRAME_S,
        exposure_s=FRAME_S,
    ).posterior
    assert list(found) == POSTERIOR.names
    assert found["frame"].tolist() == list(range(frame[0], frame[-1] + 1))
    assert found.loc[found["seen"], "frame"].tolist() == frame.tolist()
    strayed = found.loc[found["seen"], "theta_rad"].to_numpy() - theta
    assert np.std(np.angle(np.exp(1j * strayed))) < 0.1
    away = np.hypot(found["x_nm"] - 1.0, found["y_nm"] - 2.0)
    assert away.between(28.0, 30.5).all()


def test_results_do_not_depend_on_the_number_of_threads(driven_and_stuck):
    rotors = rotors_table(4, 7, 9)
    times = {"frame_interval_s": FRAME_S, "exposure_s": FRAME_S}
    one, three = (
        measure_motion(driven_and_stuck, rotors, MotionOptions(), **times, workers=workers)
        for workers in (1, 3)
    )
    pd.testing.assert_frame_equal(one.rotors, three.rotors)
    pd.testing.assert_frame_equal(one.posterior, three.posterior)


def test_all_lags_and_the_fit_with_covariance_are_told():
    rng = np.random.default_rng(8)
    angle = np.cumsum(rng.normal(0.06, 0.12, 2000))
    table = tracks_table((4, np.arange(2000), angle))
    found = measure_motion(
        table,
        rotors_table(4),
        MotionOptions(msd_covariance=True),
        frame_interval_s=FRAME_S,
        exposure_s=FRAME_S,
    )
    row = found.rotors.iloc[0]
    assert row["msd_gls_speed_ci_low_deg_s"] < row["msd_gls_speed_deg_s"]
    assert row["msd_gls_speed_deg_s"] < row["msd_gls_speed_ci_high_deg_s"]
    assert row["wrapped_step_sd_rad"] == pytest.approx(row["step_sd_rad"], rel=1e-2)
    assert found.msd["rotor"].unique().tolist() == [-1, 4]
    assert found.msd["lag_s"].max() == pytest.approx(999 * FRAME_S)
