"""Films are analysed as an experimenter would: with the times in the file, and colour by colour."""

from __future__ import annotations

import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.movies.tiff import open_movie
from rotortrack.settings import Layer
from rotortrack.simulate.film.filming import film_scene
from rotortrack.simulate.scene import make_scene
from rotortrack.tradeoff import closed_loop
from rotortrack.tradeoff.score import read_truth


def scene_of(**sections):
    values = {
        "film": {"width_px": 48, "height_px": 40, "n_frames": 300, "exposure_s": 0.002},
        "rotors": [{"x_nm": [2000.0], "y_nm": [2000.0], "photons": 900.0}],
        "background": {"photons": 5.0},
        "camera": {},
        **sections,
    }
    return make_scene([Layer("test", values)])


def test_lost_frames_have_the_same_numbers_in_film_and_truth(tmp_path, monkeypatch):
    class FilmedError(Exception):
        pass

    def instead(filmed, *_, **__):
        with open_movie(filmed.movie) as movie:
            raise FilmedError(
                movie.numbers.tolist(), read_truth(filmed.truth).spots["frame"].tolist()
            )

    monkeypatch.setattr(closed_loop, "analyse", instead)
    with pytest.raises(FilmedError) as caught:
        closed_loop.check_scene(scene_of(dropped={"frames": [50, 51, 120]}), tmp_path)
    numbers, frames = caught.value.args
    assert numbers == frames
    assert set(range(300)) - set(numbers) == {50, 51, 120}


@pytest.mark.parametrize(
    ("layout", "region"), [("left-right", [0, 0, 24, 40]), ("top-bottom", [0, 0, 48, 20])]
)
def test_of_two_colours_the_first_one_is_analysed(tmp_path, layout, region):
    scene = scene_of(
        rotors=[{"x_nm": [1300.0], "y_nm": [1000.0], "ends": 2}], split={"layout": layout}
    )
    filmed = film_scene(scene, tmp_path / "film.tif")
    assert closed_loop.config_layer(filmed).values["movie"]["region"] == region


def test_an_analysis_that_nobody_knows_is_refused_before_anything_is_filmed(tmp_path):
    with pytest.raises(ConfigurationError, match="--analysis papper is not known: known are def"):
        closed_loop.check_scene(scene_of(), tmp_path, presets=["default", "papper"])
    assert not list(tmp_path.iterdir())
