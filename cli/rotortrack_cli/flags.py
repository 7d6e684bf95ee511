"""Flags made from the option classes, and the way back from flags to settings.

An unset flag stays None, so that the origin of every value is known when the layers (file
metadata, preset, configuration, flags) are merged.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import re
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from rotortrack.errors import ProtocolWarning
from rotortrack.pipeline.presets import PRESETS, SECTIONS, preset_layer
from rotortrack.settings import Layer, option_fields, parse_toml, read_content, resolve
from rotortrack_cli.console import Console
from rotortrack_cli.stage_option import Flag

_Function = TypeVar("_Function", bound=Callable[..., Any])

FILE = click.Path(path_type=Path)
"""A path argument; whether the file can be used is for the library to say."""


@dataclass(frozen=True)
class Given:
    """What the user asked for on the command line, before anything is merged or checked."""

    preset: str | None
    config: Path | None
    assignments: tuple[str, ...]
    flags: Mapping[str, Mapping[str, Any]]
    workers: int | None
    strict: bool

    def adding(self, section: str, **values: Any) -> Given:
        """Give the same with further flags."""
        flags = {**self.flags, section: {**self.flags.get(section, {}), **values}}
        return dataclasses.replace(self, flags=flags)


def stage_options(*sections: str) -> Callable[[_Function], _Function]:
    """Add the flags of some sections and those that every stage command has.

    The decorated function receives one argument `given`, to be handed to :func:`gather`. A
    name that several of the sections share becomes one flag each, with the section in front.

    Parameters
    ----------
    *sections
        Sections whose options become flags (`drift`), or single options (`movie.exposure_s`); none
        for a command with `--set` alone.

    Raises
    ------
    TypeError
        At import: two flags still have the same name.
    """
    section_flags = flags_of(sections)

    def decorate(function: _Function) -> _Function:
        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            flags: dict[str, dict[str, Any]] = {}
            for flag in section_flags:
                value = kwargs.pop(flag.parameter)
                if value is not None:
                    flags.setdefault(flag.section, {})[flag.field.name] = value
            common = {name: kwargs.pop(name) for name in _COMMON_NAMES}
            return function(*args, given=Given(flags=flags, **common), **kwargs)

        decorated: Any = call
        for add in reversed(_COMMON):
            decorated = add(decorated)
        decorated = output_flags(decorated)
        for flag in reversed(section_flags):
            decorated = flag.add_to(decorated)
        return decorated  # type: ignore[no-any-return]

    return decorate


def output_flags(function: _Function) -> _Function:
    """Add `--quiet` and `--json`, which set the console and are not passed on."""

    def set_console(attribute: str) -> Callable[[click.Context, click.Parameter, bool], None]:
        def store(ctx: click.Context, param: click.Parameter, value: bool) -> None:  # noqa: ARG001
            setattr(ctx.ensure_object(Console), attribute, value)

        return store

    quiet = click.option(
        "--quiet",
        "-q",
        is_flag=True,
        expose_value=False,
        callback=set_console("quiet"),
        help="Show no progress.",
    )
    as_json = click.option(
        "--json",
        is_flag=True,
        expose_value=False,
        callback=set_console("as_json"),
        help="Print the result as one line of JSON.",
    )
    return quiet(as_json(function))


def output_option(metavar: str, meaning: str) -> Callable[[_Function], _Function]:
    """Add the demanded `-o`, which the function receives as the path `output`."""
    return click.option("--output", "-o", type=FILE, required=True, metavar=metavar, help=meaning)


def flags_of(sections: tuple[str, ...]) -> list[Flag]:
    """Make the flags of some sections.

    Raises
    ------
    TypeError
        Two flags, prefixed or common ones included, have the same name.
    """
    chosen = [
        (section, field)
        for section, _, name in (word.partition(".") for word in sections)
        for field in option_fields(SECTIONS[section])
        if name in ("", field.name)
    ]
    shared = Counter(field.name for _, field in chosen)
    flags = [Flag(section, field, prefixed=shared[field.name] > 1) for section, field in chosen]
    taken = Counter(name for flag in flags for name in flag.names) + _COMMON_FLAGS
    twice = [name for name, count in taken.items() if count > 1]
    if twice:
        raise TypeError(f"the flag {twice[0]} would have two meanings")
    return flags


def gather(given: Given) -> list[Layer]:
    """List what was given from weak to strong: preset, configuration file, `--set`, flags.

    The values are checked here, before any input is opened.

    Raises
    ------
    click.UsageError
        A `--set` is not of the form stage.option=value; all such are listed.
    ConfigurationError
        The configuration file cannot be read; or all mistakes of configuration, `--set` and
        flags, listed at once.
    """
    assignments = parse_assignments(given.assignments)
    layers = []
    if given.preset is not None:
        layers.append(preset_layer(given.preset))
    if given.config is not None:
        layers.append(_read_config(given.config))
    if assignments:
        layers.append(Layer("--set", _located(assignments, Path())))
    if given.flags:
        layers.append(Layer("flag", _located(given.flags, Path())))
    resolve(SECTIONS, layers)
    return layers


def _read_config(path: Path) -> Layer:
    """Read a configuration, in TOML or as ThunderSTORM's protocol; its content tells which.

    Files that it names lie where it lies.
    """
    from rotortrack.exchange.thunderstorm_protocol import is_protocol, read_protocol

    content = read_content(path)
    if is_protocol(content):
        protocol = read_protocol(content, path)
        for sentence in protocol.left_out:
            warnings.warn(f"protocol {path.name}: {sentence}", ProtocolWarning, stacklevel=2)
        return Layer(f"protocol {path.name}", protocol.values)
    values = parse_toml(content, path)
    return Layer(f"config {path}", _located(values, path.parent))


def _located(
    values: Mapping[str, Mapping[str, Any]], folder: Path
) -> Mapping[str, Mapping[str, Any]]:
    """Say where named files lie without regard to a folder: a run records it for later."""
    located = {section: dict(entries) for section, entries in values.items()}
    for section, key in _FILES_NAMED:
        name = located.get(section, {}).get(key)
        # A folder that was removed has no name; the reader of the file says so.
        with contextlib.suppress(OSError):
            if isinstance(name, str):
                located[section][key] = str((folder / name).absolute())
    return located


_FILES_NAMED = (
    ("camera", "camera_maps"),
    ("channels", "registration"),
    ("channels", "second_movie"),
)


_LONGEST_VALUE = 1_000
_ASSIGNMENT = re.compile(r"\s*(\w+)\.(\w+)\s*=\s*(\S.*)", re.DOTALL)


def parse_assignments(texts: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Read the values of `--set`.

    Raises
    ------
    click.UsageError
        Some are not of the form stage.option=value; all are listed.
    """
    values: dict[str, dict[str, Any]] = {}
    malformed = []
    for text in texts:
        match = _ASSIGNMENT.fullmatch(text)
        if match is None:
            malformed.append(f"--set {text} is not of the form stage.option=value")
            continue
        section, key, value = match.groups()
        values.setdefault(section, {})[key] = _toml_value(value.strip())
    if malformed:
        raise click.UsageError("\n".join(malformed), click.get_current_context(silent=True))
    return values


