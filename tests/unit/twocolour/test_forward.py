"""Twins have the noise, registration error, blur and screening of the rotors they belong to."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from rotortrack.motion.blur import radius_factor
from rotortrack.twocolour.forward import draw_twins, rescaled_speeds_deg_s
from rotortrack.twocolour.population import RodPopulation

from .planted_groups import FILM, group

EDGES = np.arange(0.0, 801.0)


def rods(distance_nm, rate_rev_s=1000.0, weight=None):
    distance = np.atleast_1d(np.asarray(distance_nm, np.float64))
    n = len(distance)
    return RodPopulation(
        distance_nm=distance,
        radius_nm=np.stack([0.5 * distance, 0.5 * distance], axis=1),
        rate_rev_s=np.broadcast_to(np.asarray(rate_rev_s, np.float64), n),
        weight=np.full(n, 1.0 / n) if weight is None else np.asarray(weight),
        attractor=np.arange(n),
        run=np.arange(n),
        cells=n,
        attractors=n,
        declared=False,
        mirrored_starts=False,
    )


def still(film=FILM, **changed):
    """Make a group that neither turns during an exposure nor has an error of registration."""
    made = group(1, n=6, film=film)
    zero = np.zeros(made.n)
    return dataclasses.replace(
        made,
        **{"diffusion_rad2_s": zero, "registration_sd_nm": zero, "speed_deg_s": zero, **changed},
    )


def drawn(measured, simulated, seed=3, twins=40, **options):
    return draw_twins(
        measured, simulated, EDGES, twins=twins, rng=np.random.default_rng(seed), **options
    )


def test_every_twin_has_the_frames_of_its_rotor():
    measured = group(1, n=6)
    made = drawn(measured, rods([100.0, 200.0]), twins=5)
    assert (made.counts.sum(axis=2) == measured.n_frames).all()
    assert made.mean_nm.shape == made.true_nm.shape == (5, 6)
    edges = 0.5 * (EDGES[1:] + EDGES[:-1])
    assert made.counts @ edges / made.counts.sum(axis=2) == pytest.approx(made.mean_nm, abs=0.2)


def test_distances_follow_the_rician_law_of_the_noise():
    measured = still()
    made = drawn(measured, rods(50.0))
    counts = made.counts.sum(axis=(0, 1))
    law = stats.rice(50.0 / 15.0, scale=15.0)
    expected = counts.sum() * np.diff(law.cdf(EDGES))
    assert np.abs(np.cumsum(counts) - np.cumsum(expected)).max() / counts.sum() < 5e-3
    assert made.mean_nm.mean() == pytest.approx(law.mean(), abs=0.1)


def test_fitted_noise_takes_the_place_of_told_noise_and_registration():
    measured = still(noise_ratio=np.full(6, 2.0), registration_sd_nm=np.full(6, 40.0))
    made = drawn(measured, rods(50.0), fitted_noise=True)
    assert made.mean_nm.mean() == pytest.approx(stats.rice(50 / 30, scale=30.0).mean(), abs=0.3)


def test_an_error_of_the_registration_is_one_for_all_frames_of_a_twin():
    measured = still(
        registration_sd_nm=np.full(6, 30.0), x_sd_nm=np.full_like(still().x_sd_nm, 1e-3),
        y_sd_nm=np.full_like(still().y_sd_nm, 1e-3),
    )  # fmt: skip
    made = drawn(measured, rods(100.0), twins=60)
    spread = np.array([_sd_of(counts) for counts in made.counts.reshape(360, -1)])
    # |d u + c| of a turning rod is spread by c / sqrt(2), with c of a Rayleigh law.
    assert np.mean(spread) == pytest.approx(30.0 * math.sqrt(math.pi / 2) / math.sqrt(2), rel=0.08)
    assert np.std(spread) > 0.4 * np.mean(spread)


def _sd_of(counts):
    middle = 0.5 * (EDGES[1:] + EDGES[:-1])
    mean = counts @ middle / counts.sum()
    return math.sqrt(counts @ (middle - mean) ** 2 / counts.sum())


@pytest.mark.parametrize(
    ("omega_rad_s", "diffusion_rad2_s"), [(800.0, 0.0), (0.0, 300.0), (600.0, 200.0)]
)
def test_an_exposure_blurs_as_the_closed_formula_says(omega_rad_s, diffusion_rad2_s):
    small = np.full_like(still().x_sd_nm, 1e-3)
    measured = still(
        speed_deg_s=np.full(6, np.degrees(omega_rad_s)),
        diffusion_rad2_s=np.full(6, diffusion_rad2_s), x_sd_nm=small, y_sd_nm=small,
    )  # fmt: skip
    made = drawn(measured, rods(200.0))
    middle = 0.5 * (EDGES[1:] + EDGES[:-1])
    counts = made.counts.sum(axis=(0, 1))
    rms = math.sqrt(counts @ middle**2 / counts.sum())
    factor = radius_factor(omega_rad_s, diffusion_rad2_s, FILM.exposure_s)
    assert factor < 0.95
    assert rms == pytest.approx(200.0 * factor, rel=0.01)


def test_rods_that_the_screening_would_refuse_are_nobodys_twin():
    # A ring of 5 nm radius at 10 nm uncertainty: sqrt(5^2 / 2 + 10^2) / 10 = 1.06 is below 1.3.
    measured = still(localisation_sd_nm=np.full(6, 10.0))
    made = drawn(measured, rods([10.0, 200.0]))
    assert (made.rod == 1).all()
    assert made.accepted == pytest.approx(0.5)
    assert made.unscreened == 0
    open_to_all = still(film=dataclasses.replace(FILM, min_spread=0.0))
    assert np.mean(drawn(open_to_all, rods([10.0, 200.0])).rod) == pytest.approx(0.5, abs=0.1)


def test_rotors_at_whose_noise_no_rod_passes_are_told():
    made = drawn(still(localisation_sd_nm=np.full(6, 500.0)), rods([10.0, 200.0]), twins=2)
    assert made.unscreened == 6
    assert made.accepted == 0.0


def test_rods_are_drawn_by_their_weight():
    made = drawn(still(), rods([150.0, 250.0], weight=[0.9, 0.1]), twins=200)
    assert np.mean(made.rod == 0) == pytest.approx(0.9, abs=0.03)


def test_speeds_are_rescaled_to_the_measured_ones_in_their_order_and_direction():
    measured = still(speed_deg_s=np.array([-100.0, 200.0, 300.0, -400.0, 500.0, np.nan]))
    rates = np.array([8000.0, -100.0, 20.0, -9000.0])
    found = rescaled_speeds_deg_s(measured, rods([50.0] * 4, rate_rev_s=rates))
    assert np.argsort(np.abs(found)).tolist() == [2, 1, 0, 3]
    assert (np.sign(found) == np.sign(rates)).all()
    # The middles of four equal weights: 1/8, 3/8, 5/8, 7/8 of 100 to 500.
    assert np.sort(np.abs(found)) == pytest.approx([150.0, 250.0, 350.0, 450.0])


def test_the_same_seed_gives_the_same_twins():
    measured = group(2, n=4)
    one, other = (drawn(measured, rods([100.0, 300.0]), seed=8, twins=3) for _ in range(2))
    assert (one.counts == other.counts).all()
    assert (one.true_nm == other.true_nm).all()
