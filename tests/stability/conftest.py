"""The option that writes the report anew."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--write-report", action="store_true", help="write tests/stability/REPORT.md anew"
    )
