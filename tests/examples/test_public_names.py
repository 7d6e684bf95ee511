"""Every public name is typed, documented as it is called, and shown by an example that runs."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re

import pytest

import rotortrack

NAMES = sorted(name for name in rotortrack.__all__ if name != "__version__")
SECTION = re.compile(
    r"^([A-Z][\w ]*)\n-+\n(.*?)(?=^[A-Z][\w ]*\n-+\n|\Z)", re.MULTILINE | re.DOTALL
)
_HEAD = re.compile(r"^(\S.*)$", re.MULTILINE)


def sections(thing):
    return dict(SECTION.findall(inspect.getdoc(thing) or ""))


def described(text):
    """Names that a section describes: those at its left edge."""
    return [name.strip("* ") for line in _HEAD.findall(text) for name in line.split(",")]


@pytest.mark.parametrize("name", NAMES)
def test_the_example_runs_as_it_is_printed(name):
    thing = getattr(rotortrack, name)
    assert "Examples" in sections(thing)
    module = importlib.import_module(thing.__module__)
    finder = doctest.DocTestFinder(recurse=False)
    runner = doctest.DocTestRunner(verbose=False)
    for test in finder.find(thing, name, module=module, globs={}):
        runner.run(test)
    assert runner.tries > 0
    assert runner.failures == 0


@pytest.mark.parametrize("name", NAMES)
def test_what_is_documented_is_what_is_taken(name):
    thing = getattr(rotortrack, name)
    told = sections(thing)
    summary = (inspect.getdoc(thing) or "").split("\n\n")[0]
    assert summary.endswith(".")
    if "Parameters" in told:
        taken = [one for one in inspect.signature(thing).parameters if one != "self"]
        assert described(told["Parameters"]) == taken


@pytest.mark.parametrize("name", NAMES)
def test_all_is_typed(name):
    thing = getattr(rotortrack, name)
    if inspect.isfunction(thing):
        hints = thing.__annotations__
        assert set(inspect.signature(thing).parameters) <= set(hints)
        assert "return" in hints


def test_they_are_few():
    assert len(NAMES) <= 32
