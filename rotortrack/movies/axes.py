"""Which stored planes are the frames of the movie."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

from rotortrack.errors import MetadataWarning, MovieError
from rotortrack.movies.descriptions import Claim
from rotortrack.movies.metadata import clean
from rotortrack.movies.options import MovieOptions, parse_axes
from rotortrack.movies.wording import COPY_AGAIN

_FLAGS = {"C": "--channel", "Z": "--z-slice"}
_MOST_LISTED = 4
_NAMES = {"T": "time", "C": "channels", "Z": "z slices", "S": "positions"}


@dataclass(frozen=True)
class Stored:
    """How many planes of a recording can be read, and how many there should be."""

    readable: int
    declared: int

    @property
    def complete(self) -> bool:
        """Whether no plane is missing."""
        return self.readable == self.declared


@dataclass(frozen=True)
class Planes:
    """The planes that are frames, in the order of time.

    Attributes
    ----------
    picked
        Numbers of the planes among all stored ones.
    declared
        How many there would be if no plane were missing.
    notes
        How the axes were understood, one sentence each.
    """

    picked: range
    declared: int
    notes: tuple[str, ...]


def choose_planes(name: str, stored: Stored, claim: Claim | None, options: MovieOptions) -> Planes:
    """Find the frames among the planes of a recording.

    Exactly one axis besides y and x may be longer than 1 once `channel` and `z_slice` are picked;
    it is taken as time, whatever its name.

    Parameters
    ----------
    name
        What messages call the recording.
    stored
        How many planes there are and should be.
    claim
        What the description declares, or None.
    options
        `axes` wins over the description; `channel` and `z_slice` pick.

    Raises
    ------
    MovieError
        The planes have several long axes, do not fit the lengths of the axes, or are not (y, x).

    Warns
    -----
    MetadataWarning
        `axes` contradicts the description.
    """
    claim, notes = _as_recorded(stored, claim)
    if options.axes is not None:
        axes = _given(name, options.axes, stored, claim)
    elif claim is None:
        axes = {"T": stored.declared}
    else:
        if claim.trailing != "YX":
            raise MovieError(_not_frames(name, claim.trailing))
        if claim.shared:
            raise MovieError(
                f"{name} stores fewer planes than its {claim.source} description numbers, as where "
                "a channel or a slice skips frames: save the frames of each channel as one stack, "
                f"or take the {stored.readable} planes as stored with --axes TYX"
            )
        if claim.scrambled:
            raise MovieError(
                f"{name} stores its planes in another order than its {claim.source} description "
                "numbers them: save it again as one stack, or take them as stored with --axes"
            )
        if claim.images:
            lengths = ", ".join(map(str, claim.images[:_MOST_LISTED]))
            more = ", ..." if len(claim.images) > _MOST_LISTED else ""
            raise MovieError(
                f"{name} holds {len(claim.images)} images that are not of one size (of {lengths}"
                f"{more} planes): save each as one stack, or pick one, such as the first with "
                f"--axes TYX --frames 0 {claim.images[0]}"
            )
        axes = _described(name, stored, claim)
    planes = _pick(name, axes, stored.readable, options)
    return dataclasses.replace(planes, notes=(*notes, *planes.notes))


def _as_recorded(stored: Stored, claim: Claim | None) -> tuple[Claim | None, tuple[str, ...]]:
    """Shorten the slowest axis of a recording that was stopped before all planned frames.

    It is left as it is where the planes that are listed do not fill the faster axes.
    """
    if claim is None or claim.recorded is None or claim.shared or not claim.long_axes:
        return claim, ()
    if stored.declared > claim.recorded or (stored.declared < claim.recorded and stored.complete):
        return claim, ()
    slowest = next((axis for axis in claim.long_axes if axis != "S"), "S")
    planned = math.prod(claim.axes.values())
    length, rest = divmod(claim.recorded, planned // claim.axes[slowest])
    if rest:
        return claim, ()
    what = "frames" if len(claim.long_axes) == 1 else "planes"
    note = (
        f"{claim.recorded} of the {planned} planned {what} were recorded, as its description lists"
    )
    return dataclasses.replace(claim, axes={**claim.axes, slowest: length}), (note,)


def _given(name: str, text: str, stored: Stored, claim: Claim | None) -> dict[str, int]:
    """Complete the axes that the user gave by the description and the number of planes."""
    axes = parse_axes(text)
    if tuple(axes)[-2:] != ("Y", "X"):
        raise MovieError(_not_frames(name, "".join(axes)))
    known = claim.axes if claim else {}
    lengths = {
        axis: length if length is not None or axis == "T" else known.get(axis)
        for axis, length in axes.items()
        if axis not in "YX"
    }
    unknown = [axis for axis, length in lengths.items() if length is None]
    if len(unknown) > 1:
        # A description of other lengths is no help where it leaves two open.
        other = next(axis for axis in unknown if axis != "T")
        raise MovieError(
            f"{name} does not say how long the axis {other} of --axes {text} is: give its length "
            f"behind the letter, such as {text.upper().replace(other, other + '2')}"
        )
    product = math.prod(length for length in lengths.values() if length is not None)
    if unknown:
        if not stored.complete and unknown[0] != next(iter(lengths)):
            # How many planes are lost is not known, so that the later ones have no place.
            raise MovieError(
                f"{name} is cut short and --axes {text} does not say how long the axis "
                f"{unknown[0]} is: give its length behind the letter"
            )
        whole = -(-stored.declared // product)
        fits = whole * product == stored.declared or not stored.complete
        lengths[unknown[0]] = whole
    else:
        fits = product == stored.declared or (product > stored.declared and not stored.complete)
    if not fits:
        raise MovieError(
            f"{name} holds {stored.readable} planes, which --axes {text} with its "
            f"{product} {'planes' if not unknown else f'planes a step of {unknown[0]}'} does not "
            "fit: give the axes and lengths as they are stored"
        )
    complete = {axis: length for axis, length in lengths.items() if length is not None}
    if claim is not None and _contradict(complete, claim):
        warnings.warn(
            f"{name}: --axes {text} is used, but its {claim.source} description says "
            f"{clean(_listed(claim.axes)) or 'one plane'}: leave out --axes if that is right",
            MetadataWarning,
            stacklevel=2,
        )
    return complete


def _contradict(axes: Mapping[str, int], claim: Claim) -> bool:
    """Whether two orders of axes pick different planes.

    A single axis may have any name, and one without a name may be anything.
    """
    given = [(axis, length) for axis, length in axes.items() if length > 1]
    described = list(claim.long_axes.items())
    if not claim.axes:
        return False
    if claim.scrambled or claim.trailing != "YX":
        return True
    nameless = all(len(axis) > 1 for axis, _ in described)
    if len(described) == 1 and (len(given) < 2 or nameless):
        return math.prod(axes.values()) != described[0][1]
    if nameless:
        return [length for _, length in given] != [length for _, length in described]
    return given != described


def _described(name: str, stored: Stored, claim: Claim) -> dict[str, int]:
    """Hold the axes of a description against the number of planes."""
    axes = dict(claim.axes)
    product = math.prod(axes.values())
    if product == stored.declared or (product > stored.declared and not stored.complete):
        return axes
    if product < stored.declared and len(claim.long_axes) <= 1:
        # More planes than the description counts are frames all the same.
        return {next(iter(claim.long_axes), "T"): stored.declared}
    raise MovieError(
        f"{name} holds {stored.readable} planes, but its {claim.source} description declares "
        f"{product} ({clean(_listed(axes))}): {COPY_AGAIN}, or give their order with --axes"
    )


def _pick(name: str, axes: Mapping[str, int], planes: int, options: MovieOptions) -> Planes:
    fixed = {"C": options.channel, "Z": options.z_slice}
    start, step, stride, count = 0, 1, 1, 1
    time = None
    long_axes = {}
    for axis, length in reversed(list(axes.items())):
        index = fixed.pop(axis, None)
        if index is not None:
            if index >= length:
                raise MovieError(
                    f"{name} has {length} {_NAMES[axis]}, counted from 0: {_FLAGS[axis]} {index} "
                    "is not among them"
                )
            start += index * stride
        elif length > 1:
            long_axes[axis] = length
            time, step, count = axis, stride, length
        stride *= length
    for axis, index in fixed.items():
        if index:
            raise MovieError(
                f"{name} is not known to have several {_NAMES[axis]}, but {_FLAGS[axis]} {index} "
                f"is given: say how its planes are ordered with --axes, such as T{axis}2YX"
            )
    if len(long_axes) > 1:
        raise MovieError(_several(name, {axis: axes[axis] for axis in axes if axis in long_axes}))
    picked = range(start, start + step * count, step)
    readable = picked[: len(range(start, planes, step))]
    if not readable:
        raise MovieError(f"{name} is cut short before the planes asked for: {COPY_AGAIN}")
    notes: tuple[str, ...] = ()
    if time is not None and time != "T" and len(time) == 1:
        name = clean(_NAMES.get(time, f"planes along {time}"))
        notes = (f"its {count} {name} are taken as time",)
    return Planes(readable, count, notes)


def _several(name: str, axes: Mapping[str, int]) -> str:
    flags = [_FLAGS[axis] for axis in axes if axis in _FLAGS]
    free = [axis for axis in _FLAGS if axis not in axes]
    if "S" in axes and "T" in axes and free and len(axes) - len(flags) == 2:
        # Positions have no flag of their own: they are picked under another name.
        letters = {axis: free[0] if axis == "S" else axis for axis in axes}
        order = "".join(f"{letters[axis]}{axes[axis] if axis != 'T' else ''}" for axis in axes)
        picks = " ".join(f"{_FLAGS[letters[axis]]} 0" for axis in axes if axis != "T")
        remedy = f"choose one stack, such as the first with --axes {order}YX {picks}"
    elif not flags or len(axes) - len(flags) > 1:
        remedy = "say what they are with --axes, such as TCYX, or save each stack on its own"
    else:
        remedy = (
            f"choose with {' or '.join(flags) if len(flags) == len(axes) else ' and '.join(flags)}"
        )
    return f"{name} has more than one axis besides y and x ({clean(_listed(axes))}): {remedy}"


def _not_frames(name: str, axes: str) -> str:
    return (
        f"{name} stores its pixels as {clean(axes)}, so that its pages are not frames: save each "
        "frame (y, x) as a page"
    )


def _listed(axes: Mapping[str, int]) -> str:
    return ", ".join(f"{axis} = {length}" for axis, length in axes.items() if length > 1)
