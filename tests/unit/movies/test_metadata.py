"""Metadata carry their origin, and numbers that cannot be true are not taken."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

from rotortrack.errors import MetadataWarning
from rotortrack.movies.metadata import Metadata, Value, clean, collect, merge, nanometres, seconds
from rotortrack.movies.ome import read_ome
from rotortrack.movies.tiff import open_movie

FRAMES = np.zeros((4, 8, 9), np.uint16)


def metadata_of(path: Path, **options: object) -> Metadata:
    tifffile.imwrite(path, FRAMES, photometric="minisblack", **options)
    with open_movie(path) as movie:
        return movie.metadata


@pytest.mark.parametrize(
    ("unit", "per_unit"), [("micron", 1 / 0.1083), ("um", 1 / 0.1083), ("nm", 1 / 108.3)]
)
def test_imagej_scale_and_frame_interval_are_read(
    unit: str, per_unit: float, tmp_path: Path
) -> None:
    found = metadata_of(
        tmp_path / "m.tif",
        imagej=True,
        resolution=(per_unit, per_unit),
        metadata={"axes": "TYX", "unit": unit, "finterval": 0.002},
    )
    assert found["pixel_size_nm"].value == pytest.approx(108.3, rel=1e-6)
    assert found["pixel_size_nm"].origin == "file (ImageJ)"
    assert found["frame_interval_s"] == Value(0.002, "file (ImageJ)")


def test_imagej_interval_in_another_time_unit_is_converted(tmp_path: Path) -> None:
    found = metadata_of(
        tmp_path / "m.tif",
        metadata=None,
        description="ImageJ=1.54f\nimages=4\nframes=4\nfinterval=2.5\ntunit=ms\n",
    )
    assert found["frame_interval_s"].value == pytest.approx(0.0025)


def test_ome_sizes_are_converted_from_their_units(tmp_path: Path) -> None:
    found = metadata_of(
        tmp_path / "m.tif",
        ome=True,
        metadata={
            "axes": "TYX",
            "PhysicalSizeX": 108.3,
            "PhysicalSizeXUnit": "nm",
            "PhysicalSizeY": 0.1083,
            "PhysicalSizeYUnit": "µm",
            "TimeIncrement": 2.0,
            "TimeIncrementUnit": "ms",
            "Plane": {"ExposureTime": [1.5] * 4, "ExposureTimeUnit": ["ms"] * 4},
        },
    )
    assert found["pixel_size_nm"].value == pytest.approx(108.3)
    assert found["frame_interval_s"].value == pytest.approx(0.002)
    assert found["exposure_s"].value == pytest.approx(0.0015)
    assert {found[name].origin for name in ("pixel_size_nm", "exposure_s")} == {"file (OME)"}


def test_micromanager_page_tag_is_read(tmp_path: Path) -> None:
    tag = json.dumps(
        {
            "PixelSizeUm": {"PropVal": "0.065"},
            "Exposure-ms": 2.0,
            "Camera": "Prime\x1b[31m BSI",
            "ROI": "10-20-9-8",
        }
    )
    found = metadata_of(tmp_path / "m.tif", metadata=None, extratags=[(51123, 2, None, tag, True)])
    assert found["pixel_size_nm"] == Value(pytest.approx(65.0), "file (Micro-Manager)")
    assert found["exposure_s"].value == pytest.approx(0.002)
    assert found["camera"].value == "Prime[31m BSI"
    assert found["sensor_region"].value == "10-20-9-8"


def test_times_measured_by_micromanager_win_over_the_interval_that_was_set(
    tmp_path: Path,
) -> None:
    path = tmp_path / "m.tif"
    with tifffile.TiffWriter(path) as writer:
        for index in range(21):
            tag = json.dumps({"ElapsedTime-ms": 100 + 2.5 * index, "Interval_ms": 2.0})
            writer.write(
                FRAMES[0], metadata=None, contiguous=False, extratags=[(51123, 2, None, tag, True)]
            )
    with pytest.warns(MetadataWarning, match="elapsed times"), open_movie(path) as movie:
        assert movie.metadata["frame_interval_s"] == Value(
            pytest.approx(0.0025), "file (Micro-Manager elapsed times)"
        )


def test_metric_resolution_tags_give_a_pixel_size(tmp_path: Path) -> None:
    found = metadata_of(
        tmp_path / "m.tif",
        metadata=None,
        resolution=(1e7 / 108.3,) * 2,
        resolutionunit="CENTIMETER",
        software="a camera",
    )
    assert found["pixel_size_nm"].value == pytest.approx(108.3, rel=1e-5)
    assert found["pixel_size_nm"].origin == "file (TIFF resolution)"
    assert found["software"].origin == "file (TIFF)"


@pytest.mark.parametrize(
    ("resolution", "unit"),
    [
        ((72, 72), "INCH"),
        ((28.35, 28.35), "CENTIMETER"),  # 72 dots an inch again
        ((92336.0, 46168.0), "CENTIMETER"),  # pixels that are not square
        ((9.2336, 9.2336), "NONE"),
    ],
)
def test_resolution_of_print_is_no_pixel_size(
    resolution: tuple[float, float], unit: str, tmp_path: Path
) -> None:
    found = metadata_of(
        tmp_path / "m.tif", metadata=None, resolution=resolution, resolutionunit=unit
    )
    assert "pixel_size_nm" not in found


@pytest.mark.parametrize("absurd", [0, -1.0, float("nan"), float("inf"), "x", 1e9, None])
def test_absurd_values_are_not_taken(absurd: object) -> None:
    assert collect("file", pixel_size_nm=absurd, frame_interval_s=absurd) == {}


def test_units_that_are_no_length_or_time_give_nothing() -> None:
    assert nanometres(1.0, "pixel") is None
    assert nanometres(1.0, "inch") is None
    assert nanometres(2.0, "\\u00B5m") == nanometres(2.0, "\u03bcm") == 2000.0
    assert seconds(3.0, "ms") == pytest.approx(0.003)
    assert seconds(3.0, "frames") is None


def test_later_layer_wins_and_a_contradiction_is_said() -> None:
    one, other = collect("file (A)", pixel_size_nm=108.3), collect("file (B)", pixel_size_nm=65.0)
    with pytest.warns(MetadataWarning, match=r"108\.3 by file \(A\) but 65 by file \(B\)"):
        merged = merge(one, other)
    assert merged == other
    assert merge(one, collect("file (B)", pixel_size_nm=108.9))["pixel_size_nm"].value == 108.9


def test_what_could_steer_a_terminal_is_stripped() -> None:
    assert clean("a\x1b]0;title\x07b\u202ec\nd\x9bm") == "a]0;titlebc dm"
    assert len(clean("x" * 10_000)) == 200


def test_entity_bomb_and_broken_xml_are_no_description() -> None:
    bomb = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><OME><Image Name="&b;"/></OME>'
    assert read_ome(bomb) is None
    assert read_ome("<OME><Image>") is None


def test_ome_counts_the_planes_of_each_file() -> None:
    planes = "".join(
        f'<TiffData IFD="{i % 3}"><UUID FileName="{"ab"[i // 3]}.tif">u</UUID></TiffData>'
        for i in range(5)
    )
    text = f'<o:OME xmlns:o="x"><o:Image><o:Pixels SizeT="5">{planes}</o:Pixels></o:Image></o:OME>'
    ome = read_ome(text)
    assert ome is not None
    assert ome.images[0].files == {"a.tif": 3, "b.tif": 2}
    assert ome.images[0].size("T") == 5
    assert ome.of_file("renamed.tif") == ome.images
