"""Option classes and the merging of layers."""

from __future__ import annotations

import math
import os
import tracemalloc
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pydantic
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import (
    Layer,
    Options,
    _convert,
    option,
    option_fields,
    read_toml,
    resolve,
)


def _not_seven(value: int) -> str | None:
    return "must not be 7" if value == 7 else None


@dataclass(frozen=True, kw_only=True)
class Stage(Options):
    """Options of a stage that is not part of the program."""

    length_nm: float | None = option(None, "a length, nm", gt=0)
    count: int = option(3, "a number", ge=1, le=10, check=_not_seven)
    sharp: bool = option(False, "a switch")
    method: Literal["a", "b"] = option("a", "a word")
    connectivity: Literal[4, 8] = option(8, "a choice of numbers")
    mirrored: Literal["true", "false", "unknown"] = option("unknown", "three answers")
    threshold: float | str = option("std(F)", "a number or a formula")
    lags: float | Literal["N/4"] = option("N/4", "a number or a word")
    frames: tuple[int, int] | None = option(None, "a range", ge=0)


@dataclass(frozen=True, kw_only=True)
class Other(Options):
    """A second section."""

    length_nm: float = option(1.0, "another length")


CLASSES = {"stage": Stage, "other": Other}


def layer(origin: str, **stage: Any) -> Layer:
    return Layer(origin, {"stage": stage})


def mistakes(*layers: Layer) -> tuple[str, ...]:
    with pytest.raises(ConfigurationError) as caught:
        resolve(CLASSES, layers)
    return caught.value.mistakes


def test_later_layers_win_and_every_value_knows_its_origin() -> None:
    settings = resolve(
        CLASSES,
        [layer("preset", count=4, method="b"), layer("config x.toml", count=5), layer("flag")],
    )
    assert settings["stage"] == Stage(count=5, method="b")
    assert settings.origins["stage.count"] == "config x.toml"
    assert settings.origins["stage.method"] == "preset"
    assert settings.origins["stage.sharp"] == "default"
    assert settings.origins["other.length_nm"] == "default"


@pytest.mark.parametrize(
    ("name", "raw", "value"),
    [
        ("length_nm", 5, 5.0),
        ("threshold", 3.5, 3.5),
        ("threshold", "2*std(F)", "2*std(F)"),
        ("lags", 10, 10),
        ("lags", "N/4", "N/4"),
        ("connectivity", 4, 4),
        ("frames", [0, 10], (0, 10)),
        ("mirrored", True, "true"),
        ("mirrored", False, "false"),
        ("sharp", True, True),
    ],
)
def test_good_values_keep_or_get_their_type(name: str, raw: object, value: object) -> None:
    assert getattr(resolve(CLASSES, [layer("t", **{name: raw})])["stage"], name) == value


@pytest.mark.parametrize(
    ("name", "raw", "part"),
    [
        ("length_nm", 0, "must be greater than 0, not 0"),
        ("length_nm", "108", "is '108': input should be a valid number"),
        ("length_nm", True, "is True"),
        ("length_nm", math.nan, "must be greater than 0, not nan"),
        ("length_nm", math.inf, "must be a finite number"),
        ("count", 11, "must be at most 10, not 11"),
        ("count", 0, "must be at least 1, not 0"),
        ("count", 3.5, "is 3.5"),
        ("count", True, "is True"),
        ("count", 7, "must not be 7"),
        ("sharp", 1, "is 1"),
        ("method", "c", "must be one of a, b, not 'c'"),
        ("connectivity", 6, "must be one of 4, 8, not 6"),
        ("lags", "N/3", "is 'N/3'"),
        ("frames", [1, 2, 3], "is (1, 2, 3)"),
        ("frames", [-1, 2], "must be at least 0, not -1"),
        ("frames", [1, 2.5], "is (1, 2.5)"),
    ],
)
def test_wrong_values_are_named_with_their_place(name: str, raw: object, part: str) -> None:
    (mistake,) = mistakes(layer("config x.toml", **{name: raw}))
    assert mistake.startswith(f"config x.toml: [stage] {name} ")
    assert part in mistake


