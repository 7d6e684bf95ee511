"""A server that forks a child for each command that it is told, with the fault that it is told.

Everything is loaded once, so that a command starts in no time and may be ended in any way. Run
by `runs.Server`, never imported by tests.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import fcntl
import importlib
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from runs import MARK, PART_PIXELS, PATIENCE_S, Ended, Fault, make_movie, run_words


def serve(scratch: Path) -> None:
    """Fork a child for each line of input, which names a command."""
    answers = os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 1)
    orders = os.fdopen(os.dup(0))
    os.dup2(nowhere, 0)
    _warm(scratch)
    for line in orders:
        order = json.loads(line)
        pipes = [_large_pipe() for _ in range(3)]
        pid = os.fork()
        if pid == 0:
            _child(order, *(entrance for _, entrance in pipes))
        for _, entrance in pipes:
            os.close(entrance)
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        out, err, changes = (_drained(end) for end, _ in pipes)
        ended = Ended(code, out, err, changes.splitlines())
        print(json.dumps(dataclasses.asdict(ended)), file=answers, flush=True)


def _large_pipe() -> tuple[int, int]:
    """Give a pipe that takes in all that a command says: limits on files do not hold for it."""
    end, entrance = os.pipe()
    fcntl.fcntl(entrance, fcntl.F_SETPIPE_SZ, 2**20)
    return end, entrance


def _drained(end: int) -> str:
    with os.fdopen(end, "rb") as stream:
        return stream.read().decode(errors="replace")


def _warm(scratch: Path) -> None:
    """Load all code, kernels and fonts into this process."""
    from rotortrack_cli.main import main

    movie = make_movie(scratch / "warm.tif", 120)
    target = scratch / "warm"
    words = [str(word) for word in run_words(movie, target, "--workers", "1", "--quiet")]
    for more in ([], ["--set", "cluster.min_localisations=100000"]):
        main([*words, *more])
    main(["rotors", str(target / "localisations.parquet"), "--frame-interval-s", "0.002",
          "-o", str(scratch / "warm-rotors"), "--quiet"])  # fmt: skip


def _child(order: dict[str, Any], out: int, err: int, changes: int) -> None:
    code = 70
    try:
        signal.alarm(PATIENCE_S)
        os.dup2(out, 1)
        os.dup2(err, 2)
        from rotortrack.pipeline import localise_parts
        from rotortrack_cli.main import main

        localise_parts.PART_PIXELS = PART_PIXELS
        fault = Fault(**order["fault"])
        _arm(fault, changes)
        code = main(order["words"])
    finally:
        with contextlib.suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _arm(fault: Fault, log: int) -> None:
    """Let the fault happen in this process."""
    if fault.function:
        _send_before(fault)
        return
    if fault.largest_bytes >= 0:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (fault.largest_bytes, resource.RLIM_INFINITY))
    real_write = os.write
    happened = 0
    prefix = f"{fault.within}/"

    def change(what: str, path: object, *, grows: bool = True, culprit: object = None) -> None:
        nonlocal happened
        name = os.fsdecode(path) if isinstance(path, str | bytes) else str(path)
        if not name.startswith(prefix) and name != fault.within:
            return
        there = os.path.lexists(name)
        if {"mkdir": there, "remove": not there, "open": there and MARK in name}.get(what):
            return  # This changes nothing; a file is opened again to flush it.
        number, happened = happened, happened + 1
        if fault.act == "count":
            real_write(log, f"{what} {name.removeprefix(prefix)}\n".encode())
        elif fault.act == "signal" and number == fault.at:
            os.kill(os.getpid(), fault.signal)
        elif grows and (
            (fault.act == "enospc" and number == fault.at)
            or (fault.act == "full" and number >= fault.at)
        ):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(culprit or name))

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        match event:
            case "open":
                path, _, flags = arguments
                if isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                    change("open", path)
            case "os.rename":
                change("rename", arguments[1], culprit=arguments[0])
            case "os.mkdir":
                change("mkdir", arguments[0])
            case "os.remove" | "os.rmdir":
                change("remove", arguments[0], grows=False)

    def by_descriptor(function: Callable[..., Any], what: str) -> Callable[..., Any]:
        def call(descriptor: int, *arguments: Any) -> Any:
            change(what, Path(f"/proc/self/fd/{descriptor}").readlink())
            return function(descriptor, *arguments)

        return call

    sys.addaudithook(hook)
    os.fsync = by_descriptor(os.fsync, "fsync")  # type: ignore[assignment]
    os.write = by_descriptor(os.write, "write")  # type: ignore[assignment]


def _send_before(fault: Fault) -> None:
    """Send the signal before a function is called."""
    module_name, _, name = fault.function.partition(":")
    module = importlib.import_module(module_name)
    function = getattr(module, name)

    def call(*arguments: Any, **options: Any) -> Any:
        os.kill(os.getpid(), fault.signal)
        return function(*arguments, **options)

    setattr(module, name, call)


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
