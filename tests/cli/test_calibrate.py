"""`rotortrack calibrate` as a user calls it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rotortrack.movies.write import write_movie

SHAPE = (24, 32)


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("films")
    rng = np.random.default_rng(4)
    paths = []
    for name, light in (("dark", 0), ("dim", 200), ("bright", 2000)):
        electrons = rng.poisson(light, (150, *SHAPE)) + rng.normal(0, 1.4, (150, *SHAPE))
        paths.append(folder / f"{name}.tif")
        write_movie(paths[-1], [np.rint(electrons / 0.5 + 100).astype(np.uint16)])
    return paths


def test_maps_and_their_picture_are_written_and_described(
    call: Callable[..., Any], films: list[Path], tmp_path: Path
) -> None:
    target = tmp_path / "new" / "camera.npz"
    shown = call("calibrate", *films, "-o", target)
    assert shown.code == 0
    assert "camera of 32 x 24 pixels by 150 dark frames" in shown.out
    assert "bright.tif" in shown.out
    assert "hot pixels   0 (0.00%)" in shown.out
    assert "dark.tif: 150 frames" in shown.err
    assert "300 flat frames tell a pixel's own gain to" in shown.err
    assert sorted(path.name for path in target.parent.iterdir()) == ["camera.npz", "camera.png"]
    with Image.open(target.with_suffix(".png")) as picture:
        assert picture.size[0] > 900
    described = call("info", target)
    assert "32 x 24" in described.out
    assert "0 hot pixels" in described.out
    assert "dark.tif" in described.out
    movie = tmp_path / "movie.tif"
    write_movie(movie, [np.random.default_rng(1).integers(90, 130, (5, *SHAPE)).astype(np.uint16)])
    words = ("localise", movie, "--camera-maps", target, "--pixel-size-nm", 100, "-q")
    assert call(*words, "-o", tmp_path / "l.csv").code == 0


def test_json_is_one_line_with_units_in_its_names(
    call: Callable[..., Any], films: list[Path], tmp_path: Path
) -> None:
    target = tmp_path / "camera.npz"
    told = call("calibrate", *films, "-o", target, "--json", "-q").json
    assert (told["width_px"], told["height_px"], told["frames"]) == (32, 24, 450)
    assert told["offset_adu"] == pytest.approx(100, abs=0.2)
    assert told["gain_e_per_adu"] == pytest.approx(0.5, rel=0.02)
    assert told["read_noise_e"] == pytest.approx(1.4, rel=0.03)
    assert (told["hot_pixels"], told["dead_pixels"]) == (0, 0)
    assert [flat["frames"] for flat in told["flats"]] == [150, 150]
    assert len(told["warnings"]) == 1
    again = call(
        "calibrate", *films[:1], "--gain-e-per-adu", 0.5, "-o", target, "--json", "-q"
    ).json
    assert (again["gain_pixel_spread"], again["flats"]) == (None, [])


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("dark", "-o", "c.npz"), 4, "give films of steady light"),
        (("dark", "dim", "-o", "c.csv"), 2, "does not end in .npz"),
        (("dim", "dark", "-o", "c.npz"), 3, "give the dark film first"),
        (("dark", "dark", "-o", "c.npz"), 3, "are the same film"),
        (("dark", "none", "-o", "c.npz"), 3, "none.tif"),
        (("dark", "dim", "--frames", "0", "12", "-o", "c.npz"), 3, "give at least 20"),
        (("dark", "dim", "--gain-e-per-adu", "-1", "-o", "c.npz"), 4, "gain_e_per_adu"),
        (("dark", "dim"), 2, "--output"),
    ],
)
def test_what_cannot_be_done_is_one_sentence_and_leaves_nothing(
    call: Callable[..., Any],
    films: list[Path],
    tmp_path: Path,
    words: tuple[str, ...],
    code: int,
    sentence: str,
) -> None:
    names = {path.stem: path for path in films} | {"none": tmp_path / "none.tif"}
    given = [names.get(word, tmp_path / word if word.startswith("c.") else word) for word in words]
    ended = call("calibrate", *given, "-q")
    assert ended.code == code
    assert sentence in ended.err
    assert list(tmp_path.iterdir()) == []