def test_all_mistakes_of_all_layers_are_listed() -> None:
    found = mistakes(
        Layer("a", {"stgae": {"count": 1}, "stage": {"cuont": 2, "method": 3}}),
        Layer("b", {"other": {"length_nm": "x", "width": 1}}),
    )
    assert len(found) == 5
    assert found[0] == "a: [stgae] is not a section: did you mean stage?"
    assert found[1] == "a: [stage] cuont is not an option: did you mean count?"
    assert found[4] == "b: [other] width is not an option: known are length_nm"


def test_construction_checks_bounds_and_choices_and_lists_all() -> None:
    with pytest.raises(ConfigurationError) as caught:
        Stage(count=0, length_nm=-1.0, method="c")  # type: ignore[arg-type]
    assert [text.split()[0] for text in caught.value.mistakes] == ["length_nm", "count", "method"]


@given(st.floats(), st.integers(-5, 20))
def test_a_value_is_accepted_exactly_when_it_keeps_its_bounds(length: float, count: int) -> None:
    good = math.isfinite(length) and length > 0 and 1 <= count <= 10 and count != 7
    try:
        settings = resolve(CLASSES, [layer("t", length_nm=length, count=count)])
    except ConfigurationError:
        assert not good
    else:
        assert good
        assert settings["stage"] == Stage(length_nm=length, count=count)


def test_required_values_are_all_named_with_the_way_to_give_them() -> None:
    settings = resolve(CLASSES, [])
    settings.require("stage.count", "other.length_nm")
    with pytest.raises(ConfigurationError) as caught:
        settings.require("stage.length_nm", "stage.count", "stage.frames")
    first, second = caught.value.mistakes
    assert "--length-nm" in first
    assert "[stage]" in first
    assert "--frames" in second


def test_settings_written_out_are_read_back_the_same() -> None:
    settings = resolve(CLASSES, [layer("t", frames=[0, 4], threshold=2.5, mirrored=True)])
    as_dict = settings.as_dict()
    assert as_dict["stage"]["frames"] == [0, 4]
    assert "length_nm" not in as_dict["stage"]
    assert resolve(CLASSES, [Layer("again", as_dict)])["stage"] == settings["stage"]


def test_fields_come_in_order_with_their_description() -> None:
    fields = option_fields(Stage)
    assert [field.name for field in fields][:3] == ["length_nm", "count", "sharp"]
    by_name = {field.name: field for field in fields}
    assert by_name["method"].choices == ("a", "b")
    assert by_name["lags"].choices == ()
    assert by_name["length_nm"].types == (float,)
    assert by_name["threshold"].types == (float, str)
    assert by_name["count"].description == "a number"


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"[stage\n", "not valid TOML"),
        (b"[stage]\nmethod = '\xff'\n", "not UTF-8"),
        (b"count = 3\n[stage]\n", "count stands outside any [section]"),
        (b"[stage]\ncount = 3\ncount = 4\n", "not valid TOML"),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, content: bytes, part: str) -> None:
    path = tmp_path / "run.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError) as caught:
        read_toml(path)
    assert str(path) in str(caught.value)
    assert part in str(caught.value)


