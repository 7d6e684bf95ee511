"""Running a rod: options in, a run with its end and numbers out."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ArchiveError, ConfigurationError, RodError
from rotortrack.simulate.archive import read_archive, write_archive
from rotortrack.simulate.rod.elasticity import check_shape
from rotortrack.simulate.rod.ends import EndNumbers, RodEnd, classify_end, end_numbers
from rotortrack.simulate.rod.forces import NO_NODES
from rotortrack.simulate.rod.integrate import (
    DEFORMATION_NM_US,
    EXPLICIT,
    FOLDED,
    IMPLICIT,
    NOT_FINITE,
    OUT_OF_STEPS,
    REJECTED,
    SETTLED_US,
    STEPS,
    STORED,
    TIME_US,
    TOO_STIFF,
    Control,
    Samples,
    integrate,
)
from rotortrack.simulate.rod.options import RodOptions, SteppingOptions, ThermalOptions
from rotortrack.simulate.rod.parameters import EDGE_NM, rod_parameters
from rotortrack.simulate.rod.thermal import integrate_noisy

if TYPE_CHECKING:
    from rotortrack.simulate.field.table import FieldTable

_LARGEST_BYTES = 4e9

_DIMENSIONS = {"time_us": 1, "positions_nm": 3, "turned_rad": 1}


@dataclass(frozen=True, kw_only=True)
class RodRun:
    """A rod's way from its start to an end.

    Parameters
    ----------
    time_us
        Times of the stored shapes, shape (k,): every sample_us, and the last.
    positions_nm
        The shapes, (k, n, 3); z points to cis, the origin is the pore's centre.
    turned_rad
        Angle turned about the pore's axis since the start, weighted by friction, (k,); positive
        counter-clockwise seen from cis.
    end, numbers
        How the run ended and by which numbers that was decided.
    n_steps, n_rejected
        Steps taken; steps tried again with a shorter one.
    rod, stepping
        The options of the run.
    about_field
        What the field says of itself; None without one.
    thermal
        Options of the noise; None without.
    seconds
        Time that the run took.
    """

    time_us: NDArray[np.float64]
    positions_nm: NDArray[np.float64]
    turned_rad: NDArray[np.float64]
    end: RodEnd
    numbers: EndNumbers
    n_steps: int
    n_rejected: int
    rod: RodOptions
    stepping: SteppingOptions
    about_field: dict[str, Any] | None = None
    thermal: ThermalOptions | None = None
    seconds: float = dataclasses.field(default=math.nan, compare=False)

    @property
    def simulated_us(self) -> float:
        """Time that passed for the rod."""
        return float(self.time_us[-1])

    def save(self, path: Path) -> None:
        """Write the run to an npz file, whole or not at all."""
        about = {
            "kind": "rod run",
            "end": self.end.value,
            "numbers": dataclasses.asdict(self.numbers),
            "n_steps": self.n_steps,
            "n_rejected": self.n_rejected,
            "rod": dataclasses.asdict(self.rod),
            "stepping": dataclasses.asdict(self.stepping),
            "field": self.about_field,
            "thermal": None if self.thermal is None else dataclasses.asdict(self.thermal),
            "seconds": self.seconds,
        }
        write_archive(path, {name: getattr(self, name) for name in _DIMENSIONS}, about)

    @classmethod
    def load(cls, path: Path) -> RodRun:
        """Read a run that `save` wrote.

        Raises
        ------
        ArchiveError
            The file is no such run; the sentence names it.
        """
        arrays, about = read_archive(path, "a rod's run", _DIMENSIONS)
        count = len(arrays["time_us"])
        shape = arrays["positions_nm"].shape
        if count == 0 or shape[0] != count or shape[2] != 3 or len(arrays["turned_rad"]) != count:
            raise ArchiveError(f"{path} cannot be read as a rod's run (its arrays do not fit)")
        try:
            return cls(
                **arrays,
                end=RodEnd(about["end"]),
                numbers=EndNumbers(**about["numbers"]),
                n_steps=int(about["n_steps"]),
                n_rejected=int(about["n_rejected"]),
                rod=RodOptions(**about["rod"]),
                stepping=SteppingOptions(**about["stepping"]),
                about_field=about["field"],
                thermal=None if about["thermal"] is None else ThermalOptions(**about["thermal"]),
                seconds=float(about["seconds"]),
            )
        except (KeyError, TypeError, ValueError, ConfigurationError) as error:
            raise ArchiveError(
                f"{path} cannot be read as a rod's run ({type(error).__name__}: {error})"
            ) from error


def run_rod(
    rod: RodOptions,
    stepping: SteppingOptions,
    start_nm: NDArray[np.float64],
    field: FieldTable | None = None,
    thermal: ThermalOptions | None = None,
) -> RodRun:
    """Let a rod go from its start until an end.

    Parameters
    ----------
    rod, stepping
        What the rod is, and how time is stepped.
    start_nm
        Vertices, nm, shape (n_vertices, 3), all links of the rod's link length (`place_rod`).
    field
        Field of a pore; without it there is neither field, flow nor membrane.
    thermal
        Noise, by the method of `thermal`; without it no random number is drawn.

    Raises
    ------
    RodError
        The start is no such rod; a vertex or a force stops being finite, a joint folds, or no step
        is short enough, with the number of the step; the samples would not fit into memory.
    """
    parameters = rod_parameters(rod, field)
    start = np.ascontiguousarray(start_nm, dtype=np.float64)
    _check_start(start, rod, parameters[EDGE_NM])
    r_nm, z_nm, nodes = NO_NODES if field is None else (field.r_nm, field.z_nm, field.nodes)
    samples = new_samples(stepping, rod.n_vertices)
    begin = time.perf_counter()
    control = control_of(stepping)
    if thermal is None:
        status = integrate(start, parameters, r_nm, z_nm, nodes, control, samples)
    else:
        status = integrate_noisy(start, parameters, r_nm, z_nm, nodes, control, thermal, samples)
    seconds = time.perf_counter() - begin
    raise_failure(status, samples, stepping)
    return collect(
        status,
        samples,
        parameters,
        rod=rod,
        stepping=stepping,
        about_field=None if field is None else describe_field(field),
        thermal=thermal,
        seconds=seconds,
    )


def control_of(stepping: SteppingOptions) -> Control:
    """Translate stepping options for the compiled loop."""
    capped = stepping.method == "paper"
    return Control(
        kind=IMPLICIT if stepping.method == "implicit" else EXPLICIT,
        step_us=stepping.duration_us if capped else stepping.step_us,
        longest_us=stepping.max_step_us,
        tolerance_nm=stepping.tolerance_nm,
        cap_nm=stepping.cap_nm if capped else math.inf,
        duration_us=stepping.duration_us,
        sample_us=stepping.sample_us,
        max_steps=stepping.max_steps,
        stops=stepping.stop_when_settled,
    )


def new_samples(stepping: SteppingOptions, n_vertices: int) -> Samples:
    """Make room for the samples of a run.

    Raises
    ------
    RodError
        They would take more than 4 GB.
    """
    size = stepping.duration_us / stepping.sample_us + 3.0
    if size * n_vertices * 24.0 > _LARGEST_BYTES:
        raise RodError(
            f"shapes every {stepping.sample_us:g} us for {stepping.duration_us:g} us take "
            f"{size * n_vertices * 24e-9:.0f} GB: give a larger sample_us"
        )
    count = int(size)
    return Samples(np.zeros(count), np.zeros((count, n_vertices, 3)), np.zeros(count), np.zeros(6))


def collect(
    status: int,
    samples: Samples,
    parameters: NDArray[np.float64],
    *,
    rod: RodOptions,
    stepping: SteppingOptions,
    about_field: dict[str, Any] | None,
    seconds: float,
    thermal: ThermalOptions | None = None,
) -> RodRun:
    """Name the end of what `integrate` wrote and put it into a run."""
    counts = samples.numbers
    stored = int(counts[STORED])
    arrays = {name: getattr(samples, name)[:stored].copy() for name in _DIMENSIONS}
    numbers = end_numbers(
        **arrays,
        rod=parameters,
        settled_us=float(counts[SETTLED_US]),
        deformation_nm_us=float(counts[DEFORMATION_NM_US]),
    )
    return RodRun(
        **arrays,
        end=classify_end(numbers, parameters, time_is_over=status != OUT_OF_STEPS),
        numbers=numbers,
        n_steps=int(counts[STEPS]),
        n_rejected=int(counts[REJECTED]),
        rod=rod,
        stepping=stepping,
        about_field=about_field,
        thermal=thermal,
        seconds=seconds,
    )


def raise_failure(status: int, samples: Samples, stepping: SteppingOptions) -> None:
    """Raise a RodError that names the step where a run failed; nothing where it did not."""
    counts = samples.numbers
    where = f"step {int(counts[STEPS]) + 1} at {counts[TIME_US]:g} us"
    if status == NOT_FINITE:
        raise RodError(
            f"{where}: a vertex or a force is not finite: give a shorter step_us, or look for "
            "NaN in the field"
        )
    if status == FOLDED:
        raise RodError(
            f"{where}: a joint folds by more than 150 degrees: give more n_vertices, a shorter "
            "step_us or weaker forces"
        )
    if status == TOO_STIFF:
        raise RodError(
            f"{where}: no step keeps tolerance_nm {stepping.tolerance_nm:g}: give a larger one, or "
            "look for jumps and NaN in the field"
        )


def describe_field(field: FieldTable) -> dict[str, Any]:
    """List what a run remembers of its field."""
    return {
        "options": field.options,
        "voltage_v": field.voltage_v,
        "current_error_rel": field.current_error_rel,
        "flow_error_rel": field.flow_error_rel,
    }


def _check_start(start: NDArray[np.float64], rod: RodOptions, edge_nm: float) -> None:
    if start.shape != (rod.n_vertices, 3):
        raise RodError(
            f"the start has shape {start.shape}, not ({rod.n_vertices}, 3): place the rod with its "
            "own n_vertices"
        )
    check_shape(start)
    worst = float(np.abs(np.linalg.norm(np.diff(start, axis=0), axis=1) - edge_nm).max())
    if worst > 1e-6 * edge_nm:
        raise RodError(
            f"a link of the start is {worst:.2g} nm off its length of {edge_nm:g} nm: place the "
            "rod with its own length_nm and n_vertices"
        )
