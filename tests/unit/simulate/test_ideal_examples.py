"""Example scenes: what was asked for, apart from one another, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.ideal_examples import (
    DIFFUSION_RAD2_S,
    PAPER_LIKE,
    RADIUS_NM,
    SPEED_RAD_S,
    example_scene,
)


def make(*arguments, seed=0, **options):
    return example_scene(*arguments, rng=np.random.default_rng(seed), **options)


def closest_nm(scene):
    places = np.array([[rotor.x_nm, rotor.y_nm] for rotor in scene.rotors])
    between = np.hypot(*(places[:, np.newaxis] - places).transpose(2, 0, 1))
    return between[np.triu_indices(len(places), 1)].min()


@pytest.mark.parametrize("seed", range(5))
def test_eight_rotors_in_the_default_frame_are_1500_nm_apart_and_off_the_edge(seed):
    scene = make(seed=seed)
    assert closest_nm(scene) >= 1500.0
    for rotor in scene.rotors:
        x_px, y_px = rotor.x_nm / 108.3, rotor.y_nm / 108.3
        assert 7.0 < x_px < 96 - 7.0
        assert 7.0 < y_px < 64 - 7.0


def test_default_kinds_are_those_of_the_sample():
    rotors = make().rotors
    kinds = [rotor.kind for rotor in rotors]
    assert kinds == ["driven"] * 5 + ["brownian", "stuck", "two_position"]
    assert np.sign([rotor.omega_rad_s for rotor in rotors]).tolist() == [1, 1, 1, -1, -1, 0, 0, 0]


def test_values_spread_over_their_ranges_and_speeds_have_both_signs():
    rotors = make(("driven",) * 60, shape_px=(256, 256)).rotors
    omega = np.array([rotor.omega_rad_s for rotor in rotors])
    assert 15 < np.count_nonzero(omega > 0) < 45
    for values, (low, high) in (
        (np.abs(omega), SPEED_RAD_S),
        (np.array([rotor.diffusion_rad2_s for rotor in rotors]), DIFFUSION_RAD2_S),
        (np.array([rotor.radius_nm for rotor in rotors]), RADIUS_NM),
    ):
        assert low <= values.min() < low + 0.15 * (high - low)
        assert high - 0.2 * (high - low) < values.max() <= high
    # Uniform in the logarithm: half of them below the geometric mean.
    below = np.count_nonzero(np.abs(omega) < np.sqrt(SPEED_RAD_S[0] * SPEED_RAD_S[1]))
    assert 15 < below < 45


def test_same_seed_gives_the_same_scene_and_other_kinds_the_same_places():
    assert make(seed=3) == make(seed=3)
    stuck = make(("stuck",) * len(PAPER_LIKE), seed=3)
    for one, other in zip(make(seed=3).rotors, stuck.rotors, strict=True):
        assert (one.x_nm, one.y_nm, one.photons) == (other.x_nm, other.y_nm, other.photons)


def test_rotors_move_closer_when_the_frame_is_too_small_for_the_distance():
    scene = make(("brownian", "switching") * 8, shape_px=(40, 40))
    assert 500.0 < closest_nm(scene) < 1500.0


def test_frame_without_room_for_a_spot_is_refused():
    with pytest.raises(ConfigurationError, match="shape_px"):
        make(shape_px=(14, 96))
