"""Which files and which of their planes make up a movie."""

from __future__ import annotations

import dataclasses
import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import MetadataWarning, MovieError, SalvageWarning
from rotortrack.movies.axes import Stored, choose_planes
from rotortrack.movies.descriptions import Claim
from rotortrack.movies.facts import Facts
from rotortrack.movies.layout import StoredFile, open_file
from rotortrack.movies.members import (
    beside,
    check_copies,
    check_distinct,
    check_given,
    check_order,
    members_by_name,
)
from rotortrack.movies.metadata import clean
from rotortrack.movies.options import MovieOptions
from rotortrack.movies.times import OME_ORIGIN, with_times


@dataclass(frozen=True)
class Recording:
    """The files in their order, each with its frames alone, and what is known of them."""

    files: tuple[StoredFile, ...]
    facts: Facts


def gather(given: Sequence[Path], options: MovieOptions) -> Recording:
    """Find all files of a recording, and the frames among their planes.

    Parameters
    ----------
    given
        The files as the user named them.
    options
        As for `open_movie`.

    Raises
    ------
    MovieError
        As for `open_movie`.
    """
    check_distinct(given)
    named = members_by_name(given[0])
    # Micro-Manager's description for ImageJ counts the frames of all files.
    first = open_file(given[0], options, alone=not named)
    claim = first.claim
    if claim is not None and claim.main_file is not None:
        main = beside(given[0], claim.main_file)
        if main.exists():
            described = open_file(main, options, alone=False, name=given[0].name)
            claim = described.claim or claim
        else:
            first = _without_main(first, main, options)
            claim = first.claim
    members = _members(given, claim, named, options)
    if members:
        return _set(given, members, first, claim, options)
    if len(given) > 1:
        return _list(given, first, options)
    planes = choose_planes(str(given[0]), _stored([first]), claim, options)
    missing = planes.declared - len(planes.picked)
    return _recording(first, [first.pick(planes.picked)], planes.notes, missing)


def _recording(
    first: StoredFile, files: Sequence[StoredFile], notes: Sequence[str], missing_frames: int
) -> Recording:
    """Put together what is known; the first file speaks for all."""
    times_s, joints = _joined_times(files)
    if joints:
        before, after = joints[0]
        more = f", as at {len(joints) - 1} more places between files," if len(joints) > 1 else ""
        note = (
            f"the time between {clean(before.path.name)} and {clean(after.path.name)} is not "
            f"recorded{more} and is taken as one frame interval"
        )
        notes = (*notes, note)
    facts = with_times(
        Facts(first.metadata, tuple(notes), missing_frames),
        times_s,
        str(first.path),
        next((file.times_origin for file in files if file.times_origin), ""),
    )
    return Recording(tuple(files), facts)


def _timed(files: Sequence[StoredFile], claim: Claim | None) -> list[StoredFile]:
    """Give files without times those that the description of the set tells."""
    if claim is None or claim.times_s is None or all(file.times_s is not None for file in files):
        return list(files)
    starts = itertools.accumulate((file.planes for file in files), initial=0)
    return [
        file.timed(claim.times_s[start:], OME_ORIGIN)
        for file, start in zip(files, starts, strict=False)
    ]


def _joined_times(
    files: Sequence[StoredFile],
) -> tuple[NDArray[np.float64] | None, list[tuple[StoredFile, StoredFile]]]:
    """Continue the times from file to file, also where a clock starts anew with each.

    Returns
    -------
    times_s
        Time of each frame, NaN where a frame has none; None where they tell nothing.
    joints
        Each two files between which the clock starts anew.
    """
    if all(file.times_s is None for file in files):
        return None, []
    joined: list[NDArray[np.float64]] = []
    joints = []
    for number, file in enumerate(files):
        times_s = file.times_s
        if times_s is None:
            times_s = np.full(file.planes, np.nan)
        elif joined and times_s[0] <= joined[-1][-1]:
            steps_s = np.diff(joined[-1]) if len(joined[-1]) > 1 else np.diff(times_s)
            if not len(steps_s):
                return None, []
            times_s = times_s - times_s[0] + joined[-1][-1] + np.median(steps_s)
            joints.append((files[number - 1], file))
        joined.append(times_s)
    whole_s = np.concatenate(joined)
    return whole_s, [] if np.isnan(whole_s).any() else joints


