"""Write the README's trade-off table from the stored answers.

    python tests/benchmarks/tradeoff_table.py

The answers themselves are made by `rotortrack tradeoff -o tests/benchmarks/results/tradeoff`.
"""

from __future__ import annotations

from pathlib import Path

from rotortrack.tradeoff.point import Answer
from rotortrack.tradeoff.table import as_markdown

STORED = Path(__file__).with_name("results") / "tradeoff"
README = Path(__file__).parents[2] / "README.md"
OPENING, CLOSING = "<!-- tradeoff -->\n", "\n<!-- /tradeoff -->"
ORDER = (
    *("run", "localiser", "filter", "drift", "circle", "speed", "msd"),
    *("registration", "field", "rod", "noise", "blocks"),
)


def table() -> str:
    """Give the table as the stored answers have it."""
    answers = [
        Answer.from_json((STORED / f"{name}.json").read_text(encoding="utf-8")) for name in ORDER
    ]
    return as_markdown(answers)


def main() -> None:
    text = README.read_text(encoding="utf-8")
    before, _, rest = text.partition(OPENING)
    _, _, after = rest.partition(CLOSING)
    README.write_text(before + OPENING + table() + CLOSING + after, encoding="utf-8")


if __name__ == "__main__":
    main()
