"""What a configuration or a ThunderSTORM protocol sets."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rotortrack.exchange.thunderstorm_protocol import is_protocol, read_protocol
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, option_fields, parse_toml, read_content, resolve

_HEAD_BYTES = 256


@dataclass(frozen=True)
class GivenOption:
    """One option that a file gives: its place, its value and what it means."""

    section: str
    name: str
    value: Any
    meaning: str


@dataclass(frozen=True)
class ConfigurationReport:
    """What is in a configuration.

    Attributes
    ----------
    path
        The file.
    kind
        `configuration` or `ThunderSTORM protocol`.
    options
        The options that it gives, in the order of the workflow.
    left_out
        One sentence for each thing that a protocol says and that was not taken over.
    """

    path: Path
    kind: str
    options: tuple[GivenOption, ...]
    left_out: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Give everything as plain values, the options by section."""
        options: dict[str, dict[str, Any]] = {}
        for option in self.options:
            options.setdefault(option.section, {})[option.name] = option.value
        return {
            "kind": self.kind,
            "file": self.path,
            "options": options,
            "left_out": self.left_out,
        }


def is_configuration(path: Path) -> bool:
    """Tell a configuration by its name and a protocol by its content."""
    if path.name.lower().endswith(".toml"):
        return True
    # What cannot be opened is refused as the movie that it probably is.
    with contextlib.suppress(OSError, ValueError):
        if path.is_file():
            with path.open("rb") as file:
                return is_protocol(file.read(_HEAD_BYTES))
    return False


def describe_configuration(path: Path) -> ConfigurationReport:
    """Read a configuration, in TOML or as ThunderSTORM's protocol, and check its values.

    Raises
    ------
    ConfigurationError
        It cannot be read, or all mistakes in it, listed at once.
    """
    content = read_content(path)
    kind = "configuration"
    left_out: tuple[str, ...] = ()
    if is_protocol(content):
        protocol = read_protocol(content, path)
        kind, values, left_out = "ThunderSTORM protocol", protocol.values, tuple(protocol.left_out)
    else:
        values = parse_toml(content, path)
    settings = resolve(SECTIONS, [Layer(f"{kind.rpartition(' ')[2]} {path}", values)])
    options = tuple(
        GivenOption(section, field.name, getattr(settings[section], field.name), field.description)
        for section, options_class in SECTIONS.items()
        for field in option_fields(options_class)
        if field.name in values.get(section, {})
    )
    return ConfigurationReport(path, kind, options, left_out)
