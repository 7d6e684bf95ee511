"""Measure the localisation engine against its bars and other programs, side by side in one run.

    python tests/benchmarks/engine.py peers  --scratch DIR   # once: install the other programs
    python tests/benchmarks/engine.py bars   --scratch DIR   # every bar, with verdict and ratios
    python tests/benchmarks/engine.py sweep                  # the defaults over what spots can be
    python tests/benchmarks/engine.py readme                 # the README's table from the results

DIR holds films, tables and the other programs' environment (about 1 GB, and the long movie while it
is measured). `bars` takes about a quarter of an hour; it says what is not installed and goes on
without it, and writes results/engine.json and a dated copy when everything was measured. In every
round each program runs after the other, so that a busy machine is busy for all. With --lock every
timed piece waits for that file's lock, so that several benchmarks on a machine take turns.

films.py draws the films, score.py compares with the truth, stages.py times our stages, peers.py
runs the others, processes.py measures whole processes, report.py writes tables.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

# This process stays small: a child's peak memory is never below its parent's size.
import processes
import report
from processes import HERE, answer

RESULTS = HERE / "results"
FILMS = ("bright", "maps", "dim")
PEERS = ("picasso-mle", "picasso-lsq", "smappy", "trackpy")
NEEDS = {
    "picasso-mle": "picassosr",
    "picasso-lsq": "picassosr",
    "smappy": "smappy-smlm",
    "trackpy": "trackpy",
}
PARTS = ("stages", "processes", "memory")


def install_peers(scratch: Path) -> None:
    """Make the others' environment from the package index; what it lacks is named."""
    python = scratch / "peers" / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", scratch / "peers"], check=True)
    for package in (*dict.fromkeys(NEEDS.values()), "numba"):
        words = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", package]
        if subprocess.run(words).returncode:
            print(f"{package} could not be installed: it will be left out")
    print(json.dumps(answer([python, HERE / "peers.py", "versions"])))


def bars(arguments: argparse.Namespace) -> None:
    """Measure everything, print it, and store it when it is whole."""
    scratch, parts = arguments.scratch, arguments.parts
    subprocess.run([sys.executable, HERE / "films.py", scratch / "films", *FILMS], check=True)
    python = scratch / "peers" / "bin" / "python"
    installed = answer([python, HERE / "peers.py", "versions"]) if python.exists() else {}
    results: dict[str, Any] = {
        "date": datetime.date.today().isoformat(),
        "machine": machine(),
        "versions": versions(installed),
        "rounds": arguments.rounds,
        "left_out": {
            report.TOOLS[tool]: f"{NEEDS[tool]} is not installed"
            for tool in PEERS
            if NEEDS[tool] not in installed
        },
    }
    tools = [tool for tool in PEERS if NEEDS[tool] in installed]
    if "stages" in parts:
        stages(results, tools, arguments)
    if "processes" in parts:
        whole(results, tools, arguments)
    if "memory" in parts:
        results["memory"] = {"rotortrack": memory(arguments)}
    print("\n".join(report.lines(results)))
    if set(parts) == set(PARTS):
        RESULTS.mkdir(exist_ok=True)
        text = json.dumps(results, indent=1) + "\n"
        for name in ("engine.json", f"engine-{results['date']}.json"):
            (RESULTS / name).write_text(text, encoding="utf-8")


def stages(results: dict[str, Any], tools: list[str], arguments: argparse.Namespace) -> None:
    """Rates of every stage and what was found; accuracy needs one round, rates all of them."""
    scratch = arguments.scratch
    films = scratch / "films"
    found = scratch / "found"
    found.mkdir(exist_ok=True)
    rates: dict[str, dict[str, list[dict[str, float]]]] = {}
    python = scratch / "peers" / "bin" / "python"
    for turn in range(arguments.rounds):
        for film, tool in film_runs(tools, first=turn == 0):
            out = found / f"{tool}-{film}.npz"
            words: list[object] = [python, HERE / "peers.py", "stages", tool, films, film, out]
            if tool.startswith("rotortrack"):
                words = [sys.executable, HERE / "stages.py", films, film, out]
            if tool == "rotortrack-even":
                words.append("--even")
            measured = answer(words, arguments.lock)
            rates.setdefault(film, {}).setdefault(tool, []).append(measured)
            print(f"{turn} {film} {tool} {json.dumps(measured)}", flush=True)
    results["rates"] = {
        film: {tool: best_and_median(turns, max) for tool, turns in by_tool.items()}
        for film, by_tool in rates.items()
    }
    results["accuracy"] = {
        film: {
            tool: answer(
                [
                    *(sys.executable, HERE / "score.py"),
                    *(films / f"{film}-truth.npz", found / f"{tool}-{film}.npz"),
                ]
            )
            for tool in by_tool
        }
        for film, by_tool in rates.items()
    }


