"""Ordered, bounded work over any executor."""

from __future__ import annotations

import collections
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def default_workers() -> int:
    """Count the processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def map_ordered(
    function: Callable[[_Item], _Result],
    items: Iterable[_Item],
    *,
    workers: int,
    executor: Executor | None = None,
) -> Iterator[_Result]:
    """Yield `function(item)` in the order of the items, at most ``2 * workers`` in flight.

    The bound on what is in flight bounds memory; the order makes the result independent of the
    number of workers and of the executor.

    Parameters
    ----------
    function, items
        What to do and on what; with a process pool both must be picklable.
    workers
        Number of workers of the executor; 1 without an executor runs in the calling thread.
    executor
        Any `concurrent.futures` executor; threads when not given.
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
            pending.append(executor.submit(function, item))
            if len(pending) >= 2 * workers:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        for future in pending:
            future.cancel()
        if own is not None:
            own.shutdown(cancel_futures=True)
