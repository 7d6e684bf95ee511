"""Rods that take no time, for the tests of scans."""

from __future__ import annotations

import pytest

from rotortrack.simulate import scan

from .rods import FakeRods


@pytest.fixture
def rods(monkeypatch: pytest.MonkeyPatch) -> FakeRods:
    """Let scans simulate rods that take no time, and give what they were asked for."""
    fake = FakeRods()
    monkeypatch.setattr(scan, "simulate_rod", fake)
    return fake
