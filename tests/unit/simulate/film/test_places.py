"""Where pores are: what cannot be placed is refused, and what can is."""

from __future__ import annotations

import numpy as np
import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film.options import LatticeOptions
from rotortrack.simulate.film.places import lattice, scatter


def test_more_points_than_are_tried_for_few_are_placed_too():
    places = scatter(2300, (400, 500), 100.0, 8.0, 150.0, np.random.default_rng(3))
    assert places.shape == (2300, 2)
    assert np.all((places >= 800.0) & (places <= [49200.0, 39200.0]))
    assert len(np.unique(places, axis=0)) == 2300


def test_a_field_that_its_margins_fill_is_refused_by_the_names_of_its_options():
    with pytest.raises(ConfigurationError, match=r"16 x 12 px .*width_px and height_px"):
        scatter(1, (12, 16), 100.0, 8.0, 1500.0, np.random.default_rng(0))


def test_a_pitch_in_another_unit_is_refused_before_it_fills_the_memory():
    with pytest.raises(ConfigurationError, match=r"pitch_nm of 1\.5 .* 27725 x 27725 nm: raise it"):
        lattice(LatticeOptions(pitch_nm=1.5), (27725.0, 27725.0), 800.0, 1)
