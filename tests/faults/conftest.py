"""What several modules of fault tests share."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture(scope="session")
def runs() -> ModuleType:
    """Give the helpers in runs.py."""
    spec = importlib.util.spec_from_file_location("fault_runs", Path(__file__).with_name("runs.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fault_runs"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def server(runs: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Give what runs commands in forked processes."""
    if not hasattr(os, "fork") or not Path("/proc/self/fd").is_dir():
        pytest.skip("these faults are made in the way of Linux")
    started = runs.Server(tmp_path_factory.mktemp("server"))
    yield started
    started.close()


@pytest.fixture(scope="session")
def bench(runs: ModuleType, server: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Give a movie with undisturbed runs of it; tests take copies."""
    return runs.Bench(tmp_path_factory.mktemp("bench"), server)
