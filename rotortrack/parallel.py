"""Ordered, bounded work over any executor."""

from __future__ import annotations

import collections
import contextlib
import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from typing import ParamSpec, TypeVar

from rotortrack.errors import ResourceError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
_Parameters = ParamSpec("_Parameters")


def default_workers() -> int:
    """Count the processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextlib.contextmanager
def process_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Give an executor of fresh processes, which end with the block and with this process.

    They leave signals to this process, so that Ctrl-C lets them finish what they are at, and they
    show no warnings, which this process has shown. A program that uses them must guard its start
    by ``if __name__ == "__main__"``.

    Parameters
    ----------
    workers
        Number of processes.
    """
    spawn = multiprocessing.get_context("spawn")
    with _starting_deaf():
        executor = _ProcessPool(workers, mp_context=spawn, initializer=_begin_worker)
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


def map_ordered(
    function: Callable[[_Item], _Result],
    items: Iterable[_Item],
    *,
    workers: int,
    executor: Executor | None = None,
) -> Iterator[_Result]:
    """Yield `function(item)` in the order of the items, at most ``2 * workers`` in flight.

    The bound on what is in flight bounds memory; the order makes the result independent of the
    number of workers and of the executor. However it ends, what had not begun is cancelled and what
    was running is finished first.

    Parameters
    ----------
    function, items
        What to do and on what; with a process pool both must be picklable.
    workers
        Number of workers of the executor; 1 without an executor runs in the calling thread.
    executor
        Any `concurrent.futures` executor; threads when not given.

    Raises
    ------
    ResourceError
        A worker process was killed, or no thread can be started.
    """
    if workers == 1 and executor is None:
        yield from map(function, items)
        return
    own = None
    if executor is None:
        executor = own = ThreadPoolExecutor(workers)
    pending: collections.deque[Future[_Result]] = collections.deque()
    try:
        for item in items:
            pending.append(_submit(executor, function, item))
            if len(pending) >= 2 * workers:
                yield _take_first(pending)
        while pending:
            yield _take_first(pending)
    finally:
        wait([future for future in pending if not future.cancel()])
        if own is not None:
            own.shutdown()


def _submit(
    executor: Executor, function: Callable[[_Item], _Result], item: _Item
) -> Future[_Result]:
    try:
        return executor.submit(function, item)
    except BrokenExecutor as error:
        raise _worker_lost() from error
    except RuntimeError as error:
        if "thread" not in str(error):
            raise
        raise ResourceError(
            f"no more work can be begun at once ({error}): use fewer --workers, or close other "
            "programs"
        ) from error


def _take_first(pending: collections.deque[Future[_Result]]) -> _Result:
    """Wait for the first result; it stays pending when the waiting is interrupted."""
    try:
        result = pending[0].result()
    except BrokenExecutor as error:
        raise _worker_lost() from error
    pending.popleft()
    return result


def _worker_lost() -> ResourceError:
    return ResourceError(
        "a worker process was killed, perhaps because the memory did not suffice: use fewer "
        "--workers, fewer frames or a smaller region"
    )


class _ProcessPool(ProcessPoolExecutor):
    """A pool whose processes do not hear the terminal's signals while they start either."""

    def submit(
        self,
        fn: Callable[_Parameters, _Result],
        /,
        *args: _Parameters.args,
        **kwargs: _Parameters.kwargs,
    ) -> Future[_Result]:
        """Hand work on, for which processes are started."""
        with _starting_deaf():
            return super().submit(fn, *args, **kwargs)


@contextlib.contextmanager
def _starting_deaf() -> Iterator[None]:
    """Let processes that are started here inherit that the terminal's signals are blocked."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGHUP))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """Set up a worker process."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    warnings.simplefilter("ignore")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
