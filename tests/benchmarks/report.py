"""What engine.py measured, as bars with verdicts and as the README's table.

Reads the dictionary that engine.py stores in results/engine.json; imports nothing beyond the
standard library. Rates are the best of the rounds, since another program on the machine can only
slow a run down; whole processes are given by their best, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

OPENING, CLOSING = "<!-- performance -->", "<!-- /performance -->"

TOOLS = {
    "rotortrack": "rotortrack",
    "picasso-mle": "Picasso MLE",
    "picasso-lsq": "Picasso LSQ",
    "smappy": "SMAPpy",
    "trackpy": "trackpy",
}
_THIN = "\N{THIN SPACE}"


@dataclass(frozen=True)
class Quantity:
    """A row: how to read it for a tool, how to write it, what issue 4 asks.

    `better` is max, min or near_one; `bar` and `stretch` are the asked values (for pulls, the
    largest distance from 1 below and above).
    """

    words: str
    read: Callable[[Mapping[str, Any], str], Any]
    write: Callable[[float], str]
    better: str = "max"
    bar: tuple[float, ...] = ()
    stretch: tuple[float, ...] = ()
    in_readme: bool = True


def _at(*path: str) -> Callable[[Mapping[str, Any], str], Any]:
    """Read results[path], where {} stands for the tool; None where it was not measured."""

    def read(results: Mapping[str, Any], tool: str) -> Any:
        value: Any = results
        for step in path:
            value = None if value is None else value.get(tool if step == "{}" else step)
        return value

    return read


def _fits(results: Mapping[str, Any], tool: str) -> Any:
    """Likelihood fits, with maps where the tool knows maps."""
    if tool == "picasso-lsq":
        return None
    with_maps = _at("rates", "maps", tool, "fits_per_s", "best")(results, tool)
    return with_maps or _at("rates", "bright", tool, "fits_per_s", "best")(results, tool)


def _peak(results: Mapping[str, Any], tool: str) -> Any:
    """Ours on the long movie, which the others are spared."""
    own = _at("memory", tool, "peak_mb")(results, tool)
    return own or _at("processes", tool, "peak_mb", "best")(results, tool)


def _bias(results: Mapping[str, Any], tool: str) -> Any:
    """Give the larger of both axes."""
    scores = _at("accuracy", "bright", tool)(results, tool)
    return scores and max(abs(scores["bias_x_px"]), abs(scores["bias_y_px"]))


def _rate(value: float) -> str:
    digits = len(str(int(value))) - 2
    return f"{round(value, -digits):,.0f}".replace(",", _THIN)


def _decimals(digits: int) -> Callable[[float], str]:
    return lambda value: f"{value:.{digits}f}"


def _accuracy(film: str, key: str) -> Callable[[Mapping[str, Any], str], Any]:
    return _at("accuracy", film, "{}", key)


def _rates(key: str) -> Callable[[Mapping[str, Any], str], Any]:
    return _at("rates", "bright", "{}", key, "best")


QUANTITIES = (
    Quantity("likelihood fits a second, errors included", _fits, _rate, "max", (1.4e6,), (2.5e6,)),
    Quantity("the same, cutting windows included", _rates("windows_per_s"), _rate, in_readme=False),
    Quantity(
        "frames searched a second", _rates("frames_per_s"), _rate, "max", (9000.0,), (18000.0,)
    ),
    Quantity(
        "localisations a second, from frames to errors",
        _rates("localisations_per_s"),
        _rate,
        "max",
        (130e3,),
        (310e3,),
    ),
    Quantity("the same, close spots not taken apart", _rates("alone_per_s"), _rate),
    Quantity(
        "2000 frames from file to table, cold start, s",
        _at("processes", "{}", "wall_s", "best"),
        _decimals(1),
        "min",
        (2.5,),
        (1.2,),
    ),
    Quantity(
        "the same, processor time, s",
        _at("processes", "{}", "cpu_s", "best"),
        _decimals(1),
        "min",
    ),
    Quantity("peak memory, MB", _peak, _decimals(0), "min", (250.0,), (200.0,)),
    *(
        Quantity(
            f"error over bound, {words}",
            _accuracy(film, "error_over_bound"),
            _decimals(3),
            "min",
            (bar,),
            (stretch,),
        )
        for film, words, bar, stretch in (
            ("bright", "800 photons", 1.010, 1.006),
            ("dim", "250 photons", 1.040, 1.033),
            ("maps", "uneven pixels", 1.012, 1.008),
        )
    ),
    Quantity(
        "error over reported error, 800 photons",
        _accuracy("bright", "pull"),
        _decimals(3),
        "near_one",
        (0.98, 1.02),
    ),
    Quantity(
        "error over reported error, 250 photons",
        _accuracy("dim", "pull"),
        _decimals(3),
        "near_one",
        (0.97, 1.05),
    ),
    Quantity("bias of position, px", _bias, _decimals(4), "min", (0.001,)),
    Quantity("recall", _accuracy("bright", "recall"), _decimals(3), "max", (0.99,)),
    Quantity("precision", _accuracy("bright", "precision"), _decimals(4), "max", (0.999,)),
    *(
        Quantity(f"{key}, {words}", _accuracy(film, key), _decimals(4), in_readme=False)
        for film, words in (("dim", "250 photons"), ("maps", "uneven pixels"))
        for key in ("recall", "precision")
    ),
    *(
        Quantity(
            f"bias of photons, {words}",
            _accuracy(film, "photon_bias"),
            _decimals(4),
            "near_zero",
            in_readme=False,
        )
        for film, words in (("bright", "800 photons"), ("dim", "250 photons"))
    ),
)


def holds(value: float, better: str, asked: tuple[float, ...]) -> bool:
    """Tell whether a value reaches what is asked."""
    if better == "near_one":
        return asked[0] <= value <= asked[1]
    return value >= asked[0] if better == "max" else value <= asked[0]


def verdict(quantity: Quantity, value: float) -> str:
    """Say which of bar and stretch a value reaches."""
    if not quantity.bar:
        return ""
    if quantity.stretch and holds(value, quantity.better, quantity.stretch):
        return "stretch"
    return "bar" if holds(value, quantity.better, quantity.bar) else "MISSED"


def lines(results: Mapping[str, Any]) -> Iterator[str]:
    """Write every quantity with its verdict, the other programs', and the ratio to the best."""
    tools = measured_tools(results)
    yield _cells(["", "bar", "stretch", "", *(TOOLS[tool] for tool in tools), "ratio to best"])
    for quantity in QUANTITIES:
        values = {tool: quantity.read(results, tool) for tool in tools}
        own = values.pop("rotortrack", None)
        if own is None:
            continue
        asked = [" to ".join(f"{v:g}" for v in x) for x in (quantity.bar, quantity.stretch)]
        shown = [quantity.write(v) if v is not None else "-" for v in (own, *values.values())]
        yield _cells(
            [
                quantity.words,
                *asked,
                verdict(quantity, own),
                *shown,
                _ratio(quantity.better, own, [v for v in values.values() if v is not None]),
            ]
        )
    if "rotortrack-even" in results.get("accuracy", {}).get("maps", {}):
        own = results["accuracy"]["maps"]["rotortrack-even"]
        yield f"uneven pixels, maps not given: error over bound {own['error_over_bound']:.3f}"
    for name, reason in results.get("left_out", {}).items():
        yield f"left out: {name} ({reason})"


