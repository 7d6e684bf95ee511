import numpy as np
import pytest

from rotortrack.motion.msd import msd
from rotortrack.motion.msd_covariance import Mover, Overlaps, angle_sd, circle_sd
from rotortrack.motion.msd_fit import NOT_FITTED, fit_msd_weighted

FRAME_S = 0.002
PARTS = 5


def simulated(rng, n, speed, diffusion, sigma, missing=0.0, exposed=True):
    parts = rng.normal(speed * FRAME_S / PARTS, np.sqrt(2 * diffusion * FRAME_S / PARTS), n * PARTS)
    path = np.cumsum(parts).reshape(n, PARTS)
    x = (path.mean(axis=1) if exposed else path[:, -1]) + rng.normal(0, sigma, n)
    x[rng.random(n) < missing] = np.nan
    return x


def fitted(x, lags, exposed=True, **options):
    return fit_msd_weighted(
        msd(x, lags),
        np.isfinite(x),
        frame_interval_s=FRAME_S,
        exposure_s=FRAME_S * exposed,
        lags=lags,
        **options,
    )


@pytest.mark.parametrize("missing", [0.0, 0.4])
def test_pairs_of_pairs_are_counted_exactly(missing):
    seen = np.random.default_rng(1).random(40) >= missing
    for first, second in ((3, 1), (7, 7), (20, 5), (2, 9)):
        shift, count = Overlaps(seen).count(first, second)
        starts = [np.flatnonzero(seen[lag:] & seen[:-lag]) for lag in (first, second)]
        apart = (starts[1][np.newaxis] - starts[0][:, np.newaxis]).ravel()
        assert count.tolist() == [np.count_nonzero(apart == d) for d in shift]


@pytest.mark.parametrize(
    ("speed", "diffusion", "missing", "exposed"),
    [(12.6, 2.0, 0.0, True), (12.6, 2.0, 0.3, False), (30.0, 60.0, 0.0, True)],
)
def test_intervals_hold_the_truth_as_often_as_they_say(speed, diffusion, missing, exposed):
    rng = np.random.default_rng(2)
    fits = [
        fitted(simulated(rng, 2000, speed, diffusion, 0.2, missing, exposed), 500, exposed)
        for _ in range(60)
    ]
    for name, truth in (("speed", speed), ("diffusion", diffusion)):
        found = np.array([getattr(fit, name) for fit in fits])
        told = np.array([getattr(fit, f"{name}_sd") for fit in fits])
        held = [
            low <= truth <= high for low, high in (getattr(f, f"{name}_interval") for f in fits)
        ]
        # Fewer than 52 of 60 at 95 % happen in 1 of 200 runs.
        assert sum(held) >= 52
        assert found.std() == pytest.approx(told.mean(), rel=0.3)
        assert found.mean() == pytest.approx(truth, abs=0.5 * told.mean())


def test_a_brownian_rotor_is_not_told_to_be_driven():
    rng = np.random.default_rng(3)
    fits = [fitted(simulated(rng, 2000, 0.0, 20.0, 0.2), 500) for _ in range(40)]
    assert sum(fit.speed_interval[0] > 0 for fit in fits) <= 5


def test_without_a_noise_term_noise_passes_for_diffusion():
    x = simulated(np.random.default_rng(4), 4000, 12.6, 2.0, 0.2)
    bare = fitted(x, 20, noise=False)
    assert bare.noise_sd == 0.0
    assert bare.diffusion > 3.0
    full = fitted(x, 1000)
    assert full.noise_sd == pytest.approx(0.2, rel=0.05)
    assert (full.lag_min_s, full.lag_max_s) == pytest.approx((FRAME_S, 2.0))


def test_positions_give_one_diffusion_coefficient_in_two_coordinates():
    rng = np.random.default_rng(5)
    found = []
    for _ in range(60):
        x, y = (simulated(rng, 1000, 0.0, 50.0, 0.4) for _ in range(2))
        curve = msd(x, 100)
        both = type(curve)(curve.lags, curve.values + msd(y, 100).values, curve.pairs)
        found.append(
            fit_msd_weighted(
                both,
                np.isfinite(x),
                frame_interval_s=FRAME_S,
                exposure_s=FRAME_S,
                lags=100,
                coordinates=2,
            )
        )
    diffusion = np.array([fit.diffusion for fit in found])
    assert diffusion.mean() == pytest.approx(50.0, rel=0.03)
    assert diffusion.std() == pytest.approx(np.mean([f.diffusion_sd for f in found]), rel=0.3)


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_standard_deviations_are_those_of_repeats(missing):
    rng = np.random.default_rng(6)
    lags = np.array([1, 10, 100])
    radius = 100.0
    angles, places = [], []
    for _ in range(200):
        x = simulated(rng, 1000, 12.6, 5.0, 0.1, missing, exposed=False)
        angles.append(msd(x, 100).values[lags - 1])
        spot = radius * np.exp(1j * x)
        places.append((msd(spot.real, 100).values + msd(spot.imag, 100).values)[lags - 1])
    mover = Mover(12.6, 5.0, 0.01, FRAME_S, 0.0)
    seen = np.isfinite(x)
    sd, independent = angle_sd(mover, lags, Overlaps(seen))
    np.testing.assert_allclose(sd, np.std(angles, axis=0), rtol=0.2)
    np.testing.assert_allclose(
        circle_sd(mover, radius, lags, Overlaps(seen)), np.std(places, axis=0), rtol=0.2
    )
    assert (np.diff(independent) < 0).all()
    assert independent[2] < 12


def test_too_few_lags_and_a_resting_angle_give_nothing():
    assert fitted(np.array([0.0, 1.0, np.nan]), 2) is NOT_FITTED
    assert fitted(np.zeros(50), 10) is NOT_FITTED
