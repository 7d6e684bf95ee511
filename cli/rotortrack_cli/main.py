"""The `rotortrack` command: finds the subcommand, and turns every failure into an exit code.

Nothing scientific is imported here, nor is the code of any subcommand before it is called.
"""

from __future__ import annotations

import contextlib
import errno
import gc
import os
import sys
import traceback
from collections.abc import Sequence

import click

from rotortrack.errors import ConfigurationError, RotortrackError
from rotortrack_cli.console import Console
from rotortrack_cli.exits import Exit
from rotortrack_cli.lazy import LazyGroup
from rotortrack_cli.signals import Terminated, stoppable

# Matrices here are small: threads of BLAS would wait for each other longer than they work, and add
# up in an order that depends on their number. Read when numpy is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

_COMMANDS = {
    "run": "The whole workflow: movie to rotor speeds, figures and summary.",
    "info": "What is in a movie or run folder and what was understood of it.",
    "localise": "Movie to localisations: wavelet filter, candidates, fits.",
    "drift": "Estimate stage drift and subtract it from localisations.",
    "filter": "Keep localisations that are precise and have neighbours.",
    "rotors": "Localisations to rotors: clusters, circles, screening.",
    "motion": "Rotors to angles, speeds, diffusion and behaviour.",
    "review": "Verdicts on single rotors: list them, or overrule the screening.",
    "track": "Mobile particles: spots to tracks and diffusion coefficients.",
    "register": "How the second colour lies on the first, from films of beads.",
    "end-to-end": "Distances between both ends of every rotor, less noise.",
    "compare": "Measured against measured and simulated distances and speeds.",
    "contour": "Rods in an AFM image: lengths and stiffness.",
    "plan": "What photons, frames and exposure a speed will need.",
    "calibrate": "Camera maps from a dark film and films of steady light.",
    "simulate": "Field of a pore, rods in it, scans; films of known rotors.",
    "tradeoff": "What accuracy and effects cost in time on this machine.",
    "convert": "Localisations from one program's format to another's.",
    "doctor": "Whether this computer is fit for the work, and what to do.",
}


@click.command(
    "rotortrack",
    cls=LazyGroup,
    lazy={
        name: (f"rotortrack_cli.commands.{name.replace('-', '_')}", text)
        for name, text in _COMMANDS.items()
    },
    aliases={"localize": "localise"},
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="rotortrack", message="%(prog)s %(version)s")
@click.option(
    "--traceback",
    "show_traceback",
    is_flag=True,
    envvar="ROTORTRACK_TRACEBACK",
    help="Show where in the code a failure happened.",
)
def rotortrack(show_traceback: bool) -> None:
    """Track nanoscale rotors: from a fluorescence movie to speeds with error bars."""


