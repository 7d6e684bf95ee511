import numpy as np
import pytest

from rotortrack.corrections.drift.radial_symmetry import radial_symmetry_centre


def blob(x0, y0, width=2.0, size=11, stretch=1.0):
    axis = np.arange(size) - size // 2
    x, y = np.meshgrid(axis, axis)
    return np.exp(-((x - x0) ** 2 + stretch * (y - y0) ** 2) / (2 * width**2))


@pytest.mark.parametrize(("farthest", "error"), [(0.5, 0.01), (2.5, 0.06)])
@pytest.mark.parametrize("width", [1.0, 1.5, 2.5, 4.0])
def test_noiseless_peak_is_found_to_a_hundredth_of_a_pixel_near_the_middle(farthest, error, width):
    for centre in np.random.default_rng(0).uniform(-farthest, farthest, (50, 2)):
        assert radial_symmetry_centre(100 * blob(*centre, width) + 3) == pytest.approx(
            centre, abs=error
        )


def test_x_runs_along_columns():
    x, y = radial_symmetry_centre(blob(1.5, 0.0))
    assert x == pytest.approx(1.5, abs=0.02)
    assert y == pytest.approx(0.0, abs=1e-9)


def test_transposing_exchanges_the_axes():
    image = blob(0.4, -1.1, stretch=1.7)
    x, y = radial_symmetry_centre(image)
    assert radial_symmetry_centre(image.T) == pytest.approx((y, x), abs=1e-12)


def test_scale_and_offset_of_the_image_do_not_matter():
    image = blob(0.4, -1.1)
    assert radial_symmetry_centre(1e9 * image + 1e6) == pytest.approx(
        radial_symmetry_centre(image), abs=1e-6
    )


def test_noisy_peak_is_found_without_bias():
    rng = np.random.default_rng(5)
    found = np.array(
        [radial_symmetry_centre(rng.poisson(200 * blob(0.35, -0.2) + 5)) for _ in range(300)]
    )
    error = found.mean(axis=0) - (0.35, -0.2)
    assert (np.abs(error) < 4 * found.std(axis=0) / np.sqrt(300)).all()
    assert found.std(axis=0).max() < 0.2


@pytest.mark.parametrize(
    "window", [np.zeros((11, 11)), np.ones((11, 11)), np.tile(np.arange(11.0), (11, 1))]
)
def test_flat_window_or_plain_slope_has_no_centre(window):
    assert np.isnan(radial_symmetry_centre(window)).all()
