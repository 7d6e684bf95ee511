"""What `run --accuracy` says that its levels cost, taken from the stored table of `tradeoff run`.

rotortrack tradeoff run -o tests/benchmarks/results/tradeoff
python tests/benchmarks/accuracy_costs.py
"""

from __future__ import annotations

from pathlib import Path

from rotortrack.pipeline.accuracy import COSTS, LEVELS
from rotortrack.tradeoff.point import Answer
from rotortrack.tradeoff.questions.run import MEASURES, group_of

STORED = Path(__file__).parent / "results" / "tradeoff" / "run.json"

_HEAD = """\
# Written by tests/benchmarks/accuracy_costs.py from the stored table of `rotortrack tradeoff run`:
# seconds and error (nm) of each level.
"""


def text(answer: Answer) -> str:
    """Write the file that lies in the package."""
    lines = [f'date = "{answer.date}"']
    for kind, (measure, _) in MEASURES.items():
        lines += ["", f"[scenes.{kind}]", f'measure = "{measure.partition(" ")[0]}"']
        of = {point.setting: point for point in answer.points if point.group == group_of(kind)}
        lines += [f"{level} = [{of[level].seconds:.4g}, {of[level].error:.4g}]" for level in LEVELS]
    return _HEAD + "\n".join(lines) + "\n"


if __name__ == "__main__":
    COSTS.write_text(text(Answer.from_json(STORED.read_text(encoding="utf-8"))), encoding="utf-8")
