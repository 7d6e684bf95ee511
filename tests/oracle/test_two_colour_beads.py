"""Real beads in two colours: registered by some positions of the stage, judged by others."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from rotortrack.pipeline.register_run import localise_beads, register_movies
from rotortrack.settings import Layer
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.pairing import pair_beads
from rotortrack.twocolour.register import mean_places

PIXEL_NM = 110.0
LAYERS = [
    Layer(
        "test",
        {"movie": {"pixel_size_nm": PIXEL_NM, "channel": 0}, "channels": {"second_channel": 1}},
    )
]


@pytest.fixture(scope="module")
def found(reference_data):
    folder = reference_data("two_colour_beads")
    with warnings.catch_warnings():
        # The files are single ones of a set, and say so.
        warnings.simplefilter("ignore")
        made = register_movies(sorted((folder / "map").glob("*.tif")), [], LAYERS).registration
        films = [
            localise_beads(path, None, LAYERS) for path in sorted((folder / "test").glob("*.tif"))
        ]
    missed = []
    for first, second in ((film.first, film.second) for film in films):
        beads = [mean_places(table, RegisterOptions(), PIXEL_NM) for table in (first, second)]
        pairs = pair_beads(
            beads[0][:, :2],
            beads[1][:, :2],
            beads[0][:, 2],
            beads[1][:, 2],
            regions=made.regions,
            pixel_size_nm=PIXEL_NM,
            options=RegisterOptions(),
        )
        missed.append(beads[0][pairs.first, :2] - made.to_first(beads[1][pairs.second, :2]))
    return made, np.concatenate(missed)


def test_beads_that_were_not_used_are_met_within_9_nm(found):
    _, missed = found
    assert len(missed) > 180
    assert np.sqrt(np.mean(missed**2)) <= 9.0


def test_what_is_told_of_the_error_is_what_other_beads_show(found):
    made, missed = found
    told = np.sqrt(made.bead_noise_nm**2 + made.target_error_nm**2 + made.jitter_nm**2)
    assert told == pytest.approx(np.sqrt(np.mean(missed**2)), rel=0.25)


def test_order_three_suffices_for_real_optics(found):
    made, _ = found
    assert made.model == "polynomial of order 3"
    assert made.systematic_nm < 2.0
    assert made.n_beads > 450
