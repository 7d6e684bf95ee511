"""Shapes of rotating rods: the same however they stand, mirrored where they turn the other way."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rotortrack.errors import AliasingWarning, ArchiveError, ConfigurationError, InputError
from rotortrack.exchange.parquet import write_table
from rotortrack.settings import Layer
from rotortrack.simulate.archive import write_archive
from rotortrack.simulate.film.film import Film
from rotortrack.simulate.film.filming import shapes_for, warn_of_aliases
from rotortrack.simulate.film.population import draw_rotors
from rotortrack.simulate.film.shapes import (
    CLOUDS_NM,
    shape_of_run,
    shape_of_vertices,
    shapes_of,
)
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.scan import planned_runs, runs_table, simulate_run
from rotortrack.simulate.scene import make_scene
from rotortrack.simulate.scene_field import field_for
from rotortrack.simulate.single import simulate_rod
from rotortrack.simulate.tables import RUNS

ROD = {
    "field": {},
    "rod": {"n_vertices": 21},
    "stepping": {"duration_us": 300.0, "stop_when_settled": True},
}


def scene_of(**sections):
    return make_scene([Layer("test", {**ROD, **sections})])


def bent(n=46):
    """A rod along a quarter of a circle, then straight, 450 nm long."""
    along = np.linspace(0.0, 450.0, n)
    bend = np.minimum(along, 225.0) / 150.0
    directions = np.stack([np.cos(bend), np.sin(bend), 0.1 * np.ones(n)], axis=1)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    steps = directions[:-1] * 450.0 / (n - 1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]) - np.array([60, 30, 0])


def turned(x, angle):
    c, s = math.cos(angle), math.sin(angle)
    return x @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


@pytest.fixture(scope="module")
def rotating():
    scene = scene_of()
    field = field_for(scene.field).table
    return simulate_rod(scene.rod, scene.start, scene.stepping, field, None).run


def test_a_rod_has_one_shape_however_it_is_turned():
    first = shape_of_vertices(bent(), 5.0, CLOUDS_NM)
    for angle in (0.3, 2.0, -3.0):
        again = shape_of_vertices(turned(bent(), angle), 5.0, CLOUDS_NM)
        np.testing.assert_allclose(np.array(again.ends), np.array(first.ends), atol=1e-9)


def test_ends_are_the_middles_of_the_dyes_and_point_outwards():
    x = bent()
    shape = shape_of_vertices(x, 5.0, CLOUDS_NM)
    # The last 40 nm of the rod are straight, as are nearly the first 20.
    first = x[-1] + 20.0 * (x[-2] - x[-1]) / np.linalg.norm(x[-2] - x[-1])
    (radius, angle, tangent), (second_radius, second_angle, _) = shape.ends
    assert radius == pytest.approx(math.hypot(first[0], first[1]), rel=1e-3)
    assert angle == 0.0
    direction = x[-1] - x[-2]
    place = math.atan2(first[1], first[0])
    expected = math.atan2(direction[1], direction[0]) - place
    assert math.remainder(tangent - expected, 2 * math.pi) == pytest.approx(0.0, abs=1e-3)
    second = x[0] + 10.0 * (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
    assert second_radius == pytest.approx(math.hypot(second[0], second[1]), rel=1e-2)
    apart = math.hypot(*(first - second)[:2])
    assert shape.end_to_end_nm == pytest.approx(apart, rel=1e-2)
    between = math.atan2(second[1], second[0]) - place
    assert math.remainder(second_angle - between, 2 * math.pi) == pytest.approx(0.0, abs=1e-2)


def test_a_mirrored_rod_has_the_opposite_angles():
    plain = shape_of_vertices(bent(), 5.0, CLOUDS_NM)
    mirrored = shape_of_vertices(bent() * np.array([1.0, -1.0, 1.0]), -5.0, CLOUDS_NM)
    for (r, a, t), (r2, a2, t2) in zip(plain.ends, mirrored.ends, strict=True):
        assert (r2, -a2, -t2) == pytest.approx((r, a, t))


def test_a_simulated_rod_turns_as_its_shape_says(rotating):
    shape = shape_of_run(rotating, CLOUDS_NM, "the rod")
    assert rotating.end is RodEnd.ROTATING_STEADILY
    assert shape.rate_rev_s == rotating.numbers.rate_rev_s
    assert shape.breathing_sd_nm == (0.0, 0.0)
    last = shape_of_vertices(rotating.positions_nm[-1], shape.rate_rev_s, CLOUDS_NM)
    np.testing.assert_allclose(np.array(shape.ends), np.array(last.ends), rtol=0.02, atol=0.02)


def test_what_does_not_turn_makes_no_rotor(rotating):
    still = dataclasses.replace(rotating, end=RodEnd.DOCKED_STILL)
    with pytest.raises(ConfigurationError, match=r"the rod does not keep turning \(docked_still\)"):
        shape_of_run(still, CLOUDS_NM, "here")


def test_a_rod_is_taken_from_its_file(rotating, tmp_path):
    rotating.save(tmp_path / "rod.npz")
    (shape,) = shapes_of(str(tmp_path / "rod.npz"), scene_of())
    assert shape == shape_of_run(rotating, CLOUDS_NM, "")
    with pytest.raises(InputError, match="does not exist"):
        shapes_of(str(tmp_path / "none.npz"), scene_of())
    (tmp_path / "bad.npz").write_bytes(b"PK nonsense")
    with pytest.raises(ArchiveError):
        shapes_of(str(tmp_path / "bad.npz"), scene_of())


def test_the_rods_of_a_scan_are_those_that_turn(tmp_path):
    scan = {"lambda_eff": [0.05, 0.26], "flow_ratio": [130.0], "offset_x_nm": [0.0]}
    scene = scene_of(scan={**scan, "offset_y_nm": [3.0], "mirrored": True})
    shapes = shapes_of("rod", scene)
    field = field_for(scene.field).table
    results = [simulate_run(scene, field, run) for run in planned_runs(scene.scan)]
    turning = [r for r in results if r.row["end"] == "rotating_steadily"]
    assert [shape.rate_rev_s for shape in shapes] == [r.row["rate_rev_s"] for r in turning]
    assert {math.copysign(1.0, shape.rate_rev_s) for shape in shapes} == {1.0, -1.0}
    write_table(tmp_path / "runs.parquet", runs_table([r.row for r in results]), RUNS, {})
    stored = {"shape_nm": np.array([r.shape_nm for r in results])}
    write_archive(tmp_path / "shapes.npz", stored, {})
    assert shapes_of(str(tmp_path), scene) == shapes
    write_archive(tmp_path / "shapes.npz", {"shape_nm": stored["shape_nm"][:1]}, {})
    with pytest.raises(InputError, match="belongs to other runs"):
        shapes_of(str(tmp_path), scene)
    (tmp_path / "shapes.npz").unlink()
    with pytest.raises(InputError, match=r"no finished scan \(shapes.npz is missing\)"):
        shapes_of(str(tmp_path), scene)


def test_a_scan_without_rotors_is_refused():
    scan = {"lambda_eff": [0.05], "flow_ratio": [130.0], "offset_x_nm": [0.0]}
    with pytest.raises(ConfigurationError, match="no rod of the scan keeps turning"):
        shapes_of("rod", scene_of(scan={**scan, "offset_y_nm": [3.0]}))


def test_thermal_motion_makes_ends_breathe():
    (shape,) = shapes_of("rod", scene_of(thermal={"seed": 3}))
    (calm,) = shapes_of("rod", scene_of())
    assert all(0.5 < sd < 60.0 for sd in shape.breathing_sd_nm)
    assert shape.rate_rev_s == calm.rate_rev_s
    group = {"x_nm": [2000.0], "y_nm": [2000.0], "shape": "rod"}
    film = scene_of(film={}, rotors=[group]).film
    (rotor,) = draw_rotors(film, [(shape,)])
    assert rotor.breathing_sd_nm == pytest.approx(math.hypot(*shape.breathing_sd_nm) / 2**0.5)


@pytest.mark.parametrize("direction", ["ccw", "cw"])
def test_rotors_are_mirrored_to_turn_as_asked(direction, rotating):
    shape = shape_of_run(rotating, CLOUDS_NM, "")
    group = {"x_nm": [2000.0], "y_nm": [2000.0], "shape": "rod", "ends": 2, "direction": direction}
    scene = scene_of(film={}, split={}, rotors=[group])
    (rotor,) = draw_rotors(scene.film, [(shape,)])
    sign = 1.0 if direction == "ccw" else -1.0
    hand = sign * math.copysign(1.0, shape.rate_rev_s)
    assert rotor.omega_rad_s * sign > 0.0
    assert rotor.ends[1].phase_rad == pytest.approx(hand * shape.ends[1][1])
    assert rotor.ends[1].radius_nm == shape.ends[1][0]


def test_a_rods_own_rate_is_taken_where_asked_and_warned_of(rotating):
    shape = shape_of_run(rotating, CLOUDS_NM, "")
    group = {"x_nm": [2000.0], "y_nm": [2000.0], "shape": "rod", "own_rate": True}
    short = {"exposure_s": 1e-4, "width_px": 40, "height_px": 40, "n_frames": 2}
    film = Film(scene_of(film=short, rotors=[group]).film, [(shape,)])
    omega = 2.0 * math.pi * abs(shape.rate_rev_s)
    assert abs(film.rotors[0].omega_rad_s) == pytest.approx(omega)
    with pytest.warns(AliasingWarning, match="is seen to turn at .* on a ring of"):
        warn_of_aliases(film)
    slow = {**group, "own_rate": False}
    warn_of_aliases(Film(scene_of(film=short, rotors=[slow]).film, [(shape,)]))
    with pytest.raises(ConfigurationError, match="own_rate needs motion driven"):
        scene_of(film={}, rotors=[{"own_rate": True}])


def test_groups_share_the_rods_that_they_name(monkeypatch):
    calls = []

    def once(name, _):
        calls.append(name)
        return ("a rod",)

    monkeypatch.setattr("rotortrack.simulate.film.shapes.shapes_of", once)
    rotors = [{"shape": "rod"}, {}, {"shape": "rod", "motion": "brownian"}]
    assert shapes_for(scene_of(film={}, rotors=rotors)) == [("a rod",), (), ("a rod",)]
    assert calls == ["rod"]