def _toml_value(text: str) -> Any:
    """Read a TOML value; a word without quotes, which TOML does not know, is itself."""
    try:
        content = tomllib.loads(f"value = {text}") if len(text) <= _LONGEST_VALUE else {}
    except (ValueError, RecursionError):
        return text
    # A line break would let the text hold further keys.
    return content["value"] if len(content) == 1 else text


_COMMON = (
    click.option(
        "--config",
        "-c",
        type=FILE,
        metavar="CONFIG.toml",
        help="Options of all stages, in TOML or as ThunderSTORM's protocol.",
    ),
    click.option(
        "--preset",
        type=click.Choice(list(PRESETS)),
        help="Start from these options instead of the defaults; paper: as published.",
    ),
    click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="STAGE.OPTION=VALUE",
        help="Set any option of any stage; may be repeated.",
    ),
    click.option(
        "--workers",
        type=click.IntRange(min=1),
        help="Processors to use. The result does not depend on it. [default: all]",
    ),
    click.option("--strict", is_flag=True, help="End with exit code 5 when nothing is found."),
)
_COMMON_NAMES = ("config", "preset", "assignments", "workers", "strict")
_COMMON_FLAGS = Counter(
    (
        *("--config", "--preset", "--set", "--workers", "--strict"),
        *("--quiet", "--json", "--output", "--help"),
    )
)
