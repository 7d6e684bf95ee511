"""Scene files: what a simulation contains. What a scene does not name does not exist in it.

==========  ======================================================================================
section     what it brings
==========  ======================================================================================
[field]     the pore in its membrane: electric field, flow and wall
[rod]       the elastic rod
[start]     where the rod begins; the defaults without it
[stepping]  how time is stepped and for how long; the defaults without it
[thermal]   thermal noise
[scan]      the grid of runs
[film]      size and length of a film; beside it stand the sections of film/scene.py
[[rotors]]  a group of rotors in the film; as many as wanted
==========  ======================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from rotortrack.errors import ConfigurationError, InputError
from rotortrack.settings import Layer, Options, Settings, parse_toml, read_content, resolve
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.film.options import FilmOptions, RotorsOptions
from rotortrack.simulate.film.scene import FILM_SECTIONS, FilmScene
from rotortrack.simulate.options import ScanOptions
from rotortrack.simulate.rod.options import (
    PRESETS,
    RodOptions,
    StartOptions,
    SteppingOptions,
    ThermalOptions,
)

SCENE_SECTIONS: dict[str, type[Options]] = {
    "field": FieldOptions,
    "rod": RodOptions,
    "start": StartOptions,
    "stepping": SteppingOptions,
    "thermal": ThermalOptions,
    "scan": ScanOptions,
    **FILM_SECTIONS,
}
"""Option class of each section but [[rotors]]."""

_ROTORS = "rotors"

_NUMERICS = ("start", "stepping")
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class Scene:
    """What a simulation contains; None is an effect that is off.

    Attributes
    ----------
    field, rod, start, stepping, thermal, scan
        Options of each section.
    film
        What is filmed; None without a section [film].
    settings
        The same with the origin of each value, for the record.
    origin
        The file, for sentences.
    """

    field: FieldOptions | None
    rod: RodOptions | None
    start: StartOptions
    stepping: SteppingOptions
    thermal: ThermalOptions | None
    scan: ScanOptions | None
    film: FilmScene | None
    settings: Settings
    origin: str

    def require(self, *sections: str) -> None:
        """Demand sections.

        Raises
        ------
        ConfigurationError
            Lists every section that the scene lacks.
        """
        absent = [name for name in sections if getattr(self, name) is None]
        if absent:
            raise ConfigurationError(
                *(f"{self.origin} has no [{name}] section: add one" for name in absent)
            )

    def as_dict(self) -> dict[str, Any]:
        """All values of the sections that act, ready for TOML or JSON."""
        values: dict[str, Any] = self.settings.as_dict()
        if self.film is not None and self.film.rotors:
            values[_ROTORS] = [
                values.pop(_group_name(number)) for number in range(len(self.film.rotors))
            ]
        return values


def read_scene(path: Path, layers: Sequence[Layer] = (), preset: str | None = None) -> Scene:
    """Read a scene file.

    Parameters
    ----------
    path
        TOML in UTF-8. Files that it names lie where it lies.
    layers
        Values that win over those of the file, such as from the command line. Files that they name
        are sought from the working folder.
    preset
        Name of the preset that fills what nobody gave, in the sections that the scene has.

    Raises
    ------
    InputError
        There is no such file, or it cannot be read.
    ConfigurationError
        It is not TOML, or holds unknown sections and keys, wrong types or values out of bounds,
        all listed at once.
    """
    try:
        content = read_content(path)
    except ConfigurationError as error:
        raise InputError(str(error)) from error
    values = parse_toml(content, path, arrays=(_ROTORS,))
    given = Layer(f"scene {path}", _located(values, path.parent))
    more = [Layer(layer.origin, _located(layer.values, Path())) for layer in layers]
    return make_scene([given, *more], origin=str(path), preset=preset)


def _located(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Say where files lie without regard to a folder: a film records its scene for later."""

    def place(table: Any, keys: Sequence[str]) -> Any:
        if not isinstance(table, Mapping):
            return table
        named = {key: table[key] for key in keys if isinstance(table.get(key), str)}
        files = {key: name for key, name in named.items() if name not in _NO_FILES}
        return {**table, **{key: str((folder / name).absolute()) for key, name in files.items()}}

    located = dict(values)
    for section, keys in _FILES.items():
        own = values.get(section)
        if isinstance(own, list):
            located[section] = [place(table, keys) for table in own]
        elif own is not None:
            located[section] = place(own, keys)
    return located


