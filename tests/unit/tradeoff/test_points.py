"""Answers keep what was measured; fronts and domination are what their definitions say."""

from __future__ import annotations

import csv
import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.report.figures import tradeoff as picture
from rotortrack.tradeoff.ask import ask
from rotortrack.tradeoff.point import (
    Answer,
    Effort,
    Point,
    dominated,
    interval_of_mean,
    pareto,
    stamped,
)

NUMBERS = st.floats(1e-6, 1e6)


@st.composite
def some_point(draw):
    error, spread = draw(NUMBERS), draw(st.floats(0.0, 0.9))
    return Point(
        setting=draw(st.sampled_from("abcd")),
        group=draw(st.sampled_from(["one", "two"])),
        error=error,
        error_low=error * (1.0 - spread),
        error_high=error * (1.0 + spread),
        seconds=draw(NUMBERS),
        is_default=draw(st.booleans()),
        failed=draw(st.sampled_from(["", "", "", "fell over"])),
    )


POINTS = st.lists(some_point(), max_size=12)


def point(setting, error, seconds, *, default=False, spread=0.0, failed=""):
    low, high = error * (1 - spread), error * (1 + spread)
    return Point(setting, "g", error, low, high, seconds, default, failed)


def answer(points, bounds=None):
    return stamped(
        question="rod",
        effort=Effort("quick"),
        points=points,
        error_unit="nm",
        seconds_unit="s",
        bounds=bounds or {},
        advice="Take it.",
    )


@given(POINTS)
def test_the_front_holds_every_point_that_no_other_beats(points):
    front = pareto(points)
    for one in points:
        rivals = [p for p in points if p.group == one.group and not p.failed]
        beaten = any(
            p.error <= one.error
            and p.seconds <= one.seconds
            and (p.error < one.error or p.seconds < one.seconds)
            for p in rivals
        )
        if not one.failed:
            same = [p for p in front if (p.error, p.seconds) == (one.error, one.seconds)]
            assert beaten == (not [p for p in same if p.group == one.group])
        else:
            assert one not in front


@given(POINTS)
def test_no_default_on_the_front_is_dominated(points):
    front = pareto(points)
    assert all(default not in front for default, _ in dominated(points))


def test_a_default_is_dominated_by_what_is_surely_better_in_both():
    default = point("usual", 1.0, 1.0, default=True)
    better = point("other", 0.8, 0.8)
    assert dominated([default, better]) == [(default, better)]
    assert not dominated([default, point("other", 0.8, 0.95)])
    assert not dominated([default, point("other", 0.8, 0.5, spread=0.2)])
    assert not dominated([default, point("other", 0.1, 0.1, failed="wrong state")])


@given(POINTS)
def test_an_answer_is_read_as_it_was_written(points):
    made = answer(points, {"one": 2.0, "two": None})
    assert Answer.from_json(made.to_json()) == made
    rows = list(csv.DictReader(io.StringIO(made.to_csv())))
    assert [float(row["error"]) for row in rows] == [p.error for p in points]
    assert sum(row["pareto"] == "True" for row in rows) >= len(set(pareto(points)))


def test_what_failed_has_no_number_in_json():
    made = answer([Point("a", "g", math.nan, math.nan, math.nan, 1.0, True, "too long")])
    assert made.plain()["points"][0]["error"] is None
    assert math.isnan(Answer.from_json(made.to_json()).points[0].error)


def test_an_interval_is_student_t_of_the_mean():
    assert interval_of_mean([1.0, 2.0, 3.0]) == pytest.approx((2.0, 0.0, 4.484), abs=1e-3)
    assert interval_of_mean([5.0]) == (5.0, 5.0, 5.0)


def test_an_unknown_question_is_refused():
    with pytest.raises(ConfigurationError, match="weather is not a question: known are"):
        ask("weather", Effort("quick"), lambda *_: None)


def test_the_figure_shows_a_panel_a_group_and_names_what_failed():
    points = [
        point("usual", 1.0, 1.0, default=True),
        point("exact", 0.0, 3.0),
        Point("broken", "g", math.nan, math.nan, math.nan, 2.0, False, "fell over"),
        Point("usual", "elsewhere", 1.0, 0.5, 2.0, 1.0, True),
    ]
    made = picture.figure(answer(points, {"g": 0.5}).plain(), "a title")
    assert [axes.get_title(loc="left") for axes in made.axes] == ["g", "elsewhere"]
    words = " ".join(text.get_text() for text in made.texts)
    assert "not shown: broken, g (fell over)" in words.replace("\u00a0", " ")
    dashed = [line for line in made.axes[0].lines if line.get_linestyle() == "--"]
    assert len(dashed) == 1
