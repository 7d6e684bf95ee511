import dataclasses
import math

import numpy as np
import pytest

from rotortrack.simulate.rod.contact import deepest_nm
from rotortrack.simulate.rod.ends import EndNumbers, RodEnd, classify_end, end_numbers
from rotortrack.simulate.rod.options import RodOptions
from rotortrack.simulate.rod.parameters import rod_parameters

from .steps import at, straight, uniform_field

ROD = rod_parameters(RodOptions(), uniform_field())
RATE = 2e-6 * math.pi
"""One revolution a second."""

DOCKED = EndNumbers(
    rate_rad_us=100 * RATE,
    previous_rate_rad_us=90 * RATE,
    lowest_nm=2.7,
    nearest_nm=3.0,
    approach_nm=0.0,
    trans_part=0.0,
    deepest_nm=-2.6,
    deformation_nm_us=math.nan,
    settled=False,
)


@pytest.mark.parametrize(
    ("changes", "end"),
    [
        ({}, RodEnd.ROTATING_STEADILY),
        ({"rate_rad_us": -100 * RATE}, RodEnd.TIME_REACHED),
        ({"rate_rad_us": 60 * RATE}, RodEnd.TIME_REACHED),
        ({"rate_rad_us": 60 * RATE, "settled": True}, RodEnd.ROTATING_STEADILY),
        ({"rate_rad_us": 9 * RATE, "previous_rate_rad_us": -5 * RATE}, RodEnd.DOCKED_STILL),
        ({"trans_part": 0.51}, RodEnd.TRANSLOCATED),
        ({"trans_part": 0.5}, RodEnd.ROTATING_STEADILY),
        ({"deepest_nm": 2.9}, RodEnd.ROTATING_STEADILY),
        ({"deepest_nm": 3.1}, RodEnd.IN_MEMBRANE),
        ({"deepest_nm": 3.1, "trans_part": 0.51}, RodEnd.TRANSLOCATED),
        ({"lowest_nm": 4.1}, RodEnd.NOT_DOCKED),
        ({"lowest_nm": 3.9}, RodEnd.ROTATING_STEADILY),
        ({"nearest_nm": 51.0}, RodEnd.NOT_DOCKED),
        ({"nearest_nm": 51.0, "approach_nm": 5.0}, RodEnd.TIME_REACHED),
        ({"nearest_nm": 51.0, "approach_nm": 5.0, "settled": True}, RodEnd.NOT_DOCKED),
    ],
)
def test_end_is_named_by_its_numbers(changes, end):
    assert classify_end(dataclasses.replace(DOCKED, **changes), ROD) is end


def test_end_by_steps_is_told_from_the_end_of_time():
    assert classify_end(DOCKED, ROD, time_is_over=False) is RodEnd.STEP_LIMIT
    through = dataclasses.replace(DOCKED, trans_part=0.9)
    assert classify_end(through, ROD, time_is_over=False) is RodEnd.TRANSLOCATED


def test_a_wall_without_an_inside_has_no_rod_in_it():
    paper = rod_parameters(RodOptions(wall="z_only"), uniform_field())
    inside = dataclasses.replace(DOCKED, deepest_nm=8.0)
    assert classify_end(inside, paper) is RodEnd.ROTATING_STEADILY
    assert classify_end(inside, ROD) is RodEnd.IN_MEMBRANE


def test_depth_is_that_of_the_axis_between_vertices_too():
    # The middle of the link cuts the rim's corner (25, 10), both vertices are in the water.
    link = np.array([[[20.0, 0.0, 0.0], [40.0, 0.0, 14.0]], [[20.0, 0.0, 40.0], [40.0, 0.0, 40.0]]])
    assert deepest_nm(link[:1], ROD) == pytest.approx(3.0)
    assert deepest_nm(link[1:], ROD) == pytest.approx(-30.0)
    assert deepest_nm(link, ROD) == pytest.approx(3.0)


def test_every_end_has_a_sentence():
    assert len({end.sentence for end in RodEnd}) == len(RodEnd) == 7


def test_numbers_of_a_rod_that_turns():
    time = np.linspace(0.0, 80.0, 401)
    turned = np.where(time < 60.0, 0.02 * time, 1.2 + 0.03 * (time - 60.0))
    x = np.repeat((at(straight(), 0.0, 3.0, 12.0))[np.newaxis], 401, axis=0)
    numbers = end_numbers(time, x, turned, ROD)
    np.testing.assert_allclose(numbers.rate_rad_us, 0.03)
    np.testing.assert_allclose(numbers.previous_rate_rad_us, 0.02)
    np.testing.assert_allclose(numbers.rate_rev_s, 0.03e6 / (2.0 * np.pi))
    np.testing.assert_allclose(numbers.lowest_nm, 2.0)
    np.testing.assert_allclose(numbers.nearest_nm, math.hypot(3.0, 2.0))
    assert numbers.trans_part == 0.0
    assert numbers.approach_nm == 0.0
    assert not numbers.settled
    settled = end_numbers(time, x, turned, ROD, settled_us=10.0, deformation_nm_us=1e-4)
    np.testing.assert_allclose(settled.previous_rate_rad_us, 0.03)
    assert settled.settled


def test_vertices_below_the_trans_face_are_counted():
    x = straight(direction=(0, 0, 1))[np.newaxis]
    numbers = end_numbers(np.zeros(1), x, np.zeros(1), ROD)
    np.testing.assert_allclose(numbers.trans_part, np.mean(x[0, :, 2] < -10.0))
    assert math.isnan(numbers.rate_rad_us)
