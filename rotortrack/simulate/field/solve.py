"""Solve the field of a pore: ions by Newton's method, flow by Picard passes between them.

Each pass brings the ions into balance with the flow, with the last factors of Newton's matrix while
these serve, and solves Stokes' equations for their force. Convection is weak, so that a pass gains
about two digits; Anderson's mixing of passes serves where it is not, near 1 V.

The answer comes from the finest of three meshes. The first has a smallest cell h and a ratio q of
neighbours; the second has smaller cells at the walls only; the third is the first with every cell
split in four: the second's smallest cell, and the ratio sqrt(q). Between the first two changes what
sharp rims cost, whose corner is singular: the flow rate converges nearly in proportion to h, the
current, like an energy, as h^(4/3). Between the last two changes what the grading costs, which a
split lowers 16 times. Told apart, the two cannot cancel in the estimate as they may in an answer.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import SuperLU

from rotortrack.errors import InputError
from rotortrack.simulate.field.mesh import Floats, Grid, pore_grid
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.pnp import FARADAY_C_MOL, Ions, PoissonNernstPlanck, Scales
from rotortrack.simulate.field.solution import FieldSolution
from rotortrack.simulate.field.space import Space
from rotortrack.simulate.field.stokes import Stokes, excess_force

_MOST_PASSES = 40
_MOST_STEPS = 30
_PASS_TOLERANCE = 1e-6

_MESHES = {"fast": (1.4, 4.0), "default": (0.5, 3.0), "careful": (0.2, 1.7)}
"""First cell and ratio of the coarse mesh, the first cell where the Debye length is 1.36 nm."""

_FLOW_ORDER, _CURRENT_ORDER = 0.8, 4 / 3
"""Powers of the smallest cell with which the errors of a sharp rim fall; the flow's is measured."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What one mesh gave."""

    space: Space
    scales: Scales
    rest: Ions | None
    ions: Ions
    velocity: Floats
    voltage_v: float
    current_a: float
    flow_m3_s: float
    steps: int
    passes: int
    unknowns: int


