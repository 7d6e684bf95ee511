"""Options: one frozen dataclass a section, filled from defaults, file, preset, config and flags.

An option class is the only source of a TOML key, its command-line flag, default, bounds and
documentation. pydantic is imported only for values from outside that are not plainly of the right
type, so that option classes, and most commands, load without it.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import itertools
import re
import stat
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rotortrack.errors import ConfigurationError

_MAXIMUM_BYTES = 1_000_000
"""A configuration holds some kB; a movie given by mistake is not read."""

_MAXIMUM_DOTS = 50
"""A dotted key of n parts takes the TOML parser memory for n squared ones."""

_LARGEST_WHOLE = 2**53
"""Above it whole numbers have no place in an array of 64-bit numbers."""

_LONGEST_QUOTE = 100
_MOST_MISTAKES = 20

Values = Mapping[str, Mapping[str, Any]]
"""Raw values by section and key, as read from TOML or from flags."""


def option(
    default: Any,
    description: str,
    *,
    gt: float | None = None,
    ge: float | None = None,
    le: float | None = None,
    check: Callable[[Any], str | None] | None = None,
) -> Any:
    """Declare one option of an :class:`Options` class.

    Parameters
    ----------
    default
        Value when nothing else gives one; ``None`` means "not given".
    description
        One clause without a full stop, with the unit when the name does not carry it.
    gt, ge, le
        Bounds that a number (each element of a tuple) must keep.
    check
        Returns a sentence when the value is wrong in another way, else ``None``.
    """
    metadata = {"description": description, "gt": gt, "ge": ge, "le": le, "check": check}
    return dataclasses.field(default=default, metadata=metadata)


class Options:
    """Base of all option classes; checks bounds and choices on construction.

    Raises
    ------
    ConfigurationError
        All values out of bounds, listed at once.
    """

    def __post_init__(self) -> None:
        mistakes = []
        for field in option_fields(type(self)):
            problem = field.problem(getattr(self, field.name))
            if problem:
                mistakes.append(f"{field.name} {problem}")
        if mistakes:
            raise ConfigurationError(*mistakes)


@dataclass(frozen=True, kw_only=True)
class OptionField:
    """One option as the command line, the configuration and the documentation see it."""

    name: str
    annotation: Any
    default: Any
    description: str
    gt: float | None
    ge: float | None
    le: float | None
    check: Callable[[Any], str | None] | None

    @property
    def choices(self) -> tuple[str | int, ...]:
        """The allowed words or numbers, empty when other values are allowed too."""
        if len(self.types) == 1 and typing.get_origin(self.types[0]) is typing.Literal:
            return typing.get_args(self.types[0])
        return ()

    @property
    def types(self) -> tuple[Any, ...]:
        """The types that a value may have, ``None`` left out."""
        origin = typing.get_origin(self.annotation)
        if origin is typing.Union or origin is types.UnionType:
            parts = typing.get_args(self.annotation)
            return tuple(part for part in parts if part is not type(None))
        return (self.annotation,)

    def problem(self, value: Any) -> str | None:
        """Say what is wrong with `value` of the right type, as the end of a sentence."""
        if value is None:
            return None
        if self.choices and value not in self.choices:
            allowed = ", ".join(map(str, self.choices))
            return f"must be one of {allowed}, not {shortened(repr(value))}"
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, bool) or not isinstance(number, int | float):
                continue
            if self.gt is not None and not number > self.gt:
                return f"must be greater than {self.gt:g}, not {_spelt(number)}"
            if self.ge is not None and not number >= self.ge:
                return f"must be at least {self.ge:g}, not {_spelt(number)}"
            if self.le is not None and not number <= self.le:
                return f"must be at most {self.le:g}, not {_spelt(number)}"
            if isinstance(number, int) and abs(number) > _LARGEST_WHOLE:
                return f"must be a number below 2**53, not {_spelt(number)}"
            if number in (float("inf"), float("-inf")) or number != number:
                return f"must be a finite number, not {_spelt(number)}"
        return self.check(value) if self.check else None


def option_fields(options_class: type) -> tuple[OptionField, ...]:
    """List the options of a class in the order of their declaration."""
    return _option_fields(options_class)


@functools.cache
def _option_fields(options_class: type) -> tuple[OptionField, ...]:
    hints = typing.get_type_hints(options_class)
    return tuple(
        OptionField(
            name=field.name,
            annotation=hints[field.name],
            default=field.default,
            **field.metadata,
        )
        for field in dataclasses.fields(options_class)
    )


@dataclass(frozen=True)
class Layer:
    """Values from one place, named as it is shown to the user (`config run.toml`, `flag`)."""

    origin: str
    values: Values


@dataclass(frozen=True)
class Settings:
    """Checked options of every section, with the origin of each value."""

    sections: Mapping[str, Any]
    origins: Mapping[str, str]

    def __getitem__(self, section: str) -> Any:
        return self.sections[section]

    def require(self, *keys: str) -> None:
        """Demand values that have no default.

        Raises
        ------
        ConfigurationError
            Lists every `section.key` that nobody gave and says how to give it.
        """
        missing = []
        for key in keys:
            section, name = key.split(".")
            if getattr(self.sections[section], name) is None:
                flag = name.replace("_", "-")
                missing.append(
                    f"{name} is not known: give --{flag}, or {name} in the [{section}] section of "
                    "a configuration file"
                )
        if missing:
            raise ConfigurationError(*missing)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """All values by section, `None` left out, ready for TOML or JSON."""
        return {
            section: {
                key: list(value) if isinstance(value, tuple) else value
                for key, value in dataclasses.asdict(options).items()
                if value is not None
            }
            for section, options in self.sections.items()
        }


def read_content(path: Path) -> bytes:
    """Read a configuration file of any kind, which is never large.

    Raises
    ------
    ConfigurationError
        There is no such file, it is a folder or a pipe, or it is larger than 1 MB.
    """
    try:
        # A pipe is told from its kind, as opening it would wait for a writer.
        if not stat.S_ISREG(path.stat().st_mode):
            raise ConfigurationError(f"{path} is not a file: give the name of a TOML file")
        with path.open("rb") as stream:
            content = stream.read(_MAXIMUM_BYTES + 1)
    except (OSError, ValueError) as error:
        cause = error.strerror if isinstance(error, OSError) else error
        raise ConfigurationError(f"{path} cannot be read ({cause})") from error
    if len(content) > _MAXIMUM_BYTES:
        raise ConfigurationError(
            f"{path} is larger than {_MAXIMUM_BYTES // 1_000_000} MB, as no configuration is: give "
            "the name of a TOML file"
        )
    return content


def read_toml(path: Path) -> dict[str, dict[str, Any]]:
    """Read a configuration file.

    Raises
    ------
    ConfigurationError
        The file is missing, is not UTF-8 TOML, or holds keys outside a section.
    """
    return parse_toml(read_content(path), path)


def parse_toml(content: bytes, path: Path, *, arrays: Sequence[str] = ()) -> dict[str, Any]:
    """Parse the content of a configuration file.

    Parameters
    ----------
    content
        TOML in UTF-8.
    path, arrays
        Where it comes from, for the sentences; names that may be arrays of sections.

    Raises
    ------
    ConfigurationError
        It is not UTF-8 TOML, or holds keys outside a section.
    """
    try:
        # Windows editors put a byte order mark in front, which TOML does not know.
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path} is not UTF-8 text: save it as UTF-8") from error
    # Behind a quotation mark in the same line it is doubtful what is a comment.
    lines = re.sub(r"(?m)^([^\"'#\n]*)#[^\"'\n]*$", r"\1", text).split("\n")
    dotted = [number for number, line in enumerate(lines, 1) if line.count(".") > _MAXIMUM_DOTS]
    if dotted:
        raise ConfigurationError(
            f"{path} has more than {_MAXIMUM_DOTS} dots in line {dotted[0]}, which no option needs"
        )
    try:
        values = tomllib.loads(text)
    except RecursionError as error:
        raise ConfigurationError(f"{path} is nested more deeply than any option") from error
    except ValueError as error:
        raise ConfigurationError(f"{path} is not valid TOML: {shortened(str(error))}") from error
    kinds = {key: list | dict if key in arrays else dict for key in values}
    loose = [key for key, value in values.items() if not isinstance(value, kinds[key])]
    if loose:
        raise ConfigurationError(
            *_some(
                f"{path}: {shortened(key)} stands outside any [section], or is an array of them: "
                "move it into one"
                for key in loose
            )
        )
    return values


def resolve(classes: Mapping[str, type], layers: Sequence[Layer]) -> Settings:
    """Merge layers (later ones win) into checked options.

    Raises
    ------
    ConfigurationError
        Unknown sections and keys, wrong types and values out of bounds, all listed at once (the
        first 20 of very many).
    """
    chosen: dict[str, dict[str, Any]] = {section: {} for section in classes}
    origins: dict[str, str] = {}
    mistakes = list(
        _some(
            mistake for layer in layers for mistake in _take_layer(classes, layer, chosen, origins)
        )
    )
    if mistakes:
        raise ConfigurationError(*mistakes)
    sections = {name: options_class(**chosen[name]) for name, options_class in classes.items()}
    for section, options_class in classes.items():
        for field in option_fields(options_class):
            origins.setdefault(f"{section}.{field.name}", "default")
    return Settings(sections=sections, origins=origins)


def _take_layer(
    classes: Mapping[str, type],
    layer: Layer,
    chosen: dict[str, dict[str, Any]],
    origins: dict[str, str],
) -> Iterator[str]:
    for section, values in layer.values.items():
        if section in classes:
            yield from _take(classes[section], layer, section, values, chosen, origins)
        else:
            hint = _hint(section, classes)
            yield f"{layer.origin}: [{shortened(section)}] is not a section{hint}"


def _take(
    options_class: type,
    layer: Layer,
    section: str,
    values: Mapping[str, Any],
    chosen: dict[str, dict[str, Any]],
    origins: dict[str, str],
) -> Iterator[str]:
    """Put the good values of one layer's section into `chosen` and yield the mistakes."""
    fields = {field.name: field for field in option_fields(options_class)}
    for key, raw in values.items():
        where = f"{layer.origin}: [{section}] {shortened(key)}"
        field = fields.get(key)
        if field is None:
            yield f"{where} is not an option{_hint(key, fields)}"
            continue
        value, problem = _convert(field, raw)
        problem = problem or field.problem(value)
        if problem:
            yield f"{where} {problem}"
            continue
        chosen[section][key] = value
        origins[f"{section}.{key}"] = layer.origin


