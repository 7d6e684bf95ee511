"""Films: who is in them, what an effect costs and changes, and the truth beside them."""

from __future__ import annotations

import math
import sys
import tomllib
import tracemalloc
import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import AliasingWarning, ConfigurationError
from rotortrack.motion.trigger import frame_clock, rising_edges
from rotortrack.movies.tiff import open_movie
from rotortrack.settings import Layer
from rotortrack.simulate.film.film import Film
from rotortrack.simulate.film.filming import film_scene, truth_folder, warn_of_aliases
from rotortrack.simulate.film.population import draw_rotors
from rotortrack.simulate.film.scene import FilmScene
from rotortrack.simulate.scene import make_scene, read_scene
from rotortrack.tradeoff.effects import EVERYTHING

SMALL = {
    "film": {"height_px": 40, "width_px": 48, "n_frames": 30, "exposure_s": 0.002},
    "rotors": [{"x_nm": [1500.0, 3600.0], "y_nm": [1400.0, 2900.0], "photons": 800.0}],
    "background": {"photons": 5.0},
    "camera": {},
}


def scene_of(**sections):
    """The small scene with sections changed; None leaves one, or a value of one, out."""
    values = {name: dict(own) if isinstance(own, dict) else own for name, own in SMALL.items()}
    for name, own in sections.items():
        if own is None:
            values.pop(name, None)
        else:
            values[name] = own if isinstance(own, list) else {**values.get(name, {}), **own}
    values["film"] = {key: value for key, value in values["film"].items() if value is not None}
    return make_scene([Layer("test", values)])


def film_of(scene, **kwargs):
    return Film(scene.film, **kwargs)


def frames_of(scene, workers=1, **kwargs):
    return np.concatenate(list(film_of(scene, **kwargs).blocks(workers=workers)))


def small_everything():
    values = {name: dict(own) if isinstance(own, dict) else own for name, own in EVERYTHING.items()}
    values["film"] |= {"n_frames": 24, "height_px": 80, "width_px": 160}
    values["rotors"] = [{"count": 2, "ends": 2}, {"motion": "stuck", "count": 1}]
    return make_scene([Layer("test", values)])


@settings(max_examples=8)
@given(block=st.integers(1, 30), workers=st.integers(1, 3))
def test_neither_blocks_nor_threads_change_a_pixel(block, workers):
    scene = small_everything()
    whole = frames_of(scene)
    np.testing.assert_array_equal(frames_of(scene, workers, block_frames=block), whole)


def test_the_same_seed_gives_the_same_film_and_another_another():
    assert np.array_equal(frames_of(scene_of()), frames_of(scene_of()))
    assert not np.array_equal(frames_of(scene_of()), frames_of(scene_of(film={"seed": 2})))


@pytest.mark.parametrize(
    ("section", "values"),
    [
        ("drift", {"walk_nm": 3.0}),
        ("vibration", {}),
        ("bleaching", {"lifetime_s": 0.02}),
        ("blinking", {"on_s": 0.01, "off_s": 0.01}),
        ("dyes", {"labelled": 0.6, "spread": 0.3}),
        ("flicker", {"sd": 0.1}),
        ("laser", {"waist_nm": 3000.0}),
        ("rolling_shutter", {}),
        ("voltage", {"times_s": [0.0, 0.03], "voltages_mv": [100.0, 200.0]}),
    ],
)
def test_adding_an_effect_leaves_rotors_and_their_paths_as_they_are(section, values):
    plain, changed = film_of(scene_of()), film_of(scene_of(**{section: values}))
    assert changed.rotors == plain.rotors
    assert not np.array_equal(*(np.concatenate(list(f.blocks())) for f in (plain, changed)))
    seen = []
    for one in (scene_of(), scene_of(**{section: values})):
        angles = {}

        def see(_, told, angles=angles):
            for spot in told:
                angles.setdefault(spot.rotor, []).append(spot.theta_rad)

        list(film_of(one).blocks(see=see))
        seen.append({rotor: np.concatenate(parts) for rotor, parts in angles.items()})
    if section in ("voltage", "rolling_shutter"):
        return
    for rotor, angle in seen[0].items():
        np.testing.assert_allclose(seen[1][rotor], angle, atol=1e-9)


def test_noise_is_the_same_with_and_without_drift_where_there_is_no_light():
    dark = {"background": None, "rotors": []}
    plain = frames_of(scene_of(**dark))
    moved = frames_of(scene_of(**dark, drift={"walk_nm": 5.0}))
    np.testing.assert_array_equal(plain, moved)


