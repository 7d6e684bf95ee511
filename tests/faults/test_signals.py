"""A wish to stop: the first winds the work down, the second ends it, and nothing hangs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rotortrack_cli.exits import Exit
from rotortrack_cli.signals import Terminated, stoppable

if os.name != "posix":
    pytest.skip("these signals are POSIX's", allow_module_level=True)

COMMAND = """
import signal, sys, time, types
import click
from rotortrack_cli import main

@click.command()
@click.pass_obj
def command(console):
    {body}

sys.modules["throwaway"] = types.SimpleNamespace(command=command)
main.rotortrack.lazy = {{"try": ("throwaway", "")}}
{before}
sys.exit(main.main(["try"]))
"""

WIND_DOWN = """
    try:
        print("ready", flush=True)
        time.sleep(60)
    finally:
        print("winding down", flush=True)
        time.sleep({tidy_s})
        print("done", flush=True)
"""

CODES = [
    (signal.SIGINT, Exit.INTERRUPTED, "rotortrack: stopped\n"),
    (signal.SIGTERM, Exit.TERMINATED, "rotortrack: stopped by the system\n"),
    (signal.SIGHUP, Exit.TERMINATED, "rotortrack: stopped by the system\n"),
]

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start() -> Iterator[Start]:
    running: list[subprocess.Popen[str]] = []

    def go(code: str, *arguments: object) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        return process

    yield go
    for process in running:
        if process.poll() is None:
            process.kill()
        process.communicate()


def command(tidy_s: float = 0.0, before: str = "") -> str:
    return COMMAND.format(body=WIND_DOWN.format(tidy_s=tidy_s).strip(), before=before)


def expect(process: subprocess.Popen[str], line: str) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == line + "\n"


@pytest.mark.parametrize(("number", "code", "sentence"), CODES)
def test_the_first_signal_winds_the_work_down(
    start: Start, number: signal.Signals, code: int, sentence: str
) -> None:
    running = start(command())
    expect(running, "ready")
    running.send_signal(number)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, out, err) == (code, "winding down\ndone\n", sentence)


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("second", "code", "_"), CODES)
def test_the_second_signal_ends_it_at_once(
    start: Start, first: signal.Signals, second: signal.Signals, code: int, _: str
) -> None:
    running = start(command(tidy_s=60))
    expect(running, "ready")
    running.send_signal(first)
    expect(running, "winding down")
    time.sleep(0.3)
    running.send_signal(second)
    out, err = running.communicate(timeout=30)
    assert (running.returncode, out, err) == (code, "", "")


def test_one_wish_told_twice_is_one_wish(start: Start) -> None:
    """A wrapper hands Ctrl-C on that the terminal has sent to both."""
    running = start(command(tidy_s=0.5))
    expect(running, "ready")
    running.send_signal(signal.SIGINT)
    expect(running, "winding down")
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, out, err) == (Exit.INTERRUPTED, "done\n", "rotortrack: stopped\n")


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGINT])
def test_a_signal_that_the_caller_ignores_stays_ignored(
    start: Start, number: signal.Signals
) -> None:
    """As under nohup, or in the background of a shell script."""
    running = start(command(before=f"signal.signal({int(number)}, signal.SIG_IGN)"))
    expect(running, "ready")
    running.send_signal(number)
    time.sleep(0.2)
    assert running.poll() is None
    running.send_signal(signal.SIGTERM)
    running.communicate(timeout=60)
    assert running.returncode == Exit.TERMINATED


def test_a_signal_while_a_failure_is_told_gives_no_traceback(start: Start) -> None:
    slow = """
from rotortrack_cli.console import Console
really = Console.error
def error(self, sentence):
    print("telling", flush=True)
    time.sleep(60)
Console.error = error
"""
    running = start(COMMAND.format(body="raise ValueError('boom')", before=slow))
    expect(running, "telling")
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, out, err) == (Exit.INTERRUPTED, "", "")


IN_A_TERMINAL = """
import os, pty, sys
process, terminal = pty.fork()
if process == 0:
    os.execv(sys.executable, [sys.executable, "-c", sys.argv[1]])