def _ratio(better: str, own: float, others: list[float]) -> str:
    if not others or better not in ("max", "min") or own == 0.0:
        return ""
    factor = own / max(others) if better == "max" else min(others) / own
    return f"{factor:.3g}"


def _cells(cells: list[str]) -> str:
    widths = [48, 12, 8, 8] + [12] * (len(cells) - 4)
    return "".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()


def measured_tools(results: Mapping[str, Any]) -> list[str]:
    """List the tools that something was measured of."""
    parts = (
        results.get("rates", {}).get("bright"),
        results.get("processes"),
        results.get("memory"),
    )
    return [tool for tool in TOOLS if any(tool in part for part in parts if part)]


def readme_table(results: Mapping[str, Any]) -> str:
    """Write the table of the README, markers included."""
    tools = measured_tools(results)
    machine, versions = results["machine"], results["versions"]
    rows = [
        "| one core, 256 x 256 px, 25 spots a frame | "
        + " | ".join(TOOLS[t] for t in tools)
        + " |",
        "| --- |" + " ---: |" * len(tools),
    ]
    for quantity in QUANTITIES:
        values = [quantity.read(results, tool) for tool in tools]
        if quantity.in_readme and values[0] is not None:
            cells = ("-" if value is None else quantity.write(value) for value in values)
            rows.append(f"| {quantity.words} | " + " | ".join(cells) + " |")
    programs = ", ".join(f"{name} {version}" for name, version in versions.items())
    left_out = results.get("left_out", {})
    memory = _at("memory", "rotortrack")(results, "")
    notes = [
        f"Measured on {results['date']} on {machine['processor']} ({machine['cores']} cores), all "
        "programs on the same films in the same run, rates by processor time, the best of "
        f"{results['rounds']} round{'s' if results['rounds'] > 1 else ''}: {programs}.",
        "Films are synthetic, so their truth is known. Our options are the defaults, and so is "
        "SMAPpy's threshold; Picasso's and trackpy's were set by hand, knowing the films. Fits are "
        "timed with maps of the camera where a program takes maps (SMAPpy does not). Processes use "
        "one thread, except that Picasso searches with several; trackpy's error is that of 300 "
        "frames.",
    ]
    if memory:
        notes.append(
            f"Our peak memory is that of a movie of {memory['file_gb']:.0f} GB, the others' that "
            "of 0.26 GB."
        )
    if left_out:
        notes.append("Left out: " + ", ".join(left_out) + ".")
    return "\n".join([OPENING, *rows, "", " ".join(notes), CLOSING])


def replace_table(text: str, table: str) -> str:
    """Put a table between the markers of a text."""
    before, _, rest = text.partition(OPENING)
    _, closing, after = rest.partition(CLOSING)
    if not closing:
        raise ValueError(f"no {OPENING} ... {CLOSING} to put the table between")
    return before + table + after


def write_readme(readme: Path, results: Mapping[str, Any]) -> None:
    """Renew the README's table."""
    text = readme.read_text(encoding="utf-8")
    readme.write_text(replace_table(text, readme_table(results)), encoding="utf-8")
