"""One experiment a file: what a dial of the analysis or the simulation costs and what it buys."""

from __future__ import annotations

from typing import Final

QUESTIONS: Final[dict[str, str]] = {
    name: f"rotortrack.tradeoff.questions.{name}"
    for name in (
        *("localiser", "filter", "drift", "circle", "speed", "msd"),
        *("registration", "field", "rod", "noise", "blocks", "run"),
    )
}
"""Module of each question by its name; none is imported before it is asked."""

ON_MOVIES: Final = ("localiser", "drift")
"""Questions that can be asked about what a movie of the user's is like."""
