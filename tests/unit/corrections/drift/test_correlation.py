import numpy as np
import pytest

from rotortrack.corrections.drift.correlation import (
    FINE_REACH,
    CoarseCorrelation,
    apply_stencil,
    count_pairs,
)


def rendered(columns, rows, shape, margin):
    """Averaged shifted histogram by adding the stencil point by point."""
    image = np.zeros((shape[0] + 2 * margin, shape[1] + 2 * margin))
    stencil = np.outer([1, 2, 1], [1, 2, 1])
    for column, row in zip(columns + margin, rows + margin, strict=True):
        image[row - 1 : row + 2, column - 1 : column + 2] += stencil
    return image


def plain_correlation(reference, other, lags_y, lags_x):
    """sum_p reference(p + lag) other(p), by rolling (margins are zero)."""
    return np.array(
        [[(np.roll(reference, (-j, -i), (0, 1)) * other).sum() for i in lags_x] for j in lags_y]
    )


def test_coarse_correlation_equals_the_sum_over_rendered_pixels():
    rng = np.random.default_rng(0)
    shape = (13, 22)
    (ref_c, c), (ref_r, r) = rng.integers(0, 22, (2, 60)), rng.integers(0, 13, (2, 60))
    correlate = CoarseCorrelation(ref_c, ref_r, shape, largest_lag=8)
    lags = np.arange(-8, 9)
    expected = plain_correlation(
        rendered(ref_c, ref_r, shape, 12), rendered(c, r, shape, 12), lags, lags
    )
    assert correlate(c, r) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(("lag_x", "lag_y"), [(0, 0), (3, -2), (-9, 6)])
def test_counted_pairs_equal_all_differences_near_the_lag(lag_x, lag_y):
    rng = np.random.default_rng(1)
    (ref_c, c), (ref_r, r) = rng.integers(0, 30, (2, 80)), rng.integers(0, 25, (2, 80))
    group_of_row = rng.integers(0, 3, 25)
    stride = 30 + 2 * (9 + FINE_REACH) + 1
    ref_keys, ref_counts = np.unique(ref_r * stride + ref_c, return_counts=True)
    keys, first, counts = np.unique(r * stride + c, return_index=True, return_counts=True)
    pairs = count_pairs(
        ref_keys, ref_counts, keys, counts, group_of_row[r[first]], 3, stride,
        lag_y * stride + lag_x,
    )  # fmt: skip
    side = 2 * FINE_REACH + 1
    expected = np.zeros((3, side, side))
    for i in range(80):
        for k in range(80):
            j_y = ref_r[k] - r[i] - lag_y + FINE_REACH
            j_x = ref_c[k] - c[i] - lag_x + FINE_REACH
            if 0 <= j_y < side and 0 <= j_x < side:
                expected[group_of_row[r[i]], j_y, j_x] += 1
    assert pairs.tolist() == expected.tolist()


def test_stencil_on_pair_counts_is_the_correlation_of_two_stencils():
    pairs = np.zeros((15, 15))
    pairs[7, 7] = 1
    row = np.convolve([1, 2, 1], [1, 2, 1])
    assert apply_stencil(pairs)[3:8, 3:8].tolist() == np.outer(row, row).tolist()
    assert apply_stencil(pairs).shape == (11, 11)
