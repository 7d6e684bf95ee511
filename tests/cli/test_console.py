"""What is printed: JSON alone on stdout, no control codes, tables that fit."""

from __future__ import annotations

import io
import json
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from rotortrack.errors import GainWarning
from rotortrack_cli.console import Console, format_table, one_line, printable
from rotortrack_cli.flags import output_flags
from rotortrack_cli.stage_option import StageCommand


class Terminal(io.StringIO):
    """A stderr that says that it is a terminal."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


@pytest.fixture
def measure(throwaway: Any, call: Any) -> Callable[..., Any]:
    """Call a command that does all that commands do on the console."""

    @click.command("try", cls=StageCommand)
    @output_flags
    @click.pass_obj
    def command(console: Console) -> None:
        with console.stage("localise", total=20, unit="frames") as advance:
            advance(5)
            warnings.warn("the gain is doubtful", GainWarning, stacklevel=1)
            advance(15)
        console.text("20 frames\n3 spots")
        console.table(["rotor", "speed"], [[1, 2.5]])
        console.json(
            {
                "frames": np.int64(20),
                "speed_deg_s": float("nan"),
                "bound": np.float32(np.inf),
                "values": np.array([1.0, np.nan]),
                "path": Path("a/b.csv"),
                "good": np.bool_(True),
                "rotors": ({"x_nm": 0.1},),
            }
        )

    throwaway(command)
    return lambda *arguments: call("try", *arguments)


def test_json_is_one_object_on_one_line_and_nothing_else(measure: Any) -> None:
    outcome = measure("--json")
    assert outcome.json == {
        "frames": 20,
        "speed_deg_s": None,
        "bound": None,
        "values": [1.0, None],
        "path": str(Path("a/b.csv")),
        "good": True,
        "rotors": [{"x_nm": 0.1}],
        "warnings": ["the gain is doubtful"],
    }


def test_text_is_on_stdout_and_progress_on_stderr(measure: Any) -> None:
    outcome = measure()
    assert outcome.out.splitlines() == ["20 frames", "3 spots", "rotor  speed", "    1    2.5"]
    warning, stage = outcome.err.splitlines()
    assert warning == "rotortrack: warning: the gain is doubtful"
    assert stage.startswith("localise: 20 frames, ")
    assert stage.endswith(" s")


def test_quiet_hides_progress_but_no_warning(measure: Any) -> None:
    outcome = measure("--quiet")
    assert outcome.err == "rotortrack: warning: the gain is doubtful\n"
    assert "20 frames" in outcome.out


def test_an_empty_result_is_still_json(throwaway: Any, call: Any) -> None:
    @click.command("try", cls=StageCommand)
    @output_flags
    @click.pass_obj
    def command(console: Console) -> None:
        console.json({})

    throwaway(command)
    assert call("try", "--json").json == {"warnings": []}
    assert call("try").out == ""


def test_a_terminal_gets_a_bar_with_warnings_above_it(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm-256color")
    console = Console()
    with console.showing_warnings(), console.stage("[red]fit", total=4) as advance:
        advance(1)
        warnings.warn("[bold] is doubtful", GainWarning, stacklevel=1)
        advance(3)
    shown = printable(terminal.getvalue())
    assert "4/4" in shown
    assert "[red]fit" in shown
    assert "rotortrack: warning: [bold] is doubtful\n" in shown


def test_a_failed_stage_is_not_reported_as_done(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="boom"), Console().stage("localise"):
        raise ValueError("boom")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("dirty", "clean"),
    [
        ("plain µm → λ", "plain µm → λ"),
        ("\x1b[31mred\x1b[0m", "red"),
        ("\x1b]0;title\x07name", "name"),
        ("\x1b]8;;http://x\x1b\\link\x1b]8;;\x1b\\", "link"),
        ("a\x9b2Jb\x00\x07\x08\x7f", "a2Jb"),
        ("over\rwritten", "overwritten"),
        ("file\u202egpj.exe", "filegpj.exe"),
        ("lone \x1b", "lone "),
    ],
)
def test_control_codes_do_not_reach_the_terminal(dirty: str, clean: str) -> None:
    assert printable(dirty) == clean


def test_a_sentence_stays_on_one_line() -> None:
    assert one_line("first\nrotortrack: forged\tline") == "first rotortrack: forged line"


def test_text_that_the_encoding_lacks_is_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="ascii"))
    Console().text("5 µm \udcff")
    assert raw.getvalue() == b"5 \\xb5m \\udcff\n"


def test_tables_align_numbers_right_and_words_left() -> None:
    table = format_table(
        ["rotor", "behaviour", "deg/s"],
        [
            [1, "driven_ccw", np.float32(1234.567)],
            [np.int64(12), "stuck", float("nan")],
            [3, "\x1b[1mx", None],
        ],
    )
    assert table.splitlines() == [
        "rotor  behaviour   deg/s",
        "    1  driven_ccw   1235",
        "   12  stuck           -",
        "    3  x               -",
    ]


def test_tables_fit_the_width_and_may_be_empty() -> None:
    table = format_table(["rotor", "reason"], [[1, "very " * 50], [2, "short"]], width=80)
    assert 75 < max(map(len, table.splitlines())) <= 80
    assert table.splitlines()[1].endswith("...")
    assert format_table(["rotor", "reason"], []) == "rotor  reason"


def test_json_of_a_stored_result_keeps_the_warnings_it_had(
    capsys: pytest.CaptureFixture[str],
) -> None:
    console = Console()
    console.as_json = True
    console.warnings = ["old", "new"]
    console.json({"warnings": ["old"]})
    assert json.loads(capsys.readouterr().out) == {"warnings": ["old", "new"]}


def test_what_json_cannot_say_is_our_bug() -> None:
    console = Console()
    console.as_json = True
    with pytest.raises(TypeError, match="object"):
        console.json({"thing": object()})


def test_json_escapes_control_codes(capsys: pytest.CaptureFixture[str]) -> None:
    console = Console()
    console.as_json = True
    console.json({"path": "a\x1b[31m\nb"})
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert json.loads(out)["path"] == "a\x1b[31m\nb"
