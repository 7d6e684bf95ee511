"""The shapes of rotating rods, for films: where the labelled ends stand about the pore.

A rod's motion is never integrated over the time of a film. Its mean shape, in the frame that turns
with it, is turned by an angle whose speed and diffusion the scene sets: measured rotors have a
speed over diffusion of 0.1 to 5, a simulated rod one of about 112, so one friction factor for both
would make every test of the analysis far too easy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError, InputError
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.observe import DYES_NM, dye_centres_nm
from rotortrack.simulate.rod.run import RodRun, run_rod

if TYPE_CHECKING:
    from rotortrack.simulate.scene import Scene

Floats = NDArray[np.float64]

CLOUDS_NM: Final = DYES_NM[::-1]
"""Lengths of rod that the dyes of a film's first and second end cover."""

_LAST_PART = 0.5
"""Part of a run over which its shape is averaged."""

_THERMAL_US: Final = 4.0
_THERMAL_SAMPLE_US: Final = 0.02
"""Length of the run that tells how far a rod's ends stray, and time between its samples."""


@dataclass(frozen=True)
class Shape:
    """A rod that turns, seen from above (cis).

    Attributes
    ----------
    ends
        Of the first and second labelled end: distance of the middle of its dyes from the axis (nm),
        angle of that place (rad), and direction of the rod towards its tip (rad), angles
        counter-clockwise; the angle of the first is 0. The first end is the rod's last one, which
        carries the longer cloud of dyes.
    breathing_sd_nm
        Standard deviation of each end's distance from the axis, by thermal motion; 0 without.
    rate_rev_s
        The rod's own rate, counter-clockwise seen from cis.
    """

    ends: tuple[tuple[float, float, float], tuple[float, float, float]]
    breathing_sd_nm: tuple[float, float]
    rate_rev_s: float

    @property
    def end_to_end_nm(self) -> float:
        """Distance of the middles of the dyes, seen from above."""
        (first, _, _), (second, angle, _) = self.ends
        return math.sqrt(first**2 + second**2 - 2.0 * first * second * math.cos(angle))


def shapes_of(name: str, scene: Scene) -> tuple[Shape, ...]:
    """Give the shapes among which rotors choose.

    Parameters
    ----------
    name
        `rod`: simulate that of the scene, or, where it has a section [scan], all of its scan; else
        the file of a rod's run or the folder of a scan.
    scene
        For the dyes, and for `rod` with [rod], [field] and what belongs to them.

    Raises
    ------
    ConfigurationError
        The rod, or no rod of the scan, keeps turning.
    ArchiveError, InputError
        The file cannot be read, or there is none.
    """
    clouds_nm = CLOUDS_NM
    if scene.film is not None and scene.film.dyes is not None:
        clouds_nm = (scene.film.dyes.lengths_nm[0], scene.film.dyes.lengths_nm[1])
    if name == "rod":
        return _simulated(scene, clouds_nm)
    path = Path(name)
    if path.is_dir():
        return _of_folder(path, clouds_nm)
    if not path.exists():
        raise InputError(
            f"{path} does not exist: give shape as circle, rod, the file of a rod or the folder of "
            "a scan"
        )
    return (shape_of_run(RodRun.load(path), clouds_nm, str(path)),)


def shape_of_run(run: RodRun, clouds_nm: tuple[float, float], origin: str) -> Shape:
    """Average the shape of a rod that turns.

    Parameters
    ----------
    run
        Without thermal noise.
    clouds_nm
        Lengths of rod that the dyes of a film's first and second end cover.
    origin
        Where the run comes from, for the sentence.

    Raises
    ------
    ConfigurationError
        The rod does not keep turning.
    """
    if run.end is not RodEnd.ROTATING_STEADILY:
        raise ConfigurationError(
            f"{origin}: the rod does not keep turning ({run.end.value}) and makes no rotor: "
            "choose another rod, such as lambda_eff 0.26 with flow_ratio 130, or a longer "
            "duration_us"
        )
    late = run.time_us >= run.time_us[-1] * (1.0 - _LAST_PART)
    ends, _ = _turned_back(run.positions_nm[late], clouds_nm)
    return Shape(ends=ends, breathing_sd_nm=(0.0, 0.0), rate_rev_s=run.numbers.rate_rev_s)


def shape_of_vertices(
    vertices_nm: Floats, rate_rev_s: float, clouds_nm: tuple[float, float]
) -> Shape:
    """Make a shape of one set of vertices, (n, 3) nm, and a rate."""
    ends, _ = _turned_back(vertices_nm[np.newaxis], clouds_nm)
    return Shape(ends=ends, breathing_sd_nm=(0.0, 0.0), rate_rev_s=rate_rev_s)