def test_what_a_scene_does_not_name_is_not_even_loaded():
    heavy = ["free_rods", "illumination", "split", "fiducials", "airy", "shapes", "recording"]
    names = [f"rotortrack.simulate.film.{name}" for name in heavy]
    kept = {name: sys.modules.pop(name) for name in names if name in sys.modules}
    try:
        scene = scene_of(background=None, camera=None)
        assert frames_of(scene).dtype == np.float32
        assert [name for name in names if name in sys.modules] == []
    finally:
        sys.modules.update(kept)


def test_effects_that_are_absent_draw_no_number(monkeypatch):
    from rotortrack.simulate.film import streams

    drawn = []
    real = np.random.default_rng

    def counted(key):
        drawn.append(key.spawn_key[0])
        return real(key)

    monkeypatch.setattr(streams.np.random, "default_rng", counted)
    frames_of(scene_of(rotors=[{"motion": "stuck", "x_nm": [1500.0], "y_nm": [1500.0]}]))
    effects = {streams.Effect(number) for number in drawn}
    assert effects == {
        streams.Effect.ROTOR,
        streams.Effect.SHOT_NOISE,
        streams.Effect.READ_NOISE,
    }


def test_memory_does_not_grow_with_the_film():
    peaks = []
    for n_frames in (200, 2000):
        film = film_of(scene_of(film={"n_frames": n_frames}, drift=None), block_frames=50)
        tracemalloc.start()
        for _ in film.blocks():
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_light_without_noise_is_where_and_as_bright_as_the_truth_says():
    scene = scene_of(camera=None, background=None, film={"exposure_s": 0.001})
    told = {}

    def see(_, seen):
        for spot in seen:
            told.setdefault(spot.rotor, []).append((spot.x_nm, spot.y_nm, spot.photons))

    images = np.concatenate(list(film_of(scene).blocks(see=see))).astype(float)
    total = sum(np.concatenate([p for _, _, p in told[r]]) for r in told)
    assert images.sum(axis=(1, 2)) == pytest.approx(total, rel=1e-5)
    centres = (np.arange(48) + 0.5) * 108.3
    left = images[:, :, :24]
    x = (left.sum(axis=1) * centres[:24]).sum(axis=1) / left.sum(axis=(1, 2))
    assert x == pytest.approx(np.concatenate([x for x, _, _ in told[0]]), abs=0.05)


def test_a_rotor_turns_counter_clockwise_on_the_image():
    rotors = [
        {
            "x_nm": [2000.0],
            "y_nm": [2000.0],
            "radius_nm": 400.0,
            "start_deg": 0.0,
            "omega_rad_s": math.pi / 2 / 0.02,
            "direction": "ccw",
            "diffusion_rad2_s": 0.0,
        }
    ]
    scene = scene_of(camera=None, background=None, rotors=rotors, film={"exposure_s": None})
    images = frames_of(scene).astype(float)
    rows, columns = np.indices(images[0].shape) + 0.5
    places = [
        ((image * columns).sum() / image.sum(), (image * rows).sum() / image.sum())
        for image in images
    ]
    middle = 2000.0 / 108.3
    # From the right of the pore, in a quarter of a turn, to above it: smaller y.
    assert places[0] == pytest.approx((middle + 400 / 108.3, middle), abs=1e-3)
    assert places[10] == pytest.approx((middle, middle - 400 / 108.3), abs=1e-3)


def test_a_second_rotor_arrives_later_on_the_same_pore():
    groups = [{"count": 3, "second_after_s": [0.01, 0.02], "arrive_s": [0.0, 0.01]}]
    film = scene_of(rotors=groups, film={"height_px": 96, "width_px": 96}).film
    rotors = draw_rotors(film, [()])
    assert [rotor.pore for rotor in rotors] == [0, 1, 2, 0, 1, 2]
    for first, second in zip(rotors[:3], rotors[3:], strict=True):
        assert (second.x_nm, second.y_nm) == (first.x_nm, first.y_nm)
        assert 0.01 <= second.arrive_s - first.arrive_s <= 0.02
        assert second.start_rad != first.start_rad


def test_rotors_shine_from_their_arrival_to_their_release():
    groups = [{"x_nm": [2000.0], "y_nm": [2000.0], "arrive_s": 0.021, "leave_s": 0.04}]
    light = []
    scene = scene_of(rotors=groups, camera=None, background=None)
    list(film_of(scene).blocks(see=lambda _, seen: light.extend(seen[0].photons / 1.0)))
    shares = np.array(light) / max(light)
    assert shares == pytest.approx([0.0] * 10 + [0.5] + [1.0] * 9 + [0.0] * 10, abs=1e-9)


