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
        "localise.threshold",
        "5.5*noise(Wave.F)",
        "5.5*noise(Wave.F)",
        "4.5*noise(Wave.F)",
        "a lower one finds more of the spots of dim rotors, and more that are none",
    ),
    Dial(
        "localise.fit_radius_px",
        3,
        3,
        4,
        "the tails of a spot tell a little of where it is",
    ),
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
)
"""In the order of the workflow. The fit's method is none of them: likelihood fits are as fast as
closed forms here, and nearer to the bound."""


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
    """Read what the levels cost: when it was measured, then by scene seconds and error of each."""
    return tomllib.loads(COSTS.read_text(encoding="utf-8"))


def _sentence(level: str, costs: dict[str, Any]) -> str:
    """Compare a level with the balanced one, or that with the two others."""
    others = [level] if level != "balanced" else [one for one in LEVELS if one != level]
    told = [f"{other} takes {_beside(other, costs['scenes'])}" for other in others]
    defaults = ", the defaults" if level == "balanced" else ""
    return (
        f"--accuracy {level}{defaults}: beside balanced {'; '.join(told)} (measured by "
        f"`rotortrack tradeoff run`, {costs['date']})"
    )


def _beside(level: str, scenes: dict[str, Any]) -> str:
    parts = []
    for kind, scene in scenes.items():
        time, error = (
            own / usual for own, usual in zip(scene[level], scene["balanced"], strict=True)
        )
        parts.append(
            f"{time:.2f} times the time for {error:.2f} times the error of {scene['measure']} "
            f"({kind})"
        )
    return ", ".join(parts)
