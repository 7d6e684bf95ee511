"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def reference_data() -> Callable[[str], Path]:
    """Give the folder of a reference data set, or skip where it is absent."""
    root = Path(
        os.environ.get("ROTORTRACK_REFERENCE_DATA") or Path(__file__).parents[2] / "shared" / "data"
    )

    def folder(name: str) -> Path:
        if not (root / name).is_dir():
            pytest.skip(f"the reference data set {name} is not on this machine")
        return root / name

    return folder
