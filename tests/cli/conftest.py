"""Ways to call the command line from a test."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import click
import pytest

from rotortrack_cli import main as entry


@dataclass(frozen=True)
class Outcome:
    """What a call printed and its exit code."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        assert self.out.count("\n") == 1
        return json.loads(self.out)


@pytest.fixture
def call(capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Call the command line in this process."""

    def run(*arguments: object) -> Outcome:
        code = entry.main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return Outcome(code, out, err)

    return run


@pytest.fixture
def throwaway(monkeypatch: pytest.MonkeyPatch) -> Callable[[click.Command], None]:
    """Register a command of the test's own under the name `try`."""

    def register(command: click.Command) -> None:
        module = types.ModuleType("throwaway_command")
        module.command = command  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "throwaway_command", module)
        lazy = {**entry.rotortrack.lazy, "try": ("throwaway_command", "A trial.")}
        monkeypatch.setattr(entry.rotortrack, "lazy", lazy)

    return register


@pytest.fixture
def process() -> Callable[..., subprocess.Popen[str]]:
    """Start a fresh Python process on some code, with its output piped."""

    def start(code: str, *arguments: str, **kwargs: Any) -> subprocess.Popen[str]:
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **kwargs}
        environment = {**os.environ, **kwargs.get("env", {})}
        streams["env"] = environment
        return subprocess.Popen([sys.executable, "-c", code, *arguments], **streams)

    return start
