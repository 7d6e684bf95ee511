"""What effects cost is told of scenes of any length."""

from __future__ import annotations

import pytest

from rotortrack.settings import Layer
from rotortrack.simulate.film.film import Film
from rotortrack.simulate.scene import make_scene
from rotortrack.tradeoff.effects import effect_costs


@pytest.mark.parametrize("n_frames", [20, 200])
def test_a_scene_is_neither_cut_nor_prolonged_to_be_measured(tmp_path, n_frames):
    late = n_frames - 1
    drift, places = tmp_path / "drift.csv", tmp_path / "places.csv"
    drift.write_text("frame,dx_nm,dy_nm\n" + "".join(f"{frame},1,2\n" for frame in range(n_frames)))
    places.write_text(f"frame,rotor,x_nm,y_nm\n0,0,900,900\n{late},0,900,900\n")
    values = {
        "film": {"width_px": 24, "height_px": 24, "n_frames": n_frames},
        "rotors": [{"motion": "table", "table": str(places)}],
        "drift": {"table": str(drift)},
        "dropped": {"frames": [3, late]},
    }
    scene = make_scene([Layer("test", values)]).film
    costs = effect_costs(scene, [()], frames=96, repeats=1)
    assert {cost.effect for cost in costs} == {"everything", "rotors", "drift", "dropped"}


def test_a_film_that_is_stopped_has_the_frames_of_the_whole_one():
    values = {
        "film": {"width_px": 24, "height_px": 24, "n_frames": 50},
        "rotors": [{"x_nm": [1200.0], "y_nm": [1200.0]}],
        "dropped": {"frames": [4, 40]},
        "camera": {},
    }
    scene = make_scene([Layer("test", values)]).film
    whole = list(Film(scene, block_frames=10).blocks())
    film = Film(scene, block_frames=10, n_frames=20)
    begun = list(film.blocks())
    assert film.shape == (19, 24, 24)
    assert [block.tolist() for block in begun] == [block.tolist() for block in whole[:2]]
