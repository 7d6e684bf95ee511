"""The tree of errors and warnings."""

from __future__ import annotations

import pickle

import pytest

from rotortrack import errors
from rotortrack.errors import (
    ConfigurationError,
    RegistrationError,
    RotortrackError,
    RotortrackWarning,
)

ERRORS = [
    thing
    for thing in vars(errors).values()
    if isinstance(thing, type) and issubclass(thing, RotortrackError)
]
WARNINGS = [
    thing
    for thing in vars(errors).values()
    if isinstance(thing, type) and issubclass(thing, RotortrackWarning)
]


@pytest.mark.parametrize("kind", ERRORS)
def test_errors_come_back_whole_from_a_worker_process(kind: type[RotortrackError]) -> None:
    given = ["movie.tif is empty"]
    if issubclass(kind, RegistrationError):
        given.insert(0, "no beads")
    error = pickle.loads(pickle.dumps(kind(*given)))
    assert type(error) is kind
    assert str(error) == ": ".join(given)


def test_the_list_of_mistakes_comes_back_from_a_worker_process() -> None:
    error = pickle.loads(pickle.dumps(ConfigurationError("first", "second")))
    assert error.mistakes == ("first", "second")
    assert str(error) == "first; second"


def test_every_error_has_a_code_of_the_command_line_other_than_a_bug() -> None:
    codes = {kind.__name__: kind.exit_code for kind in ERRORS if kind is not RotortrackError}
    assert set(codes.values()) <= {2, 3, 4, 5, 6, 7}
    assert codes["MovieError"] == codes["CameraError"] == codes["TableError"] == 3


def test_every_error_and_warning_says_what_it_is_for() -> None:
    assert all(kind.__doc__ for kind in ERRORS + WARNINGS)
    assert len(WARNINGS) > 5
