"""The engine: the same answer for any workers and blocks, and a flag for every oddity."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.special import ndtr

from rotortrack.cameras.camera import Camera
from rotortrack.errors import CameraError, ConfigurationError, MovieError
from rotortrack.flags import FitFlag
from rotortrack.localise.engine import localise, localise_all
from rotortrack.localise.options import LocaliseOptions
from rotortrack.movies.movie import ArrayMovie
from rotortrack.movies.select import select
from rotortrack.tables import LOCALISATIONS

CAMERA = Camera(offset_adu=100.0, gain_e_per_adu=0.5, read_noise_e=1.5)
PIXEL = 100.0
SPOTS = np.array([[10.3, 8.6], [30.8, 20.2], [18.5, 26.5]])


def film(frames=12, shape=(34, 40), photons=1500.0, seed=0):
    """Frames in counts with spots at SPOTS (x, y in pixels from the outer corner)."""
    rng = np.random.default_rng(seed)
    expected = np.full(shape, 6.0)
    for x, y in SPOTS:
        gx = np.diff(ndtr((np.arange(shape[1] + 1) - x) / 1.3))
        gy = np.diff(ndtr((np.arange(shape[0] + 1) - y) / 1.3))
        expected += photons * gy[:, None] * gx[None, :]
    electrons = rng.poisson(expected, (frames, *shape)) + rng.normal(0, 1.5, (frames, *shape))
    return np.round(electrons / 0.5 + 100).astype(np.uint16)


def run(movie, **options):
    return localise_all(movie, CAMERA, LocaliseOptions(**options), pixel_size_nm=PIXEL)


def test_spots_are_found_where_they_are():
    table = run(ArrayMovie(film(frames=200)))
    bright = table[table["photons"] > 500]
    assert len(bright) == 200 * len(SPOTS)
    for x, y in SPOTS:
        own = np.hypot(bright["x_nm"] - x * PIXEL, bright["y_nm"] - y * PIXEL) < 50
        assert own.sum() == 200
        assert abs(bright.loc[own, "x_nm"].mean() - x * PIXEL) < 1.5
        assert abs(bright.loc[own, "y_nm"].mean() - y * PIXEL) < 1.5
        assert bright.loc[own, "photons"].mean() == pytest.approx(1500, rel=0.015)
        assert bright.loc[own, "sigma_nm"].mean() == pytest.approx(130, rel=0.01)
        assert bright.loc[own, "background"].mean() == pytest.approx(6, rel=0.05)


def test_table_has_the_schemas_columns_and_types():
    table = run(ArrayMovie(film()))
    dtypes = {name: str(dtype) for name, dtype in table.dtypes.items()}
    assert dtypes == {k: v for k, v in LOCALISATIONS.dtypes.items() if k != "rotor"}
    assert table["frame"].is_monotonic_increasing


@pytest.mark.parametrize("workers", [1, 2, 3])
@pytest.mark.parametrize("block_frames", [1, 5, 64])
def test_the_answer_is_the_same_to_the_last_bit_for_any_workers_and_blocks(workers, block_frames):
    movie = ArrayMovie(film())
    reference = run(movie)
    blocks = localise(
        movie,
        CAMERA,
        LocaliseOptions(),
        pixel_size_nm=PIXEL,
        workers=workers,
        block_frames=block_frames,
    )
    columns = [block.columns for block in blocks]
    for name in reference:
        joined = np.concatenate([part[name] for part in columns])
        assert joined.tobytes() == reference[name].to_numpy().tobytes()


def test_a_region_keeps_sensor_coordinates_and_frame_numbers():
    whole = ArrayMovie(film())
    part = select(whole, (20, 10, 20, 22), (3, 9))
    table = run(part)
    bright = table[table["photons"] > 500]
    assert set(bright["frame"]) == set(range(3, 9))
    distance = np.hypot(bright["x_nm"] - 3080, bright["y_nm"] - 2020)
    assert (distance < 60).sum() == 6


def test_saturated_pixels_are_flagged_only_where_they_are():
    counts = film()
    counts[4, 8, 10] = 65535
    table = run(ArrayMovie(counts))
    flagged = table[table["fit_flags"] & int(FitFlag.SATURATED) != 0]
    assert set(flagged["frame"]) == {4}
    assert (np.hypot(flagged["x_nm"] - 1030, flagged["y_nm"] - 860) < 500).all()


def test_pixels_without_a_number_are_masked_and_flagged():
    counts = film().astype(np.float32)
    counts[:, 21, 29] = np.nan
    counts[2] = np.nan
    table = run(ArrayMovie(counts))
    near = np.hypot(table["x_nm"] - 3080, table["y_nm"] - 2020) < 60
    assert near.sum() == 11
    assert (table.loc[near, "fit_flags"] & int(FitFlag.MASKED_PIXELS) != 0).all()
    assert not (table["frame"] == 2).any()
    assert np.isfinite(table[["x_nm", "y_nm", "photons"]]).all().all()


@pytest.mark.parametrize("shift", [False, True])
def test_dead_pixels_of_the_camera_are_no_missing_numbers_of_the_movie(shift):
    dead = np.zeros((34, 40), bool)
    dead[20, 31] = True
    blocks = localise(
        ArrayMovie(film(frames=2)),
        Camera(100.0, 0.5, 1.5, dead_pixels=dead),
        LocaliseOptions(shift_negative_frames=shift),
        pixel_size_nm=PIXEL,
    )
    assert [block.counts.masked_pixels for block in blocks] == [0]


def test_negative_counts_do_no_harm():
    table = run(ArrayMovie(film().astype(np.int16) - 150))
    assert np.isfinite(table["x_nm"]).all()


def test_a_frame_without_spots_gives_an_empty_table_with_all_columns():
    table = run(ArrayMovie(np.full((3, 20, 20), 100, np.uint16)), threshold=50.0)
    assert len(table) == 0
    assert list(table) == [name for name in LOCALISATIONS.names if name != "rotor"]


def test_a_frame_smaller_than_the_window_is_refused():
    with pytest.raises(MovieError, match="6 x 20 pixels"):
        run(ArrayMovie(np.zeros((3, 20, 6), np.uint16)))


def test_maps_of_the_wrong_size_are_refused():
    camera = Camera(offset_adu=np.full((9, 9), 100.0), gain_e_per_adu=0.5, read_noise_e=1.0)
    with pytest.raises(CameraError, match="9"):
        localise_all(ArrayMovie(film()), camera, pixel_size_nm=PIXEL)


def test_a_wrong_threshold_is_refused():
    with pytest.raises(ConfigurationError, match=r"Wave\.F9"):
        run(ArrayMovie(film()), threshold="std(Wave.F9)")


@pytest.mark.parametrize(("order", "scale"), [(1, 2.0), (3, 0.5)])
def test_a_filter_that_shows_no_spot_is_refused(order, scale):
    with pytest.raises(ConfigurationError, match="single pixel"):
        run(ArrayMovie(film()), wavelet_order=order, wavelet_scale=scale)


@pytest.mark.parametrize("block_frames", [0, -1])
def test_blocks_without_frames_are_refused(block_frames):
    blocks = localise(
        ArrayMovie(film()),
        Camera(100.0, 0.45, 1.6),
        LocaliseOptions(),
        pixel_size_nm=100.0,
        block_frames=block_frames,
    )
    with pytest.raises(ConfigurationError, match="block_frames"):
        list(blocks)


def test_per_pixel_maps_of_a_uniform_camera_change_nothing():
    shape = (34, 40)
    maps = Camera(
        offset_adu=np.full(shape, 100.0),
        gain_e_per_adu=np.full(shape, 0.5),
        read_noise_e=np.full(shape, 1.5),
    )
    movie = ArrayMovie(film())
    with_maps = localise_all(movie, maps, pixel_size_nm=PIXEL)
    np.testing.assert_allclose(with_maps["x_nm"], run(movie)["x_nm"], rtol=1e-9)


def test_localising_needs_no_pandas():
    program = (
        "import sys, numpy as np\n"
        "from rotortrack.localise.engine import localise\n"
        "assert 'pandas' not in sys.modules and 'matplotlib' not in sys.modules\n"
        "assert 'trackpy' not in sys.modules and 'scipy.optimize' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("block_frames", [1, 5, 64])
def test_dropped_frames_are_gaps_in_the_column_frame(block_frames):
    movie = ArrayMovie(film())
    movie.numbers = np.array([0, 1, 2, 5, 6, 7, 8, 9, 10, 40, 41, 42])
    part = select(movie, frames=(2, 11))
    blocks = localise(
        part, CAMERA, LocaliseOptions(), pixel_size_nm=PIXEL, block_frames=block_frames
    )
    frame = np.concatenate([block.columns["frame"] for block in blocks])
    assert np.unique(frame).tolist() == movie.numbers[2:11].tolist()
    whole = run(movie)
    kept = whole["frame"].isin(movie.numbers[2:11])
    assert frame.tolist() == whole.loc[kept, "frame"].tolist()
