"""From films on disk to maps on disk, and back into the engine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from rotortrack.cameras.camera import camera_from_options
from rotortrack.cameras.maps import read_provenance
from rotortrack.cameras.options import CameraOptions
from rotortrack.errors import (
    CalibrationWarning,
    CameraError,
    ConfigurationError,
    InputError,
    MovieError,
    UsageError,
)
from rotortrack.localise.engine import localise_all
from rotortrack.movies.movie import ArrayMovie
from rotortrack.movies.write import write_movie
from rotortrack.pipeline.calibrate_run import calibrate_films, check_target, save
from rotortrack.settings import Layer

SHAPE = (30, 40)
OFFSET = 100 + np.arange(30.0)[:, None] + np.zeros(40)
FEW = "ignore:.*flat frames tell:rotortrack.errors.CalibrationWarning"


def film(light: float, frames: int = 120, seed: int = 0) -> NDArray[np.uint16]:
    """Half an electron per count, read noise 1.5 electrons, pixel (7, 9) 30 electrons."""
    rng = np.random.default_rng(seed)
    read = np.full(SHAPE, 1.5)
    read[7, 9] = 30.0
    electrons = rng.poisson(light, (frames, *SHAPE)) + rng.normal(size=(frames, *SHAPE)) * read
    return np.clip(np.rint(electrons / 0.5 + OFFSET), 0, 65535).astype(np.uint16)


def write(path: Path, counts: NDArray[np.uint16]) -> Path:
    write_movie(path, [counts])
    return path


@pytest.fixture
def films(tmp_path: Path) -> list[Path]:
    lights = {"dark": 0.0, "dim": 300.0, "bright": 3000.0}
    return [
        write(tmp_path / f"{name}.tif", film(light, seed=number))
        for number, (name, light) in enumerate(lights.items())
    ]


def layer(**sections: dict[str, object]) -> list[Layer]:
    return [Layer("flag", sections)]


@pytest.mark.filterwarnings(FEW)
def test_maps_go_from_films_through_a_file_to_the_engine(films: list[Path], tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    dark, *flats = films
    found = calibrate_films(
        dark, flats, [], folder=tmp_path, progress=lambda *words: told.append(words)
    )
    target = tmp_path / "camera.npz"
    save(found, target)
    camera = camera_from_options(CameraOptions(camera_maps=str(target)))
    np.testing.assert_allclose(camera.offset_adu, OFFSET, atol=20)
    assert np.argwhere(camera.hot_pixels).tolist() == [[7, 9]]
    assert np.median(camera.gain_e_per_adu) == pytest.approx(0.5, rel=0.01)
    assert found.frames == 360
    assert ("bright.tif", 120, 120) in told
    record = read_provenance(target)
    assert [entry["path"] for entry in record["inputs"]] == ["dark.tif", "dim.tif", "bright.tif"]
    assert record["counts"]["hot_pixels"] == 1
    # A spot of light that the row-wise offset would tilt.
    scene = np.zeros(SHAPE)
    scene[14:17, 19:22] = [[60, 120, 60], [120, 400, 120], [60, 120, 60]]
    rng = np.random.default_rng(9)
    counts = np.rint((rng.poisson(scene + 5, (40, *SHAPE))) / 0.5 + OFFSET).astype(np.uint16)
    spots = localise_all(ArrayMovie(counts), camera, pixel_size_nm=100.0)
    bright = spots[spots["photons"] > 500]
    assert len(bright) == 40
    assert bright["y_nm"].mean() == pytest.approx(1550, abs=3)


@pytest.mark.filterwarnings(FEW)
def test_dead_pixels_are_masked_in_the_engine(films: list[Path], tmp_path: Path) -> None:
    stuck = []
    for path in films:
        counts = tifffile.imread(path)
        counts[:, 15, 20] = 20_000
        stuck.append(write(tmp_path / f"stuck-{path.name}", counts))
    found = calibrate_films(stuck[0], stuck[1:], [])
    target = tmp_path / "camera.npz"
    save(found, target)
    camera = camera_from_options(CameraOptions(camera_maps=str(target)))
    assert np.argwhere(camera.dead_pixels).tolist() == [[15, 20]]
    counts = film(6.0, 20, seed=5)
    counts[:, 7, 9] = counts[:, 7, 10]
    counts[:, 15, 20] = 20_000
    spots = localise_all(ArrayMovie(counts), camera, pixel_size_nm=100.0)
    assert len(spots[spots["photons"] > 300]) == 0


@pytest.mark.filterwarnings(FEW)
def test_a_region_and_a_range_of_frames_are_used(films: list[Path]) -> None:
    whole = calibrate_films(films[0], films[1:], []).calibration
    part = calibrate_films(
        films[0], films[1:], layer(movie={"region": [4, 2, 20, 10], "frames": [0, 100]})
    )
    assert part.calibration.offset_adu.shape == (10, 20)
    assert part.frames == 300
    np.testing.assert_allclose(part.calibration.offset_adu, whole.offset_adu[2:12, 4:24], atol=20)
    with pytest.raises(ConfigurationError, match="does not lie within"):
        calibrate_films(films[0], films[1:], layer(movie={"region": [30, 2, 20, 10]}))


def test_films_of_other_sizes_and_copies_are_refused_before_they_are_read(
    films: list[Path], tmp_path: Path
) -> None:
    small = write(tmp_path / "small.tif", film(500)[:, :20, :25])

    def unread(*words: object) -> None:
        raise AssertionError(words)

    with pytest.raises(
        CameraError, match=r"small.tif has .* 25 x 20 pixels but .*dark.tif of 40 x"
    ):
        calibrate_films(films[0], [films[1], small], [], progress=unread)
    copy = tmp_path / "copy.tif"
    copy.write_bytes(films[1].read_bytes())
    with pytest.raises(CameraError, match=r"dim.tif and .*copy.tif are the same film"):
        calibrate_films(films[0], [films[1], copy], [], progress=unread)
    with pytest.raises(CameraError, match=r"dark.tif and .*dark.tif are the same film"):
        calibrate_films(films[0], [films[0]], [], progress=unread)
    with pytest.raises(ConfigurationError, match="--gain-e-per-adu"):
        calibrate_films(films[0], [], [], progress=unread)
    with pytest.raises(InputError, match="nothing"):
        calibrate_films(films[0], [tmp_path / "nothing.tif"], [], progress=unread)
    text = tmp_path / "text.tif"
    text.write_text("no movie")
    with pytest.raises(MovieError):
        calibrate_films(films[0], [text], [], progress=unread)


def test_swapped_films_are_named(films: list[Path]) -> None:
    with pytest.raises(CameraError, match=r"dark.tif: .* darker than the dark one"):
        calibrate_films(films[1], [films[0]], [])


@pytest.mark.filterwarnings(FEW)
def test_films_of_different_exposure_are_warned_of(films: list[Path], tmp_path: Path) -> None:
    timed = []
    for path, exposure_ms in zip(films[:2], (10, 50), strict=True):
        counts = tifffile.imread(path)
        timed.append(_with_exposure(tmp_path / f"timed-{path.name}", counts, exposure_ms))
    with pytest.warns(CalibrationWarning, match=r"timed-dark.tif 10 ms, timed-dim.tif 50 ms"):
        calibrate_films(timed[0], timed[1:], [])


def _with_exposure(path: Path, counts: Any, exposure_ms: float) -> Path:
    frames, height, width = counts.shape
    planes = "".join(
        f'<Plane TheC="0" TheZ="0" TheT="{t}" ExposureTime="{exposure_ms}" ExposureTimeUnit="ms"/>'
        for t in range(frames)
    )
    text = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
        f'<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" '
        f'SizeX="{width}" SizeY="{height}" SizeZ="1" SizeC="1" SizeT="{frames}">'
        f'<Channel ID="Channel:0:0"/><TiffData/>{planes}</Pixels></Image></OME>'
    )
    tifffile.imwrite(path, counts, description=text, metadata=None, photometric="minisblack")
    return path


def test_the_target_ends_in_npz_and_is_no_film(films: list[Path], tmp_path: Path) -> None:
    check_target(tmp_path / "Camera.NPZ", films)
    with pytest.raises(UsageError, match=r"does not end in \.npz"):
        check_target(tmp_path / "camera.npy", films)
    odd = films[0].rename(tmp_path / "odd.npz")
    with pytest.raises(UsageError, match="is one of the films"):
        check_target(tmp_path / "odd.npz", [odd])
