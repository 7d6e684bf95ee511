"""Fields that are known because their sources were made for them: errors fall at the orders of Q2.

Sources are those of the strong equations, div F = (1/r) d(r F_r)/dr + dF_z/dz, worked out by hand,
so that a wrong weight or sign in the weak forms leaves an error that no refinement takes away.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j0, j1

from rotortrack.simulate.field.mesh import Grid, Rim
from rotortrack.simulate.field.options import FieldOptions
from rotortrack.simulate.field.pnp import Ions, PoissonNernstPlanck, Scales
from rotortrack.simulate.field.space import Space
from rotortrack.simulate.field.stokes import Stokes

RADIUS, HEIGHT = 3.0, 4.0
NO_SLOPE = 3.8317059702075125 / RADIUS
"""J0(NO_SLOPE r) has no slope at r = RADIUS."""

SCALES = replace(Scales.of(FieldOptions()), viscosity=2.5e-3, charge_per_nm=0.4)


def pipe(cells):
    """A cylinder of uneven cells, halved from one refinement to the next."""
    part = np.linspace(0.0, 1.0, cells + 1)
    z_nm = HEIGHT * (part + 0.08 * np.sin(2 * math.pi * part))
    grid = Grid(
        r_nm=RADIUS * part * (0.6 + 0.4 * part), z_nm=z_nm, solid=np.zeros((cells, cells), bool)
    )
    return Space(grid)


def errors(space, nodal, value, slope_r, slope_z):
    """Root mean squares of the errors of a Q2 function and of its slopes."""
    volume = space.weight.sum()
    found_r, found_z = space.slopes(nodal)
    return (
        math.sqrt(np.sum(space.weight * (space.at_points(nodal) - value) ** 2) / volume),
        math.sqrt(
            np.sum(space.weight * ((found_r - slope_r) ** 2 + (found_z - slope_z) ** 2)) / volume
        ),
    )


def orders(of_cells, counts=(4, 8, 16)):
    """Powers of the cell's size with which the errors fell at the last refinement."""
    found = np.array([of_cells(cells) for cells in counts])
    return np.log2(found[-2] / found[-1]), found[-1]


def wave(r, z, amplitude, turns, side=0.0, radial=NO_SLOPE):
    """A function with slope `side` at r = RADIUS: value, slopes by r and z, and Laplacian."""
    k = turns * math.pi / HEIGHT
    cosine, sine = amplitude * np.cos(k * z + 0.3), amplitude * np.sin(k * z + 0.3)
    return (
        j0(radial * r) * cosine + side * r**2 / (2 * RADIUS),
        -radial * j1(radial * r) * cosine + side * r / RADIUS,
        -k * j0(radial * r) * sine,
        -(radial**2 + k**2) * j0(radial * r) * cosine + 2 * side / RADIUS,
    )


def stream(r, z):
    """Flow of the stream function r^2 (1 - r^2/R^2)^2 sin(k z): u_r, u_z; it has no divergence."""
    k, x = math.pi / HEIGHT, (r / RADIUS) ** 2
    return -k * r * (1 - x) ** 2 * np.cos(k * z), 2 * (1 - x) * (1 - 3 * x) * np.sin(k * z)


def ions_at(r, z):
    """Values, slopes and Laplacians of phi, psi+ and psi-."""
    return (
        wave(r, z, 0.8, 1, side=SCALES.charge_per_nm),
        wave(r, z, 0.5, 0.7),
        wave(r, z, -0.6, 1.3),
    )


def ion_sources(r, z, flow):
    """What must flow in per volume for `ions_at` to hold: one for each equation of the residual."""
    phi, plus, minus = ions_at(r, z)
    c_plus, c_minus = np.exp(plus[0] - phi[0]), np.exp(minus[0] + phi[0])
    sources = [-phi[3] - (c_plus - c_minus) / (2 * SCALES.debye_nm**2)]
    for sign, psi, density, diffusivity in (
        (1.0, plus, c_plus, SCALES.cation_nm2_us),
        (-1.0, minus, c_minus, SCALES.anion_nm2_us),
    ):
        # -div(c (grad psi - u / D)) with grad c = c (grad psi -+ grad phi) and div u = 0.
        log_r, log_z = psi[1] - sign * phi[1], psi[2] - sign * phi[2]
        pushed = log_r * (psi[1] - flow[0] / diffusivity) + log_z * (psi[2] - flow[1] / diffusivity)
        sources.append(-density * (psi[3] + pushed))
    return sources


def ion_errors(cells):
    space = pipe(cells)
    pnp = PoissonNernstPlanck(space, SCALES, charged=("side",))
    r, z = space.radius, space.height
    # Fast enough that convection counts as much as diffusion.
    flow = tuple(1e3 * part for part in stream(r, z))
    load = np.stack(
        [space.gather(space.loads(f, space.value)) for f in ion_sources(r, z, flow)], axis=1
    )
    at_nodes = [f[0] for f in ions_at(*space.points)]
    ions = Ions(*(np.where(pnp.free, 0.0, exact) for exact in at_nodes))
    for _ in range(12):
        residual = pnp.residual(ions, flow) - load
        residual[pnp.held] = 0
        change = pnp.jacobian(ions, flow).solve(residual.ravel()).reshape(-1, 3)
        ions.phi -= change[:, 0]
        ions.plus -= change[:, 1]
        ions.minus -= change[:, 2]
        if np.abs(change).max() < 1e-6:
            break
    assert np.abs(change).max() < 1e-6
    return [
        errors(space, nodal, *exact[:3])
        for nodal, exact in zip((ions.phi, ions.plus, ions.minus), ions_at(r, z), strict=True)
    ]


