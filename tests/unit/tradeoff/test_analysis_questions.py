"""Questions on the analysis: a few seconds of each, in which known truths come out."""

from __future__ import annotations

import importlib
import math

import numpy as np
import pytest

from rotortrack.cameras.camera import Camera
from rotortrack.tradeoff.point import Effort
from rotortrack.tradeoff.questions import QUESTIONS, circle, drift, localiser, msd, speed
from rotortrack.tradeoff.questions import filter as spot_filter

TINY = {
    "localiser": localiser.Sizes(800, 1),
    "filter": spot_filter.Sizes(32, 1),
    "drift": drift.Sizes(2, 1),
    "circle": circle.Sizes(12, 1),
    "speed": speed.Sizes(3, 1),
    "msd": msd.Sizes((100, 1000), 2, 1),
}
SMALLER = {
    "drift": {"20 rotors": drift.Field(20, 12.0, frames=1500, side_nm=6000.0)},
    "localiser": {"500": localiser.Spots(500.0), "border": localiser.Spots(500.0, at_border=True)},
    "speed": {name: speed.GROUPS[name] for name in ("D 10, noise 8 nm", "D 1, noise 25 nm")},
}
_asked = {}


def ask(name):
    """Ask a question with the least effort, once for all tests."""
    if name not in _asked:
        module = importlib.import_module(QUESTIONS[name])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(module, "SIZES", {"quick": TINY[name]})
            if name in SMALLER:
                patch.setattr(module, "GROUPS", SMALLER[name])
            given = (SMALLER[name],) if name in ("drift", "localiser") else ()
            _asked[name] = module.answer(Effort("quick"), lambda *_: None, *given)
    return _asked[name]


def by_setting(name, group):
    return {p.setting: p for p in ask(name).points if p.group == group}


@pytest.mark.parametrize("name", TINY)
def test_every_setting_has_an_error_and_a_time_or_a_reason(name):
    answer = ask(name)
    assert answer.question == name
    assert answer.advice.endswith(".")
    assert "nan" not in answer.advice
    assert {(p.setting, p.group) for p in answer.points} == {
        (setting, group)
        for setting in {p.setting for p in answer.points}
        for group in answer.groups
    }
    for point in answer.points:
        assert point.seconds > 0.0
        assert math.isnan(point.error) if point.failed else point.error_low <= point.error
        assert point.failed or point.error <= point.error_high


@pytest.mark.parametrize("name", TINY)
def test_each_group_has_one_default_that_does_not_fail(name):
    for group in ask(name).groups:
        chosen = [p for p in by_setting(name, group).values() if p.is_default]
        assert [p.failed for p in chosen] == [""]


@pytest.mark.parametrize("group", SMALLER["localiser"])
def test_likelihood_fits_reach_the_bound_and_lanes_equal_float64(group):
    own = by_setting("localiser", group)
    bound = ask("localiser").bounds[group]
    assert 0.9 * bound < own["mle"].error < 1.15 * bound
    assert own["mle float64"].error == pytest.approx(own["mle"].error, rel=1e-3)
    assert own["mle float64"].seconds > own["mle"].seconds
    assert own["centroid"].error > own["mle"].error
    assert own["wlsq"].error > own["mle"].error


def test_one_number_for_all_pixels_is_the_mean_of_the_maps():
    camera = Camera(np.array([[90.0, 110.0]]), np.array([[0.4, 0.6]]), np.array([[1.0, 7.0]]))
    mean = localiser.flat(camera)
    assert (mean.offset_adu, mean.gain_e_per_adu, mean.read_noise_e) == pytest.approx((100, 0.5, 5))


def test_a_clipped_window_tells_less_than_a_whole_one():
    bounds = ask("localiser").bounds
    assert bounds["border"] > 1.1 * bounds["500"]


def test_candidates_that_are_all_right_have_no_error():
    truth = np.array([[0, 10.5, 20.5], [31, 30.5, 40.5]])
    right, found, true = spot_filter.compared(np.floor(truth).astype(np.int32), truth, 32)
    np.testing.assert_array_equal([right, found, true], [[1, 0, 0, 0, 0, 0, 0, 1]] * 3)


