"""The scene of a command that simulates, and what changes it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from rotortrack.errors import UsageError
from rotortrack.settings import Layer
from rotortrack.simulate.rod.options import PRESETS
from rotortrack.simulate.scene import read_scene
from rotortrack_cli.flags import FILE, parse_assignments

_Function = TypeVar("_Function", bound=Callable[..., Any])


def scene_flags(*, optional: bool = False) -> Callable[[_Function], _Function]:
    """Add the scene, given as the argument `scene`, and what changes it."""

    def decorate(function: _Function) -> _Function:
        @functools.wraps(function)
        def call(
            *args: Any,
            path: Path | None,
            preset: str | None,
            assignments: tuple[str, ...],
            **kwargs: Any,
        ) -> Any:
            values = parse_assignments(assignments)
            if path is None and (values or preset):
                raise UsageError("--set and --preset change a scene: give SCENE.toml, too")
            layers = [Layer("--set", values)] if values else []
            scene = None if path is None else read_scene(path, layers, preset)
            return function(*args, scene=scene, **kwargs)

        decorated: Any = call
        argument = click.argument(
            "path",
            metavar="[SCENE.toml]" if optional else "SCENE.toml",
            type=FILE,
            required=not optional,
        )
        for add in reversed((argument, *_CHANGES)):
            decorated = add(decorated)
        return decorated  # type: ignore[no-any-return]

    return decorate


_CHANGES = (
    click.option(
        "--preset",
        type=click.Choice(list(PRESETS)),
        help="How to read what the paper leaves open; the scene's own values win.",
    ),
    click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="SECTION.OPTION=VALUE",
        help="Set any option of the scene; may be repeated.",
    ),
)
