import json

import numpy as np
import pytest
from scipy import stats

from rotortrack.motion.population import binomial_share, driven_share, paper_class, summarise


@pytest.mark.parametrize(
    ("speed", "name"),
    [
        (0.0, "none"),
        (1e-9, "between"),
        (99.9, "between"),
        (100.0, "slow"),
        (720.0, "slow"),
        (720.1, "fast"),
        (np.nan, ""),
    ],
)
def test_classes_are_those_of_the_paper_and_what_lies_between(speed, name):
    assert paper_class(speed) == name


def test_binomial_intervals_are_those_of_scipy():
    for count, n in ((0, 10), (3, 10), (10, 10), (70, 89)):
        found = binomial_share(count, n)
        exact = stats.binomtest(count, n).proportion_ci(method="exact")
        assert (found.low, found.high) == pytest.approx((exact.low, exact.high))


def p_values(rng, n, share, z):
    """Draw two-sided p of rotors of which a share has speeds of z sd."""
    speeds = np.where(rng.random(n) < share, z, 0.0)
    return 2 * stats.norm.sf(np.abs(rng.normal(speeds, 1.0)))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8, 1.0])
def test_driven_share_covers_where_driven_rotors_are_seen(share):
    rng = np.random.default_rng(int(10 * share))
    found = [driven_share(p_values(rng, 84, share, 6.0)) for _ in range(1000)]
    covered = [f.estimate.low <= share <= f.estimate.high for f in found]
    # Exact binomial intervals of so few rotors are a little wide.
    assert np.mean(covered) >= 0.94
    assert np.mean([f.at_least.low <= share for f in found]) >= 0.965
    if 0.0 < share < 1.0:
        assert np.mean([f.estimate.value for f in found]) == pytest.approx(share, abs=0.02)
        assert np.mean([f.at_least.value for f in found]) == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize("z", [0.5, 1.0, 2.0])
def test_lower_ends_hold_however_slow_driven_rotors_are(z):
    rng = np.random.default_rng(5)
    found = [driven_share(p_values(rng, 84, 0.6, z)) for _ in range(1000)]
    assert np.mean([f.estimate.low <= 0.6 for f in found]) >= 0.965
    assert np.mean([f.at_least.low <= 0.6 for f in found]) >= 0.965


def test_a_population_of_brownian_rotors_has_no_driven_part():
    rng = np.random.default_rng(6)
    assert np.mean([driven_share(rng.random(84)).at_least.low > 0 for _ in range(1000)]) <= 0.035


def test_a_summary_counts_and_is_plain_json():
    found = summarise(
        ["driven_ccw", "driven_ccw", "driven_cw", "brownian", "stuck"],
        ["fast", "slow", "slow", "between", ""],
        np.array([1e-9, 1e-5, 1e-8, 0.7, np.nan]),
        np.array([1e-8, 1e-4, 1e-7, 0.7, np.nan]),
    )
    assert found.n_rotors == 5
    assert found.behaviours == {"driven_ccw": 2, "driven_cw": 1, "brownian": 1, "stuck": 1}
    assert found.paper_classes == {"slow": 2, "fast": 1, "between": 1}
    assert found.n_driven_q == 3
    assert found.driven.n == 4
    assert found.counter_clockwise.value == pytest.approx(2 / 3)
    nothing = json.loads(json.dumps(summarise([], [], np.empty(0), np.empty(0)).plain()))
    assert nothing["driven"] == {
        "n": 0,
        "estimate": {"value": None, "low": None, "high": None},
        "at_least": {"value": None, "low": None, "high": None},
    }