def film_runs(tools: list[str], *, first: bool) -> list[tuple[str, str]]:
    """Pair films with tools: all for accuracy, then what the rates are taken from."""
    if first:
        everything = [(film, tool) for film in FILMS for tool in ("rotortrack", *tools)]
        return [*everything, ("maps", "rotortrack-even")]
    every = ("rotortrack", *tools)
    knowing_maps = [tool for tool in every if tool in ("rotortrack", "picasso-mle")]
    return [*(("bright", tool) for tool in every), *(("maps", tool) for tool in knowing_maps)]


def whole(results: dict[str, Any], tools: list[str], arguments: argparse.Namespace) -> None:
    """Cold processes from file to table; a first run of each, not counted, fills its caches."""
    scratch, lock = arguments.scratch, arguments.lock
    movie, out = scratch / "films" / "bright.tif", scratch / "ours.parquet"
    peers = processes.peer_commands(scratch / "peers", scratch / "films", scratch)
    commands = {
        "rotortrack": processes.localise_words(movie, out, "--workers", 1),
        "rotortrack-all": processes.localise_words(movie, out),
        **{tool: peers[tool] for tool in tools},
    }
    turns: dict[str, list[dict[str, float]]] = {tool: [] for tool in commands}
    for turn in range(arguments.rounds + 1):
        for tool, words in commands.items():
            measured = processes.measured(words, lock)
            print(f"{turn} process {tool} {json.dumps(measured)}", flush=True)
            if turn:
                turns[tool].append(measured)
    results["processes"] = {tool: best_and_median(runs, min) for tool, runs in turns.items()}


def memory(arguments: argparse.Namespace) -> dict[str, float]:
    """Peak memory and time of our command line on a movie that is much larger than a block."""
    films = arguments.scratch / "films"
    movie = films / "long.tif"
    words = [sys.executable, HERE / "films.py", films, "long", str(arguments.gigabytes)]
    subprocess.run(words, check=True)
    try:
        size = movie.stat().st_size / 1e9
        command = processes.localise_words(movie, arguments.scratch / "long.parquet")
        # Nothing is timed, so nobody has to wait.
        return {"file_gb": size, **processes.measured(command, None)}
    finally:
        movie.unlink()


def best_and_median(turns: Iterable[dict[str, float]], best: Any) -> dict[str, dict[str, float]]:
    """Sum several rounds up, quantity by quantity."""
    turns = list(turns)
    return {
        key: {
            "best": best(turn[key] for turn in turns),
            "median": statistics.median(turn[key] for turn in turns),
        }
        for key in turns[0]
    }


def machine() -> dict[str, Any]:
    """Describe the processor and system."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        models = (row for row in cpuinfo.read_text().splitlines() if row.startswith("model name"))
        name = next(models, name).partition(":")[2].strip() or name
    return {"processor": name, "cores": os.cpu_count(), "system": platform.system()}


def versions(installed: dict[str, str]) -> dict[str, str]:
    """Name the versions of all programs, ours with what it stands on."""
    from importlib.metadata import version

    ours = ("rotortrack", "numpy", "numba")
    own = {"Python": platform.python_version(), **{name: version(name) for name in ours}}
    peers = {package: installed[package] for package in NEEDS.values() if package in installed}
    return own | peers


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the localisation engine.")
    parser.add_argument("what", choices=("peers", "bars", "sweep", "readme"))
    parser.add_argument("--scratch", type=Path, help="folder for films, tables and environment")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--gigabytes", type=float, default=5.0, help="size of the long movie")
    parser.add_argument("--lock", type=Path, help="file whose lock every timed piece waits for")
    arguments = parser.parse_args()
    if arguments.what == "readme":
        stored = json.loads((RESULTS / "engine.json").read_text(encoding="utf-8"))
        report.write_readme(HERE.parents[1] / "README.md", stored)
        return
    if arguments.what == "sweep":
        subprocess.run([sys.executable, HERE / "sweep.py"], check=True)
        return
    if arguments.scratch is None:
        parser.error("--scratch is needed: a folder for films, tables and environment")
    arguments.scratch.mkdir(parents=True, exist_ok=True)
    if arguments.what == "peers":
        install_peers(arguments.scratch)
    else:
        bars(arguments)


if __name__ == "__main__":
    main()