_FILES = {"camera": ("camera_maps",), "drift": ("table",), _ROTORS: ("table", "shape")}
"""Options that name files."""

_NO_FILES = ("circle", "rod")
"""Shapes that are none."""


def make_scene(
    layers: Sequence[Layer], *, origin: str = "the scene", preset: str | None = None
) -> Scene:
    """Make a scene of values by section; of several layers the later ones win.

    Raises
    ------
    ConfigurationError
        All mistakes, listed at once.
    """
    layers, groups = _split_groups(layers)
    named = {section for layer in layers for section in layer.values}
    known = {**SCENE_SECTIONS, **dict.fromkeys(groups, RotorsOptions)}
    classes = {
        name: options_class
        for name, options_class in known.items()
        if name in named or name in _NUMERICS
    }
    if preset is not None:
        layers = [Layer(f"preset {preset}", PRESETS[preset]), *layers]
    mistakes: list[str] = []
    sections: dict[str, Any] = {}
    origins: dict[str, str] = {}
    # Each by itself: what contradicts itself in one section is told beside the others' mistakes.
    for name in (*(named - known.keys()), *classes):
        own = [Layer(layer.origin, _only(layer.values, name)) for layer in layers]
        try:
            settings = resolve(_only(classes, name) or {**SCENE_SECTIONS, _ROTORS: Options}, own)
        except ConfigurationError as error:
            mistakes += error.mistakes
        else:
            sections |= settings.sections
            origins |= settings.origins
    film, of_the_film = _film(named, sections, groups)
    mistakes += of_the_film
    if mistakes:
        raise ConfigurationError(*mistakes)
    parts: dict[str, Any] = {
        name: sections.get(name) for name in SCENE_SECTIONS if name not in FILM_SECTIONS
    }
    return Scene(**parts, film=film, settings=Settings(sections, origins), origin=origin)


def _film(
    named: set[str], sections: Mapping[str, Any], groups: Sequence[str]
) -> tuple[FilmScene | None, list[str]]:
    """Put what is filmed together, and list what contradicts itself in it."""
    if "film" not in named:
        loose = [name for name in FILM_SECTIONS if name in named]
        loose += [f"[{_ROTORS}]"] * bool(groups)
        return None, [f"[{name}] is of no use without [film]: add it" for name in loose]
    effects: dict[str, Any] = {name: sections.get(name) for name in FILM_SECTIONS}
    effects["film"] = effects["film"] or _CONTRADICTS_NOTHING
    # A group with mistakes has told them: what stands in for it keeps the others' numbers.
    rotors = tuple(sections.get(name, RotorsOptions()) for name in groups)
    film = FilmScene(**effects, rotors=rotors)
    return film, list(film.mistakes(named))


_CONTRADICTS_NOTHING = FilmOptions(
    width_px=10**9, height_px=10**9, n_frames=10**9, frame_interval_s=1e12
)
"""Stands in for a [film] with mistakes of its own, so that those of all others are told."""


def _group_name(number: int) -> str:
    return f"{_ROTORS} {number + 1}"


def _split_groups(layers: Sequence[Layer]) -> tuple[list[Layer], list[str]]:
    """Make sections of the tables [[rotors]]; a layer with one table changes all of them."""
    count = max((len(_tables(layer)) for layer in layers), default=0)
    names = [_group_name(number) for number in range(count)]
    split = []
    for layer in layers:
        tables = _tables(layer)
        values = {name: content for name, content in layer.values.items() if name != _ROTORS}
        if isinstance(layer.values.get(_ROTORS), Mapping):
            tables = tables * count
        values |= dict(zip(names, tables, strict=False))
        split.append(Layer(layer.origin, values))
    return split, names


def _tables(layer: Layer) -> list[Any]:
    given: Any = layer.values.get(_ROTORS, [])
    return [given] if isinstance(given, Mapping) else list(given)


def _only(values: Mapping[str, _Value], name: str) -> dict[str, _Value]:
    return {name: values[name]} if name in values else {}
