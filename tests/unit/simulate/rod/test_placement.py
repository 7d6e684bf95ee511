import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.simulate.rod.options import RodOptions, StartOptions
from rotortrack.simulate.rod.placement import PLACEMENTS, place_rod


def test_placements_are_the_three_of_the_phase_diagram():
    assert PLACEMENTS == ((0.0, 3.0), (40.0, 8.0), (90.0, 15.0))


@given(
    st.integers(3, 101),
    st.floats(-200.0, 200.0),
    st.floats(-200.0, 200.0),
    st.floats(-60.0, 60.0),
    st.floats(0.0, 3.0),
)
def test_rod_has_its_links_its_height_and_its_offset(n, offset_x, offset_y, tilt, jitter):
    start = StartOptions(
        offset_x_nm=offset_x,
        offset_y_nm=offset_y,
        tilt_deg=tilt,
        height_nm=7.0,
        jitter_nm=jitter,
        seed=5,
    )
    x = place_rod(RodOptions(n_vertices=n), start, membrane_nm=20.0)
    lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
    np.testing.assert_allclose(lengths, 450.0 / (n - 1), rtol=1e-9)
    np.testing.assert_allclose(x[:, 2].min(), 17.0)
    np.testing.assert_allclose(x[:, :2].mean(axis=0), [offset_x, offset_y], atol=1e-9)


def test_mirrored_start_is_the_exact_mirror_image():
    options = {"offset_x_nm": 40.0, "offset_y_nm": 8.0, "azimuth_deg": 33.0, "jitter_nm": 0.1}
    x = place_rod(RodOptions(), StartOptions(**options))
    mirrored = place_rod(RodOptions(), StartOptions(**options, mirrored=True))
    np.testing.assert_array_equal(mirrored, x * [1.0, -1.0, 1.0])


def test_azimuth_turns_counter_clockwise_seen_from_cis():
    x = place_rod(RodOptions(), StartOptions(offset_y_nm=0.0, tilt_deg=0.0, azimuth_deg=90.0))
    np.testing.assert_allclose(x[-1], [0.0, 225.0, 5.0], atol=1e-9)


def test_jitter_is_drawn_from_its_seed():
    def placed(seed):
        return place_rod(RodOptions(), StartOptions(jitter_nm=0.5, seed=seed))

    np.testing.assert_array_equal(placed(1), placed(1))
    assert np.abs(placed(1) - placed(2)).max() > 0.1


@pytest.mark.parametrize("tilt", [0.2, -0.2])
def test_default_tilt_breaks_the_mirror_symmetry(tilt):
    x = place_rod(RodOptions(), StartOptions(tilt_deg=tilt))
    np.testing.assert_allclose(x[-1, 2] - x[0, 2], 450.0 * np.sin(np.radians(tilt)))
