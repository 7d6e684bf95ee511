"""One command-line flag made from one option of an option class, and the command that has such."""

from __future__ import annotations

import contextlib
import difflib
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from rotortrack.settings import OptionField

if TYPE_CHECKING:
    _Type = click.ParamType[Any]
else:
    # Not generic at run time in older versions of click.
    _Type = click.ParamType

_PROBLEMS = "rotortrack_cli.problems"
_SIMPLE: dict[Any, _Type] = {int: click.INT, float: click.FLOAT, str: click.STRING}


@dataclass(frozen=True)
class Flag:
    """The flag of one option: name, type, choices and help come from its declaration."""

    section: str
    field: OptionField
    prefixed: bool = False

    @property
    def parameter(self) -> str:
        """Name of the function argument that carries the value."""
        return f"{self.section}__{self.field.name}"

    @property
    def names(self) -> tuple[str, ...]:
        """What the user types; two names for a switch."""
        name = f"{self.section}_{self.field.name}" if self.prefixed else self.field.name
        word = name.replace("_", "-")
        return (f"--{word}", f"--no-{word}") if self.field.types == (bool,) else (f"--{word}",)

    def add_to(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Add the flag to a function that becomes a :class:`StageCommand`."""
        kind = {} if len(self.names) == 2 else _click_type(self.field)
        add = click.option(
            "/".join(self.names),
            self.parameter,
            cls=StageOption,
            section=self.section,
            default=None,
            help=_help(self.field),
            **kind,
        )
        return add(function)


class StageOption(click.Option):
    """An option that records a wrong value, so that all are reported together."""

    def __init__(self, *args: Any, section: str, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.section = section

    def handle_parse_result(
        self, ctx: click.Context, opts: Mapping[str, Any], args: list[str]
    ) -> tuple[Any, list[str]]:
        """Convert the value; a wrong one is left for the command to report."""
        try:
            return super().handle_parse_result(ctx, opts, args)
        except click.BadParameter as problem:
            problem.param = problem.param or self
            ctx.meta.setdefault(_PROBLEMS, []).append(problem.format_message())
            return None, args


class StageCommand(click.Command):
    """A command that lists its flags by section and reports all mistakes in them at once."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the command's arguments.

        Raises
        ------
        click.UsageError
            All unknown flags, or all wrong values, one a line.
        """
        try:
            rest = super().parse_args(ctx, list(args))
        except click.NoSuchOption as problem:
            unknown = self._unknown(ctx, args) or [problem.format_message()]
            raise click.UsageError("\n".join(unknown), ctx) from None
        except click.UsageError as problem:
            problems = ctx.meta.get(_PROBLEMS, [])
            raise click.UsageError("\n".join([*problems, problem.format_message()]), ctx) from None
        if ctx.meta.get(_PROBLEMS) and not ctx.resilient_parsing:
            raise click.UsageError("\n".join(ctx.meta[_PROBLEMS]), ctx)
        return rest

    def _unknown(self, ctx: click.Context, args: Sequence[str]) -> list[str]:
        """Say of each unknown long flag what was probably meant."""
        known = [
            name for param in self.get_params(ctx) for name in (*param.opts, *param.secondary_opts)
        ]
        until = args.index("--") if "--" in args else len(args)
        sentences = []
        for word in (arg.partition("=")[0] for arg in args[:until] if arg.startswith("--")):
            if word not in known:
                close = difflib.get_close_matches(word, known, n=1)
                hint = f": did you mean {close[0]}?" if close else ""
                sentences.append(f"{word} is not a flag of this command{hint}")
        return sentences

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the flags, those of each section of the configuration under its name."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is None or isinstance(param, click.Argument):
                continue
            title = f"Options of [{param.section}]" if isinstance(param, StageOption) else "Options"
            groups.setdefault(title, []).append(record)
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)


class _OneOf(_Type):
    """A value of the first type that accepts it, for options such as `float | str`."""

    def __init__(self, kinds: Sequence[_Type]) -> None:
        self.kinds = kinds
        self.name = "|".join(_metavar(kind) for kind in kinds)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Try one type after the other."""
        for kind in self.kinds[:-1]:
            with contextlib.suppress(click.BadParameter):
                return kind.convert(value, param, ctx)
        return self.kinds[-1].convert(value, param, ctx)


class _Choice(_Type):
    """One of some words or numbers; the value keeps the type of its declaration."""

    def __init__(self, choices: Sequence[str | int]) -> None:
        self.choices = {str(choice): choice for choice in choices}
        self.name = f"[{'|'.join(self.choices)}]"

    def convert(
        self,
        value: Any,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | int:
        """Look the word up."""
        if str(value) not in self.choices:
            self.fail(f"must be one of {', '.join(self.choices)}, not {value}", param, ctx)
        return self.choices[str(value)]


def _click_type(field: OptionField) -> dict[str, Any]:
    """Choose click's `type`, `nargs` and `metavar` for an option."""
    if len(field.types) == 1 and typing.get_origin(field.types[0]) is tuple:
        items = typing.get_args(field.types[0])
        kind = _SIMPLE[items[0]]
        return {"type": kind, "nargs": len(items), "metavar": f"{_metavar(kind)}..."}
    # Text accepts everything, so it is tried last.
    kinds = sorted((_one_type(part) for part in field.types), key=lambda k: k is click.STRING)
    whole = kinds[0] if len(kinds) == 1 else _OneOf(kinds)
    return {"type": whole, "metavar": _metavar(whole)}


def _one_type(part: Any) -> _Type:
    if typing.get_origin(part) is typing.Literal:
        return _Choice(typing.get_args(part))
    return _SIMPLE[part]


def _metavar(kind: _Type) -> str:
    return kind.name if isinstance(kind, _Choice | _OneOf) else kind.name.upper()


def _help(field: OptionField) -> str:
    text = field.description + "."
    if "_" not in text.split()[0]:
        text = text[0].upper() + text[1:]
    if field.default is None:
        return text
    default = field.default
    if isinstance(default, bool):
        default = "on" if default else "off"
    return f"{text} [default: {default}]"