def test_changing_one_property_changes_no_other():
    first = draw_rotors(scene_of(rotors=[{"count": 2}]).film, [()])
    second = draw_rotors(scene_of(rotors=[{"count": 2, "radius_nm": 99.0}]).film, [()])
    for a, b in zip(first, second, strict=True):
        assert b.ends[0].radius_nm == 99.0
        assert (a.omega_rad_s, a.diffusion_rad2_s, a.start_rad) == (
            b.omega_rad_s,
            b.diffusion_rad2_s,
            b.start_rad,
        )


def test_a_lattice_has_its_pitch_and_turn_and_only_as_many_pores_as_there_are():
    lattice = {"pitch_nm": 1000.0, "rotation_deg": 10.0}
    size = {"height_px": 96, "width_px": 96}
    film = scene_of(lattice=lattice, rotors=[{"count": 30}], film=size).film
    places = np.array([(rotor.x_nm, rotor.y_nm) for rotor in draw_rotors(film, [()])])
    turn = math.radians(10.0)
    # Along a row x grows and, turned counter-clockwise on the image, y falls.
    along = np.array([math.cos(turn), -math.sin(turn)])
    across = np.array([math.sin(turn), math.cos(turn)])
    steps = np.stack([places @ along, places @ across], axis=1) / 1000.0
    steps -= steps[0]
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    with pytest.raises(ConfigurationError, match=r"\[lattice\] has \d+ pores .* ask for 500"):
        draw_rotors(scene_of(lattice=lattice, rotors=[{"count": 500}], film=size).film, [()])


def test_fiducials_stand_in_both_colours_under_the_distortion():
    sections = {
        "film": {"width_px": 96, "height_px": 48, "n_frames": 2},
        "rotors": [],
        "split": {"shift_nm": [60.0, -30.0], "scale": 1.01},
        "fiducials": {"missing": 0.0, "pitch_nm": 2000.0},
        "camera": None,
        "background": None,
    }
    images = frames_of(scene_of(**sections))
    np.testing.assert_array_equal(images[0], images[1])
    left, right = images[0][:, :48], images[0][:, 48:]
    assert left.max() > 500
    assert right.max() > 500
    assert left.sum() != right.sum()


def test_the_stage_moves_fiducials_too():
    sections = {
        "film": {"width_px": 96, "height_px": 48, "n_frames": 3},
        "rotors": [],
        "split": {},
        "fiducials": {},
        "camera": None,
        "background": None,
    }
    still = frames_of(scene_of(**sections))
    moved = frames_of(scene_of(**sections, drift={"total_nm": [216.6, 0.0]}))
    np.testing.assert_allclose(moved[0], still[0], rtol=1e-5)
    np.testing.assert_allclose(moved[2][:, 10:40], still[2][:, 8:38], rtol=1e-3, atol=1e-2)


def test_crosstalk_is_light_in_the_other_colour():
    sections = {
        "film": {"width_px": 96, "height_px": 48, "n_frames": 2},
        "rotors": [{"x_nm": [2500.0], "y_nm": [2500.0], "photons": 1000.0}],
        "split": {"crosstalk": [0.1, 0.0]},
        "camera": None,
        "background": None,
    }
    image = frames_of(scene_of(**sections))[0]
    assert image[:, :48].sum() == pytest.approx(900.0, rel=1e-5)
    assert image[:, 48:].sum() == pytest.approx(100.0, rel=1e-5)


def test_leaving_an_effect_out_leaves_those_out_that_need_it():
    film = small_everything().film
    assert film.without("camera").names == tuple(
        name
        for name in film.names
        if name not in ("camera", "pixel_maps", "hot_pixels", "column_noise")
    )
    single = film.without("split")
    assert {group.ends for group in single.rotors} == {1}
    assert isinstance(film.without("rotors"), FilmScene)
    assert film.without("rotors").dyes is None


