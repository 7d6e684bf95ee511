"""Tables that the plugin and other programs wrote, read as the ten obvious lines would."""

from __future__ import annotations

import csv
import gzip
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotortrack.errors import TableWarning
from rotortrack.exchange.tables import TableInfo, convert, read_localisations, write_localisations

OURS = {
    "x": "x_nm",
    "y": "y_nm",
    "sigma": "sigma_nm",
    "intensity": "photons",
    "offset": "background",
    "bkgstd": "background_sd",
    "chi2": "chi2",
    "uncertainty": "uncertainty_nm",
    "uncertainty_xy": "uncertainty_nm",
}

TABLES = [
    ("thunderstorm", "lsq.csv"),
    ("thunderstorm", "wlsq.csv"),
    ("thunderstorm", "mle.csv"),
    ("thunderstorm", "table.csv.gz"),
    ("thunderstorm", "table_density.csv.gz"),
    ("thunderstorm", "table_drift_corrected.csv.gz"),
    ("pmhc", "thunderstorm.csv"),
]


def plainly(path: Path) -> dict[str, list[float]]:
    content = path.read_bytes()
    text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode()
    rows = list(csv.DictReader(text.splitlines()))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


@pytest.mark.parametrize(("folder", "name"), TABLES)
def test_a_plugin_table_is_read_number_for_number(
    reference_data: Callable[[str], Path], folder: str, name: str
) -> None:
    path = reference_data(folder) / name
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        locs = read_localisations(path)
    plain = plainly(path)
    assert locs["frame"].tolist() == [frame - 1 for frame in plain.pop("frame")]
    unknown = []
    for header, values in plain.items():
        column = OURS.get(header.split(" [")[0])
        if column is None:
            unknown.append(header)
            continue
        np.testing.assert_array_equal(locs[column], np.array(values, locs[column].dtype))
    unknown = [header for header in unknown if header != "id"]
    assert len(caught) == bool(unknown)
    for warning in caught:
        assert warning.category is TableWarning
        assert all(header in str(warning.message) for header in unknown)


@pytest.mark.parametrize(("folder", "name"), TABLES[:4])
def test_a_plugin_table_written_again_holds_the_same_numbers(
    reference_data: Callable[[str], Path], tmp_path: Path, folder: str, name: str
) -> None:
    path = reference_data(folder) / name
    write_localisations(tmp_path / "again.csv", read_localisations(path), TableInfo())
    old, new = plainly(path), plainly(tmp_path / "again.csv")
    assert list(new) == list(old)
    for header, values in old.items():
        exact = header in ("id", "frame", "x [nm]", "y [nm]")
        kept = values if exact else np.float64(np.float32(values))
        np.testing.assert_allclose(new[header], kept, rtol=0 if exact else 1e-7)


def test_positions_pass_through_picasso_within_its_float32(
    reference_data: Callable[[str], Path], tmp_path: Path
) -> None:
    source = reference_data("thunderstorm") / "table.csv.gz"
    rows = convert(source, tmp_path / "t.hdf5", pixel_size_nm=100)
    assert rows == 26_917
    before, after = read_localisations(source), read_localisations(tmp_path / "t.hdf5")
    np.testing.assert_array_equal(after["frame"], before["frame"])
    for name in ("x_nm", "y_nm"):
        assert np.abs(after[name] - before[name]).max() < 4e-4
    np.testing.assert_allclose(after["uncertainty_nm"], before["uncertainty_nm"], rtol=1e-6)
