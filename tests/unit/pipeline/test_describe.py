"""What `info` tells, against movies, tables and maps of which everything is known."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from rotortrack.errors import CameraError, ConfigurationError, GainWarning, LineNoiseWarning
from rotortrack.exchange.tables import TableInfo, write_localisations
from rotortrack.movies.write import write_movie
from rotortrack.pipeline.describe_movie import describe_movie
from rotortrack.pipeline.describe_table import describe_maps, describe_table
from rotortrack.settings import Layer

SHAPE = (120, 48, 64)


@pytest.fixture
def movie(tmp_path: Path) -> Path:
    """A ramp of light at 0.5 electrons per count, with a black frame and a dead row."""
    rng = np.random.default_rng(1)
    light = np.broadcast_to(np.linspace(5, 100, SHAPE[2]), SHAPE)
    counts = np.rint(rng.poisson(light) / 0.5 + 100 + rng.normal(0, 2, SHAPE))
    counts[17] = 0
    counts[:, 40] = 100
    counts[17, 40] = 0
    return write(tmp_path / "movie.tif", counts)


def write(path: Path, counts: Any) -> Path:
    counts = counts.astype(np.uint16)
    write_movie(path, [counts], shape=counts.shape, pixel_size_nm=108.3, frame_interval_s=0.002)
    return path


def layer(**sections: dict[str, object]) -> list[Layer]:
    return [Layer("flag", sections)]


def test_a_movie_is_told_with_its_origins_and_faults(movie: Path) -> None:
    report = describe_movie(movie, layer(movie={"exposure_s": 0.001}))
    assert report.shape == SHAPE
    assert report.files == (movie,)
    assert report.size_bytes == movie.stat().st_size
    assert report.values["exposure_s"].origin == "flag"
    assert report.values["pixel_size_nm"].value == pytest.approx(108.3)
    assert "file" in report.values["pixel_size_nm"].origin
    assert report.gain.gain_e_per_adu == pytest.approx(0.5, rel=0.1)
    assert report.gain_in_use == report.gain.gain_e_per_adu
    assert report.pixels.zero_frames == (17,)
    assert report.pixels.dead_rows == (40,)
    assert not report.column_noise.matters
    assert report.times is None
    json.dumps(report.as_dict(), default=str)


def test_a_given_gain_is_held_against_the_noise(movie: Path) -> None:
    with pytest.warns(GainWarning):
        report = describe_movie(movie, layer(camera={"gain_e_per_adu": 2.0}))
    assert report.gain_in_use == 2.0


def test_column_noise_warns(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    counts = 200 + rng.normal(0, 3, SHAPE) + rng.normal(0, 2, (SHAPE[0], 1, SHAPE[2]))
    with pytest.warns(LineNoiseWarning, match="column noise of"):
        report = describe_movie(write(tmp_path / "fast.tif", np.rint(counts)), [])
    assert report.as_dict()["column_noise"]["matters"] is True
    assert report.as_dict()["row_noise"]["matters"] is False


def test_maps_and_their_saturation_are_used_and_must_fit(movie: Path, tmp_path: Path) -> None:
    maps = tmp_path / "camera.npz"
    arrays = {name: np.full(SHAPE[1:], 0.5) for name in ("offset_adu", "gain_e_per_adu")}
    np.savez(maps, **arrays, read_noise_e=1.0, saturation_adu=250.0)
    camera = {"camera_maps": str(maps)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = describe_movie(movie, layer(camera=camera))
    assert report.gain_in_use == 0.5
    assert report.pixels.saturation_adu == 250
    assert report.pixels.saturated_pixels > 0
    np.savez(maps, offset_adu=np.zeros((3, 3)), gain_e_per_adu=1.0, read_noise_e=1.0)
    with pytest.raises(CameraError, match="3"):
        describe_movie(movie, layer(camera=camera))


def test_a_selection_is_what_is_looked_at(movie: Path) -> None:
    chosen = {"region": (8, 4, 40, 40), "frames": (10, 60)}
    report = describe_movie(movie, layer(movie=chosen))
    assert report.shape == (50, 40, 40)
    assert (report.first_frame, report.origin_px) == (10, (8, 4))
    assert report.pixels.zero_frames == (17,)
    assert report.pixels.dead_rows == (40,)
    with pytest.raises(ConfigurationError):
        describe_movie(movie, layer(movie={"frames": (0, 1000)}))


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_a_table_is_told_by_its_columns(tmp_path: Path, ending: str) -> None:
    table = pd.DataFrame(
        {
            "frame": [0, 0, 3],
            "x_nm": [100.0, 250.0, 900.0],
            "y_nm": [5.0, 6.0, 7.0],
            "photons": [500.0, 700.0, math.nan],
        }
    )
    path = tmp_path / f"table.{ending}"
    info = TableInfo(pixel_size_nm=100.0, frames=9, provenance={"made_by": "hand"})
    write_localisations(path, table, info)
    report = describe_table(path)
    assert (report.rows, report.frames_with_rows) == (3, 2)
    columns = {column.name: column for column in report.columns}
    assert (columns["x_nm"].least, columns["x_nm"].largest) == (100, 900)
    assert columns["x_nm"].unit == "nm"
    assert (columns["photons"].missing, columns["photons"].largest) == (1, 700)
    if ending == "parquet":
        assert (report.info.pixel_size_nm, report.info.frames) == (100, 9)
        assert report.info.provenance["made_by"] == "hand"
    json.dumps(report.as_dict(), default=str)


def test_an_empty_table_is_told_too(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    empty = pd.DataFrame({name: np.empty(0) for name in ("frame", "x_nm", "y_nm")})
    write_localisations(path, empty, TableInfo())
    report = describe_table(path)
    assert report.rows == 0
    assert all(math.isnan(column.least) and column.missing == 0 for column in report.columns)


def test_hot_pixels_of_maps_are_counted(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(1.4, 0.05, (40, 50))
    noise[[3, 7, 20], [4, 5, 6]] = 9.0
    offset = np.rint(rng.normal(100, 0.3, (40, 50)))
    path = tmp_path / "camera.npz"
    np.savez(path, read_noise_e=noise, offset_adu=offset, gain_e_per_adu=0.5)
    described = describe_maps(path)
    assert described.hot_pixels == 3
    reports = {report.name: report for report in described.arrays}
    assert reports["read_noise_e"].shape == (40, 50)
    assert reports["read_noise_e"].outliers == 3
    assert reports["read_noise_e"].median == pytest.approx(1.4, abs=0.01)
    assert reports["offset_adu"].outliers == 0
    assert (reports["gain_e_per_adu"].shape, reports["gain_e_per_adu"].median) == ((), 0.5)