class _Pore:
    """The discrete problem on one mesh; voltages are tried on it one after the other."""

    def __init__(self, options: FieldOptions, grid: Grid) -> None:
        self.options = options
        self.scales = Scales.of(options)
        self.space = Space(grid)
        self.pnp = PoissonNernstPlanck(self.space, self.scales)
        self.stokes = Stokes(self.space, self.scales)
        self.cis, self.trans = self.space.boundary("cis"), self.space.boundary("trans")
        rise = np.zeros(self.space.n2)
        rise[self.trans] = 1.0
        # 1 on the trans end, 0 on the cis end.
        self.fall = self.pnp.harmonic(rise)
        self.steps = self.passes = 0

    def start(self, voltage_v: float) -> Ions:
        """Solve Poisson's equation in ions that drift and diffuse past an uncharged membrane."""
        options, scales = self.options, self.scales
        salt = options.cis_mm + (options.trans_mm - options.cis_mm) * self.fall
        log_salt = np.log(np.maximum(salt, 0.5 * min(options.cis_mm, options.trans_mm)))
        log_salt -= math.log(scales.salt_mm)
        potential = voltage_v / scales.thermal_v * self.fall
        ions = Ions(potential.copy(), log_salt + potential, log_salt - potential)
        self.steps += self.pnp.relax_potential(ions)
        return ions

    def solve(self, voltage_v: float, ions: Ions, velocity: Floats) -> tuple[Ions, Floats]:
        """Potential, ions and flow at a voltage; `ions` and `velocity` are first guesses."""
        ions = ions.copy()
        self._hold(ions, voltage_v)
        if not velocity.any():
            velocity = self.stokes.solve(*excess_force(self.space, self.scales, ions))
        steps, factors = self.pnp.solve(ions, self.stokes.sampled(velocity))
        self.steps += steps
        mixer = _Mixer()
        goal = 1e-3
        for _ in range(_MOST_PASSES):
            self.passes += 1
            factors = self._settle(ions, self.stokes.sampled(velocity), factors, goal)
            driven = self.stokes.solve(*excess_force(self.space, self.scales, ions))
            moved = float(np.abs(driven - velocity).max())
            speed = float(np.abs(driven).max())
            # At rest everything is 0 but for rounding: compare without dividing.
            small = _PASS_TOLERANCE * speed + 1e-9 * self.scales.speed_nm_us
            if moved <= small and goal <= 1e-7:
                return ions, driven
            goal = min(max(1e-3 * moved / max(speed, small), 1e-8), 1e-4) if moved > small else 1e-8
            velocity = mixer.mixed(velocity, driven)
        raise InputError(
            f"flow and ions did not settle in {_MOST_PASSES} passes; lower voltage_v or raise "
            "viscosity_mpa_s"
        )

    def _settle(
        self, ions: Ions, flow: tuple[Floats, Floats], factors: SuperLU, goal: float
    ) -> SuperLU:
        """Bring the ions into balance with a flow, with new factors only where old ones fail."""
        change = math.inf
        for _ in range(_MOST_STEPS):
            last, change = change, self.pnp.step(ions, flow, factors)
            if change <= goal:
                return factors
            if change > 0.2 * last or change > 1.0:
                factors = self.pnp.jacobian(ions, flow)
                self.steps += 1
        raise InputError(
            "the ions did not settle in the flow; lower voltage_v or raise viscosity_mpa_s"
        )

    def _hold(self, ions: Ions, voltage_v: float) -> None:
        """Set potential and concentrations at the two ends, and shift the guess between them."""
        options, scales = self.options, self.scales
        present = float(ions.phi[self.trans[0]])
        shift = (voltage_v / scales.thermal_v - present) * self.fall
        ions.phi += shift
        ions.plus += shift
        ions.minus -= shift
        for nodes, salt_mm, volts in (
            (self.cis, options.cis_mm, 0.0),
            (self.trans, options.trans_mm, voltage_v),
        ):
            log_salt, potential = math.log(salt_mm / scales.salt_mm), volts / scales.thermal_v
            ions.phi[nodes] = potential
            ions.plus[nodes] = log_salt + potential
            ions.minus[nodes] = log_salt - potential

    def current_a(self, ions: Ions, velocity: Floats) -> float:
        """Electric current from trans to cis, A."""
        plus, minus = self.pnp.fluxes(ions, self.stokes.sampled(velocity))
        return FARADAY_C_MOL * self.scales.salt_mm * 1e-21 * float(np.mean(plus - minus))

    def answer(self, voltage_v: float, rest: Ions | None, ions: Ions, velocity: Floats) -> Answer:
        """Gather what this mesh gave."""
        return Answer(
            space=self.space,
            scales=self.scales,
            rest=rest,
            ions=ions,
            velocity=velocity,
            voltage_v=voltage_v,
            current_a=self.current_a(ions, velocity),
            flow_m3_s=self.stokes.flow_rate(velocity) * 1e-21,
            steps=self.steps,
            passes=self.passes,
            unknowns=3 * self.space.n2 + self.stokes.unknowns,
        )


class _Mixer:
    """Anderson's mixing: the combination of the last passes whose changes cancel best."""

    def __init__(self, depth: int = 6) -> None:
        self.depth = depth
        self.inputs: list[Floats] = []
        self.changes: list[Floats] = []

    def mixed(self, given: Floats, found: Floats) -> Floats:
        """Next input of the fixed-point map that made `found` of `given`."""
        self.inputs = [*self.inputs[-self.depth :], given]
        self.changes = [*self.changes[-self.depth :], found - given]
        if len(self.inputs) == 1:
            return found
        slopes = np.stack([self.changes[-1] - old for old in self.changes[:-1]]).reshape(
            len(self.inputs) - 1, -1
        )
        moves = np.stack([self.inputs[-1] - old for old in self.inputs[:-1]])
        parts = np.linalg.lstsq(slopes.T, self.changes[-1].ravel(), rcond=1e-8)[0]
        return found - np.tensordot(parts, moves + slopes.reshape(moves.shape), axes=1)


def solve_on(options: FieldOptions, grid: Grid) -> Answer:
    """Solve on one mesh, with the electrical reading of the options."""
    pore = _Pore(options, grid)
    voltage = options.voltage_v
    if options.electrical == "shorted_agcl":
        voltage += pore.scales.thermal_v * math.log(options.trans_mm / options.cis_mm)
    rest: Ions | None = None
    if options.cis_mm == options.trans_mm:
        rest = pore.start(0.0)
        guess = rest
    elif options.electrical == "zero_current":
        guess = pore.start(0.0)
    else:
        guess = pore.start(voltage)
    still = np.zeros((2, pore.space.n2))
    if options.electrical != "zero_current":
        ions, velocity = pore.solve(voltage, guess, still)
        return pore.answer(voltage, rest, ions, velocity)
    return _without_current(pore, rest, guess, still)


