"""Formats in which images of an atomic force microscope come, and what is no image."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import tifffile
from skimage.io import imsave

from rotortrack.afm.image import read_image
from rotortrack.afm.text_matrix import parse_matrix
from rotortrack.errors import ContourWarning, ImageError, InputError, MovieError
from rotortrack.movies.options import MovieOptions

HEIGHTS = np.random.default_rng(0).normal(0.0, 1.0, (20, 30)).round(4)


def test_a_tiff_tells_its_pixel_size(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path,
        HEIGHTS.astype(np.float32),
        imagej=True,
        resolution=(200.0, 200.0),
        metadata={"unit": "um"},
    )
    image = read_image(path)
    assert image.values == pytest.approx(HEIGHTS, abs=1e-6)
    assert image.pixel_size_nm == pytest.approx(5.0)
    assert image.nm_per_unit is None


def test_of_a_stack_one_image_is_chosen(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, np.stack([HEIGHTS, -HEIGHTS]).astype(np.float32), metadata={"axes": "TYX"}
    )
    with pytest.raises(ImageError, match=r"holds 2 images: choose .* --frames 0 1"):
        read_image(path)
    chosen = read_image(path, MovieOptions(frames=(1, 2)))
    assert chosen.values == pytest.approx(-HEIGHTS, abs=1e-6)


def test_grey_pictures_and_arrays_are_read_as_they_are(tmp_path):
    grey = (1000 * HEIGHTS - 1000 * HEIGHTS.min()).astype(np.uint16)
    imsave(tmp_path / "a.png", grey, check_contrast=False)
    np.save(tmp_path / "b.npy", HEIGHTS.astype(np.float32))
    assert read_image(tmp_path / "a.png").values == pytest.approx(grey)
    assert read_image(tmp_path / "b.npy").values == pytest.approx(HEIGHTS, abs=1e-6)


def test_colours_are_not_heights(tmp_path):
    level = np.tile(np.arange(40, dtype=np.uint8) * 6, (30, 1))
    rgb = np.stack([level, level // 2, level // 4], axis=2)
    imsave(tmp_path / "a.png", rgb, check_contrast=False)
    with pytest.warns(ContourWarning, match="coloured"):
        image = read_image(tmp_path / "a.png")
    assert (np.diff(image.values, axis=1) > 0).all()
    imsave(tmp_path / "grey.png", np.stack([level] * 3, axis=2), check_contrast=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_image(tmp_path / "grey.png").values == pytest.approx(level)


@pytest.mark.parametrize("mark", [" ", "\t", ";", ",", "  "])
def test_a_text_matrix_is_read_whatever_parts_its_numbers(tmp_path, mark):
    path = tmp_path / "a.txt"
    path.write_text("\n".join(mark.join(f"{v:.4f}" for v in row) for row in HEIGHTS))
    assert read_image(path).values == pytest.approx(HEIGHTS)


@pytest.mark.parametrize("mark", ["\t", ";"])
def test_decimal_commas_are_read(tmp_path, mark):
    path = tmp_path / "a.txt"
    rows = [mark.join(f"{v:.4f}".replace(".", ",") for v in row) for row in HEIGHTS]
    path.write_text("\r\n".join(rows))
    assert read_image(path).values == pytest.approx(HEIGHTS)


def test_the_header_of_an_export_tells_size_and_unit(tmp_path):
    path = tmp_path / "a.txt"
    header = "# Channel: Height\n# Width: 0.150 µm\n# Height: 0.100 µm\n# Value units: m\n"
    rows = "\n".join("\t".join(f"{1e-9 * v:.6e}" for v in row) for row in HEIGHTS)
    for encoding in ("utf-8", "latin-1"):
        path.write_text(header + rows + "\n", encoding=encoding)
        image = read_image(path)
        assert image.pixel_size_nm == pytest.approx(5.0)
        assert image.nm_per_unit == pytest.approx(1.0e9)
        assert image.values * image.nm_per_unit == pytest.approx(HEIGHTS, rel=1e-5)


def test_a_header_without_marks_is_left_out(tmp_path):
    path = tmp_path / "a.asc"
    header = "a microscope's file\nX Amplitude: 150 nm\nZ Amplitude: 3 nm\n[Header end]\n\n"
    path.write_text(header + "\n".join("\t".join(f"{v:.4f}" for v in row) for row in HEIGHTS))
    assert read_image(path).pixel_size_nm == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no rows of numbers"),
        ("a b\nc d\n", "no rows of numbers"),
        ("1 2 3\n4 5\n", "rows of 3 and of 2 numbers"),
        ("1 2\n3 x\n", "something else than numbers in line 2"),
        ("0 0 1.5\n" * 60, "list points as x, y, z"),
    ],
)
def test_text_that_is_no_matrix_is_refused(tmp_path, text, said):
    with pytest.raises(ImageError, match=said):
        parse_matrix(text, tmp_path / "a.txt")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.zeros((20, 30)), "same height everywhere"),
        (np.where(HEIGHTS.max() > HEIGHTS, HEIGHTS, np.nan), "1 pixels without a finite height"),
        (HEIGHTS[:10], "10 x 30"),
        (HEIGHTS[None], "1 x 20 x 30"),
        (HEIGHTS.astype(complex), "no array of real numbers"),
        (np.array(["a"] * 400).reshape(20, 20), "no array of real numbers"),
    ],
)
def test_arrays_that_are_no_image_are_refused(tmp_path, values, said):
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(ImageError, match=said):
        read_image(tmp_path / "a.npy")


def test_objects_are_never_unpickled(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}, []], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"a\.npy"):
        read_image(tmp_path / "a.npy")


@pytest.mark.parametrize("name", ["a.png", "a.npy", "a.tif"])
def test_damaged_and_missing_files_are_told_in_one_sentence(tmp_path, name):
    with pytest.raises(MovieError, match=r"check that|check the name"):
        read_image(tmp_path / name)
    (tmp_path / name).write_bytes(b"nothing of the kind")
    with pytest.raises(InputError) as told:
        read_image(tmp_path / name)
    assert "\n" not in str(told.value)


def test_a_picture_that_is_cut_short_is_told(tmp_path):
    path = tmp_path / "a.png"
    imsave(path, (100 * HEIGHTS).astype(np.uint8), check_contrast=False)
    path.write_bytes(path.read_bytes()[:120])
    with pytest.raises(MovieError, match=r"damaged|cannot be read"):
        read_image(path)


def test_endings_and_sizes_beyond_reason_are_refused(tmp_path):
    with pytest.raises(ImageError, match="no known ending"):
        read_image(tmp_path / "a.spm")
    np.save(tmp_path / "a.npy", np.zeros((200, 200)))
    with pytest.raises(ImageError, match="max-frame-megapixels"):
        read_image(tmp_path / "a.npy", MovieOptions(max_frame_megapixels=1e-3))
