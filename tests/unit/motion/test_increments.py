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
