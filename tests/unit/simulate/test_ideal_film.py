"""Films of ideal scenes: anchors that no analysis code shares, and streams that do not mix."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rotortrack.cameras.camera import Camera
from rotortrack.errors import CameraError, MovieError
from rotortrack.movies.movie import Movie
from rotortrack.simulate import ideal_film
from rotortrack.simulate.ideal import IdealRotor, IdealScene
from rotortrack.simulate.ideal_examples import example_scene
from rotortrack.simulate.ideal_film import film

CAMERA = Camera(offset_adu=100.0, gain_e_per_adu=0.4545, read_noise_e=1.4)
PIXEL = 100.0


def scene(*rotors, **changes):
    values = {
        "shape_px": (40, 60),
        "n_frames": 12,
        "pixel_size_nm": PIXEL,
        "frame_interval_s": 0.002,
        "exposure_s": 0.002,
        "sigma_nm": 125.0,
        "background_photons": 0.0,
    }
    return IdealScene(**(values | changes), rotors=rotors)


def rotor(kind="stuck", **changes):
    values = {"x_nm": 4070.0, "y_nm": 1530.0, "radius_nm": 120.0, "photons": 800.0}
    return IdealRotor(kind=kind, **(values | changes))


TURNING = rotor("driven", omega_rad_s=40.0, diffusion_rad2_s=8.0)


def shoot(what, seed=7, **options):
    return film(what, CAMERA, np.random.default_rng(seed), **options)


def centroid_nm(image):
    """Mean position of light: pixel (i, j) has its middle at (j + 0.5, i + 0.5)."""
    total = image.sum()
    x = (image.sum(axis=0) @ (np.arange(image.shape[1]) + 0.5)) / total
    y = (image.sum(axis=1) @ (np.arange(image.shape[0]) + 0.5)) / total
    return x * PIXEL, y * PIXEL


class TestAnchors:
    def test_centroid_of_a_bright_point_gives_x_along_columns_and_y_along_rows(self):
        point = rotor(radius_nm=0.0, photons=1e7, x_nm=4071.0, y_nm=1533.0)
        counts = shoot(scene(point), dtype=np.float64).frames(0, 1)[0]
        assert counts.shape == (40, 60)
        assert np.unravel_index(counts.argmax(), counts.shape) == (15, 40)
        x, y = centroid_nm(counts - 100.0)
        assert x == pytest.approx(4071.0, abs=0.2)
        assert y == pytest.approx(1533.0, abs=0.2)

    def test_positive_speed_is_drawn_right_then_top_then_left_then_bottom(self):
        quarter = np.pi / 2.0 / 0.002
        # A quarter turn a frame, exposed for a moment at the start of it.
        turning = rotor("driven", omega_rad_s=quarter, radius_nm=1000.0, x_nm=3050.0, y_nm=2050.0)
        frames = shoot(scene(turning, exposure_s=1e-6)).expected_photons(0, 4)
        brightest = [np.unravel_index(frame.argmax(), frame.shape) for frame in frames]
        assert brightest == [(20, 40), (10, 30), (20, 20), (30, 30)]

    def test_negative_speed_is_drawn_clockwise(self):
        quarter = np.pi / 2.0 / 0.002
        turning = rotor("driven", omega_rad_s=-quarter, radius_nm=1000.0, x_nm=3050.0, y_nm=2050.0)
        frame = shoot(scene(turning, exposure_s=1e-6)).expected_photons(1, 2)[0]
        assert np.unravel_index(frame.argmax(), frame.shape) == (30, 30)

    def test_photon_transfer_slope_of_a_still_scene_gives_the_gain(self):
        lights = [rotor(x_nm=1000.0 + 1000.0 * n, photons=1500.0 * (n + 1)) for n in range(5)]
        counts = shoot(scene(*lights, n_frames=1500, background_photons=8.0)).frames(0, 1500)
        mean, variance = counts.mean(axis=0).ravel(), counts.var(axis=0).ravel()
        slope, intercept = np.polyfit(mean - 100.0, variance, 1, w=1.0 / variance)
        assert 1.0 / slope == pytest.approx(0.4545, rel=0.01)
        assert intercept == pytest.approx((1.4 / 0.4545) ** 2 + 1.0 / 12.0, rel=0.15)

    def test_dark_frames_show_offset_and_read_noise(self):
        counts = shoot(scene(), dtype=np.float64).frames(0, 12)
        noise = np.sqrt((1.4 / 0.4545) ** 2 + 1.0 / 12.0)
        assert counts.mean() == pytest.approx(100.0, abs=5 * noise / np.sqrt(counts.size))
        assert counts.std() == pytest.approx(noise, rel=0.02)

    def test_light_of_a_frame_is_that_of_the_rotors_and_the_background(self):
        frames = shoot(scene(TURNING, rotor(), background_photons=3.0)).expected_photons(0, 12)
        expected = 2 * 800.0 + 3.0 * 40 * 60
        np.testing.assert_allclose(frames.sum(axis=(1, 2)), expected, rtol=1e-6)

    def test_noise_has_the_mean_of_the_expected_light(self):
        movie = shoot(scene(TURNING, n_frames=400, background_photons=3.0))
        photons = (movie.frames(0, 400).mean(axis=0) - 100.0) * 0.4545
        expected = movie.expected_photons(0, 400)
        error = np.sqrt((expected.mean(axis=0) + 1.4**2) / 400)
        pulls = (photons - expected.mean(axis=0)) / error
        assert np.abs(pulls).max() < 5.0
        assert np.mean(pulls**2) == pytest.approx(1.0, abs=0.12)


class TestTruth:
    @pytest.mark.parametrize("exposure_s", [0.002, 0.0005])
    def test_truth_is_the_centroid_of_the_rendered_light(self, exposure_s):
        fast = rotor("driven", omega_rad_s=600.0, diffusion_rad2_s=30.0, radius_nm=300.0)
        movie = shoot(scene(fast, exposure_s=exposure_s, drift_nm=(400.0, -250.0)))
        seen = np.array([centroid_nm(frame) for frame in movie.expected_photons(0, 12)])
        np.testing.assert_allclose(seen, movie.truth_spots[["x_nm", "y_nm"]], atol=1e-3)

    def test_radius_of_the_averaged_position_follows_the_blur_formula(self):
        omega = 0.6 * np.pi / 0.002
        movie = shoot(scene(rotor("driven", omega_rad_s=omega)))
        truth = movie.truth_spots
        radius = np.hypot(truth["x_nm"] - 4070.0, truth["y_nm"] - 1530.0)
        np.testing.assert_allclose(radius, 120.0 * np.sin(0.3 * np.pi) / (0.3 * np.pi), rtol=1e-3)

    def test_angle_is_counter_clockwise_on_screen_and_averaged_over_the_exposure(self):
        truth = shoot(scene(rotor("driven", omega_rad_s=30.0, start_rad=0.2))).truth_spots
        seen = np.arctan2(-(truth["y_nm"] - 1530.0), truth["x_nm"] - 4070.0)
        np.testing.assert_allclose(seen, truth["theta_rad"], atol=1e-9)
        expected = 0.2 + 30.0 * (0.002 * np.arange(12) + 0.001)
        np.testing.assert_allclose(truth["theta_rad"], expected, rtol=1e-12)

    def test_tables_have_a_row_a_spot_by_frame_and_a_row_a_rotor(self):
        movie = shoot(scene(TURNING, rotor(photons=500)))
        spots, rotors = movie.truth_spots, movie.truth_rotors
        assert list(spots) == ["frame", "rotor", "x_nm", "y_nm", "theta_rad", "photons"]
        assert spots["frame"].tolist() == np.repeat(np.arange(12), 2).tolist()
        assert spots["rotor"].tolist() == [0, 1] * 12
        assert spots["photons"].tolist() == [800.0, 500.0] * 12
        assert rotors["kind"].tolist() == ["driven", "stuck"]
        assert rotors["omega_rad_s"].tolist() == [40.0, 0.0]
        assert rotors["diffusion_rad2_s"].tolist() == [8.0, 0.0]

    def test_scene_without_rotors_has_empty_tables_and_flat_light(self):
        movie = shoot(scene(background_photons=2))
        assert movie.truth_spots.empty
        assert movie.truth_rotors.empty
        np.testing.assert_array_equal(movie.expected_photons(3, 5), np.full((2, 40, 60), 2.0))


class TestEffects:
    def test_dark_frames_come_as_often_as_asked_and_hold_no_light(self):
        movie = shoot(scene(TURNING, rotor(), n_frames=3000, dark_probability=0.3))
        truth = movie.truth_spots
        dark = truth["photons"] == 0.0
        assert dark.mean() == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / 6000))
        light = movie.expected_photons(0, 60).sum(axis=(1, 2))
        expected = truth.groupby("frame")["photons"].sum()[:60]
        np.testing.assert_allclose(light, expected, rtol=1e-6)

    def test_drift_moves_every_spot_and_changes_no_angle(self):
        still = shoot(scene(TURNING, rotor())).truth_spots
        moved = shoot(scene(TURNING, rotor(), drift_nm=(220.0, -110.0))).truth_spots
        pd.testing.assert_series_equal(moved["theta_rad"], still["theta_rad"])
        shift = np.repeat(np.linspace(0.0, 1.0, 12), 2)
        np.testing.assert_allclose(moved["x_nm"] - still["x_nm"], 220.0 * shift, atol=1e-9)
        np.testing.assert_allclose(moved["y_nm"] - still["y_nm"], -110.0 * shift, atol=1e-9)

    def test_adding_dark_frames_leaves_the_pixels_of_lit_frames_as_they_were(self):
        always = shoot(scene(TURNING, n_frames=40)).frames(0, 40)
        movie = shoot(scene(TURNING, n_frames=40, dark_probability=0.5))
        lit = movie.truth_spots["photons"].to_numpy() > 0.0
        assert 5 < lit.sum() < 35
        np.testing.assert_array_equal(movie.frames(0, 40)[lit], always[lit])

    def test_adding_a_rotor_changes_no_other_rotor(self):
        alone = shoot(scene(TURNING)).truth_spots
        both = shoot(scene(TURNING, rotor("brownian", diffusion_rad2_s=3.0))).truth_spots
        both = both[both["rotor"] == 0].reset_index(drop=True)
        pd.testing.assert_frame_equal(both, alone)

    def test_stuck_rotors_are_drawn_once_for_the_whole_movie(self, monkeypatch):
        drawn = []
        real = ideal_film.spot_images

        def count(*arguments):
            drawn.append(arguments[0].shape)
            return real(*arguments)

        monkeypatch.setattr(ideal_film, "spot_images", count)
        movie = shoot(scene(rotor(), rotor(x_nm=2000.0), n_frames=50), block_frames=5)
        movie.frames(0, 50)
        assert drawn == [(1, 1), (1, 1)]

    def test_effect_that_is_not_named_draws_from_no_stream(self, monkeypatch):
        asked = []
        real = np.random.SeedSequence

        def record(entropy, *, spawn_key):
            asked.append(spawn_key)
            return real(entropy, spawn_key=spawn_key)

        monkeypatch.setattr(ideal_film.np.random, "SeedSequence", record)
        shoot(scene(TURNING)).frames(0, 2)
        assert asked == [(0, 0), (2, 0), (2, 1)]
        asked.clear()
        shoot(scene(TURNING, dark_probability=0.1))
        assert asked == [(0, 0), (1, 0)]


class TestFilm:
    kinds = ("driven", "brownian", "stuck", "switching", "two_position")

    def example(self):
        rng = np.random.default_rng(11)
        return example_scene(self.kinds, rng=rng, shape_px=(48, 56), n_frames=30)

    def test_pixels_depend_neither_on_blocks_nor_on_the_order_of_asking(self):
        whole = shoot(self.example()).frames(0, 30)
        small = shoot(self.example(), block_frames=7)
        np.testing.assert_array_equal(small.frames(21, 30), whole[21:])
        np.testing.assert_array_equal(np.concatenate(list(small.blocks())), whole)
        assert [len(block) for block in small.blocks()] == [7, 7, 7, 7, 2]

    def test_drifting_pixels_do_not_depend_on_blocks(self):
        drifting = scene(TURNING, rotor(), drift_nm=(700.0, -300.0), background_photons=1.0)
        whole = shoot(drifting).expected_photons(0, 12)
        parts = [shoot(drifting).expected_photons(n, n + 1)[0] for n in range(12)]
        np.testing.assert_array_equal(parts, whole)

    def test_same_seed_films_the_same_and_another_seed_does_not(self):
        first, again, other = (shoot(self.example(), seed).frames(0, 5) for seed in (1, 1, 2))
        np.testing.assert_array_equal(first, again)
        assert np.mean(first != other) > 0.5

    def test_film_is_a_movie_with_metadata(self):
        with shoot(self.example()) as movie:
            assert isinstance(movie, Movie)
            assert movie.shape == (30, 48, 56)
            assert movie.reopen().frames(0, 1).dtype == movie.dtype == np.uint16
            assert movie.metadata["frame_interval_s"].value == 0.002
            with pytest.raises(MovieError):
                movie.frames(25, 31)

    def test_camera_maps_of_another_size_are_refused(self):
        maps = Camera(offset_adu=np.full((5, 5), 100.0), gain_e_per_adu=0.5, read_noise_e=1.0)
        with pytest.raises(CameraError):
            film(scene(), maps, np.random.default_rng(0))
