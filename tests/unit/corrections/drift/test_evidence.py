import numpy as np
import pytest

from rotortrack.corrections.drift.evidence import dense_pixels, excess_on


def test_dense_pixels_lie_about_the_localisations():
    dense = dense_pixels(np.array([10]), np.array([20]), (40, 50))
    expected = np.zeros((40, 50), dtype=bool)
    expected[19:22, 9:12] = True
    assert (dense == expected).all()


def test_at_most_a_tenth_of_a_crowded_field_is_dense():
    rng = np.random.default_rng(0)
    columns, rows = rng.integers(0, 60, (2, 50_000))
    dense = dense_pixels(columns, rows, (60, 60))
    assert 0.08 < dense.mean() <= 0.1


def test_chance_gives_standard_normal_excesses():
    rng = np.random.default_rng(1)
    dense = dense_pixels(*rng.integers(0, 60, (2, 5000)), (60, 60))
    z = [excess_on(dense, *rng.integers(0, 60, (2, 2000))) for _ in range(400)]
    assert np.mean(z) == pytest.approx(0.0, abs=0.2)
    assert np.std(z) == pytest.approx(1.0, abs=0.12)


def test_positions_beyond_the_field_hit_nothing():
    dense = np.ones((40, 40), dtype=bool)
    assert excess_on(dense, np.array([-1, 40, 5]), np.array([5, 5, -1])) < 0
