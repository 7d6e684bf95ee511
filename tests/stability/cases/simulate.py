"""Hard cases of the estimates and of what a scene is made of."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from cases.registry import case, digits, on_arrays, on_numbers

from rotortrack.simulate import estimates, psf

E, K, N = Fraction("1.602176634e-19"), Fraction("1.380649e-23"), Fraction("6.02214076e23")
VACUUM = Fraction("8.8541878128e-12")
PI = Fraction("3.14159265358979323846264338327950288")


def ratio(value: float) -> Fraction:
    return Fraction(value)


on_numbers(
    estimates.thermal_energy_pn_nm,
    [300.0],
    lambda t: float(K * 10**21 * ratio(t)),
    {"1e-300 K": [1e-270], "1e300 K": [1e300]},
)
on_numbers(estimates.thermal_voltage_v, [300.0], lambda t: float(K * ratio(t) / E))
on_numbers(
    estimates.bare_line_charge_c_m,
    [12.0, 0.34],
    lambda n, a: float(ratio(n) * E / ratio(a) * 10**9),
)
on_numbers(
    estimates.debye_length_nm,
    [50.0],
    lambda c: 1e9 * math.sqrt(78 * VACUUM * K * 300 / (E * 2 * E * N * ratio(c))),
    {"1 nM": [1e-6], "10 M": [1e4]},
)
on_numbers(
    estimates.electroosmotic_mobility_m2_vs,
    [-0.03],
    lambda v: float(-78 * VACUUM * ratio(v) * 1000),
)
on_numbers(
    estimates.bulk_conductivity_s_m,
    [50.0],
    lambda c: float((E * N) ** 2 * (ratio(1.33e-9) + ratio(2.03e-9)) * ratio(c) / (K * N * 300)),
)
on_numbers(
    estimates.hall_conductance_ns,
    [25.0, 20.0, 0.627],
    lambda r, length, s: float(ratio(s) * PI * ratio(r) ** 2 / (ratio(length) + PI / 2 * ratio(r))),
    {"no membrane": [25.0, 0.0, 0.627], "a long pipe": [1e-3, 1e9, 0.627]},
)
on_numbers(
    estimates.drag_over_pull,
    [75.0, 2.06e-8],
    lambda f, m: float(ratio(f) * PI / 1000 * ratio(m) * ratio(0.34) / (12 * E) / 10**9),
)
on_numbers(
    estimates.salt_flux_mol_m2_s,
    [450.0],
    lambda c: float(ratio(1.6e-9) * ratio(c) * 10**9 / 20),
    {"no difference": [0.0], "towards the rod": [-450.0]},
)
on_numbers(
    estimates.concentration_rate_um_s,
    [36.0],
    lambda j: float(ratio(j) * 400 * PI * 625 / 10**18 / 50 * 10**12),
)
on_numbers(
    estimates.access_factor, [25.0, 20.0], lambda r, m: float(1 + PI * ratio(r) / (2 * ratio(m)))
)
on_numbers(
    estimates.straight_rod_friction_pn_nm_s,
    [450.0],
    lambda length: float(PI * ratio(length) ** 3 / 12 / 10**9),
    {"a point": [0.0]},
)
on_numbers(
    estimates.rotational_power_pn_nm_s,
    [0.012, 125.0],
    lambda xi, omega: float(ratio(xi) * ratio(omega) ** 2),
    {"backwards": [0.012, -125.0], "at rest": [0.012, 0.0]},
)

straight = np.column_stack((np.linspace(-225.0, 225.0, 51), np.zeros(51), np.full(51, 3.0)))
friction = on_arrays(
    estimates.rotational_friction_pn_nm_s,
    straight,
    leaves_out={"inf": "vertices of a simulated rod, which stops with an error before"},
)
for size in (1e-9, 1e9):
    case(
        friction.name,
        f"scale {size:g}",
        lambda size=size: digits(  # type: ignore[misc]
            estimates.rotational_friction_pn_nm_s(straight * size),
            float(PI * (450 * Fraction(size)) ** 3 / 12 / 10**9),
        ),
    )
case(
    friction.name,
    "rotation",
    lambda: digits(
        estimates.rotational_friction_pn_nm_s(
            straight @ np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
        ),
        float(PI * 450**3 / 12 / 10**9),
    ),
)

first = np.array([0, 0, 0], dtype=np.int64)
on_arrays(
    psf.pixel_fractions,
    np.array([3.2, 3.5, 4.0]),
    call=lambda x: psf.pixel_fractions(x, first[: len(x)], 8, 1.3),
)
case(
    "simulate.psf.pixel_fractions",
    "all light is counted",
    lambda: digits(psf.pixel_fractions(np.array([50.3]), np.array([0]), 100, 1.3).sum(), 1.0),
)
