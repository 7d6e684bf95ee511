import numpy as np
import pytest

from rotortrack.motion.increments import StepSizes, increments, step_sizes

FRAME = np.array([0, 1, 2, 5, 6, 9])
THETA = np.array([0.0, 0.1, 0.3, 0.6, 1.0, 1.5])


def test_dropped_gaps_start_new_runs():
    moves = increments(FRAME, THETA, "drop")
    np.testing.assert_allclose(moves.step_rad, [0.1, 0.2, 0.4])
    assert moves.frames_apart.tolist() == [1, 1, 1]
    assert moves.run[0] == moves.run[1] < moves.run[2]


def test_bridged_gaps_are_steps_of_one_run():
    moves = increments(FRAME, THETA, "bridge")
    np.testing.assert_allclose(moves.step_rad, [0.1, 0.2, 0.3, 0.4, 0.5])
    assert moves.frames_apart.tolist() == [1, 1, 3, 1, 3]
    assert np.unique(moves.run).size == 1


@pytest.mark.parametrize("gap_mode", ["drop", "bridge"])
def test_step_sizes_are_those_between_adjacent_frames(gap_mode):
    sizes = step_sizes(increments(FRAME, THETA, gap_mode))
    assert sizes.n_steps == 3
    assert sizes.mean_rad == pytest.approx(0.7 / 3)
    assert sizes.sd_rad == pytest.approx(np.std([0.1, 0.2, 0.4], ddof=1))


@pytest.mark.parametrize("frames", [0, 1])
def test_a_track_without_steps_has_none(frames):
    sizes = step_sizes(increments(FRAME[:frames], THETA[:frames], "drop"))
    assert sizes.n_steps == 0
    assert np.isnan(sizes.mean_rad)
    assert not sizes.folded


@pytest.mark.parametrize(
    ("mean_deg", "sd_deg", "folded"),
    [(0, 54, False), (0, 56, True), (89, 5, False), (-91, 5, True)],
)
def test_wide_or_long_steps_are_folded(mean_deg, sd_deg, folded):
    assert StepSizes(np.deg2rad(mean_deg), np.deg2rad(sd_deg), 100).folded is folded


@pytest.mark.parametrize(
    ("sd_deg", "mean_deg", "part"),
    [
        (30, 3.6, 1.0),
        (30, 135, 0.82),
        (45, 90, 0.91),
        (60, 45, 0.90),
        (90, 45, 0.52),
        (90, 135, 0.18),
        (120, 90, 0.14),
        (60, 160, 0.17),
    ],
)
def test_the_rule_shortens_wide_steps_and_the_wrapped_normal_does_not(sd_deg, mean_deg, part):
    n = 400_000
    turned = np.random.default_rng(7).normal(np.deg2rad(mean_deg), np.deg2rad(sd_deg), n)
    theta = np.angle(np.exp(1j * np.concatenate(([0.0], np.cumsum(turned)))))
    sizes = step_sizes(increments(np.arange(n + 1), theta, "drop"))
    # Four standard errors of the folded mean, at most 104 degrees wide, come on top.
    error = 4 * sizes.sd_rad / np.sqrt(n) / np.deg2rad(mean_deg)
    assert sizes.mean_rad / np.deg2rad(mean_deg) == pytest.approx(part, abs=0.01 + error)
    away = sizes.wrapped_mean_rad - np.deg2rad(mean_deg)
    assert abs(away) < 4 * sizes.wrapped_mean_sd_rad
    assert abs(sizes.wrapped_sd_rad - np.deg2rad(sd_deg)) < 4 * sizes.wrapped_sd_sd_rad
    assert sizes.folded is (sd_deg > 55 or mean_deg >= 90)


@pytest.mark.parametrize(("mean", "sd"), [(0.2, 0.02), (0.3, 0.8), (2.8, 1.05), (0.25, 2.0)])
def test_wrapped_normal_errors_are_those_of_repeats(mean, sd):
    rng = np.random.default_rng(8)
    theta = np.cumsum(rng.normal(mean, sd, (300, 8001)), axis=1)
    fits = [step_sizes(increments(np.arange(8001), one, "drop")) for one in theta]
    for name in ("mean", "sd"):
        found = np.array([getattr(fit, f"wrapped_{name}_rad") for fit in fits])
        told = np.array([getattr(fit, f"wrapped_{name}_sd_rad") for fit in fits])
        assert found.std() == pytest.approx(told.mean(), rel=0.15)
        truth = mean if name == "mean" else sd
        assert found.mean() == pytest.approx(truth, abs=5 * told.mean() / np.sqrt(300) + 0.01 * sd)


def test_equal_steps_have_no_spread():
    sizes = step_sizes(increments(np.arange(9), 0.5 * np.arange(9), "drop"))
    assert sizes.wrapped_mean_rad == pytest.approx(0.5)
    assert sizes.wrapped_sd_rad == pytest.approx(0.0, abs=1e-12)


def test_an_expected_turn_carries_steps_across_gaps():
    frame = np.array([0, 1, 4, 5, 14])
    turned = 1.2 * frame
    theta = np.angle(np.exp(1j * turned))
    moves = increments(frame, theta, "model", 1.15)
    np.testing.assert_allclose(moves.step_rad, np.diff(turned), atol=1e-12)
    assert moves.frames_apart.tolist() == [1, 3, 1, 9]
    lone = increments(frame[[0, 2, 4]], theta[[0, 2, 4]], "model", 1.15)
    np.testing.assert_allclose(lone.step_rad, np.diff(turned[[0, 2, 4]]), atol=1e-12)