def test_a_low_threshold_has_false_candidates_and_a_high_one_misses_faint_spots():
    faint = by_setting("filter", "150 photons, 10 spots")
    assert faint["threshold 8 noise"].error > 3.0 * faint["threshold 5.5 noise"].error
    assert faint["threshold 4 noise"].error > faint["threshold 5.5 noise"].error


def test_drift_is_told_but_for_a_few_nanometres():
    own = by_setting("drift", "20 rotors")
    assert own["none"].error > 20.0
    assert own[drift.DEFAULT].error < 0.2 * own["none"].error


def test_the_error_of_a_drift_is_free_of_a_common_shift():
    pd = pytest.importorskip("pandas")
    truth = np.column_stack([np.linspace(0.0, 90.0, 10), np.zeros(10)])
    told = pd.DataFrame({"frame": np.arange(10), "dx_nm": truth[:, 0] + 70.0, "dy_nm": -4.0})
    assert drift.error_nm(told, truth) == pytest.approx(0.0, abs=1e-9)
    told["dy_nm"] += np.tile([-3.0, 3.0], 5)
    assert drift.error_nm(told, truth) == pytest.approx(3.0 / math.sqrt(2.0))


def test_circle_fits_have_the_known_bound_and_bias():
    whole = circle.Rotor(1000, 360.0, 0.125)
    # Centre 2 s^2 / N per axis, radius s^2 / N.
    assert circle.bound_nm(whole) == pytest.approx(10.0 * math.sqrt(5.0 / 3.0 / 1000), rel=1e-3)
    own = by_setting("circle", "whole circle, noise R / 3")
    assert own["auto"].error < 0.4 * own["kasa"].error < 0.4 * own["pratt"].error


def test_spots_elsewhere_need_the_search_for_outliers():
    own = by_setting("circle", "whole circle, R / 8, 3 % elsewhere")
    assert own["hyper, all spots"].failed or own["hyper, all spots"].error > own["hyper"].error
    assert own["auto"].error < 1.0


def test_the_bound_of_a_speed_is_that_of_diffusion_where_noise_is_small():
    rotor = speed.Rotor(30.0, 10.0, 0.01)
    time_s = speed.INTERVAL_S * (speed.FRAMES - 1)
    assert speed.bound_rad_s(rotor) == pytest.approx(math.sqrt(20.0 / time_s), rel=1e-3)


def test_the_bound_of_a_speed_is_that_of_a_line_where_nothing_diffuses():
    rotor = speed.Rotor(30.0, 1e-9, 8.0)
    time_s = speed.INTERVAL_S * np.arange(speed.FRAMES)
    line = 0.1 / math.sqrt(np.sum((time_s - time_s.mean()) ** 2))
    assert speed.bound_rad_s(rotor) == pytest.approx(line, rel=1e-3)


def test_speeds_are_of_the_order_of_their_bound_and_few_lags_lose_a_slow_one():
    for group in SMALLER["speed"]:
        own = by_setting("speed", group)
        assert own["auto"].error < 4.0 * ask("speed").bounds[group]
    noisy = by_setting("speed", "D 1, noise 25 nm")
    assert noisy["MSD, 10 lags"].error > 5.0 * noisy["auto"].error


def test_every_way_tells_the_speed_of_a_rotor_that_hardly_diffuses():
    rotor = speed.Rotor(40.0, 0.05, 2.0, 0.2)
    seen = speed.turning(rotor, np.random.default_rng(0))
    for way in speed.ways().values():
        assert abs(way(seen) - 40.0) < 4.0 * speed.bound_rad_s(rotor)


def test_transforms_keep_twelve_digits_and_sums_are_the_definition():
    for group in ask("msd").groups:
        assert all(p.error < 1e-12 for p in by_setting("msd", group).values())
    values = msd.by_sums(np.array([0.0, 1.0, np.nan, 4.0]), np.array([1, 2]))
    np.testing.assert_array_equal(values, [1.0, 9.0])
