"""Every public numerical routine has its hard cases, and none of them gets worse unnoticed."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

from .cases.registry import CASES
from .owed import OWED

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
for cases in ("others", "motion", "rotors", "simulate"):
    importlib.import_module(f".cases.{cases}", __package__)

FOLDERS = ("localise", "rotors", "corrections", "motion", "twocolour", "afm", "cameras", "simulate")
NUMBERS = ("float", "Array", "Floats", "Values", "Positions")
ELSEWHERE = ("DataFrame", "Options", "Path", "Movie", "Camera", "Film", "Run", "Scene", "Table")

HEAD = """# What hard cases do to the numerical routines

Written by `python -m pytest tests/stability --write-report`; every other run compares with it, case
by case. A case fails when it loses more than one digit, when a refusal becomes an answer, an answer
a refusal or another kind of answer, and when a case comes or goes without being written here.

- **digits**: fewest significant digits that any number of the answer shares with its reference:
  exact fractions, decimals or extended precision, a formula, or the invariance that the case names.
  15 means to the last place. For `float32` the reference is the same input in double precision.
- **answers**: the kind of answer to spoiled input (one value nan or infinite, all values equal, all
  values denormal, no row, one row).
- **refuses**: the error that names the trouble.
- **does not apply**: with the reason.

Division by zero and invalid operations of numpy are errors in all of them.

| routine | case | outcome |
| --- | --- | --- |
"""


def public_routines() -> list[str]:
    """Functions of modules that take or give numbers, without those on tables, options and files.

    Kernels are compared with plain Python elsewhere.
    """
    found = []
    for folder in FOLDERS:
        for path in sorted((ROOT / "rotortrack" / folder).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT / "rotortrack").with_suffix("").parts)
            for item in ast.parse(path.read_text()).body:
                if not isinstance(item, ast.FunctionDef) or item.name.startswith("_"):
                    continue
                signature = ast.unparse(item.args) + (
                    ast.unparse(item.returns) if item.returns else ""
                )
                if any(ast.unparse(d) == "kernel" for d in item.decorator_list):
                    continue
                if any(word in signature for word in ELSEWHERE):
                    continue
                if any(word in signature for word in NUMBERS):
                    found.append(f"{module}.{item.name}")
    return found


def stored() -> dict[tuple[str, str], str]:
    """Outcomes in the report."""
    rows = [row.split(" | ") for row in (HERE / "REPORT.md").read_text().splitlines()]
    cells = [[cell.strip("| `") for cell in row] for row in rows if len(row) == 3]
    return {(routine, name): outcome for routine, name, outcome in cells[2:]}


def is_worse(outcome: str, before: str) -> bool:
    """Whether digits were lost (more than one) or the kind of outcome changed."""
    now, then = outcome.removesuffix(" digits"), before.removesuffix(" digits")
    if now != outcome and then != before:
        return float(now) < float(then) - 1.0
    return outcome != before


@pytest.fixture(scope="session")
def written(request: pytest.FixtureRequest) -> dict[tuple[str, str], str]:
    if request.config.getoption("--write-report", default=False):
        rows = [f"| `{key[0]}` | {key[1]} | {CASES[key].measure()} |" for key in sorted(CASES)]
        (HERE / "REPORT.md").write_text(HEAD + "\n".join(rows) + "\n")
    return stored()


@pytest.mark.parametrize("key", sorted(CASES), ids="-".join)
def test_no_case_gets_worse(key: tuple[str, str], written: dict[tuple[str, str], str]) -> None:
    outcome = CASES[key].measure()
    assert not outcome.startswith("wrong"), outcome
    assert key in written, "a new case: run pytest tests/stability --write-report"
    assert not is_worse(outcome, written[key]), f"{written[key]} became {outcome}"


def test_the_report_holds_these_cases_and_no_others(written: dict[tuple[str, str], str]) -> None:
    assert set(written) == set(CASES)


def test_every_public_numerical_routine_is_in_the_report() -> None:
    routines = set(public_routines())
    covered = {routine for routine, _ in CASES}
    assert len(routines) > 150
    assert routines - covered == OWED, "give it cases in tests/stability/cases, or take it off OWED"


@pytest.mark.parametrize(
    ("outcome", "before", "worse"),
    [
        ("12.0 digits", "13.1 digits", True),
        ("12.2 digits", "13.1 digits", False),
        ("15.0 digits", "3.0 digits", False),
        ("answers: nan", "refuses: ValueError: no", True),
        ("answers: nan", "answers: finite", True),
    ],
)
def test_what_counts_as_worse(outcome: str, before: str, worse: bool) -> None:
    assert is_worse(outcome, before) is worse