def test_what_is_no_file_is_refused_without_waiting(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    for path in (tmp_path, pipe):
        with pytest.raises(ConfigurationError, match="is not a file"):
            read_toml(path)
    for name in ("absent.toml", "a\0b"):
        with pytest.raises(ConfigurationError, match="cannot be read"):
            read_toml(tmp_path / name)


def test_a_file_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "movie.toml"
    with path.open("wb") as file:
        file.truncate(100_000_000)
    tracemalloc.start()
    with pytest.raises(ConfigurationError, match="larger than 1 MB"):
        read_toml(path)
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("x=" + "[" * 100_000, "nested more deeply"),
        ("x=" + "{a=" * 5_000, "nested more deeply"),
        ("[stage]\n" + ".".join("a" * 100_000) + "=1", "more than 50 dots in line 2"),
        ("[stage]\ncount = " + "9" * 5_000, "not valid TOML"),
        ("[stage]\nmethod = '\x00'", "not valid TOML"),
        ("[[stage]]\ncount = 3", "array of them"),
        ("\n".join(f"a{i} = 1" for i in range(50_000)), "and more: these are the first 20"),
    ],
    ids=["brackets", "braces", "dots", "digits", "nul", "array", "many"],
)
def test_toml_made_to_exhaust_the_parser_is_refused_at_once(
    tmp_path: Path, content: str, part: str
) -> None:
    path = tmp_path / "run.toml"
    path.write_text(content)
    with pytest.raises(ConfigurationError) as caught:
        read_toml(path)
    assert part in str(caught.value)
    assert len(str(caught.value)) < 5_000


@pytest.mark.parametrize(
    ("line", "refused"),
    [
        ("# {dots}", False),
        ("count = 4 # {dots}", False),
        ("a{dots}a = 1 # a comment", True),
        ("a.'#'{dots}a = 1", True),
        ('a = [""" \n # """, {{a{dots}a = 1}}]', True),
    ],
)
def test_dots_count_where_they_may_be_of_a_key(tmp_path: Path, line: str, refused: bool) -> None:
    path = tmp_path / "run.toml"
    path.write_text("[stage]\ncount = 3\n[other]\n" + line.format(dots=".a" * 60 + "."))
    if refused:
        with pytest.raises(ConfigurationError, match="more than 50 dots in line"):
            read_toml(path)
    else:
        assert read_toml(path)["stage"] == {"count": 3}


def test_very_many_mistakes_are_cut_and_long_values_shortened() -> None:
    many = mistakes(layer("x", **{f"option_{i}": 1 for i in range(3_000)}))
    assert len(many) == 21
    assert many[-1] == "and more: these are the first 20 mistakes"
    (one,) = mistakes(layer("x", count=list(range(100_000))))
    assert len(one) < 300
    (one,) = mistakes(layer("x", **{"a\x1b[31m" * 1_000: 1}))
    assert len(one) < 400
    assert one.isprintable()


@pytest.mark.parametrize("number", [10**400, -(10**400), 2**63])
def test_whole_numbers_that_no_array_holds_are_refused(number: int) -> None:
    for name in ("count", "frames"):
        raw = [0, number] if name == "frames" else number
        (mistake,) = mistakes(layer("x", **{name: raw}))
        assert len(mistake) < 300


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text("[stage]\ncount = 4\n", encoding="utf-8-sig")
    content: Mapping[str, Any] = read_toml(path)
    assert content == {"stage": {"count": 4}}


RAW = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-5, 20),
    st.sampled_from([2**53, 2**70, "mle", "bound", "lsq ", "unknown", "paper", [], [0, 4], {}]),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.one_of(st.integers(-5, 5), st.floats(), st.text(max_size=2)), max_size=4),
)


@given(raw=RAW, data=st.data())
def test_values_taken_without_pydantic_are_those_that_it_takes(raw: Any, data: Any) -> None:
    """Plain values skip its import; every option of the program is tried."""
    field = data.draw(
        st.sampled_from([field for kind in SECTIONS.values() for field in option_fields(kind)])
    )
    value, problem = _convert(field, raw)
    raw = str(raw).lower() if isinstance(raw, bool) and str(raw).lower() in field.choices else raw
    raw = tuple(raw) if isinstance(raw, list) else raw
    adapter = pydantic.TypeAdapter(field.annotation, config=pydantic.ConfigDict(strict=True))
    try:
        expected = adapter.validate_python(raw)
    except pydantic.ValidationError:
        assert problem is not None
    else:
        assert problem is None
        assert (type(value), repr(value)) == (type(expected), repr(expected))
