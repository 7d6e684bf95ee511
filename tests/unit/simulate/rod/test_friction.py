"""Friction: tangents against circles, sums against the whole rod's drag."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.rod.friction import drag_frames
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters


def frames(x, **options):
    tangent, zeta = np.empty((len(x), 3)), np.empty((len(x), 2))
    drag_frames(x, rod_parameters(RodOptions(n_vertices=len(x), **options), None), tangent, zeta)
    return tangent, zeta


def test_half_ends_make_the_drag_of_the_whole_rod_exact(wavy):
    zeta = frames(wavy)[1]
    # pi eta L, with 1 mPa s = 1e-3 pN us/nm^2
    np.testing.assert_allclose(zeta.sum(axis=0), math.pi * 1e-3 * 450.0 * np.array([1.0, 0.5]))


def test_full_ends_carry_one_more_segment(wavy):
    zeta = frames(wavy, end_weight="full")[1]
    np.testing.assert_allclose(zeta[:, 0], math.pi * 1e-3 * 9.0)


def test_secants_of_a_circle_are_its_tangents():
    angle = 0.1 * np.arange(30)
    x = 90.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros(30)], axis=1)
    tangent = frames(x)[0]
    exact = np.stack([-np.sin(angle), np.cos(angle), np.zeros(30)], axis=1)
    np.testing.assert_allclose(tangent[1:-1], exact[1:-1], atol=1e-14)
    for end, neighbour in ((0, 1), (29, 28)):
        edge = x[max(end, neighbour)] - x[min(end, neighbour)]
        np.testing.assert_allclose(tangent[end], edge / np.linalg.norm(edge), atol=1e-14)


def test_friction_grows_with_viscosity_prefactor_and_printed_length(wavy):
    plain = frames(wavy)[1]
    np.testing.assert_allclose(frames(wavy, viscosity_mpa_s=0.85)[1], 0.85 * plain)
    np.testing.assert_allclose(frames(wavy, friction_prefactor=3 * math.pi)[1], 3 * plain)
    np.testing.assert_allclose(frames(wavy, friction_length_nm=30.0)[1], plain * 30.0 / 9.0)


def test_slender_body_friction_of_an_8_nm_bundle_is_four_fifths_of_pi(wavy):
    ratio = frames(wavy, friction="slender_body")[1] / frames(wavy)[1]
    np.testing.assert_allclose(ratio, 4 / (math.log(450.0 / 8.0) + 0.84))
    assert ratio[0, 0] == pytest.approx(0.82, abs=0.005)


def test_a_stubby_rod_is_no_slender_body():
    with pytest.raises(RodError, match="friction = 'resistive'"):
        rod_parameters(RodOptions(length_nm=15.0, friction="slender_body"), None)
