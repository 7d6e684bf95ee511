"""Every hard case of every public numerical routine, held against REPORT.md.

    python -m pytest tests/stability/test_report.py --write-report      writes it anew

A case that loses more than one digit, or whose answer becomes of another kind, fails.
"""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from battery import COMMON, FLOATING, LOST, Subject
from cases import registry
from routines import FOLDERS, public_routines

REPORT = Path(__file__).with_name("REPORT.md")
MODULES = [
    importlib.import_module(f"subjects.{name}")
    for name in FOLDERS
    if Path(__file__).with_name("subjects").joinpath(f"{name}.py").is_file()
]
SUBJECTS: dict[str, Subject] = {
    subject.routine: subject for module in MODULES for subject in module.SUBJECTS
}
for name in ("motion", "others", "rotors", "simulate"):
    importlib.import_module(f"cases.{name}")
ROUTINES = sorted({*SUBJECTS, *(routine for routine, _ in registry.CASES)})
EXEMPT: dict[str, str] = {
    routine: reason for module in MODULES for routine, reason in module.EXEMPT.items()
}
HEAD = """# Hard cases, and what becomes of them

Written by `python -m pytest tests/stability/test_report.py --write-report`; the suite fails where a
case loses more than one digit against this table, or where its answer becomes of another kind.

`N digits` of the answer agree with the known one: with the same input in double precision, with the
input in another order, or with the answer to the input before it was scaled, moved or turned, as
the case says; 15 is all of them. `refuses: NAME` is the class of the error, whose sentence the
tests of the routine show. `answers` is a finite answer that nothing exact is known of, `answers as
without it` that of the other rows, `answers nan for it alone` nan for that row and for no other.
Floating-point exceptions (division by zero, invalid operations) in the library's own numpy code are
errors here.
"""


def outcomes(routine: str) -> dict[str, str]:
    """Run the cases of a routine: those of the battery, then those written for it alone."""
    found: dict[str, str] = {}
    if routine in SUBJECTS:
        found = {name: str(make()) for name, make in SUBJECTS[routine].cases()}
    common = {*COMMON, *registry.COMMON} if found else set()
    for (of, name), case in registry.CASES.items():
        if of == routine and name not in common and name not in found:
            found[name] = case.measure()
    return found


def kept_digits(outcome: str) -> float | None:
    return float(outcome.split()[0]) if outcome.endswith(" digits") else None


def stored() -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    for line in REPORT.read_text(encoding="utf-8").splitlines():
        row = re.fullmatch(r"\| `([\w.]+)` \| (.*?) \| (.*) \|", line)
        if row:
            found.setdefault(row[1], {})[row[2]] = row[3]
    return found


@pytest.mark.parametrize("routine", ROUTINES)
def test_no_case_loses_more_than_a_digit(routine, request):
    now = outcomes(routine)
    assert FLOATING not in now.values()
    if request.config.getoption("--write-report"):
        pytest.skip("the report is written anew")
    before = stored().get(routine, {})
    assert list(now) == list(before), "write the report anew: cases came or went"
    for name, outcome in now.items():
        kept, least = kept_digits(outcome), kept_digits(before[name])
        if kept is not None and least is not None:
            assert kept >= least - LOST, (name, before[name])
        else:
            assert outcome == before[name], name


def test_every_public_numerical_routine_is_there_or_exempt_with_a_reason():
    public = public_routines()
    there, exempt = set(ROUTINES), set(EXEMPT)
    assert not there & exempt
    assert not set(public) - there - exempt, "write a subject, or say why there is none"
    assert not exempt - set(public), "these are not public any more"
    assert all(len(reason) > 10 for reason in EXEMPT.values())


def test_the_report_has_no_others(request):
    if request.config.getoption("--write-report"):
        pytest.skip("the report is written anew")
    assert set(stored()) == set(ROUTINES)


def test_the_rule_finds_what_everybody_uses():
    public = public_routines()
    assert {
        "rotors.circle.fit_circle",
        "motion.msd.msd",
        "twocolour.distance.true_distance",
    } <= set(public)
    assert len(public) > 80


@pytest.fixture(scope="module", autouse=True)
def _written(request):
    yield
    if request.config.getoption("--write-report"):
        lines = [HEAD, "| routine | case | outcome |", "| --- | --- | --- |"]
        for routine in ROUTINES:
            lines += [
                f"| `{routine}` | {name} | {outcome} |"
                for name, outcome in outcomes(routine).items()
            ]
        lines += ["", "## Not in it", "", "| routine | why |", "| --- | --- |"]
        lines += [f"| `{routine}` | {reason} |" for routine, reason in sorted(EXEMPT.items())]
        REPORT.write_text("\n".join(lines) + "\n", encoding="utf-8")
