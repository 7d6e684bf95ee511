"""Flags are made from option classes and find their way into settings with their origin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import click
import pytest

from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Options, Settings, option
from rotortrack.settings import resolve as resolve_layers
from rotortrack_cli import flags
from rotortrack_cli.stage_option import StageCommand


@dataclass(frozen=True, kw_only=True)
class EveryKind(Options):
    """One option of each type."""

    length_nm: float | None = option(None, "a length, nm", gt=0)
    count: int = option(3, "a number", ge=1)
    sharp: bool = option(False, "a switch")
    word: Literal["one", "two"] = option("one", "a word")
    number: Literal[4, 8] = option(8, "a choice of numbers")
    limit: float | str = option("std(F)", "a number or a formula")
    lags: float | Literal["N/4"] = option("N/4", "a number or N/4")
    region: tuple[int, int, int, int] | None = option(None, "a region")
    text: str | None = option(None, "free text")


@pytest.fixture
def stage(throwaway: Any, call: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Call a command that has the flags of some sections; give what it was given."""

    def run(sections: list[str], *arguments: object, resolve: bool = True) -> Any:
        seen: list[Any] = []

        @click.command("try", cls=StageCommand)
        @flags.stage_options(*sections)
        def command(given: flags.Given) -> None:
            seen.append(given)
            if resolve:
                seen[0] = resolve_layers(SECTIONS, flags.gather(given))

        throwaway(command)
        outcome = call("try", *arguments)
        return seen[0] if outcome.code == 0 and seen else outcome

    monkeypatch.setitem(SECTIONS, "every", EveryKind)
    return run


@pytest.mark.parametrize(
    ("arguments", "name", "value"),
    [
        (["--length-nm", "1e2"], "length_nm", 100.0),
        (["--count", "7"], "count", 7),
        (["--sharp"], "sharp", True),
        (["--no-sharp"], "sharp", False),
        (["--word", "two"], "word", "two"),
        (["--number", "4"], "number", 4),
        (["--limit", "12.5"], "limit", 12.5),
        (["--limit", "2*std(F)"], "limit", "2*std(F)"),
        (["--lags", "10"], "lags", 10.0),
        (["--lags", "N/4"], "lags", "N/4"),
        (["--region", "1", "2", "30", "40"], "region", (1, 2, 30, 40)),
        (["--text", "1.5"], "text", "1.5"),
    ],
)
def test_a_flag_of_each_type_arrives_with_its_type(
    stage: Any, arguments: list[str], name: str, value: object
) -> None:
    settings = stage(["every"], *arguments)
    got = getattr(settings["every"], name)
    assert got == value
    assert type(got) is type(value)
    assert settings.origins[f"every.{name}"] == "flag"


def test_an_unset_flag_keeps_the_default_as_its_origin(stage: Any) -> None:
    settings = stage(["every"])
    assert settings["every"] == EveryKind()
    assert {o for key, o in settings.origins.items() if key.startswith("every.")} == {"default"}


def test_wrong_values_of_several_flags_are_listed_at_once(stage: Any) -> None:
    outcome = stage(
        ["every"], "--count", "many", "--word", "three", "--number", "5", "--lags", "N/3"
    )
    assert outcome.code == 2
    *mistakes, hint = outcome.err.splitlines()
    assert len(mistakes) == 4
    for line, part in zip(mistakes, ["--count", "--word", "--number", "--lags"], strict=True):
        assert part in line
    assert hint == "rotortrack: see rotortrack try --help"


def test_misspelt_flags_are_listed_at_once_with_what_was_meant(stage: Any) -> None:
    outcome = stage(["every"], "--lenght-nm", "3", "--cuont=4", "--zzzz", "--count", "2")
    assert outcome.code == 2
    assert outcome.err.splitlines()[:3] == [
        "rotortrack: --lenght-nm is not a flag of this command: did you mean --length-nm?",
        "rotortrack: --cuont is not a flag of this command: did you mean --count?",
        "rotortrack: --zzzz is not a flag of this command",
    ]


def test_values_out_of_bounds_are_a_configuration_error(stage: Any) -> None:
    outcome = stage(["every"], "--count", "0", "--length-nm", "nan")
    assert outcome.code == 4
    assert outcome.err.splitlines() == [
        "rotortrack: flag: [every] length_nm must be greater than 0, not nan",
        "rotortrack: flag: [every] count must be at least 1, not 0",
    ]


def test_a_shared_name_gets_its_section_in_front_and_others_stay_plain() -> None:
    names = [name for flag in flags.flags_of(("drift", "circle")) for name in flag.names]
    assert "--drift-method" in names
    assert "--circle-method" in names
    assert "--method" not in names
    assert "--bins" in names
    assert "--method" in [name for flag in flags.flags_of(("drift",)) for name in flag.names]


def test_prefixed_flags_reach_their_sections(stage: Any) -> None:
    settings = stage(["drift", "circle"], "--drift-method", "none", "--circle-method", "kasa")
    assert settings["drift"].method == "none"
    assert settings["circle"].method == "kasa"


