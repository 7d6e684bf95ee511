import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.motion.msd import MSD, fit_msd, msd


def plain(x, lag):
    """The definition, in extended precision."""
    moved = (x[lag:] - x[:-lag]).astype(np.longdouble)
    moved = moved[np.isfinite(moved)]
    return float(np.mean(moved**2)) if moved.size else np.nan, moved.size


def walk(n, missing=0.0, offset=0.0, seed=1):
    rng = np.random.default_rng(seed)
    x = offset + np.cumsum(rng.normal(0.1, 0.5, n))
    x[rng.random(n) < missing] = np.nan
    return x


@pytest.mark.parametrize("missing", [0.0, 0.2])
@pytest.mark.parametrize("offset", [0.0, 1e8])
def test_a_million_frames_and_1e5_rad_keep_eight_digits_at_every_lag(missing, offset):
    n = 1_000_000
    # An offset of 1e8 rad leaves the angles themselves with eight digits after the point.
    x = walk(n, missing, offset)
    assert abs(np.nanmax(x) - np.nanmin(x) - 1e5) < 3e3
    found = msd(x)
    for lag in (1, 2, 3, 10, 100, 10_000, 300_000, n - 200):
        value, pairs = plain(x, lag)
        assert found.values[lag - 1] == pytest.approx(value, rel=1e-8)
        assert found.pairs[lag - 1] == pairs


@given(
    st.lists(st.none() | st.floats(-1e3, 1e3), min_size=1, max_size=40),
    st.none() | st.integers(1, 50),
)
def test_it_equals_the_definition_with_any_gaps(angles, max_lag):
    x = np.array([np.nan if a is None else a for a in angles], float)
    found = msd(x, max_lag)
    assert found.lags.tolist() == list(range(1, min(x.size - 1, max_lag or x.size) + 1))
    size = np.nanmax(x**2, initial=1e-300)
    for lag, value, pairs in zip(found.lags, found.values, found.pairs, strict=True):
        expected, count = plain(x, lag)
        assert pairs == count
        np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-11 * size)


def test_a_steady_turn_is_a_parabola_and_a_resting_angle_zero():
    x = 0.3 * np.arange(100.0)
    x[40:45] = np.nan
    found = msd(x)
    np.testing.assert_allclose(found.values, (0.3 * found.lags) ** 2, rtol=1e-12)
    assert not msd(np.full(50, 2.0)).values.any()


def exact(speed, diffusion, sigma, frame_s, n=200):
    tau = np.arange(1, n + 1) * frame_s
    values = speed**2 * tau**2 + 2 * diffusion * tau + 2 * sigma**2
    return MSD(np.arange(1, n + 1), values, np.arange(n, 0, -1))


@pytest.mark.parametrize("frame_s", [1e-6, 0.002, 3.0])
@pytest.mark.parametrize("speed", [0.5, 40.0])
def test_an_exact_curve_gives_back_its_parameters(frame_s, speed):
    speed, diffusion = speed * 0.002 / frame_s, 3.0 * 0.002 / frame_s
    fit = fit_msd(exact(speed, diffusion, 0.0, frame_s), frame_s, lags=100)
    assert fit.speed_rad_s == pytest.approx(speed, rel=1e-6)
    assert fit.diffusion_rad2_s == pytest.approx(diffusion, rel=1e-6)
    assert (fit.lag_min_s, fit.lag_max_s) == pytest.approx((frame_s, 100 * frame_s))
    assert not fit.at_bound
    assert fit.curve(np.array([2.0]))[0] == pytest.approx(4 * speed**2 + 4 * diffusion, rel=1e-6)


def test_the_noise_term_is_fitted_only_on_request():
    curve = exact(20.0, 3.0, 0.2, 0.002)
    assert fit_msd(curve, 0.002, lags=150).noise_sd_rad == 0.0
    fit = fit_msd(curve, 0.002, lags=150, noise=True)
    assert fit.noise_sd_rad == pytest.approx(0.2, rel=1e-6)
    assert fit.diffusion_rad2_s == pytest.approx(3.0, rel=1e-6)


def test_a_saturating_curve_ends_at_the_bound_of_zero_speed():
    curve = MSD(np.arange(1, 101), np.sqrt(np.arange(1.0, 101.0)), np.arange(100, 0, -1))
    fit = fit_msd(curve, 0.01, lags=100)
    assert fit.speed_rad_s == 0.0
    assert fit.at_bound


def test_a_curve_steeper_than_a_parabola_ends_at_the_bound_of_zero_diffusion():
    tau = 0.01 * np.arange(1, 101)
    fit = fit_msd(MSD(np.arange(1, 101), tau**3, np.arange(100, 0, -1)), 0.01, lags=100)
    assert fit.diffusion_rad2_s == 0.0
    assert fit.at_bound


def test_lags_without_pairs_are_left_out_and_too_few_give_nan():
    x = np.full(60, np.nan)
    x[::3] = 0.1 * np.arange(20)
    fit = fit_msd(msd(x), 1.0, lags=30)
    assert (fit.lag_min_s, fit.lag_max_s) == (3.0, 30.0)
    nothing = fit_msd(msd(x), 1.0, lags=4)
    assert np.isnan(nothing.speed_rad_s)
    assert np.isnan(nothing.lag_max_s)
    assert not nothing.at_bound