def _without_main(file: StoredFile, main: Path, options: MovieOptions) -> StoredFile:
    """Open a file as what it says of itself, where the first file of its recording is missing.

    Micro-Manager writes each position into a file of its own, which is whole without the first.
    """
    what = f"{file.path} belongs to a recording that {main} describes, which is missing"
    own = file.claim.alone if file.claim is not None else None
    if own is None and options.axes is None and not options.salvage:
        raise MovieError(
            f"{what}: put it back into the folder, or read the planes of this file alone with "
            "--axes TYX"
        )
    alone = dataclasses.replace(file, claim=None)
    if own is not None:
        alone = open_file(file.path, options, claim=own)
        alone = dataclasses.replace(alone, metadata=file.metadata)
    warnings.warn(
        f"{what}: the {alone.planes} planes of this file alone are used; put it back into the "
        "folder if they belong together",
        MetadataWarning,
        stacklevel=2,
    )
    return alone


def _members(
    given: Sequence[Path], claim: Claim | None, named: tuple[str, ...], options: MovieOptions
) -> tuple[Path, ...]:
    """Find all files of the set to which the first file belongs; none where it stands alone."""
    names = tuple(claim.files) if claim is not None and claim.files else named
    if len(names) < 2:
        return ()
    if given[0].name not in names:
        if len(given) == len(names):
            return tuple(given)  # renamed, and named in their order
        if options.axes is not None:
            return ()
        raise MovieError(
            f"{given[0]} is one of {len(names)} files of a movie and was renamed: give it back "
            f"its name ({_few(names)}), or name all files in their order"
        )
    if len(given) > 1:
        check_given(given, names)
        return tuple(given)
    return tuple(beside(given[0], name) for name in names)


def _set(
    given: Sequence[Path],
    members: Sequence[Path],
    first: StoredFile,
    claim: Claim | None,
    options: MovieOptions,
) -> Recording:
    """Join the files of a set, in which one description counts for all."""
    files: list[StoredFile] = []
    for number, path in enumerate(members):
        if not path.exists():
            _missing_member(path, number, members, given[0], salvage=options.salvage)
            break
        if path == given[0]:
            file = first
        elif number == 0:
            file = open_file(path, options, alone=False)
        else:
            here = claim.files.get(path.name, 0) if claim else 0
            source = claim.source if claim else "Micro-Manager"
            stand_in = Claim(source, {}, one_directory=False, here=here)
            file = open_file(path, options, claim=stand_in)
        files.append(file)
        if file.missing:
            break
    _check_alike(files)
    files = _timed(files, claim)
    # What the first file says of itself counts for the planes of all.
    absent = len(members) - len(files)
    planes = choose_planes(str(given[0]), _stored(files, absent), claim, options)
    note = (
        f"{len(members)} files are read as one recording, in the order of "
        f"{'their description' if claim and claim.files else 'their names'}: "
        f"{_few([path.name for path in members])}"
    )
    missing = planes.declared - len(planes.picked)
    return _recording(files[0], _distribute(files, planes.picked), (note, *planes.notes), missing)


def _missing_member(
    path: Path, number: int, members: Sequence[Path], given: Path, *, salvage: bool
) -> None:
    what = f"{path} is missing, file {number + 1} of {len(members)} of the recording of {given}"
    if not number or not salvage:
        remedy = ", or read the frames before it with --salvage" if number else ""
        raise MovieError(f"{what}: put it back into the folder{remedy}")
    warnings.warn(
        f"{what}: the frames before it are used; put it back into the folder if you can",
        SalvageWarning,
        stacklevel=2,
    )