_GARBAGE_OBJECTS = 200_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments
        What stands behind `rotortrack`; `sys.argv` when not given.
    """
    if arguments is None:
        # Libraries are a million objects that stay: a search for garbage among them at every start
        # takes as long as half of their imports.
        gc.set_threshold(_GARBAGE_OBJECTS)
    try:
        with stoppable():
            return _run(arguments)
    except KeyboardInterrupt as stop:
        # It came while the end of the command was being told.
        return _explain(stop)[0]
    finally:
        if arguments is None:
            # Nor is there a need for one at the end of the process.
            gc.freeze()


def _run(arguments: Sequence[str] | None) -> int:
    """Run the command line and tell how it ended."""
    console = Console()
    wants_traceback = False
    try:
        with console.showing_warnings():
            if "_ROTORTRACK_COMPLETE" in os.environ:
                rotortrack.main(arguments, "rotortrack")
            given = list(sys.argv[1:] if arguments is None else arguments)
            context = rotortrack.make_context("rotortrack", given, obj=console)
            wants_traceback = context.params["show_traceback"]
            with context:
                rotortrack.invoke(context)
            sys.stdout.flush()
        return Exit.DONE
    except click.exceptions.Exit as end:
        return end.exit_code
    except click.exceptions.NoArgsIsHelpError as failure:
        console.error_text(failure.format_message())
        return Exit.USAGE
    except BaseException as failure:
        if isinstance(failure, SystemExit):
            raise
        code, sentences = _explain(failure)
        with contextlib.suppress(OSError):
            if wants_traceback and code is not Exit.USAGE:
                console.error_text(traceback.format_exc())
            for sentence in sentences:
                console.error(sentence)
        if code is Exit.READER_GONE:
            _abandon_stdout()
        return code


_MORE_MEMORY = "close other programs, or use fewer --workers, fewer frames or a smaller region"


def _explain(failure: BaseException) -> tuple[int, Sequence[str]]:
    """Choose the exit code and the lines that tell the user what happened."""
    match failure:
        case click.UsageError():
            return Exit.USAGE, _usage_sentences(failure)
        case click.ClickException():
            return Exit.USAGE, [failure.format_message()]
        case ConfigurationError():
            return Exit.CONFIGURATION, failure.mistakes
        case RotortrackError():
            return failure.exit_code, [str(failure)]
        case Terminated():
            return Exit.TERMINATED, ["stopped by the system"]
        case KeyboardInterrupt() | click.Abort():
            return Exit.INTERRUPTED, ["stopped"]
        case MemoryError() | ImportError() if _is_short_of_memory(failure):
            return Exit.RESOURCES, [f"the memory does not suffice: {_MORE_MEMORY}"]
        case OSError() if (stop := _stop_behind(failure)) is not None:
            return _explain(stop)
        case BrokenPipeError():
            return Exit.READER_GONE, []
        case OSError() if failure.errno not in (None, errno.ENOENT):
            return Exit.RESOURCES, [_resource_sentence(failure)]
    return Exit.BUG, [
        f"this is a bug in rotortrack, please report it: {type(failure).__name__}: {failure} "
        "(run `rotortrack --traceback ...` or set ROTORTRACK_TRACEBACK=1 to see where it happened)"
    ]


def _stop_behind(failure: BaseException) -> KeyboardInterrupt | None:
    """Find the wish to stop that a failure followed: a closed terminal cannot be written to."""
    behind = failure.__context__
    while behind is not None and not isinstance(behind, KeyboardInterrupt):
        behind = behind.__context__
    return behind


def _is_short_of_memory(failure: MemoryError | ImportError) -> bool:
    """Whether memory is what lacks; a library is loaded late and may find none for its code."""
    signs = ("failed to map", "cannot map", "annot allocate memory")
    return isinstance(failure, MemoryError) or any(sign in str(failure) for sign in signs)


def _usage_sentences(failure: click.UsageError) -> list[str]:
    lines = failure.format_message().splitlines()
    path = failure.ctx.command_path if failure.ctx else "rotortrack"
    return [*lines, f"see {path} --help"]


def _resource_sentence(failure: OSError) -> str:
    what = f"{failure.filename}: " if failure.filename else ""
    match failure.errno:
        case errno.ENOMEM | errno.EAGAIN:
            remedy = _MORE_MEMORY
        case errno.EMFILE | errno.ENFILE:
            remedy = "close other programs, or allow more open files (`ulimit -n 4096`)"
        case errno.ENOSPC | errno.EDQUOT:
            remedy = "free disk space, or choose another folder"
        case errno.EFBIG:
            remedy = "allow larger files (`ulimit -f`), or choose a folder on another disk"
        case errno.EACCES | errno.EPERM | errno.EROFS:
            remedy = "use files and folders that you may read and write"
        case _:
            remedy = "see that the disk or network drive is at work, or use another one"
    return f"{what}{failure.strerror or failure}: {remedy}"


def _abandon_stdout() -> None:
    """Let Python's flush at exit go nowhere instead of failing a second time."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())
