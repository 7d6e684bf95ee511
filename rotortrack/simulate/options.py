"""Options of scans of simulated rods."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from rotortrack.errors import ConfigurationError
from rotortrack.settings import Options, option

_MOST_RUNS = 1_000_000


def _several(values: tuple[float, ...]) -> str | None:
    if not values:
        return "must hold at least one number"
    twice = {value for value in values if values.count(value) > 1}
    return f"holds {min(twice):g} more than once" if twice else None


def _any(values: tuple[float, ...]) -> str | None:
    return None if values else "must hold at least one number"


@dataclass(frozen=True, kw_only=True)
class ScanOptions(Options):
    """Which rods are simulated, each from every placement.

    Charges and flow factors replace those of [rod], offsets those of [start]. The defaults are the
    8 x 11 x 3 runs of the phase diagram.

    Raises
    ------
    ConfigurationError
        Values out of bounds; as many x as y offsets are needed; the grid has too many runs.
    """

    lambda_eff: tuple[float, ...] = option(
        (0.02, 0.05, 0.1, 0.15, 0.2, 0.26, 0.35, 0.5),
        "parts of the bare charge that the electric field pulls at",
        gt=0,
        check=_several,
    )
    flow_ratio: tuple[float, ...] = option(
        (60.0, 90.0, 105.0, 115.0, 122.0, 130.0, 138.0, 145.0, 155.0, 170.0, 200.0),
        "factors of the flow over lambda_eff",
        ge=0,
        check=_several,
    )
    offset_x_nm: tuple[float, ...] = option(
        (0.0, 40.0, 90.0),
        "offset along the rod in each placement, nm",
        check=_any,
    )
    offset_y_nm: tuple[float, ...] = option(
        (3.0, 8.0, 15.0),
        "offset across the rod in each placement, nm",
        check=_any,
    )
    mirrored: bool = option(False, "simulate the mirror image of each placement as well")

    def __post_init__(self) -> None:
        super().__post_init__()
        mistakes = self.mistakes()
        if mistakes:
            raise ConfigurationError(*(f"[scan] {mistake}" for mistake in mistakes))

    @property
    def runs(self) -> int:
        """Number of runs."""
        starts = len(self.offset_x_nm) * (2 if self.mirrored else 1)
        return len(self.lambda_eff) * len(self.flow_ratio) * starts

    def mistakes(self) -> list[str]:
        """Say what is wrong with the options taken together."""
        found = []
        x, y = len(self.offset_x_nm), len(self.offset_y_nm)
        if x != y:
            found.append(
                f"offset_x_nm and offset_y_nm have {x} and {y} numbers: a placement is one of each"
            )
        if self.runs > _MOST_RUNS:
            found.append(f"asks for {self.runs} runs: ask for fewer than {_MOST_RUNS}")
        return found

    def as_dict(self) -> dict[str, object]:
        """Give the options as plain values."""
        return dataclasses.asdict(self)