def test_ions_in_a_flow_are_met_to_third_order_and_their_slopes_to_second():
    found, last = orders(ion_errors)
    assert found[:, 0].min() > 2.8
    assert found[:, 1].min() > 1.85
    assert last[:, 0].max() < 2e-4


def force(r, z):
    """Body force that drives `stream` against a pressure with no stress at z = 0 and HEIGHT."""
    k, x = math.pi / HEIGHT, (r / RADIUS) ** 2
    cosine, sine = np.cos(k * z), np.sin(k * z)
    profile, by_r = 1 - 4 * x + 3 * x**2, (-8 + 12 * x) * r / RADIUS**2
    # lap u_r - u_r / r^2 and lap u_z: (n^2 - 1) r^(n - 2) and n^2 r^(n - 2) for each power.
    bent = (-16 + 24 * x) * r / RADIUS**2
    lap_r = -k * cosine * (bent - k**2 * r * (1 - x) ** 2)
    lap_z = 2 * sine * ((-16 + 48 * x) / RADIUS**2 - k**2 * profile)
    # p = eta (2 du_z/dz + sin(k z) x), where du_z/dz = 2 k cos(k z) profile.
    p_r = 4 * k * cosine * by_r + sine * 2 * r / RADIUS**2
    p_z = -4 * k**2 * sine * profile + k * cosine * x
    return SCALES.viscosity * (p_r - lap_r), SCALES.viscosity * (p_z - lap_z)


def flow_errors(cells):
    space = pipe(cells)
    r, z = space.radius, space.height
    velocity = Stokes(space, SCALES, no_slip=("side",)).solve(*force(r, z))
    found = [space.at_points(part) for part in velocity]
    volume = space.weight.sum()
    square = sum((a - b) ** 2 for a, b in zip(found, stream(r, z), strict=True))
    spread = space.slopes(velocity[0])[0] + found[0] / r + space.slopes(velocity[1])[1]
    return [
        math.sqrt(np.sum(space.weight * square) / volume),
        math.sqrt(np.sum(space.weight * spread**2) / volume),
    ]


def test_flow_is_met_to_third_order_between_open_ends_and_its_divergence_to_second():
    found, last = orders(flow_errors)
    assert found[0] > 2.8
    assert found[1] > 1.85
    assert last[0] < 1e-3


def rounded_errors(cells):
    """Laplace's equation around a rounded rim: cells are curved and the wall's nodes moved."""
    lines = np.linspace(0.0, 1.0, cells + 1)
    r_nm = np.concatenate([2 * lines, 2 + lines[1:], 3 + 2 * lines[1:]])
    above = np.concatenate([1 * lines, 1 + lines[1:], 2 + 2 * lines[1:]])
    z_nm = np.concatenate([-above[:0:-1], above])
    middle_r, middle_z = (r_nm[1:] + r_nm[:-1]) / 2, (z_nm[1:] + z_nm[:-1]) / 2
    solid = (middle_r[:, None] > 3) & (np.abs(middle_z)[None, :] < 2)
    rim = Rim(pore_nm=3.0, half_nm=2.0, radius_nm=1.0)
    space = Space(Grid(r_nm=r_nm, z_nm=z_nm, solid=solid, rim=rim))
    pnp = PoissonNernstPlanck(space, SCALES, charged=(), ends=("cis", "trans", "side", "wall"))

    def bessel(r, z):
        # lap = 0: an oscillation by r that grows along z.
        decay = 0.7
        return (
            j0(decay * r) * np.exp(decay * z),
            -decay * j1(decay * r) * np.exp(decay * z),
            decay * j0(decay * r) * np.exp(decay * z),
        )

    held = np.where(pnp.free, 0.0, bessel(*space.points)[0])
    return errors(space, pnp.harmonic(held), *bessel(space.radius, space.height))


def test_curved_cells_at_a_rounded_rim_keep_the_order():
    found, _ = orders(rounded_errors, (2, 4, 8))
    assert found[0] > 2.0
    assert found[1] > 1.5


def test_quadratics_are_exact_on_any_cells():
    space = pipe(5)
    pnp = PoissonNernstPlanck(space, SCALES, charged=(), ends=("cis", "trans", "side"))
    r, z = space.points
    exact = r**2 - 2 * z**2
    np.testing.assert_allclose(pnp.harmonic(np.where(pnp.free, 0.0, exact)), exact, atol=1e-11)


@pytest.mark.parametrize("reversed_", [False, True])
def test_poiseuilles_flow_is_exact(reversed_):
    """A parabola is in the space: what a uniform push drives through a pipe has no error at all."""
    space = pipe(4)
    stokes = Stokes(space, SCALES, no_slip=("side",), no_radial=("axis", "side", "cis", "trans"))
    push = -3.0 if reversed_ else 3.0
    velocity = stokes.solve(np.zeros_like(space.weight), np.full_like(space.weight, push))
    exact = push / (4 * SCALES.viscosity) * (RADIUS**2 - space.points[0] ** 2)
    np.testing.assert_allclose(velocity[1], exact, atol=1e-8)
    np.testing.assert_allclose(velocity[0], 0.0, atol=1e-8)
    hagen = math.pi * push * RADIUS**4 / (8 * SCALES.viscosity)
    assert stokes.flow_rate(velocity) == pytest.approx(hagen, rel=1e-10)
