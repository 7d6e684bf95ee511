"""`rotortrack doctor`: whether this computer is fit for the work."""

from __future__ import annotations

import textwrap
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rotortrack.errors import ResourceError
from rotortrack_cli.console import Console, one_line
from rotortrack_cli.flags import output_flags
from rotortrack_cli.stage_option import StageCommand

if TYPE_CHECKING:
    from rotortrack.pipeline.doctor import Finding

WIDTH = 100
_MARKS = {"ok": "ok", "warning": "warning", "impossible": "FAILED"}
_MARK_WIDTH = 9
_TOPIC_WIDTH = 18


@click.command("doctor", cls=StageCommand)
@click.option(
    "--warm",
    is_flag=True,
    help="Compile all kernels by analysing a tiny simulated movie, so that the next command "
    "starts at once.",
)
@output_flags
@click.pass_obj
def command(console: Console, warm: bool) -> None:
    """Look at what the work depends on: versions, processors, memory, disks, compiled kernels.

    Ends with exit code 7 when work is impossible.
    """
    from rotortrack.pipeline.doctor import examine, examine_kernels

    with console.stage("doctor"):
        findings = examine(Path())
    for finding in findings:
        _show(console, finding)
    failed = [finding.topic for finding in findings if finding.level == "impossible"]
    seconds = None
    if not failed:
        if warm:
            seconds = _warm(console)
        findings.append(examine_kernels())
        _show(console, findings[-1])
    console.json(
        {
            "able": not failed,
            "findings": [vars(finding) for finding in findings],
            "warm_up_s": seconds,
        }
    )
    if failed:
        raise ResourceError(
            f"no work can be done here because of {', '.join(failed)}: do what stands beside it"
        )


def _warm(console: Console) -> float:
    """Compile all kernels and find the fonts; give the seconds that it took."""
    from rotortrack.pipeline.doctor import warm_up
    from rotortrack.pipeline.run import Result
    from rotortrack_cli.figures import draw
    from rotortrack_cli.stages import Stages

    unheard = Console()
    unheard.quiet = True

    def draw_quietly(result: Result) -> None:
        with Stages(unheard) as stages:
            draw(result, stages)

    start = time.perf_counter()
    with console.stage("warm up"):
        warm_up(draw_quietly)
    return round(time.perf_counter() - start, 1)


def _show(console: Console, finding: Finding) -> None:
    """Print a finding on lines of its own, with the remedy below it."""
    head = _MARKS[finding.level].ljust(_MARK_WIDTH) + finding.topic.ljust(_TOPIC_WIDTH)
    indent = " " * (_MARK_WIDTH + _TOPIC_WIDTH)
    for text in (finding.state, finding.remedy):
        if text:
            console.text(
                textwrap.fill(
                    one_line(text),
                    WIDTH,
                    initial_indent=head,
                    subsequent_indent=indent,
                    break_long_words=False,
                    break_on_hyphens=False,
                )
            )
        head = f"{indent}-> "
