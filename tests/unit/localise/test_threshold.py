"""Threshold formulas are parsed into numbers; nothing else passes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.localise.threshold import parse_threshold

rng = np.random.default_rng(2)
PLANES = {name: rng.normal(5, 2, (8, 9)).astype(np.float32) for name in ("I", "F", "F1", "F2")}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("std(Wave.F1)", np.std(PLANES["F1"].astype(float), ddof=1)),
        ("1.5*std( Wave.F1 )", 1.5 * np.std(PLANES["F1"].astype(float), ddof=1)),
        ("mean(I) + 2 * std(F)", PLANES["I"].mean() + 2 * np.std(PLANES["F"], ddof=1)),
        ("median(Wave.F2)/2", np.median(PLANES["F2"]) / 2),
        ("max(Wave.F - mean(F))", (PLANES["F"] - PLANES["F"].mean()).max()),
        ("-(1 - 3) * 2", 4.0),
        ("8 - 4 - 2", 2.0),
        ("16 / 4 / 2", 2.0),
        ("2 + 3 * 4", 14.0),
        ("--3", 3.0),
        ("abs(-2.5e1)", 25.0),
        ("var(F)", np.var(PLANES["F"].astype(float), ddof=1)),
        ("sum(abs(Wave.F1)) - min(I)", np.abs(PLANES["F1"]).sum() - PLANES["I"].min()),
        (12, 12.0),
        (".5", 0.5),
    ],
)
def test_formula_gives_its_value(text, expected):
    assert parse_threshold(text).value(PLANES) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "std(",
        "std(Wave.F3)",
        "std Wave.F1",
        "2 +",
        "2 2",
        "1..2.3.",
        "F",
        "F + 1",
        "__import__('os').system('true')",
        "mean(I) ** 2",
        "max(I, F)",
        "std()",
        ")",
    ],
)
def test_anything_else_is_one_clear_mistake(text):
    with pytest.raises(ConfigurationError, match="threshold") as raised:
        parse_threshold(text)
    assert "\n" not in str(raised.value)


@given(
    st.recursive(
        st.floats(0.1, 100).map(lambda number: f"{number:.3f}"),
        lambda inner: st.tuples(inner, st.sampled_from("+-*"), inner).map(
            lambda parts: "(" + " ".join(parts) + ")"
        ),
        max_leaves=8,
    )
)
def test_arithmetic_agrees_with_python(text):
    expected = eval(text)  # the text holds numbers and + - * alone
    assert parse_threshold(text).value(PLANES) == pytest.approx(expected, rel=1e-5, abs=1e-3)
