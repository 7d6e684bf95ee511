"""Linking: the same particles whatever the order of rows, gaps up to the memory, crowds."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from rotortrack.errors import InputError, LinkWarning
from rotortrack.motion.link import link


def columns(table):
    return tuple(table[name].to_numpy() for name in ("frame", "x_nm", "y_nm"))


def test_particles_far_apart_are_told_apart_in_whatever_order_rows_come(swimming):
    rng = np.random.default_rng(1)
    table = swimming(rng, 8, 100, missing=0.1, box_nm=100_000.0)
    mixed = table.sample(frac=1.0, random_state=1)
    for rows in (table, mixed):
        found = link(*columns(rows), search_range_nm=400.0, memory_frames=3)
        pairs = set(zip(found.particle, rows["truth"], strict=True))
        assert len(pairs) == 8
        assert not found.adaptive


def test_numbers_follow_the_first_appearance():
    frame = np.array([0, 1, 1, 2, 2])
    x = np.array([0.0, 0.0, 900.0, 900.0, 0.0])
    found = link(frame, x, np.zeros(5), search_range_nm=50.0, memory_frames=0)
    assert found.particle.tolist() == [0, 0, 1, 1, 0]


@pytest.mark.parametrize("memory", [0, 1, 2, 5])
def test_a_gap_of_the_memory_is_bridged_and_a_longer_one_is_not(memory):
    for gap in range(7):
        frame = np.array([0, 1, gap + 2, gap + 3])
        found = link(frame, np.zeros(4), np.zeros(4), search_range_nm=5.0, memory_frames=memory)
        assert found.particle.max() == (0 if gap <= memory else 1)


def test_a_gap_of_years_costs_no_time():
    frame = np.array([0, 1, 10**15])
    found = link(frame, np.zeros(3), np.zeros(3), search_range_nm=5.0, memory_frames=2)
    assert found.particle.tolist() == [0, 0, 1]


def test_no_spots_are_no_particles():
    found = link(np.empty(0, int), np.empty(0), np.empty(0), search_range_nm=5.0, memory_frames=1)
    assert found.particle.size == 0


def test_trackpy_stays_silent_and_keeps_its_own_logging(swimming, capfd):
    logger = logging.getLogger("trackpy")
    before = logger.level
    link(*columns(swimming(np.random.default_rng(2), 3, 20)), search_range_nm=300, memory_frames=0)
    assert capfd.readouterr() == ("", "")
    assert logger.level == before


def test_in_a_crowd_the_range_shrinks_and_the_user_is_told():
    rng = np.random.default_rng(3)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(12.0), np.arange(12.0)))
    place = np.concatenate([100 * np.stack([x, y]), 100 * np.stack([x, y])], axis=1)
    place = place + rng.normal(0, 2.0, place.shape)
    frame = np.repeat([0, 1], 144)
    with pytest.warns(LinkWarning, match="less far than 250 nm"):
        found = link(frame, *place, search_range_nm=250.0, memory_frames=0)
    assert found.adaptive
    assert (found.particle[:144] == found.particle[144:]).all()


def test_a_hopeless_crowd_is_refused():
    rng = np.random.default_rng(4)
    frame = np.repeat([0, 1], 400)
    with pytest.raises(InputError, match="too dense to be linked over 1000 nm"):
        link(frame, *rng.uniform(0, 300, (2, 800)), search_range_nm=1000.0, memory_frames=0)