def test_a_film_and_all_that_lies_beside_it(tmp_path):
    scene = small_everything()
    movie = tmp_path / "deep" / "film.ome.tif"
    made = film_scene(scene, movie, workers=2)
    folder = truth_folder(movie)
    assert made.truth == folder
    assert folder.name == "film.truth"
    assert {path.name for path in folder.iterdir()} == {
        *("rotors.csv", "spots.parquet", "scene.toml", "config.toml"),
        *("drift.csv", "camera.npz", "daq.csv"),
    }
    with open_movie(movie) as opened:
        assert opened.shape[0] == made.frames
        np.testing.assert_array_equal(opened.frames(0, made.frames), frames_of(scene))
        assert opened.metadata["pixel_size_nm"].value == pytest.approx(108.3)
    assert read_scene(folder / "scene.toml").film == scene.film
    config = tomllib.loads((folder / "config.toml").read_text())
    assert config["camera"] == {"camera_maps": "camera.npz"}
    spots = pd.read_parquet(folder / "spots.parquet")
    rotors = pd.read_csv(folder / "rotors.csv")
    assert len(spots) == made.frames * (2 * 2 + 1)
    assert list(rotors["motion"]) == ["driven", "driven", "stuck"]
    ends = spots[(spots["rotor"] == 0)].pivot(index="frame", columns="end")
    apart = np.hypot(
        ends["first_x_nm"][1] - ends["first_x_nm"][0], ends["first_y_nm"][1] - ends["first_y_nm"][0]
    )
    assert apart.max() <= rotors["end_to_end_nm"][0] + 2.0
    trace = pd.read_csv(folder / "daq.csv")
    edges = rising_edges(trace["time_s"].to_numpy(), trace["trigger_v"].to_numpy())
    assert len(edges.time_s) == made.frames
    assert frame_clock(edges).period_s == pytest.approx(0.002, rel=1e-3)
    assert trace["voltage_v"].iloc[0] == pytest.approx(0.05, abs=2e-3)


def test_dropped_frames_are_gaps_by_the_times_in_the_file(tmp_path):
    scene = scene_of(film={"n_frames": 60}, dropped={"frames": [7, 20, 21]}, timestamps={})
    movie = tmp_path / "film.ome.tif"
    film_scene(scene, movie)
    with open_movie(movie) as opened:
        assert opened.shape[0] == 57
        numbers = opened.numbers
    assert sorted(set(range(60)) - set(numbers.tolist())) == [7, 20, 21]
    frames = pd.read_parquet(tmp_path / "film.truth" / "spots.parquet")["frame"]
    assert set(frames) == set(numbers.tolist())


def test_a_film_without_rotors_or_camera_is_written_too(tmp_path):
    scene = scene_of(rotors=[], camera=None)
    film_scene(scene, tmp_path / "film.tif")
    with open_movie(tmp_path / "film.tif") as opened:
        assert np.all(opened.frames(0, 30) == 5.0)
    assert pd.read_parquet(tmp_path / "film.truth" / "spots.parquet").empty
    assert pd.read_csv(tmp_path / "film.truth" / "rotors.csv").empty


@pytest.mark.parametrize(
    ("name", "folder"),
    [("at 0.5 V.tif", "at 0.5 V.truth"), ("at 0.7 V.OME.tiff", "at 0.7 V.truth")],
)
def test_a_name_with_a_point_keeps_its_truth_to_itself(tmp_path, name, folder):
    assert truth_folder(tmp_path / name) == tmp_path / folder


def test_the_truth_of_an_earlier_film_is_not_left_beside_a_new_one(tmp_path):
    movie = tmp_path / "film.tif"
    film_scene(scene_of(drift={"total_nm": [90.0, 0.0]}, voltage={}, pixel_maps={}), movie)
    folder = truth_folder(movie)
    assert {"drift.csv", "daq.csv", "camera.npz"} <= {path.name for path in folder.iterdir()}
    film_scene(scene_of(), movie)
    assert {path.name for path in folder.iterdir()} == {
        *("rotors.csv", "spots.parquet", "scene.toml", "config.toml"),
    }


def test_a_voltage_that_makes_a_rotor_alias_is_warned_of():
    slow = [{"x_nm": [2000.0], "y_nm": [2000.0], "omega_rad_s": 600.0}]
    film = {"exposure_s": None}
    warn_of_aliases(film_of(scene_of(film=film, rotors=slow)))
    scene = scene_of(film=film, rotors=slow, voltage={"voltages_mv": [-400.0]})
    with pytest.warns(AliasingWarning, match="382 turns a second"):
        warn_of_aliases(film_of(scene))


def test_a_rotor_of_a_table_is_not_warned_of(tmp_path):
    table = tmp_path / "places.csv"
    table.write_text("frame,rotor,x_nm,y_nm\n0,0,900,900\n")
    scene = scene_of(rotors=[{"motion": "table", "table": str(table)}])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_aliases(film_of(scene))