def test_two_flags_of_one_name_fail_at_import(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass(frozen=True, kw_only=True)
    class Taken(Options):
        workers: int = option(1, "a name of the program's own")

    monkeypatch.setitem(SECTIONS, "taken", Taken)
    with pytest.raises(TypeError, match="--workers"):
        flags.stage_options("taken")


def test_help_groups_flags_by_section_with_default_and_unit(throwaway: Any, call: Any) -> None:
    @click.command("try", cls=StageCommand)
    @flags.stage_options("movie", "quality")
    def command(given: flags.Given) -> None:
        """Try."""

    throwaway(command)
    shown = call("try", "--help").out
    assert shown.index("[movie]") < shown.index("--pixel-size-nm") < shown.index("[quality]")
    assert "nm. [default:" in " ".join(shown.split())
    assert "50.0" in shown


def test_all_settings_of_the_workflow_can_be_set_by_name(stage: Any, tmp_path: Path) -> None:
    config = tmp_path / "run.toml"
    config.write_text("[drift]\nbins = 7\nmagnification = 3\n[localise]\nthreshold = 9.5\n")
    settings: Settings = stage(
        ["movie", "localise"],
        *("--preset", "paper", "--config", config),
        *("--set", "drift.bins=8", "--set", "movie.region=[0, 0, 8, 8]"),
        *("--set", "drift.method=none", "--set", "movie.mirrored = true"),
        *("--set", 'localise.threshold="mean(Wave.F1)"', "--wavelet-scale", "3"),
    )
    assert settings["drift"].bins == 8
    assert settings.origins["drift.bins"] == "--set"
    assert settings["drift"].magnification == 3.0
    assert settings.origins["drift.magnification"] == f"config {config}"
    assert settings["drift"].method == "none"
    assert settings["movie"].region == (0, 0, 8, 8)
    assert settings["movie"].mirrored == "true"
    assert settings["localise"].threshold == "mean(Wave.F1)"
    assert settings["localise"].method == "wlsq"
    assert settings.origins["localise.method"] == "preset paper"
    assert settings["localise"].wavelet_scale == 3.0
    assert settings.origins["localise.connectivity"] == "preset paper"
    assert settings.origins["circle.method"] == "default"


@pytest.mark.parametrize(
    "words", [("--camera-maps", "c.npz"), ("--set", "camera.camera_maps=c.npz")]
)
def test_camera_maps_are_found_again_from_another_folder(
    stage: Any, words: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = stage(["camera"], *words)
    assert Path(settings["camera"].camera_maps) == tmp_path / "c.npz"


def test_the_last_of_two_assignments_wins(stage: Any) -> None:
    assert stage([], "--set", "drift.bins=8", "--set", "drift.bins=9")["drift"].bins == 9


@pytest.mark.parametrize("text", ["drift", "bins=3", "drift.bins", "drift.bins=", "=3", "a b.c=1"])
def test_malformed_assignments_are_usage_errors(stage: Any, text: str) -> None:
    outcome = stage([], "--set", text, "--set", "also wrong")
    assert outcome.code == 2
    assert f"--set {text} is not of the form stage.option=value" in outcome.err
    assert "--set also wrong is not" in outcome.err


def test_an_assignment_cannot_smuggle_further_keys(stage: Any) -> None:
    outcome = stage([], "--set", "camera.camera_model=1\nx = 2")
    assert getattr(outcome, "code", None) is None
    assert outcome["camera"].camera_model == "1\nx = 2"


def test_all_mistakes_of_config_assignments_and_flags_are_listed_at_once(
    stage: Any, tmp_path: Path
) -> None:
    config = tmp_path / "run.toml"
    config.write_text("[drfit]\nbins = 3\n[density]\nradius = 50\nmin_neighbours = -1\n")
    outcome = stage(
        ["circle"], "-c", config, "--set", "quality.max_uncertainty=3", "--set", "drift.bins=soon"
    )
    assert outcome.code == 4
    text = outcome.err
    assert text.count("\n") == 5
    assert "[drfit] is not a section: did you mean drift?" in text
    assert "[density] radius is not an option: did you mean radius_nm?" in text
    assert "[density] min_neighbours must be at least 0, not -1" in text
    assert "[quality] max_uncertainty is not an option: did you mean max_uncertainty_nm?" in text
    assert "--set: [drift] bins is 'soon'" in text


def test_mistakes_are_told_before_the_input_is_opened(call: Any, tmp_path: Path) -> None:
    outcome = call(
        *("drift", tmp_path / "absent.csv", "-o", tmp_path / "out.csv", "--bins", "0"),
        *("--set", "drift.smothing=1"),
    )
    assert outcome.code == 4
    assert outcome.err.count("\n") == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (None, "cannot be read"),
        (b"[drift\n", "not valid TOML"),
        (b"[drift]\nmethod = '\xff'\n", "not UTF-8"),
        (b"bins = 3\n", "outside any [section]"),
    ],
)
def test_an_unreadable_configuration_is_one_sentence(
    stage: Any, tmp_path: Path, content: bytes | None, part: str
) -> None:
    config = tmp_path / "run.toml"
    if content is not None:
        config.write_bytes(content)
    outcome = stage([], "-c", config)
    assert outcome.code == 4
    assert part in outcome.err
    assert str(config) in outcome.err


def test_workers_and_strict_are_handed_on(stage: Any) -> None:
    given = stage([], "--workers", "3", "--strict", resolve=False)
    assert (given.workers, given.strict) == (3, True)
    assert stage([], "--workers", "0").code == 2


def test_a_section_that_nothing_was_given_for_makes_no_layer(stage: Any) -> None:
    assert flags.gather(stage(["movie"], resolve=False)) == []