shown = b""
while b"ready" not in shown:
    shown += os.read(terminal, 1000)
os.close(terminal)
print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]))
"""


def test_closing_the_terminal_is_a_stop_though_nothing_can_be_told(start: Start) -> None:
    body = """
    with console.stage("work", 10, "frames"):
        print("ready", flush=True)
        time.sleep(60)
"""
    code = COMMAND.format(body=body.strip(), before="")
    out, err = start(IN_A_TERMINAL, code).communicate(timeout=60)
    assert (out, err) == (f"{int(Exit.TERMINATED)}\n", "")


def test_handlers_are_put_back() -> None:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    with stoppable():
        assert all(signal.getsignal(number) not in before for number in numbers)
    assert [signal.getsignal(number) for number in numbers] == before

    def stop() -> None:
        with stoppable():
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Terminated):
        stop()
    assert [signal.getsignal(number) for number in numbers] == before


def test_outside_the_main_thread_nothing_is_changed() -> None:
    before = signal.getsignal(signal.SIGTERM)
    seen = []

    def work() -> None:
        with stoppable():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]


POOL = """
import multiprocessing, os, signal, sys, time
from pathlib import Path
from rotortrack import parallel

def work(i):
    Path(sys.argv[1], f"begun-{i}").touch()
    time.sleep(0.3)
    Path(sys.argv[1], f"finished-{i}").touch()
    return os.getpid()

def main():
    from rotortrack_cli.signals import stoppable
    with stoppable(), parallel.process_pool(2) as pool:
        try:
            for pid in parallel.map_ordered(work, range(100), workers=2, executor=pool):
                print(pid, flush=True)
        except KeyboardInterrupt:
            begun, finished = (
                sorted(path.name.split("-")[1] for path in Path(sys.argv[1]).glob(pattern))
                for pattern in ("begun-*", "finished-*")
            )
            print("all finished", begun == finished, 0 < len(begun) < 20, flush=True)

if __name__ == "__main__":
    main()
"""


STARTING = (
    POOL.replace(
        "def work(i):", 'if __name__ == "__mp_main__":\n    time.sleep(0.5)\n\ndef work(i):'
    )
    .replace("range(100)", "told()")
    .replace(
        "def main():",
        """def told():
    yield from range(2)
    print("0", flush=True)
    yield from range(2, 100)

def main():""",
    )
)


@pytest.mark.parametrize("code", [POOL, STARTING], ids=["at work", "starting"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP, signal.SIGTERM])
def test_a_pool_of_processes_finishes_what_it_is_at(
    tmp_path: Path, number: signal.Signals, code: str
) -> None:
    """What the terminal sends goes to the workers too, also to those that are not ready yet."""
    script = tmp_path / "pool.py"
    script.write_text(code)
    running = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert running.stdout is not None
        pid = int(running.stdout.readline())
        time.sleep(0.2)
        if number == signal.SIGTERM:
            running.send_signal(number)
        else:
            os.killpg(running.pid, number)
        out, err = running.communicate(timeout=60)
    finally:
        running.kill()
    assert running.returncode == 0, err
    assert out.splitlines()[-1] == "all finished True True"
    assert err == ""
    assert pid == 0 or is_gone(pid)


def test_no_worker_outlives_a_killed_parent(tmp_path: Path) -> None:
    script = tmp_path / "pool.py"
    script.write_text(POOL)
    running = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert running.stdout is not None
        pid = int(running.stdout.readline())
        os.kill(pid, 0)
    finally:
        running.kill()
        running.communicate()
    assert is_gone(pid)


def is_gone(pid: int) -> bool:
    """Whether a process ends within some seconds; one that only waits to be buried has ended."""
    for _ in range(500):
        try:
            os.kill(pid, 0)
            if Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
                return True
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.02)
    return False
