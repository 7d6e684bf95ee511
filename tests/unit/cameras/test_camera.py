"""Counts and photo-electrons, numbers and maps, and the camera that options describe."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotortrack.cameras.camera import Camera, camera_from_options
from rotortrack.cameras.models import MODELS
from rotortrack.cameras.options import CameraOptions
from rotortrack.errors import CameraError, ConfigurationError, NominalCameraWarning

SHAPE = (6, 9)


def maps() -> dict[str, NDArray[np.float64]]:
    rng = np.random.default_rng(1)
    return {
        "offset_adu": rng.uniform(95, 105, SHAPE),
        "gain_e_per_adu": rng.uniform(0.4, 0.5, SHAPE),
        "read_noise_e": rng.uniform(1, 3, SHAPE),
    }


@given(
    offset=st.floats(0, 500),
    gain=st.floats(0.05, 10),
    photons=st.floats(0, 5000),
)
def test_photons_of_noiseless_counts_are_the_photons(
    offset: float, gain: float, photons: float
) -> None:
    counts = np.full((1, 2, 3), photons / gain + offset)
    found = Camera(offset, gain, 0.0).to_photons(counts)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, photons, atol=1e-6 * (photons + gain * offset) + 1e-5)


def test_maps_act_pixel_by_pixel_on_integer_counts_below_the_offset() -> None:
    values = maps()
    counts = np.random.default_rng(2).integers(0, 400, (4, *SHAPE)).astype(np.uint16)
    expected = (counts.astype(float) - values["offset_adu"]) * values["gain_e_per_adu"]
    found = Camera(**values).to_photons(counts)
    assert found.min() < 0
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


def test_drawn_counts_have_the_mean_and_variance_of_the_camera() -> None:
    camera = Camera(100.0, 0.4545, 1.4)
    counts = camera.to_counts(np.full((400, 25, 40), 30.0), np.random.default_rng(3))
    assert counts.dtype == np.uint16
    # 400 000 draws: the mean is known to 0.02 counts, the variance to 0.2 %; rounding adds 1/12.
    assert counts.mean() == pytest.approx(100 + 30 / 0.4545, abs=0.08)
    assert counts.var() == pytest.approx((30 + 1.4**2) / 0.4545**2 + 1 / 12, rel=0.01)


def test_read_noise_map_sets_the_variance_of_each_pixel() -> None:
    camera = Camera(**maps())
    counts = camera.to_counts(np.zeros((4000, *SHAPE)), np.random.default_rng(4))
    electrons = camera.to_photons(counts)
    rounding = np.asarray(camera.gain_e_per_adu) ** 2 / 12
    ratio = electrons.var(axis=0) / (np.asarray(camera.variance_e2) + rounding)
    np.testing.assert_allclose(ratio, 1.0, atol=0.12)


def test_counts_are_clipped_to_type_and_saturation() -> None:
    bright = np.array([[0.0, 1e6]])
    rng = np.random.default_rng(5)
    assert Camera(-500.0, 1.0, 0.0).to_counts(bright, rng).tolist() == [[0, 65535]]
    assert Camera(100.0, 1.0, 0.0, 4095.0).to_counts(bright, rng).tolist() == [[100, 4095]]
    assert Camera(100.0, 1.0, 0.0).to_counts(bright, rng, np.uint8).tolist() == [[100, 255]]


def test_same_generator_state_draws_the_same_counts() -> None:
    camera, photons = Camera(100.0, 0.5, 1.5), np.full((3, 4, 5), 20.0)
    one, other = (camera.to_counts(photons, np.random.default_rng(6)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_cropped_camera_equals_cropped_frames() -> None:
    camera = Camera(**maps(), saturation_adu=4095.0)
    counts = np.random.default_rng(7).integers(0, 400, (2, *SHAPE)).astype(np.uint16)
    found = camera.crop(2, 1, 5, 4).to_photons(counts[:, 1:5, 2:7])
    np.testing.assert_array_equal(found, camera.to_photons(counts)[:, 1:5, 2:7])
    number = Camera(100.0, 0.5, 1.0)
    assert number.is_scalar
    assert not camera.is_scalar
    assert number.crop(2, 1, 5, 4).offset_adu == 100.0
    with pytest.raises(CameraError, match=r"9 x 6 pixels, the region x 5 to 10"):
        camera.crop(5, 0, 5, 6)


def test_maps_of_another_size_than_the_frames_name_both_sizes() -> None:
    with pytest.raises(CameraError, match=r"9 x 6 pixels .* but the frames 9 x 7"):
        Camera(**maps()).to_photons(np.zeros((2, 7, 9), np.uint16))
    with pytest.raises(CameraError, match=r"differ in size: .*6 x 9.*5 x 9"):
        Camera(100.0, maps()["gain_e_per_adu"], np.ones((5, 9)))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gain_e_per_adu", np.nan),
        ("gain_e_per_adu", 0.0),
        ("gain_e_per_adu", -1.0),
        ("offset_adu", np.inf),
        ("read_noise_e", -0.1),
    ],
)
def test_impossible_values_are_refused_with_their_place(name: str, value: float) -> None:
    values = maps()
    values[name][2, 3] = value
    with pytest.raises(CameraError, match=rf"{name} is {value:g} at row 2, column 3 \(1 of 54"):
        Camera(**values)
    numbers = {"offset_adu": 100.0, "gain_e_per_adu": 0.5, "read_noise_e": 1.0, name: value}
    with pytest.raises(CameraError, match=rf"{name} is {value:g}: "):
        Camera(**numbers)


def test_impossible_photons_and_map_shapes_are_refused() -> None:
    rng = np.random.default_rng(8)
    for photons in (-1.0, np.nan, np.inf):
        with pytest.raises(CameraError, match="finite and not negative"):
            Camera(100.0, 0.5, 1.0).to_counts(np.full((2, 2), photons), rng)
    with pytest.raises(CameraError, match=r"shape \(9,\)"):
        Camera(100.0, np.ones(9), 1.0)


def test_three_numbers_make_a_camera() -> None:
    camera = camera_from_options(
        CameraOptions(offset_adu=100.0, gain_e_per_adu=0.4545, read_noise_e=1.4)
    )
    assert (camera.offset_adu, camera.gain_e_per_adu, camera.read_noise_e) == (100.0, 0.4545, 1.4)
    assert camera.saturation_adu is None


def test_every_missing_value_is_named_with_its_flag() -> None:
    with pytest.raises(ConfigurationError) as caught:
        camera_from_options(CameraOptions(gain_e_per_adu=0.5))
    sentence = str(caught.value)
    for flag in ("--offset-adu", "--read-noise-e", "--camera-maps", "--camera-model"):
        assert flag in sentence
    assert "--gain-e-per-adu" not in sentence


@pytest.mark.parametrize("name", MODELS)
def test_nominal_model_gives_its_values_and_a_number_overrides_them(name: str) -> None:
    with pytest.warns(NominalCameraWarning, match="measure them"):
        camera = camera_from_options(CameraOptions(camera_model=name.upper(), offset_adu=123.0))
    model = MODELS[name]
    assert (camera.offset_adu, camera.gain_e_per_adu) == (123.0, model.gain_e_per_adu)
    assert camera.saturation_adu == 2**model.bits - 1
    assert "nominal" in model.description


def test_unknown_model_and_maps_beside_a_model_are_configuration_errors() -> None:
    with pytest.raises(ConfigurationError, match="known are prime-bsi"):
        camera_from_options(CameraOptions(camera_model="polaroid"))
    with pytest.raises(ConfigurationError, match="both given"):
        camera_from_options(CameraOptions(camera_model="polaroid", camera_maps="x.npz"))


def test_maps_are_loaded_from_npz_and_a_number_overrides_them(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    np.savez(path, **maps(), saturation_adu=4095)
    camera = camera_from_options(CameraOptions(camera_maps=str(path), read_noise_e=1.0))
    np.testing.assert_array_equal(camera.gain_e_per_adu, maps()["gain_e_per_adu"])
    assert camera.read_noise_e == 1.0
    assert camera.saturation_adu == 4095


def test_unusable_map_files_are_camera_errors(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"

    def sentence() -> str:
        with pytest.raises(CameraError) as caught:
            camera_from_options(CameraOptions(camera_maps=str(path)))
        assert str(path) in str(caught.value)
        return str(caught.value)

    assert "cannot be read" in sentence()
    np.savez(path, gain_e_per_adu=maps()["gain_e_per_adu"])
    assert "lacks offset_adu, read_noise_e" in sentence()
    assert "--offset-adu, --read-noise-e" in sentence()
    np.savez(path, **{**maps(), "offset_adu": np.array([{"a": 1}], dtype=object)})
    assert "cannot be read" in sentence()
    np.savez(path, **{**maps(), "offset_adu": np.array("text")})
    assert "save it as numbers" in sentence()
    path.write_bytes(b"PK\x03\x04 broken")
    assert "cannot be read" in sentence()
    path.write_text("offset_adu = 100")
    assert "cannot be read" in sentence()
    with path.open("wb") as file:
        np.save(file, np.ones(3))
    assert "one array" in sentence()


def test_hot_and_dead_pixels_are_kept_cut_and_checked(tmp_path: Path) -> None:
    hot, dead = np.zeros((2, *SHAPE), np.bool_)
    hot[1, 2], dead[3, 4] = True, True
    path = tmp_path / "camera.npz"
    np.savez(path, **maps(), hot_pixels=hot, dead_pixels=dead.astype(np.uint8))
    camera = camera_from_options(CameraOptions(camera_maps=str(path)))
    np.testing.assert_array_equal(camera.hot_pixels, hot)
    np.testing.assert_array_equal(camera.dead_pixels, dead)
    assert np.argwhere(np.isinf(camera.variance_e2)).tolist() == [[3, 4]]
    assert np.argwhere(np.isnan(camera.to_photons(np.ones((2, *SHAPE))))).tolist() == [
        [0, 3, 4],
        [1, 3, 4],
    ]
    cut = camera.crop(1, 1, 6, 4)
    assert np.argwhere(cut.hot_pixels).tolist() == [[0, 1]]
    assert np.argwhere(cut.dead_pixels).tolist() == [[2, 3]]
    with pytest.raises(CameraError, match="hot_pixels has 9 x 6 pixels"):
        Camera(100.0, 0.5, 1.0, hot_pixels=hot).check_fits(6, 10)
    with pytest.raises(CameraError, match=r"differ in size: .*dead_pixels 5 x 9"):
        Camera(**maps(), dead_pixels=dead[:5])
    with pytest.raises(CameraError, match="hot_pixels is no"):
        Camera(**maps(), hot_pixels=hot.astype(float))
    for wrong in (hot * 2.0, hot[0], np.bool_(True), np.full(SHAPE, np.nan)):
        np.savez(path, **maps(), hot_pixels=wrong)
        with pytest.raises(CameraError, match=r"camera\.npz: hot_pixels is no .*map of 0 and 1"):
            camera_from_options(CameraOptions(camera_maps=str(path)))
    np.savez(path, **{**maps(), "offset_adu": hot})
    with pytest.raises(CameraError, match="offset_adu is bool: save it as numbers"):
        camera_from_options(CameraOptions(camera_maps=str(path)))


def test_maps_that_tell_no_hot_pixels_get_them_from_their_read_noise(tmp_path: Path) -> None:
    values = maps()
    values["read_noise_e"][2, 3] = 50.0
    path = tmp_path / "camera.npz"
    np.savez(path, **values)
    options = CameraOptions(camera_maps=str(path))
    assert np.argwhere(camera_from_options(options).hot_pixels).tolist() == [[2, 3]]
    np.savez(path, **values, hot_pixels=np.zeros(SHAPE, np.bool_))
    assert not np.any(camera_from_options(options).hot_pixels)
    np.savez(path, **{**values, "read_noise_e": 1.4})
    assert camera_from_options(options).hot_pixels is None
