"""`rotortrack review`: verdicts of people on single rotors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, output_flags

if TYPE_CHECKING:
    from rotortrack.pipeline.review_run import Review


@click.command("review")
@click.argument("run", metavar="RUN", type=FILE)
@click.option(
    "--rotor",
    "rotors",
    type=click.IntRange(min=0),
    multiple=True,
    metavar="N",
    help="A rotor to judge; may be repeated.",
)
@click.option("--verdict", type=click.Choice(["kept", "refused"]), help="What becomes of it.")
@click.option("--reason", default="", metavar="TEXT", help="Why, for whoever reads it later.")
@click.option("--by", metavar="NAME", help="Who says so. [default: the name of the user]")
@output_flags
@click.pass_obj
def command(
    console: Console,
    run: Path,
    rotors: tuple[int, ...],
    verdict: str | None,
    reason: str,
    by: str | None,
) -> None:
    """List the rotors of the run folder RUN with their verdicts, or overrule the screening.

    With --rotor and --verdict the verdict is appended to RUN/curation.toml, and `motion`, `rotors`
    and `run` heed it from then on. The latest verdict on a rotor counts; to withdraw one, remove
    its lines from that file.
    """
    if bool(rotors) != (verdict is not None) or ((reason or by) and not rotors):
        raise click.UsageError("a verdict needs both --rotor and --verdict")
    from rotortrack.pipeline.review_run import add_verdicts, review_run

    if verdict is not None:
        for said in add_verdicts(run, rotors, verdict, reason=reason, by=by):
            console.text(f"rotor {said.rotor}: {verdict} by hand")
    _show(console, run, review_run(run), listed=verdict is None)


def _show(console: Console, run: Path, review: Review, *, listed: bool) -> None:
    """Show all rotors, and what is still to be done."""
    if listed:
        header = ["rotor", "x um", "y um", "R nm", "verdict", "reason", "by hand", "remark"]
        rows: list[list[object]] = [
            [
                *(row["rotor"], row["x_nm"] / 1000.0, row["y_nm"] / 1000.0, row["radius_nm"]),
                *(row["verdict"], row["reason"], row["by_hand"], row["remark"]),
            ]
            for row in review.rotors.to_dict("records")
        ]
        console.table(header, rows)
    if review.pending:
        names = ", ".join(map(str, review.pending[:10])) + ", ..." * (len(review.pending) > 10)
        console.text(
            f"not in the tables yet (rotor {names}): `rotortrack motion {run}` puts them there"
        )
    console.json({"rotors": review.rotors.to_dict("records"), "pending": review.pending})
