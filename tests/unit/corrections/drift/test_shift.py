import numpy as np
import pytest

from rotortrack.corrections.drift.shift import ShiftMeasurement
from rotortrack.errors import TableError

FIELD_PX = 64


def spots(rng, n=300, centres=9, sd_px=0.3):
    corners = np.random.default_rng(99).uniform(8, FIELD_PX - 8, (centres, 2))
    return (corners[rng.integers(0, centres, n)] + rng.normal(0, sd_px, (n, 2))).T


def uniform(rng, n=300):
    return rng.uniform(0, FIELD_PX, (n, 2)).T


def measure(reference, other, expected=(0.0, 0.0)):
    x, y = np.concatenate([reference, other], axis=1)
    n = reference.shape[1]
    measurement = ShiftMeasurement(x, y, slice(0, n), 5.0)
    return measurement(slice(n, x.size), np.array(expected))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.37, -0.81), (-5.2, 11.4), (20.0, 3.3)])
def test_planted_shift_is_found_within_its_standard_deviation(shift):
    errors, sds = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        found = measure(spots(rng, 2000), spots(rng, 2000) + np.array(shift)[:, np.newaxis])
        assert found.problem is None
        assert found.peak > 50
        errors.append(found.px - shift)
        deviations = found.replicates_px - found.replicates_px.mean(axis=0)
        groups = len(deviations)
        sds.append(np.sqrt((groups - 1) / groups * (deviations**2).sum(axis=0)))
    error, sd = (np.sqrt(np.mean(np.square(v))) for v in (errors, sds))
    # At best the error of the difference of two means of 2000 spots.
    assert 0.3 * np.sqrt(2 / 2000) < error < 0.03
    # A jackknife over few uneven parts errs on the side of caution.
    assert 0.3 < error / sd < 1.4


def test_shift_of_one_axis_does_not_leak_into_the_other():
    reference = spots(np.random.default_rng(1))
    found = measure(reference, reference + np.array([[3.0], [0.0]]))
    assert found.px == pytest.approx([3.0, 0.0], abs=0.01)


@pytest.mark.parametrize(
    ("first", "second"), [(uniform, uniform), (spots, uniform), (uniform, spots)]
)
@pytest.mark.parametrize("n", [60, 300, 5000])
def test_bins_without_a_common_structure_do_not_pass_as_evidence(first, second, n):
    for seed in range(8):
        rng = np.random.default_rng(seed)
        found = measure(first(rng, n), second(rng, n))
        assert found.problem is not None
        assert not found.peak >= 8


def test_few_spots_of_common_structure_do_pass():
    for seed in range(8):
        rng = np.random.default_rng(seed)
        found = measure(spots(rng, 60), spots(rng, 60))
        assert found.problem is None
        assert found.px == pytest.approx([0.0, 0.0], abs=0.4)


def test_among_equal_peaks_the_one_near_the_bin_before_is_taken():
    # Two columns of spots one pitch apart; the other bin shows only one: both lags fit alike.
    rng = np.random.default_rng(2)
    y = np.repeat([10.0, 25.0, 40.0], 200)
    both = np.concatenate([[np.full(600, 10.2), y], [np.full(600, 30.2), y]], axis=1)
    single = np.array([np.full(600, 20.2), y])
    noise = rng.normal(0, 0.2, (2, 1800))
    for expected in (-10.0, 10.0):
        found = measure(both + noise[:, :1200], single + noise[:, 1200:], (expected, 0.0))
        assert found.px == pytest.approx([expected, 0.0], abs=0.1)


def test_field_larger_than_any_camera_is_refused_before_memory_is_taken():
    x = np.array([0.0, 1e5, 3.0])
    with pytest.raises(TableError, match="100001 x 100001 camera pixels"):
        ShiftMeasurement(x, x, slice(0, 1), 5.0)
