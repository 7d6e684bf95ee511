"""Every kind of failure has its exit code and its one line."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
from pyarrow.lib import ArrowMemoryError

from rotortrack import errors
from rotortrack_cli.exits import Exit

BUGS: list[Exception] = [
    ValueError("boom"),
    KeyError("boom"),
    FileNotFoundError(errno.ENOENT, "boom"),
    RecursionError("boom"),
]

SCRIPT = """
import sys, time, types
import click
from rotortrack_cli import main

@click.command()
@click.pass_obj
def command(console):
{body}

sys.modules["throwaway"] = types.SimpleNamespace(command=command)
main.rotortrack.lazy = {{"try": ("throwaway", "")}}
sys.exit(main.main(["try"]))
"""


@pytest.fixture
def failing(
    throwaway: Callable[[click.Command], None], call: Callable[..., Any]
) -> Callable[..., Any]:
    """Call a command that raises."""

    def run(error: BaseException, *before: str) -> Any:
        @click.command()
        def command() -> None:
            raise error

        throwaway(command)
        return call(*before, "try")

    return run


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.UsageError("that is wrong"), 2),
        (errors.MovieError("that is wrong"), 3),
        (errors.CameraError("that is wrong"), 3),
        (errors.TableError("that is wrong"), 3),
        (errors.ConfigurationError("that is wrong"), 4),
        (errors.NothingFoundError("that is wrong"), 5),
        (errors.LockedError("that is wrong"), 6),
        (errors.ResourceError("that is wrong"), 7),
    ],
)
def test_our_errors_are_one_line_and_their_code(failing: Any, error: Any, code: int) -> None:
    outcome = failing(error)
    assert (outcome.code, outcome.out, outcome.err) == (code, "", "rotortrack: that is wrong\n")


def test_every_mistake_of_a_configuration_has_its_line(failing: Any) -> None:
    outcome = failing(errors.ConfigurationError("first", "second"))
    assert outcome.code == Exit.CONFIGURATION
    assert outcome.err == "rotortrack: first\nrotortrack: second\n"


@pytest.mark.parametrize("error", BUGS, ids=lambda error: type(error).__name__)
def test_any_other_exception_is_called_our_bug(failing: Any, error: Exception) -> None:
    outcome = failing(error)
    assert outcome.code == Exit.BUG
    assert outcome.err.count("\n") == 1
    assert "bug in rotortrack" in outcome.err
    assert f"{type(error).__name__}: " in outcome.err
    assert "boom" in outcome.err
    assert "--traceback" in outcome.err


def test_traceback_is_shown_on_request_by_flag_or_environment(
    failing: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "Traceback" not in failing(ValueError("boom")).err
    assert "Traceback (most recent call last)" in failing(ValueError("boom"), "--traceback").err
    monkeypatch.setenv("ROTORTRACK_TRACEBACK", "1")
    assert "Traceback (most recent call last)" in failing(ValueError("boom")).err


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "free disk space"),
        (errno.EDQUOT, "free disk space"),
        (errno.EFBIG, "ulimit -f"),
        (errno.EROFS, "that you may read and write"),
        (errno.EACCES, "that you may read and write"),
        (errno.EPERM, "that you may read and write"),
        (errno.EMFILE, "ulimit -n"),
        (errno.ENFILE, "ulimit -n"),
        (errno.ENOMEM, "--workers"),
        (errno.EAGAIN, "--workers"),
        (errno.EIO, "at work"),
        (errno.ESTALE, "at work"),
    ],
)
@pytest.mark.parametrize("name", ["file.parquet", None])
def test_lack_of_resources_is_7_with_what_to_do(
    failing: Any, number: int, remedy: str, name: str | None
) -> None:
    outcome = failing(OSError(number, os.strerror(number), name))
    assert outcome.code == Exit.RESOURCES
    assert "bug" not in outcome.err
    assert outcome.err.count("\n") == 1
    assert os.strerror(number) in outcome.err
    assert remedy in outcome.err
    assert (name or "") in outcome.err


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        ArrowMemoryError("malloc of size 1 failed"),
        ImportError("_core.so: failed to map segment from shared object"),
        ImportError("_core.so: cannot map zero-fill pages: Cannot allocate memory"),
    ],
)
def test_lack_of_memory_is_7(failing: Any, error: Exception) -> None:
    outcome = failing(error)
    assert outcome.code == Exit.RESOURCES
    assert outcome.err.count("\n") == 1
    assert "memory does not suffice" in outcome.err
    assert "--workers" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["nonsense"], "nonsense is not a command: known are run"),
        (["localis"], "did you mean localise?"),
        (["--nonsense"], "--nonsense"),
        (["convert", "a.csv"], "OUT"),
        (["convert", "a.csv", "b.csv", "--pixel-size-nm", "wide"], "wide"),
    ],
)
def test_usage_errors_are_2_and_point_to_help(call: Any, arguments: list[str], part: str) -> None:
    outcome = call(*arguments)
    assert outcome.code == Exit.USAGE
    assert part in outcome.err
    assert outcome.err.endswith("--help\n")
    assert all(line.startswith("rotortrack: ") for line in outcome.err.splitlines())


def test_the_american_spelling_is_an_alias() -> None:
    from rotortrack_cli.main import rotortrack

    assert rotortrack.aliases == {"localize": "localise"}
    assert "localize" not in rotortrack.list_commands(click.Context(rotortrack))


def test_a_reader_that_leaves_early_is_no_failure_to_tell(
    process: Callable[..., subprocess.Popen[str]],
) -> None:
    body = """
    for i in range(100_000):
        console.text(f"line {i}")
"""
    running = process(SCRIPT.format(body=body))
    assert running.stdout is not None
    assert running.stderr is not None
    running.stdout.readline()
    running.stdout.close()
    assert running.stderr.read() == ""
    running.stderr.close()
    assert running.wait(timeout=30) == Exit.READER_GONE


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_stdout_on_a_full_disk_is_7(process: Callable[..., subprocess.Popen[str]]) -> None:
    with Path("/dev/full").open("w") as full:
        running = process(SCRIPT.format(body="    console.text('x')"), stdout=full)
        _, err = running.communicate(timeout=30)
    assert running.returncode == Exit.RESOURCES
    assert "No space left" in err
    assert "Exception ignored" not in err


def test_our_warnings_are_shown_once_in_one_line_and_others_never(
    throwaway: Any, call: Any
) -> None:
    @click.command()
    def command() -> None:
        for _ in range(3):
            warnings.warn("the gain is doubtful:\n measure it", errors.GainWarning, stacklevel=1)
            warnings.warn("numpy is old", DeprecationWarning, stacklevel=1)
            warnings.warn("something else", UserWarning, stacklevel=1)
        warnings.warn("the drift is doubtful", errors.DriftWarning, stacklevel=1)

    throwaway(command)
    for _ in range(2):  # a second call in the same process starts afresh
        outcome = call("try")
        assert outcome.code == 0
        assert outcome.err.splitlines() == [
            "rotortrack: warning: the gain is doubtful: measure it",
            "rotortrack: warning: the drift is doubtful",
        ]


def test_the_filters_of_the_calling_process_are_left_alone(throwaway: Any, call: Any) -> None:
    throwaway(click.Command("try", callback=lambda: None))
    before = list(warnings.filters), warnings.showwarning, signal.getsignal(signal.SIGTERM)
    assert call("try").code == 0
    assert before == (
        list(warnings.filters),
        warnings.showwarning,
        signal.getsignal(signal.SIGTERM),
    )


def test_the_module_runs_as_a_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rotortrack_cli.main", "nonsense"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == Exit.USAGE
