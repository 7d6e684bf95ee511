"""`run --accuracy`: the dials of all stages set at once, and what each setting costs.

A dial stands here when a table of `rotortrack tradeoff` shows that turning it buys time or accuracy
in a run. `balanced` is the default of each. What a setting costs was measured by the question `run`
and lies in `accuracy_costs.toml`, which is written from the stored tables and tested against them.
"""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rotortrack.errors import ConfigurationError
from rotortrack.settings import Layer, Settings

LEVELS: Final = ("fast", "balanced", "best")

_ORIGIN: Final = "accuracy "

COSTS: Final = Path(__file__).with_name("accuracy_costs.toml")


@dataclass(frozen=True)
class Dial:
    """One option and its value at each level.

    Attributes
    ----------
    option
        As `section.key`.
    fast, balanced, best
        Values.
    reason
        What the fast and the best value are about.
    """

    option: str
    fast: Any
    balanced: Any
    best: Any
    reason: str

    def value(self, level: str) -> Any:
        """Give the value at a level."""
        return {"fast": self.fast, "balanced": self.balanced, "best": self.best}[level]


DIALS: Final = (
    Dial(
        "localise.max_emitters",
        1,
        3,
        3,
        "overlapping spots are fitted together; where rotors stand apart there are none",
    ),
    Dial(
        "circle.method",
        "hyper",
        "auto",
        "auto",
        "auto adds the likelihood of distances, the best use of a full ring and the dearest fit",
    ),
    Dial(
        "motion.estimator",
        "increments",
        "auto",
        "auto",
        "auto adds the likelihood on the circle where steps alone would be biased",
    ),
    Dial(
        "motion.msd_covariance",
        False,
        False,
        True,
        "the fit of the MSD with the covariance of its lags, for honest errors of it",
    ),
)
"""In the order of the workflow."""


def accuracy_layer(level: str) -> Layer:
    """Give the values of a level.

    Raises
    ------
    ConfigurationError
        There is no such level.
    """
    if level not in LEVELS:
        raise ConfigurationError(f"--accuracy {level} is not known: known are {', '.join(LEVELS)}")
    values: dict[str, dict[str, Any]] = {}
    for dial in DIALS:
        section, _, key = dial.option.partition(".")
        values.setdefault(section, {})[key] = dial.value(level)
    return Layer(_ORIGIN + level, values)


def accuracy_of(settings: Settings) -> str | None:
    """Tell the level that settings were made with, if any."""
    for level in LEVELS:
        if _ORIGIN + level in settings.origins.values():
            return level
    return None


def cost_notes(settings: Settings) -> tuple[str, ...]:
    """Say what the level that settings were made with costs, and which of its dials others set."""
    level = accuracy_of(settings)
    if level is None:
        return ()
    costs = stored_costs()
    own = _ORIGIN + level
    others = [dial.option for dial in DIALS if settings.origins[dial.option] != own]
    sentences = [_sentence(level, costs)]
    if others:
        sentences.append(f"--accuracy {level} does not set {', '.join(others)}: given otherwise")
    return tuple(sentences)


@functools.cache
def stored_costs() -> dict[str, Any]:
    """Read what the levels cost: when and where it was measured, and numbers by level."""
    return tomllib.loads(COSTS.read_text(encoding="utf-8"))


def _sentence(level: str, costs: dict[str, Any]) -> str:
    """Compare a level with the balanced one, or that with the two others."""
    where = f"measured by `rotortrack tradeoff run`, {costs['date']}"
    if level == "balanced":
        parts = [f"{other} {_beside(other, costs)}" for other in LEVELS if other != level]
        return f"--accuracy balanced, the defaults; {'; '.join(parts)} ({where})"
    return f"--accuracy {level} {_beside(level, costs)} ({where})"


def _beside(level: str, costs: dict[str, Any]) -> str:
    own, usual = costs["levels"][level], costs["levels"]["balanced"]
    time = own["seconds"] / usual["seconds"]
    errors = ", ".join(
        f"{own['errors'][name] / usual['errors'][name]:.2f} times the error of {name}"
        for name in usual["errors"]
    )
    return f"takes {time:.2f} times the balanced time, with {errors}"
