import numpy as np
import pytest
from scipy import optimize

from rotortrack.motion.diffusion import UNKNOWN, estimate_diffusion
from rotortrack.motion.increments import Increments, increments

FRAME_S = 0.002


def estimate(frame, theta, gap_mode="drop", exposure_s=FRAME_S):
    moves = increments(frame, theta, gap_mode)
    return estimate_diffusion(moves, frame_interval_s=FRAME_S, exposure_s=exposure_s)


def plain_likelihood(moves, exposure_s):
    """Maximise the Gaussian likelihood of the steps with their dense covariance matrix."""
    step = moves.step_rad - moves.step_rad.mean()
    same_run = moves.run[:, None] == moves.run
    apart = np.abs(np.subtract.outer(np.arange(step.size), np.arange(step.size)))
    blur = exposure_s / (6 * FRAME_S)

    def minus_twice_log(parameters):
        moved, noise = np.exp(parameters)
        matrix = (moved * (1 - 2 * blur) + 2 * noise) * (apart == 0)
        matrix = matrix + (moved * blur - noise) * ((apart == 1) & same_run)
        return np.linalg.slogdet(matrix)[1] + step @ np.linalg.solve(matrix, step)

    best = optimize.minimize(
        minus_twice_log, np.log([0.02, 0.02]), method="Nelder-Mead", options={"xatol": 1e-6}
    )
    return np.exp(best.x) / [2 * FRAME_S, 1.0]


@pytest.mark.parametrize("part_exposed", [0.5, 1.0])
def test_it_is_the_maximum_of_the_plain_likelihood(turning, part_exposed):
    frame, theta = turning(
        np.random.default_rng(3),
        150,
        omega=20.0,
        diffusion=10.0,
        sigma=0.15,
        missing=0.15,
        part_exposed=part_exposed,
    )
    exposure_s = part_exposed * FRAME_S
    found = estimate(frame, theta, exposure_s=exposure_s)
    expected = plain_likelihood(increments(frame, theta, "drop"), exposure_s)
    assert found.diffusion_rad2_s == pytest.approx(expected[0], rel=1e-3)
    assert found.noise_variance_rad2 == pytest.approx(expected[1], rel=1e-3)


def test_the_information_is_the_curvature_of_the_covariance_model():
    # Without noise or blur the steps are independent, and the relative variance of D is known
    # to be 2 / N when sigma is given; the estimated sigma costs a factor of 3 in that limit.
    rng = np.random.default_rng(8)
    moves = Increments(rng.normal(0.0, 0.3, 20_000), np.ones(20_000, int), np.zeros(20_000, int))
    found = estimate_diffusion(moves, frame_interval_s=FRAME_S, exposure_s=1e-12)
    relative = np.sqrt(np.linalg.inv(found.covariance)[0, 0]) * found.diffusion_rad2_s
    assert relative == pytest.approx(np.sqrt(20_000 / 2), rel=0.1)
    assert found.diffusion_rad2_s == pytest.approx(0.09 / (2 * FRAME_S), rel=0.05)


@pytest.mark.parametrize("gap_mode", ["drop", "bridge"])
@pytest.mark.parametrize("part_exposed", [0.25, 1.0])
def test_noise_blur_and_gaps_leave_no_bias(turning, gap_mode, part_exposed):
    rng = np.random.default_rng(11)
    found = [
        estimate(
            *turning(
                rng,
                2000,
                omega=30.0,
                diffusion=20.0,
                sigma=0.1,
                missing=0.2,
                part_exposed=part_exposed,
            ),
            gap_mode=gap_mode,
            exposure_s=part_exposed * FRAME_S,
        )
        for _ in range(60)
    ]
    diffusion = np.array([f.diffusion_rad2_s for f in found])
    sd = np.array([f.diffusion_sd_rad2_s for f in found])
    assert diffusion.mean() == pytest.approx(20.0, rel=0.03)
    assert np.mean([f.noise_variance_rad2 for f in found]) == pytest.approx(0.01, rel=0.08)
    assert 0.75 < diffusion.std() / sd.mean() < 1.3


def test_noise_alone_gives_next_to_no_diffusion_with_a_positive_sd(turning):
    rng = np.random.default_rng(2)
    found = [estimate(*turning(rng, 1000, sigma=0.2, missing=0.3)) for _ in range(30)]
    at_bound = [f for f in found if f.diffusion_rad2_s == 0.0]
    assert len(at_bound) > 5
    assert all(f.diffusion_sd_rad2_s > 0.0 for f in found)
    assert all(f.cautious_rad2_s > 0.0 for f in found)
    assert np.mean([f.noise_variance_rad2 for f in found]) == pytest.approx(0.04, rel=0.05)


def test_a_motionless_noiseless_angle_gives_zero():
    found = estimate(np.arange(50), np.full(50, 1.0))
    assert (found.diffusion_rad2_s, found.noise_variance_rad2) == (0.0, 0.0)


@pytest.mark.parametrize("frame", [[], [0], [0, 1, 2], [0, 1, 5, 6, 10, 11, 20, 21]])
def test_too_few_or_only_lone_steps_leave_it_unknown(frame):
    theta = np.random.default_rng(0).normal(size=len(frame))
    assert estimate(np.array(frame, int), theta) is UNKNOWN