def _list(given: Sequence[Path], first: StoredFile, options: MovieOptions) -> Recording:
    """Join files that the user named, each of which describes itself."""
    check_order(given)
    files, absent = [first], 0
    for path in given[1:]:
        file = open_file(path, options)
        if files[-1].missing:
            absent += file.declared
        else:
            files.append(file)
    _check_alike(files)
    _check_times(files)
    check_copies([file.path for file in files if file.planes > 1])
    note = f"{len(given)} files are read as one recording, in the order given"
    if options.axes is not None:
        planes = choose_planes(str(given[0]), _stored(files, absent), _joined_claim(files), options)
        missing = planes.declared - len(planes.picked)
        return _recording(
            files[0], _distribute(files, planes.picked), (note, *planes.notes), missing
        )
    chosen = [choose_planes(str(file.path), _stored([file]), file.claim, options) for file in files]
    parts = [file.pick(planes.picked) for file, planes in zip(files, chosen, strict=True)]
    notes = dict.fromkeys(note for planes in chosen for note in planes.notes)
    missing = sum(planes.declared - len(planes.picked) for planes in chosen) + absent
    return _recording(first, parts, (note, *notes), missing)


def _stored(files: Sequence[StoredFile], absent: int = 0) -> Stored:
    """Count the planes of all files; `absent` ones are in files that are not used."""
    readable = sum(file.planes for file in files)
    return Stored(readable, sum(file.declared for file in files) + absent)


def _joined_claim(files: Sequence[StoredFile]) -> Claim | None:
    """Describe files that continue one another along their slowest axis."""
    claims = [file.claim for file in files if file.claim is not None]
    if len(claims) < len(files):
        return None
    axes = [list(claim.axes.items()) for claim in claims]
    if not axes[0] or any(
        [name for name, _ in other] != [name for name, _ in axes[0]] or other[1:] != axes[0][1:]
        for other in axes
    ):
        return None
    slowest = axes[0][0][0]
    total = sum(dict(other)[slowest] for other in axes)
    recorded = None
    if any(claim.recorded is not None for claim in claims):
        recorded = sum(claim.planes for claim in claims)
    return dataclasses.replace(
        claims[0], axes={**claims[0].axes, slowest: total}, recorded=recorded
    )


def _check_times(files: Sequence[StoredFile]) -> None:
    """Refuse files whose times lie one behind another in another order than the one given."""
    spans = [
        (file.times_s[0], file.times_s[-1])
        for file in files
        if file.times_s is not None and not np.isnan(file.times_s).any()
    ]
    order = sorted(range(len(spans)), key=spans.__getitem__)
    one_clock = all(spans[a][1] < spans[b][0] for a, b in itertools.pairwise(order))
    if len(spans) < len(files) or not one_clock:
        return
    for place, right in enumerate(order):
        if place != right:
            raise MovieError(
                f"{files[place].path} was not recorded where it is given, by the times in the "
                "files: give them in the order "
                f"{_few([files[index].path.name for index in order])}"
            )


def _check_alike(files: Sequence[StoredFile]) -> None:
    """Refuse files of another frame size or number type than the first."""
    _, height, width = files[0].layout.shape
    kind = files[0].layout.stored.newbyteorder("=")
    for file in files:
        _, rows, columns = file.layout.shape
        other = file.layout.stored.newbyteorder("=")
        if (rows, columns, other) != (height, width, kind):
            raise MovieError(
                f"{file.path} has frames of {columns} x {rows} pixels, {other}, but "
                f"{files[0].path} of {width} x {height}, {kind}: name files of one recording"
            )


def _distribute(files: Sequence[StoredFile], picked: range) -> tuple[StoredFile, ...]:
    """Keep of each file the planes that are picked among those of all, and drop empty files."""
    parts, before = [], 0
    for file in files:
        planes = file.planes
        skipped = max(0, -((picked.start - before) // picked.step))
        start = picked.start + skipped * picked.step - before
        own = range(start, min(picked.stop - before, planes), picked.step)
        if own:
            parts.append(file.pick(own))
        before += planes
    return tuple(parts)


def _few(names: Sequence[str]) -> str:
    shown = [*names[:2], "...", names[-1]] if len(names) > 4 else names
    return clean(", ".join(shown))