def _convert(field: OptionField, raw: Any) -> tuple[Any, str | None]:
    """Check the type of a raw value; a list becomes a tuple, a TOML boolean a choice's word."""
    if isinstance(raw, bool) and str(raw).lower() in field.choices:
        raw = str(raw).lower()
    if isinstance(raw, list):
        raw = tuple(raw)
    if type(raw) in field.types or (type(raw) is str and raw in field.choices):
        return raw, None
    from pydantic import ConfigDict, TypeAdapter, ValidationError

    adapter = TypeAdapter(field.annotation, config=ConfigDict(strict=True))
    try:
        return adapter.validate_python(raw), None
    except ValidationError as error:
        if field.choices:
            allowed = ", ".join(map(str, field.choices))
            return None, f"must be one of {allowed}, not {shortened(repr(raw))}"
        # A union such as `float | None` reports the failure of every branch; the first one is
        # the type that the user meant to give.
        message = error.errors()[0]["msg"]
        return None, f"is {shortened(repr(raw))}: {message[0].lower()}{message[1:]}"


def shortened(text: str) -> str:
    """Cut a text from a file, and take control codes out, so that it fits into a sentence."""
    plain = "".join(letter if letter.isprintable() else "?" for letter in text[:_LONGEST_QUOTE])
    return plain if len(text) <= _LONGEST_QUOTE else f"{plain}..."


def _some(mistakes: Iterable[str]) -> Iterator[str]:
    """Give the mistakes, of very many only the first."""
    remaining = iter(mistakes)
    yield from itertools.islice(remaining, _MOST_MISTAKES)
    if next(remaining, None) is not None:
        yield f"and more: these are the first {_MOST_MISTAKES} mistakes"


def _spelt(number: float) -> str:
    try:
        return f"{number:g}"
    except OverflowError:
        return shortened(str(number))


def _hint(word: str, known: Mapping[str, Any]) -> str:
    close = difflib.get_close_matches(word, list(known), n=1) if len(word) < _LONGEST_QUOTE else []
    return f": did you mean {close[0]}?" if close else f": known are {', '.join(known)}"
