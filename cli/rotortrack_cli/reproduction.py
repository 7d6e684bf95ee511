"""`rotortrack run --reproduce`: a run repeated and compared."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import click

from rotortrack.errors import InputError
from rotortrack_cli.console import Console
from rotortrack_cli.flags import Given
from rotortrack_cli.stages import Stages


def repeat(
    console: Console, run: Path, movies: tuple[Path, ...], output: Path | None, given: Given
) -> None:
    """Repeat a run, into a folder that is removed again when none is given, and say what differs.

    Raises
    ------
    click.UsageError
        Options were given that would make another run of it.
    InputError
        The tables differ by more than rounding.
    """
    if given.flags or given.assignments or given.config or given.preset:
        raise click.UsageError(
            "--reproduce takes all options from the run: leave the others out",
            click.get_current_context(),
        )
    from rotortrack.pipeline.reproduce import reproduce

    with _folder(output) as target, Stages(console) as stages:
        found = reproduce(run, target, paths=movies, workers=given.workers, progress=stages)
    for comparison in found.comparisons:
        console.text(comparison.sentence)
    for name, (before, now) in found.versions.items():
        console.text(f"version: {name} was {before}, is {now}")
    console.json(
        {
            "identical": found.identical,
            "tables": {
                comparison.table: {
                    "rows": comparison.rows,
                    "earlier_rows": comparison.earlier_rows,
                    "worst_column": comparison.worst_column,
                    "relative_difference": comparison.difference,
                }
                for comparison in found.comparisons
            },
            "versions_changed": dict(found.versions),
        }
    )
    if not found.agrees:
        worst = max(found.comparisons, key=lambda comparison: comparison.difference)
        raise InputError(
            f"{run} was not reproduced ({worst.sentence}): compare the versions, or keep the "
            "repetition with -o to look into it"
        )


@contextlib.contextmanager
def _folder(output: Path | None) -> Iterator[Path]:
    if output is not None:
        yield output
        return
    with tempfile.TemporaryDirectory(prefix="rotortrack-") as folder:
        yield Path(folder) / "repeated"
