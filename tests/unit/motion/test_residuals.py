import numpy as np
import pytest

from rotortrack.motion.residuals import (
    UNTESTED,
    Whiteness,
    block_bootstrap,
    calibrated,
    whiteness,
)


def test_a_test_that_was_not_made_hides_no_other_and_none_at_all_is_no_pass():
    assert np.isnan(UNTESTED.p)
    assert Whiteness(np.nan, 0.01, 0.5, np.nan).p == pytest.approx(0.02)
    assert Whiteness(0.5, 0.01, np.nan, np.nan).p == pytest.approx(0.02)


def test_white_residuals_pass_as_often_as_they_should():
    rng = np.random.default_rng(2)
    p = []
    for _ in range(300):
        deviation, ahead = rng.normal(size=2000), np.cumsum(rng.normal(0.0, 0.3, 2000))
        p.append(whiteness(deviation, ahead).p)
    # Four tests, corrected for their number, hence a little less than the level.
    assert 0.02 < np.mean(np.array(p) < 0.1) < 0.15


@pytest.mark.parametrize("kind", ["lag_p", "slow_p", "spread_p", "angle_p"])
def test_each_unevenness_is_found_by_its_test(kind):
    rng = np.random.default_rng(3)
    noise = rng.normal(size=4001)
    ahead = np.cumsum(rng.normal(0.0, 0.2, 4001))
    deviation = {
        "lag_p": noise + 0.3 * np.roll(noise, 1),
        "slow_p": noise + 0.3 * np.sign(np.sin(np.arange(4001) / 300)),
        "spread_p": noise * np.where(np.arange(4001) // 200 % 2, 1.5, 0.7),
        "angle_p": noise + 0.3 * np.sin(2 * ahead),
    }[kind]
    found = whiteness(deviation, ahead)
    assert getattr(found, kind) < 1e-6
    assert found.p < 1e-5


def followed(rng, n, move, drift=0.0, pull=0.0):
    """Scores of a rotor that its predictions follow, as a filter of fixed gain does."""
    scores, ahead = rng.normal(size=n), np.empty(n)
    now = 0.0
    for k in range(n):
        ahead[k] = now
        scores[k] -= pull * np.sin(3.0 * now)
        now += move * scores[k] + drift
    return scores - scores.mean(), ahead


def calibrated_p(rng, n, move, drift=0.0, pull=0.0):
    scores, ahead = followed(rng, n, move, drift, pull)
    moves = np.full(n, move), np.full(n, drift)
    white = whiteness(scores, ahead)
    return white.angle_p, calibrated(white, ahead[0], *moves, seed=0).angle_p


@pytest.mark.parametrize("move", [0.001, 0.02, 0.1])
def test_directions_of_a_rotor_that_hardly_leaves_its_place_count_as_they_should(move):
    rng = np.random.default_rng(7)
    p = np.array([calibrated_p(rng, 1500, move) for _ in range(200)])
    raw, told = (p < 0.05).mean(axis=0)
    assert raw > 0.1
    assert 0.005 < told < 0.1
    assert (p[:, 1] < 1e-3).mean() <= 0.01


def test_a_potential_is_found_although_the_rotor_hardly_leaves_its_place():
    rng = np.random.default_rng(8)
    p = [calibrated_p(rng, 3000, 0.1, pull=0.3)[1] for _ in range(20)]
    assert np.max(p) < 1e-4


def test_directions_of_a_rotor_that_turns_many_times_need_no_calibration():
    raw, told = calibrated_p(np.random.default_rng(9), 1000, 0.1, drift=0.2, pull=0.3)
    assert raw == told < 1e-3


def test_few_readings_are_not_tested():
    assert whiteness(np.ones(50), np.zeros(50)).p == 1.0


def bootstrap_of_mean(values, seed=0):
    n = values.size
    point = np.array([values.mean(), np.log(values.var()), 0.0])
    covariance = np.diag([values.var() / n, 2.0 / n, 1e-6])

    def log_densities(at):
        return -0.5 * ((values - at[0]) ** 2 * np.exp(-at[1]) + at[1])

    return block_bootstrap(log_densities, point, covariance, seed)


def test_the_bootstrap_knows_the_error_of_a_mean_of_independent_values():
    rng = np.random.default_rng(4)
    told = [bootstrap_of_mean(rng.normal(0.0, 2.0, 2000)).sd for _ in range(40)]
    # The widest of three block lengths is taken, hence more than the error itself.
    assert 1.0 < np.mean([sd[0] for sd in told]) / (2.0 / np.sqrt(2000)) < 1.25
    assert np.mean([sd[1] for sd in told]) == pytest.approx(np.sqrt(2 / 2000), rel=0.15)


def test_the_bootstrap_covers_the_mean_of_correlated_values_where_the_model_does_not():
    rng = np.random.default_rng(5)
    covered = []
    for _ in range(150):
        noise = rng.normal(size=2060)
        values = np.convolve(noise, np.ones(60), "valid")[:2000]
        low, high = bootstrap_of_mean(values).omega_interval_rad_s
        covered.append(low < 0.0 < high)
    assert 0.88 < np.mean(covered) <= 1.0


def test_draws_are_reproducible():
    values = np.random.default_rng(6).normal(size=500)
    once, again, other = (bootstrap_of_mean(values, seed) for seed in (1, 1, 2))
    assert once.omega_interval_rad_s == again.omega_interval_rad_s
    assert once.omega_interval_rad_s != other.omega_interval_rad_s
