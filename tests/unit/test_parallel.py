"""Work in order, with a bound on what is in flight, over any executor."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotortrack.errors import ResourceError
from rotortrack.parallel import default_workers, map_ordered, process_pool


class CountingExecutor(Executor):
    """A thread pool that counts what was submitted and what was cancelled."""

    def __init__(self, workers: int) -> None:
        self.pool = ThreadPoolExecutor(workers)
        self.futures: list[Future[Any]] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.futures.append(self.pool.submit(fn, *args, **kwargs))
        return self.futures[-1]


def late_first(i: int) -> int:
    time.sleep(0.002 * (5 - i % 5))
    return i * i


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 30), st.integers(1, 5))
def test_results_come_in_the_order_of_the_items(count: int, workers: int) -> None:
    def work(i: int) -> int:
        time.sleep(0.0005 * (i % 3))
        return i * i

    assert list(map_ordered(work, range(count), workers=workers)) == [i * i for i in range(count)]


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_no_more_than_twice_the_workers_is_taken_before_the_consumer_asks(workers: int) -> None:
    taken = 0

    def items() -> Iterator[int]:
        nonlocal taken
        for i in range(100):
            taken += 1
            yield i

    results = map_ordered(late_first, items(), workers=workers)
    assert taken == 0
    for i in range(10):
        assert next(results) == i * i
        assert taken <= i + 2 * workers
    results.close()  # type: ignore[attr-defined]


def test_one_worker_runs_in_the_calling_thread() -> None:
    here = threading.get_ident()
    assert set(map_ordered(lambda _: threading.get_ident(), range(3), workers=1)) == {here}
    assert here not in set(map_ordered(lambda _: threading.get_ident(), range(3), workers=2))


def test_a_given_executor_does_the_work_and_stays_open() -> None:
    executor = CountingExecutor(1)
    assert list(map_ordered(late_first, range(6), workers=1, executor=executor)) == [
        i * i for i in range(6)
    ]
    assert len(executor.futures) == 6
    assert executor.submit(late_first, 2).result() == 4
    executor.pool.shutdown()


def act(what: str | int) -> str | int:
    """Do what a worker may do."""
    if what == "be killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "run out of memory":
        raise MemoryError("array of 9 TiB")
    if what == "ignore Ctrl-C":
        signal.raise_signal(signal.SIGINT)
    return what


@pytest.mark.skipif(os.name != "posix", reason="these signals are POSIX's")
def test_a_pool_of_processes_works_in_order_and_tells_how_a_worker_ended() -> None:
    with process_pool(2) as pool:
        items = [*range(5), "ignore Ctrl-C", 6]
        assert list(map_ordered(act, items, workers=2, executor=pool)) == items
        with pytest.raises(MemoryError, match="9 TiB"):
            list(map_ordered(act, [0, "run out of memory", 2], workers=2, executor=pool))
        with pytest.raises(ResourceError, match=r"was killed.*fewer --workers"):
            list(map_ordered(act, [0, 1, "be killed", *range(9)], workers=2, executor=pool))
        with pytest.raises(ResourceError, match="worker process was killed"):
            list(map_ordered(act, [0], workers=2, executor=pool))


def test_a_shortage_of_threads_is_a_resource_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(ResourceError, match="fewer --workers"):
        list(map_ordered(abs, range(3), workers=2))


def test_any_other_refusal_of_an_executor_is_raised_as_it_is() -> None:
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(RuntimeError, match="after shutdown"):
        list(map_ordered(abs, range(3), workers=2, executor=executor))


@pytest.mark.parametrize("given_executor", [False, True])
def test_an_interrupt_cancels_what_waits_and_finishes_what_runs(given_executor: bool) -> None:
    """The consumer is waiting for a result when the signal comes, as it nearly always is."""
    begun: list[int] = []
    finished: list[int] = []
    pool = ThreadPoolExecutor(2) if given_executor else None
    interrupt = threading.Timer(0.15, os.kill, [os.getpid(), signal.SIGINT])

    def work(i: int) -> int:
        begun.append(i)
        time.sleep(0.1)
        finished.append(i)
        return i

    interrupt.start()
    with pytest.raises(KeyboardInterrupt):
        list(map_ordered(work, range(1000), workers=2, executor=pool))
    assert 2 <= len(begun) < 20
    assert sorted(begun) == sorted(finished)
    interrupt.join()
    if pool is not None:
        assert pool.submit(abs, -1).result() == 1
        pool.shutdown()
    assert sorted(begun) == sorted(finished)


@pytest.mark.parametrize("given_executor", [False, True])
def test_a_failure_waits_for_what_runs(given_executor: bool) -> None:
    """What a failing block leaves running may still read files that the caller will close."""
    finished: list[int] = []
    pool = ThreadPoolExecutor(3) if given_executor else None

    def work(i: int) -> int:
        if i == 0:
            raise ValueError("item 0")
        time.sleep(0.1)
        finished.append(i)
        return i

    with pytest.raises(ValueError, match="item 0"):
        list(map_ordered(work, range(100), workers=3, executor=pool))
    count = len(finished)
    time.sleep(0.2)
    assert len(finished) == count
    if pool is not None:
        pool.shutdown()


def test_the_first_failure_in_order_is_raised_and_the_rest_cancelled() -> None:
    executor = CountingExecutor(1)
    release = threading.Event()

    def work(i: int) -> int:
        if i == 2:
            raise ValueError(f"item {i}")
        if i > 2:
            release.wait(5)
        return i

    results = map_ordered(work, range(100), workers=4, executor=executor)
    assert [next(results), next(results)] == [0, 1]
    threading.Timer(0.1, release.set).start()
    with pytest.raises(ValueError, match="item 2"):
        next(results)
    executor.pool.shutdown()
    assert len(executor.futures) <= 2 + 8
    assert any(future.cancelled() for future in executor.futures)


def test_a_failing_source_of_items_is_raised_and_pending_work_cancelled() -> None:
    executor = CountingExecutor(1)
    release = threading.Event()

    def items() -> Iterator[int]:
        yield from range(3)
        raise OSError("the file ended early")

    threading.Timer(0.1, release.set).start()
    with pytest.raises(OSError, match="ended early"):
        list(map_ordered(lambda _: release.wait(5), items(), workers=4, executor=executor))
    executor.pool.shutdown()
    assert [future.cancelled() for future in executor.futures][1:] == [True, True]


def test_a_consumer_that_stops_leaves_no_thread_behind() -> None:
    before = threading.active_count()
    results = map_ordered(late_first, range(100), workers=3)
    next(results)
    results.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before


def test_the_default_is_the_number_of_processors_that_may_be_used() -> None:
    assert default_workers() >= 1
