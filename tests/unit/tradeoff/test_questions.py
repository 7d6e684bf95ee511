"""Each question answers, its errors stand above the bound, and the default is in every group."""

from __future__ import annotations

import importlib
import math

import numpy as np
import pytest

from rotortrack.simulate.rod.options import RodOptions
from rotortrack.tradeoff.point import Answer, Effort
from rotortrack.tradeoff.questions import QUESTIONS, blocks, field, noise, registration, rod, run
from rotortrack.twocolour.options import RegisterOptions

TINY = {
    "registration": registration.Sizes((1, 0, 0), grid=11),
    "field": field.Sizes(("default",), (), (0.1, 1.6), (0.1, 1.6), 1),
    "rod": rod.Sizes(2.0, 30.0, (51, 101), 151, 1, (51,), 1, 1e-3),
    "noise": noise.Sizes(1.0, 1.0, (0.1,), (0.1,)),
    "blocks": blocks.Sizes(16, 1),
    "run": run.Sizes(300, 1),
}


@pytest.fixture(scope="module", params=TINY)
def answered(request) -> Answer:
    module = importlib.import_module(QUESTIONS[request.param])
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(module.SIZES, "quick", TINY[request.param])
        if request.param == "run":
            patch.setattr(module, "SETTINGS", ("fast", "balanced", "best"))
            for name in ("SCENES", "MEASURES"):
                patch.setattr(module, name, {"apart": getattr(module, name)["apart"]})
        said: list[tuple[str, int, int]] = []
        made: Answer = module.answer(Effort("quick"), lambda *told: said.append(told))
    assert said
    return made


@pytest.mark.filterwarnings("ignore::rotortrack.errors.RotortrackWarning")
def test_every_group_has_its_default_and_errors_above_the_bound(answered) -> None:
    for group in answered.groups:
        own = [point for point in answered.points if point.group == group]
        assert sum(point.is_default for point in own) == 1
        for point in own:
            assert math.isfinite(point.seconds)
            assert not point.failed
            assert 0.0 <= point.error_low <= point.error <= point.error_high
            assert point.seconds > 0.0
    assert answered.advice.endswith(".")
    assert Answer.from_json(answered.to_json()) == answered
    if answered.question == "registration":
        errors = {point.setting: point.error for point in answered.points}
        assert errors["affine"] > 20.0
        assert answered.bounds["64 beads"] < errors["cross-validated"] < 8.0


def test_the_true_distortion_has_the_size_that_it_is_said_to_have() -> None:
    corner = registration.to_first(np.array([[registration.FIELD_NM] * 2]))[0]
    moved = np.abs(corner - registration.FIELD_NM)
    most = 2.0 * registration.RADIAL_NM + registration.KEYSTONE_NM + registration.WAVE_NM
    assert np.all(moved <= most)
    assert np.all(moved >= most - 2.0 * registration.WAVE_NM)
    assert {RegisterOptions(**values).model for values in registration.MODELS.values()}


def test_a_free_rod_is_drawn_from_the_law_it_is_compared_with() -> None:
    options = RodOptions(n_vertices=1001, length_nm=9000.0)
    shape = noise.equilibrium_rod(np.random.default_rng(1), options)
    edges = np.diff(shape, axis=0)
    assert np.allclose(np.linalg.norm(edges, axis=1), 9.0)
    cosines = np.sum(edges[1:] * edges[:-1], axis=1) / 81.0
    persistence_nm = -9.0 / math.log(cosines.mean())
    # 1000 exponential heights: 3 % of the mean.
    assert persistence_nm == pytest.approx(1500.0, rel=0.12)
    assert np.mean(np.cross(edges[1:], edges[:-1]), axis=0) == pytest.approx(0.0, abs=1.0)


def test_implicit_steps_stiffen_a_rod() -> None:
    sizes = noise.Sizes(4.0, 4.0)
    points = {
        method: noise.measure("bending", method, 0.1, sizes) for method in ("midpoint", "implicit")
    }
    assert points["midpoint"].error_low < 0.02
    assert points["implicit"].error_high > 0.08


def test_a_step_that_the_rod_refuses_is_a_point_that_failed() -> None:
    point = noise.measure("bending", "midpoint", 5.0, noise.Sizes(1.0, 1.0))
    assert "give at most" in point.failed
    assert math.isnan(point.error)
