"""Options of the hard cases, and floating-point exceptions as errors around all of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--write-report", action="store_true", help="write tests/stability/REPORT.md anew"
    )


@pytest.fixture(autouse=True)
def exceptions_of_arithmetic() -> Iterator[None]:
    """Division by zero and invalid operations in numpy are errors, not warnings."""
    with np.errstate(divide="raise", invalid="raise"):
        yield