def _turned_back(
    positions_nm: Floats, clouds_nm: tuple[float, float]
) -> tuple[tuple[tuple[float, float, float], tuple[float, float, float]], tuple[float, float]]:
    """Average shapes in the frame that turns with them, and tell how far each end strays."""
    flat = positions_nm[..., 0] + 1j * positions_nm[..., 1]
    # The turn that fits each shape best to the last one.
    turn = np.angle(np.einsum("kn,n->k", flat, flat[-1].conj()))
    back = np.exp(-1j * turn)
    length_nm = float(np.linalg.norm(np.diff(positions_nm[-1], axis=0), axis=1).sum())
    centres = dye_centres_nm(positions_nm, length_nm, clouds_nm[::-1])
    dyes = (centres[..., 0] + 1j * centres[..., 1])[:, ::-1] * back[:, np.newaxis]
    mean = (flat * back[:, np.newaxis]).mean(axis=0)
    directions = np.array([mean[-1] - mean[-2], mean[0] - mean[1]])
    middle = dyes.mean(axis=0)
    start = np.angle(middle[0])
    ends = [
        (
            float(abs(place)),
            float(np.angle(place * np.exp(-1j * start))) if number else 0.0,
            float(np.angle(direction * np.exp(-1j * start))),
        )
        for number, (place, direction) in enumerate(zip(middle, directions, strict=True))
    ]
    strays = np.abs(dyes).std(axis=0)
    return (ends[0], ends[1]), (float(strays[0]), float(strays[1]))


def _simulated(scene: Scene, clouds_nm: tuple[float, float]) -> tuple[Shape, ...]:
    from rotortrack.simulate.scene_field import field_for

    scene.require("rod", "field")
    assert scene.rod is not None
    assert scene.field is not None
    field = field_for(scene.field).table
    if scene.scan is None:
        from rotortrack.simulate.single import simulate_rod

        done = simulate_rod(scene.rod, scene.start, scene.stepping, field, None)
        shape = shape_of_run(done.run, clouds_nm, scene.origin)
        if scene.thermal is None:
            return (shape,)
        # Noise from the start would make of docking a matter of chance.
        brief = replace(scene.stepping, duration_us=_THERMAL_US, sample_us=_THERMAL_SAMPLE_US)
        noisy = run_rod(scene.rod, brief, done.run.positions_nm[-1], field, scene.thermal)
        ends, strays = _turned_back(noisy.positions_nm, clouds_nm)
        return (replace(shape, ends=ends, breathing_sd_nm=strays),)
    from rotortrack.parallel import default_workers, map_ordered
    from rotortrack.simulate.scan import planned_runs, simulate_run

    results = map_ordered(
        lambda run: simulate_run(scene, field, run),
        planned_runs(scene.scan),
        workers=default_workers(),
    )
    turning = [
        shape_of_vertices(result.shape_nm, result.row["rate_rev_s"], clouds_nm)
        for result in results
        if result.row["end"] == RodEnd.ROTATING_STEADILY.value
    ]
    return _some(turning, scene.origin)


def _of_folder(folder: Path, clouds_nm: tuple[float, float]) -> tuple[Shape, ...]:
    from rotortrack.exchange.parquet import read_table
    from rotortrack.simulate.archive import read_archive
    from rotortrack.simulate.tables import RUNS

    table, archive = folder / "runs.parquet", folder / "shapes.npz"
    for path in (table, archive):
        if not path.is_file():
            raise InputError(
                f"{folder} holds no finished scan ({path.name} is missing): make one with "
                "`rotortrack simulate scan`"
            )
    runs = read_table(table, RUNS)
    arrays, _ = read_archive(archive, "the shapes of a scan", {"shape_nm": 3})
    if len(arrays["shape_nm"]) != len(runs):
        raise InputError(f"{archive} belongs to other runs: make the scan again")
    turning = [
        shape_of_vertices(vertices, float(rate), clouds_nm)
        for vertices, end, rate in zip(
            arrays["shape_nm"], runs["end"], runs["rate_rev_s"], strict=True
        )
        if end == RodEnd.ROTATING_STEADILY.value
    ]
    return _some(turning, str(folder))


def _some(shapes: Sequence[Shape], origin: str) -> tuple[Shape, ...]:
    if not shapes:
        raise ConfigurationError(
            f"{origin}: no rod of the scan keeps turning, so that it makes no rotors: scan other "
            "values of lambda_eff and flow_ratio"
        )
    return tuple(shapes)
