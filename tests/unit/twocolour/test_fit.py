"""Maps through beads against a known distortion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import RegistrationError
from rotortrack.twocolour.fit import best_map
from rotortrack.twocolour.maps import map_from_dict
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.smoother import Smoother

AUTO = RegisterOptions()
SEEDS = range(4)


def test_400_beads_with_10_nm_noise_give_an_error_below_3_5_nm(bead_pairs, target_error_nm):
    errors, claims, noises = [], [], []
    for seed in SEEDS:
        second, first = bead_pairs(seed)
        fit, telling = best_map(second, first, AUTO)
        errors.append(target_error_nm(fit.mapping))
        noises.append(telling.noise_nm)
        claims.append(telling.noise_nm * np.sqrt(fit.variance(second).mean()))
    assert np.sqrt(np.mean(np.square(errors))) <= 3.5
    # What is said of the error is within a quarter of it, and the noise within its own error.
    assert np.mean(claims) == pytest.approx(np.mean(errors), rel=0.25)
    assert np.mean(noises) == pytest.approx(10.0, rel=4.0 / np.sqrt(2 * 4 * 400))


def test_stiffer_maps_are_as_bad_as_theory_says(bead_pairs, target_error_nm):
    second, first = bead_pairs(0)
    affine, _ = best_map(second, first, RegisterOptions(model="affine"))
    cubic, _ = best_map(second, first, RegisterOptions(order=3))
    auto, _ = best_map(second, first, AUTO)
    errors = [target_error_nm(fit.mapping) for fit in (affine, cubic, auto)]
    assert errors[0] > 2.0 * errors[1] > 2.0 * errors[2]


def test_mismatches_are_found_and_do_not_pull(bead_pairs, target_error_nm):
    for seed in SEEDS:
        second, first = bead_pairs(seed)
        wrong = np.random.default_rng(seed).choice(400, 20, replace=False)
        first[wrong, 0] += 1500.0
        fit, _ = best_map(second, first, AUTO)
        assert set(np.flatnonzero(~fit.used)) == set(wrong)
        assert target_error_nm(fit.mapping) <= 4.0


@pytest.mark.parametrize("model", ["affine", "polynomial", "spline", "local-mean"])
def test_a_map_survives_its_file(bead_pairs, model):
    second, first = bead_pairs(1)
    fit, _ = best_map(second, first, RegisterOptions(model=model))
    again = map_from_dict(fit.mapping.as_dict())
    assert again.name == fit.mapping.name
    np.testing.assert_array_equal(again(second), fit.mapping(second))


def test_a_local_weighted_mean_follows_what_it_can(bead_pairs, target_error_nm):
    second, first = bead_pairs(2, noise_nm=3.0)
    fit, _ = best_map(second, first, RegisterOptions(model="local-mean"))
    assert target_error_nm(fit.mapping) < 4.0
    assert fit.mapping.name == "local weighted mean"


@pytest.mark.parametrize(
    ("n", "options"),
    [
        (5, AUTO),
        (11, RegisterOptions(order=2)),
        (23, RegisterOptions(model="spline", order=2)),
        (49, RegisterOptions(model="local-mean")),
    ],
)
def test_fewer_than_two_beads_a_parameter_are_refused(bead_pairs, n, options):
    second, first = bead_pairs(3, n=n)
    with pytest.raises(RegistrationError, match=r"too few beads: .* needs"):
        best_map(second, first, options)


def test_left_out_residuals_are_those_of_a_fit_without_the_bead():
    rng = np.random.default_rng(4)
    free, penalised = rng.normal(size=(60, 6)), rng.normal(size=(60, 20))
    targets, weights = rng.normal(size=(60, 2)), rng.uniform(0.2, 1.0, 60)
    whole = Smoother(free, penalised, weights).solve(targets, 3.0)
    for bead in (0, 17, 42):
        others = np.arange(60) != bead
        without = Smoother(free[others], penalised[others], weights[others]).solve(
            targets[others], 3.0
        )
        predicted = free[bead] @ without.free + penalised[bead] @ without.penalised
        np.testing.assert_allclose(whole.left_out[bead], targets[bead] - predicted, atol=1e-10)


@settings(max_examples=10)
@given(
    angle=st.floats(-3.0, 3.0),
    scale=st.floats(0.01, 100.0),
    x=st.floats(-1e6, 1e6),
    y=st.floats(-1e6, 1e6),
    seed=st.integers(0, 5),
)
def test_a_map_turns_scales_and_moves_with_the_first_colour(angle, scale, x, y, seed):
    rng = np.random.default_rng(seed)
    second = rng.uniform(0.0, 1e4, (40, 2))
    first = second + 1e-6 * (second - 5e3) ** 2 + rng.normal(0.0, 3.0, (40, 2))
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    options = RegisterOptions(order=2)
    plain = best_map(second, first, options)[0].mapping(second)
    moved = best_map(second, first @ turn.T + (x, y), options)[0].mapping(second)
    np.testing.assert_allclose(moved, plain @ turn.T + (x, y), atol=1e-5 * scale * 1e4 + 1e-3)


def test_the_order_of_beads_does_not_matter(bead_pairs):
    second, first = bead_pairs(6, n=100)
    order = np.random.default_rng(0).permutation(100)
    plain = best_map(second, first, AUTO)[0].mapping(second)
    shuffled = best_map(second[order], first[order], AUTO)[0].mapping(second)
    np.testing.assert_allclose(shuffled, plain, atol=1e-3)