def _without_current(pore: _Pore, rest: Ions | None, guess: Ions, velocity: Floats) -> Answer:
    """Secant steps on the voltage until the current is 1e-6 of that which 1 mV drives."""
    trial_v = 1e-3
    voltage = 0.0
    ions, velocity = pore.solve(voltage, guess, velocity)
    current = pore.current_a(ions, velocity)
    allowed: float | None = None
    for _ in range(20):
        ions, velocity = pore.solve(voltage + trial_v, ions, velocity)
        voltage += trial_v
        new = pore.current_a(ions, velocity)
        conductance = (new - current) / trial_v
        current = new
        if allowed is None:
            allowed = abs(conductance) * 1e-9
        if abs(current) <= allowed:
            return pore.answer(voltage, rest, ions, velocity)
        trial_v = -current / conductance
    raise InputError("no voltage without current was found; choose electrical = 'fixed_potential'")


def field_grid(options: FieldOptions, first_nm: float, ratio: float) -> Grid:
    """Mesh of a pore; cells shrink with the Debye length of the more concentrated side."""
    scales = Scales.of(options)
    finest = scales.debye_nm * math.sqrt(scales.salt_mm / max(options.cis_mm, options.trans_mm))
    first = first_nm * min(finest / 1.36, 1.0)
    if options.rim_radius_nm > 0:
        first = min(first, options.rim_radius_nm / 2)
    return pore_grid(
        pore_nm=options.pore_radius_nm,
        membrane_nm=options.membrane_nm,
        box_radius_nm=options.box_radius_nm,
        box_height_nm=options.box_height_nm,
        first_nm=first,
        ratio=ratio,
        rim_nm=options.rim_radius_nm,
    )


def solve_field(options: FieldOptions) -> FieldSolution:
    """Solve potential, ions and flow around a pore, with estimates of the errors.

    Returns
    -------
    FieldSolution
        Of the finer mesh. Current and flow rate count positive from trans to cis.

    Raises
    ------
    InputError
        Newton's method or the passes found no solution.
    """
    began = time.perf_counter()
    first, ratio = _MESHES[options.accuracy]
    grid = field_grid(options, first, ratio)
    shrinking = 1 + math.sqrt(ratio)
    coarse = solve_on(options, grid)
    sharper = solve_on(options, field_grid(options, first / shrinking, ratio))
    fine = solve_on(options, grid.refined(ratio))
    typical_a, typical_m3_s = _typical(options, fine.scales)
    currents = (coarse.current_a, sharper.current_a, fine.current_a)
    flows = (coarse.flow_m3_s, sharper.flow_m3_s, fine.flow_m3_s)
    return as_solution(
        options,
        fine,
        current_error_rel=_error(currents, shrinking**_CURRENT_ORDER, typical_a),
        flow_error_rel=_error(flows, shrinking**_FLOW_ORDER, typical_m3_s),
        seconds=time.perf_counter() - began,
    )


def as_solution(
    options: FieldOptions,
    answer: Answer,
    *,
    current_error_rel: float = math.nan,
    flow_error_rel: float = math.nan,
    seconds: float = math.nan,
) -> FieldSolution:
    """Make what one mesh gave a solution; its errors are unknown unless given."""
    return FieldSolution(
        options=options,
        space=answer.space,
        scales=answer.scales,
        rest=answer.rest,
        ions=answer.ions,
        velocity=answer.velocity,
        voltage_v=answer.voltage_v,
        current_a=answer.current_a,
        flow_m3_s=answer.flow_m3_s,
        current_error_rel=current_error_rel,
        flow_error_rel=flow_error_rel,
        unknowns=answer.unknowns,
        iterations=answer.steps + answer.passes,
        seconds=seconds,
    )


def _typical(options: FieldOptions, scales: Scales) -> tuple[float, float]:
    """Give an ordinary current, A, and flow, m3/s: what is far smaller is rounding."""
    radius = options.pore_radius_nm
    diffusivity = scales.cation_nm2_us + scales.anion_nm2_us
    current_a = FARADAY_C_MOL * scales.salt_mm * diffusivity * radius * 1e-21
    return current_a, scales.speed_nm_us * radius**2 * 1e-21


def _error(values: tuple[float, float, float], gain: float, typical: float) -> float:
    """Relative error of the last value; `gain` is by how much smaller cells lower the corner's.

    Zero where all values vanish but for rounding.
    """
    coarse, sharper, fine = values
    error = abs(coarse - sharper) / (gain - 1) + abs(sharper - fine) / 15
    return error / abs(fine) if error > 1e-12 * typical else 0.0
