"""Registrations: made of localised beads, kept in a file, used, and refused."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError, RegistrationError, RegistrationWarning
from rotortrack.twocolour.options import RegisterOptions
from rotortrack.twocolour.register import register_beads
from rotortrack.twocolour.registration import read_registration

PIXEL_NM = 100.0
SIDE_PX = 300
FIELD_NM = SIDE_PX * PIXEL_NM
REGIONS = ((0, 0, SIDE_PX, SIDE_PX), (SIDE_PX, 0, SIDE_PX, SIDE_PX))
AUTO = RegisterOptions()
BESIDE = np.array([FIELD_NM, 0.0])


def table(places, rng, frames=1, noise_nm=3.0, shift=(0.0, 0.0)):
    rows = [
        pd.DataFrame(
            {
                "frame": frame,
                "x_nm": places[:, 0] + shift[0] + rng.normal(0.0, noise_nm, len(places)),
                "y_nm": places[:, 1] + shift[1] + rng.normal(0.0, noise_nm, len(places)),
                "photons": 1e4,
                "uncertainty_nm": noise_nm,
            }
        )
        for frame in range(frames)
    ]
    return pd.concat(rows, ignore_index=True)


def films(distort, second, seed=0, **changes):
    """Tables of both colours; beads closer than 540 nm would be left out."""
    rng = np.random.default_rng(seed)
    beads = [table(places, rng, **changes) for places in (distort(second), second + BESIDE)]
    return [[one] for one in beads]


def apart(seed, n, low=0.0, high=FIELD_NM):
    """Places that keep 700 nm from each other."""
    rng = np.random.default_rng(seed)
    kept: list[np.ndarray] = []
    while len(kept) < n:
        place = rng.uniform(low, high, 2)
        if all(np.hypot(*(place - other)) > 700.0 for other in kept):
            kept.append(place)
    return np.array(kept)


@pytest.fixture(scope="module")
def made(distort):
    first, second = films(distort, apart(1, 250), frames=4)
    return register_beads(first, second, AUTO, pixel_size_nm=PIXEL_NM, regions=REGIONS)


def test_frames_of_a_bead_are_averaged_and_the_error_told_is_right(made, distort):
    assert made.n_beads > 200
    assert made.n_outliers == 0
    # Two colours, four frames: 3 nm times sqrt(2 / 4).
    assert made.bead_noise_nm == pytest.approx(3.0 * np.sqrt(0.5), rel=0.15)
    side = np.linspace(1000.0, FIELD_NM - 1000.0, 30)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    missed = made.to_first(grid + BESIDE) - distort(grid)
    error_nm = np.sqrt(np.mean(missed**2))
    assert made.target_error_nm == pytest.approx(error_nm, rel=0.35)
    told = np.sqrt(np.mean(made.error_nm(distort(grid)) ** 2))
    assert told == pytest.approx(error_nm, rel=0.35)
    assert made.systematic_nm < 1.0


@settings(max_examples=20)
@given(x=st.floats(0.0, FIELD_NM), y=st.floats(0.0, FIELD_NM))
def test_there_and_back_ends_where_it_began(made, x, y):
    place = np.array([[x, y]])
    np.testing.assert_allclose(made.to_first(made.to_second(place)), place, atol=1e-5)


def test_places_among_the_beads_are_told_from_those_outside(made):
    places = np.array([[15e3, 15e3], [-4e3, 15e3], [15e3, 40e3]])
    assert made.inside(places).tolist() == [True, False, False]


def test_a_registration_survives_its_file(made, tmp_path):
    path = tmp_path / "channels.json"
    made.write(path)
    again = read_registration(path)
    places = np.random.default_rng(0).uniform(0.0, FIELD_NM, (50, 2))
    np.testing.assert_array_equal(again.to_first(places), made.to_first(places))
    np.testing.assert_array_equal(again.error_nm(places), made.error_nm(places))
    assert again.regions == made.regions
    assert (again.n_beads, again.model, again.mirror) == (made.n_beads, made.model, made.mirror)
    content = json.loads(path.read_text())
    assert content["version"] == 1
    assert content["beads"] == made.n_beads


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("not json", "is not JSON"),
        ({"format": "something"}, "is no registration"),
        ({"version": 2}, "is of version 2, not 1"),
        ({"map": {"kind": "spline"}}, "is damaged"),
        ({"map": {"kind": "rubber", "order": 1}}, "is damaged"),
        ({"pairs": {}}, "is damaged"),
        ({"error": {"x_nm": [0, 1], "y_nm": [0, 1], "sd_nm": [[1, 2]]}}, "is damaged"),
    ],
)
def test_a_file_that_is_no_registration_is_refused(made, tmp_path, change, words):
    path = tmp_path / "channels.json"
    made.write(path)
    if isinstance(change, str):
        path.write_text(change)
    else:
        path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(RegistrationError, match=words):
        read_registration(path)


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_registration(tmp_path / "none.json")


def test_another_region_pixel_size_or_order_of_colours_is_refused(made):
    first, second = REGIONS
    made.check_regions(first, second, pixel_size_nm=PIXEL_NM)
    made.check_regions((10, 5, 100, 90), (310, 5, 100, 90), pixel_size_nm=PIXEL_NM)
    with pytest.raises(RegistrationError, match="swapped colours"):
        made.check_regions(second, first, pixel_size_nm=PIXEL_NM)
    with pytest.raises(RegistrationError, match=r"another region: .* x 300 to 600"):
        made.check_regions((0, 0, 400, 300), (400, 0, 400, 300), pixel_size_nm=PIXEL_NM)
    with pytest.raises(RegistrationError, match="another pixel size"):
        made.check_regions(first, second, pixel_size_nm=110.0)


def test_positions_of_the_stage_are_pooled_and_their_own_shift_is_not_taken_for_noise(distort):
    rng = np.random.default_rng(3)
    first, second = [], []
    for film in range(12):
        beads = apart(10 + film, 40)
        first.append(table(distort(beads), rng, shift=rng.normal(0.0, 12.0, 2)))
        second.append(table(beads + BESIDE, rng))
    made = register_beads(first, second, AUTO, pixel_size_nm=PIXEL_NM, regions=REGIONS)
    assert made.bead_noise_nm == pytest.approx(3.0 * np.sqrt(2.0), rel=0.15)
    assert made.jitter_nm == pytest.approx(12.0, rel=0.5)
    assert made.n_outliers == 0


def along_a_line(width_nm):
    rng = np.random.default_rng(8)
    along = np.cumsum(rng.uniform(600.0, 900.0, 36)) + 800.0
    across = rng.uniform(-width_nm, width_nm, along.size)
    return np.column_stack([along, 0.3 * along + 5000.0 + across])


def test_beads_on_a_line_are_refused():
    first, second = films(lambda places: places, along_a_line(0.0), noise_nm=0.0)
    with pytest.raises(RegistrationError, match=r"beads on a line: .* all over the field"):
        register_beads(first, second, AUTO, pixel_size_nm=PIXEL_NM, regions=REGIONS)


def test_beads_nearly_on_a_line_are_told():
    first, second = films(lambda places: places, along_a_line(700.0))
    with pytest.warns(RegistrationWarning, match="nearly on one line"):
        register_beads(first, second, AUTO, pixel_size_nm=PIXEL_NM, regions=REGIONS)


def test_beads_in_one_heap_are_refused(distort):
    first, second = films(distort, apart(2, 12, 14_000.0, 17_500.0))
    with pytest.raises(RegistrationError, match=r"beads in one heap: .* cover 0.8% of the field"):
        register_beads(first, second, AUTO, pixel_size_nm=PIXEL_NM, regions=REGIONS)


def test_much_of_the_field_without_beads_is_told(distort):
    first, second = films(distort, apart(2, 60, 10_000.0, 22_000.0))
    with pytest.warns(RegistrationWarning, match="cover 1.% of the field"):
        register_beads(first, second, AUTO, pixel_size_nm=PIXEL_NM, regions=REGIONS)


def test_beads_that_are_hardly_known_are_refused(distort):
    first, second = films(distort, apart(2, 60), noise_nm=8.0)
    with pytest.raises(RegistrationError, match="no bead is known to 5 nm"):
        register_beads(first, second, AUTO, pixel_size_nm=PIXEL_NM, regions=REGIONS)
