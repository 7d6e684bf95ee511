"""Rings of both ends, and how the ends stand to each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.twocolour.rings import both_rings


def ends(seed, radii, phase, n=2000, noise=10.0, shift=(0.0, 0.0)):
    rng = np.random.default_rng(seed)
    theta = rng.uniform(0, 2 * math.pi, n)
    made = []
    for radius, ahead, off in ((radii[0], 0.0, (0, 0)), (radii[1], phase, shift)):
        angle = theta + ahead
        places = np.column_stack([radius * np.cos(angle), -radius * np.sin(angle)])
        made.append(places + np.array(off) + rng.normal(0, noise, (n, 2)))
    return made


@pytest.mark.parametrize(
    ("phase", "word"),
    [(0.3, "tandem"), (-0.6, "tandem"), (1.5, "skew"), (-2.0, "skew"), (3.0, "opposed"),
     (-2.9, "opposed")],
)  # fmt: skip
def test_ends_stand_as_they_were_put(phase, word):
    found = both_rings(*ends(1, (80.0, 140.0), phase))
    assert found.arrangement == word
    assert found.phase_rad == pytest.approx(phase, abs=0.02)
    assert found.first_radius_nm == pytest.approx(80.0, abs=5 * found.first_radius_sd_nm)
    assert found.second_radius_nm == pytest.approx(140.0, abs=5 * found.second_radius_sd_nm)
    # Noise of 10 nm on both radii.
    assert found.phase_sd_rad == pytest.approx(math.hypot(10 / 80, 10 / 140), rel=0.1)


def test_radii_tell_where_the_rod_is_held():
    assert both_rings(*ends(2, (80.0, 140.0), 3.0)).docking == "off-centre"
    assert both_rings(*ends(2, (100.0, 100.0), 3.0)).docking == "centred"
    assert both_rings(*ends(2, (100.0, 104.0), 3.0)).docking == "centred"


def test_an_end_on_the_axis_has_no_angle():
    found = both_rings(*ends(3, (100.0, 0.0), 0.0))
    assert found.arrangement == "centred"
    assert math.isnan(found.phase_rad)
    assert math.isnan(found.second_radius_nm)


def test_two_spots_are_no_rings():
    found = both_rings(*ends(4, (0.0, 0.0), 0.0, shift=(100.0, 0.0)))
    assert (found.arrangement, found.docking) == ("unknown", "unknown")


@settings(deadline=None, max_examples=20)
@given(st.floats(-math.pi, math.pi), st.tuples(st.floats(-50, 50), st.floats(-50, 50)))
def test_a_registration_error_moves_a_ring_and_turns_nothing(phase, shift):
    plain = both_rings(*ends(5, (90.0, 120.0), phase))
    moved = both_rings(*ends(5, (90.0, 120.0), phase, shift=shift))
    assert math.remainder(moved.phase_rad - plain.phase_rad, 2 * math.pi) == pytest.approx(
        0.0, abs=1e-6
    )
    assert moved.centres_apart_nm == pytest.approx(math.hypot(*shift), abs=2.0)


def test_blur_and_the_registrations_error_are_allowed_for():
    plain = both_rings(*ends(6, (90.0, 120.0), 1.0))
    found = both_rings(*ends(6, (90.0, 120.0), 1.0), registration_sd_nm=3.0, stretch=1.1)
    assert found.second_radius_nm == pytest.approx(1.1 * plain.second_radius_nm)
    assert found.centres_apart_sd_nm == pytest.approx(math.hypot(plain.centres_apart_sd_nm, 3.0))
