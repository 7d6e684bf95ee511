"""Angles of rotors: exact laws, whatever the parts of an exposure and the cuts of a film."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from rotortrack.errors import ConfigurationError
from rotortrack.simulate.film.angles import AngleWalk
from rotortrack.simulate.film.clock import Clock
from rotortrack.simulate.film.legs import Drive, Flips
from rotortrack.simulate.film.options import VoltageOptions
from rotortrack.simulate.film.rotor import Rotor
from rotortrack.simulate.film.streams import Effect, stream
from rotortrack.simulate.film.wander import ornstein_uhlenbeck

T = 0.002


def rotor(motion="driven", **changes):
    values = {
        "driven": {"omega_rad_s": 30.0, "diffusion_rad2_s": 5.0},
        "brownian": {"diffusion_rad2_s": 5.0},
        "switching": {"omega_rad_s": 30.0, "diffusion_rad2_s": 5.0, "switch_rate_per_s": 20.0},
        "stuck": {},
        "tethered": {"diffusion_rad2_s": 5.0, "wobble_sd_rad": 0.2},
        "two_position": {
            **{"diffusion_rad2_s": 5.0, "wobble_sd_rad": 0.2, "switch_rate_per_s": 20.0}
        },
        "arc": {"diffusion_rad2_s": 50.0, "arc_rad": 1.5},
    }[motion]
    return Rotor(
        **{"number": 3, "pore": 3, "group": 0, "x_nm": 0.0, "y_nm": 0.0, "ends": ()},
        **{"motion": motion, "start_rad": 0.4, **values, **changes},
    )


def walk(made, n, *, exposure_s=T, drive=None, seed=5, delays_s=(0.0,)):
    return AngleWalk(made, Clock(n, T, exposure_s), seed, drive, delays_s)


MOTIONS = ("driven", "brownian", "switching", "tethered", "two_position", "arc")
DELAYS = ((0.0,), (0.0003, 0.0003), (0.0, 0.0012), (0.0005, 0.0017))


@pytest.mark.parametrize("motion", MOTIONS)
@given(
    cuts=st.lists(st.integers(1, 9), min_size=1, max_size=6),
    exposure_s=st.sampled_from([0.0, 0.001, T]),
    delays_s=st.sampled_from(DELAYS),
)
def test_nothing_depends_on_how_many_frames_are_asked_for_at_a_time(
    motion, cuts, exposure_s, delays_s
):
    drive = Drive((0.0, 0.0071), (1.0, -0.5))
    kwargs = {"exposure_s": exposure_s, "drive": drive, "delays_s": delays_s}
    whole = walk(rotor(motion), sum(cuts), **kwargs).advance(sum(cuts))
    piecewise = walk(rotor(motion), sum(cuts), **kwargs)
    pieces = [piecewise.advance(n) for n in cuts]
    for end, all_at_once in enumerate(whole):
        np.testing.assert_array_equal(np.concatenate([one[end] for one in pieces]), all_at_once)


def test_what_is_stuck_draws_nothing_and_stays():
    still = walk(rotor("stuck"), 5)
    assert [angle.tolist() for angle in still.advance(5)] == [[[0.4]]]
    assert still.realised_rad_s() == 0.0


@pytest.mark.parametrize("exposure_s", [0.0, 0.0005, T])
def test_increments_of_exposure_means_have_the_variance_of_theory(exposure_s):
    d, n = 5.0, 100_000
    angles = walk(rotor("brownian"), n, exposure_s=exposure_s).advance(n)[0].mean(axis=1)
    steps = np.diff(angles)
    blur = exposure_s / (6.0 * T)
    expected = 2.0 * d * T * (1.0 - 2.0 * blur)
    assert np.var(steps) == pytest.approx(expected, rel=5.0 * math.sqrt(2.0 / n))
    together = np.mean(steps[1:] * steps[:-1])
    assert together == pytest.approx(2.0 * d * T * blur, abs=5.0 * expected / math.sqrt(n))


def test_the_mean_speed_is_omega_within_what_diffusion_allows():
    n = 20_000
    made = rotor()
    moving = walk(made, n)
    moving.advance(n)
    sd = math.sqrt(2.0 * made.diffusion_rad2_s / (n * T))
    assert abs(moving.realised_rad_s() - made.omega_rad_s) < 4.0 * sd


def test_a_voltage_step_within_a_part_is_integrated_exactly():
    drive = Drive((0.0, 0.00313, 0.00341), (1.0, 3.0, -2.0))
    made = rotor(diffusion_rad2_s=0.0, omega_rad_s=20.0)
    moving = walk(made, 5, drive=drive)
    angles = moving.advance(5)[0]

    def factor(t):
        return 1.0 if t < 0.00313 else 3.0 if t < 0.00341 else -2.0

    def turned(t):
        return integrate.quad(factor, 0.0, t, points=[0.00313, 0.00341], epsabs=1e-13)[0]

    part_s = T / moving.parts
    for frame in range(5):
        for part in range(moving.parts):
            begin = frame * T + part * part_s
            kinks = [k for k in (0.00313, 0.00341) if begin < k < begin + part_s]
            area = integrate.quad(turned, begin, begin + part_s, points=kinks or None)[0]
            expected = 0.4 + 20.0 * area / part_s
            assert angles[frame, part] == pytest.approx(expected, abs=1e-8)


def test_speeds_follow_the_voltage():
    options = VoltageOptions(times_s=(0.0, 1.0), voltages_mv=(50.0, 100.0), reference_mv=100.0)
    angles = (
        walk(rotor(diffusion_rad2_s=0.0), 1000, drive=Drive.from_options(options))
        .advance(1000)[0]
        .mean(axis=1)
    )
    assert (angles[400] - angles[0]) / (400 * T) == pytest.approx(15.0)
    assert (angles[900] - angles[600]) / (300 * T) == pytest.approx(30.0)


def test_a_switching_rotor_turns_at_plus_or_minus_its_speed_from_flip_to_flip():
    n = 400
    drive = Drive((0.0, 0.3), (1.0, 0.5))
    moving = walk(rotor("switching", diffusion_rad2_s=0.0), n, drive=drive)
    angles = moving.advance(n)[0]
    flips = list(Flips(20.0, stream(5, Effect.EVENTS, 3)).until(n * T))
    assert len(flips) > 5
    kinks = np.unique([0.0, 0.3, *flips, n * T])
    middles = 0.5 * (kinks[1:] + kinks[:-1])
    signs = (-1.0) ** np.searchsorted(flips, middles)
    speeds = 30.0 * signs * np.where(middles < 0.3, 1.0, 0.5)
    # Angles are straight between kinks, so that trapezia between all edges are exact.
    edges = np.linspace(0.0, n * T, n * moving.parts + 1)
    times = np.union1d(edges, kinks)
    turned = np.interp(times, kinks, np.concatenate([[0.0], np.cumsum(speeds * np.diff(kinks))]))
    area = np.concatenate([[0.0], np.cumsum(0.5 * (turned[1:] + turned[:-1]) * np.diff(times))])
    means = np.diff(np.interp(edges, times, area)) / np.diff(edges)
    np.testing.assert_allclose(angles.ravel(), 0.4 + means, atol=1e-9)


def test_flips_come_at_their_rate():
    count = sum(1 for _ in Flips(20.0, stream(1, Effect.EVENTS, 0)).until(500.0))
    assert count == pytest.approx(10_000, abs=5.0 * 100.0)


def test_the_fastest_voltage_decides_into_how_many_parts_an_exposure_is_cut():
    made = rotor(diffusion_rad2_s=0.0)
    fast = Drive((0.0, 1.0, 2.0), (1.0, -50.0, 2.0))
    assert walk(made, 5).parts == math.ceil(30.0 * T / 0.03)
    assert walk(made, 5, drive=fast).parts == math.ceil(50.0 * 30.0 * T / 0.03)


@pytest.mark.parametrize(("omega", "diffusion"), [(40.0, 0.0), (0.0, 1.0), (50.0, 30.0)])
def test_mean_positions_of_exposures_are_as_far_inside_the_circle_as_theory_says(omega, diffusion):
    made = rotor(omega_rad_s=omega, diffusion_rad2_s=diffusion)
    moved = walk(made, 20_000)
    angles = moved.advance(20_000)[0]
    mean = moved.inward * np.exp(1j * angles).mean(axis=1)
    # E|mean|^2 is the double integral of exp(i w (s - t) - D |s - t|) over the exposure.
    rate = complex(diffusion, omega) * T
    square = (2.0 / rate - 2.0 * (1.0 - cmath.exp(-rate)) / rate**2).real
    assert np.mean(np.abs(mean) ** 2) == pytest.approx(square, abs=3e-5 + 4e-3 * (1.0 - square))


@pytest.mark.parametrize("motion", ["brownian", "tethered", "two_position"])
def test_the_path_is_the_same_with_and_without_blur(motion):
    n = 20_000
    made = rotor(motion, **({"switch_rate_per_s": 1e-9} if motion == "two_position" else {}))
    instants = walk(made, n + 1, exposure_s=0.0).advance(n + 1)[0][:, 0]
    blurred = walk(made, n).advance(n)[0].mean(axis=1)
    off = blurred - 0.5 * (instants[1:] + instants[:-1])
    # A bridge's mean is left: another path would differ by twelve times as much and more.
    bridge = 2.0 * made.diffusion_rad2_s * T / 12.0
    assert off.var() == pytest.approx(bridge, rel=0.1)


@pytest.mark.parametrize("change", ["voltage", "shutter"])
def test_the_path_is_the_same_with_and_without_other_effects(change):
    n = 4000
    made = rotor(diffusion_rad2_s=30.0, omega_rad_s=2.0)
    plain = walk(made, n).advance(n)[0].mean(axis=1)
    if change == "voltage":
        other = walk(made, n, drive=Drive((0.0,), (100.0,))).advance(n)[0].mean(axis=1)
        other -= 99.0 * 2.0 * T * (np.arange(n) + 0.5)
    else:
        other = walk(made, n, delays_s=(0.0, 0.0011)).advance(n)[0].mean(axis=1)
    bridge = 2.0 * made.diffusion_rad2_s * T / 12.0
    assert np.var(other - plain) < 2.2 * bridge
    assert abs(np.mean(other - plain)) < 5.0 * math.sqrt(2.0 * bridge / n)


@pytest.mark.parametrize("ratio", [1e-6, 0.009, 0.011, 0.5, 7.0])
def test_the_law_of_a_wobble_is_that_of_its_integral(ratio):
    c0, c1, c2, c3, c4 = ornstein_uhlenbeck(np.array([ratio]), 1.0)[0]

    # Covariances of an Ornstein-Uhlenbeck process that starts at 0, relaxation time 1.
    def cov(s, t):
        return math.exp(-abs(s - t)) - math.exp(-(s + t))

    var_mean = integrate.dblquad(lambda s, t: 2.0 * cov(s, t), 0, ratio, 0, lambda t: t)[0]
    with_end = integrate.quad(lambda s: cov(s, ratio), 0, ratio)[0]
    assert c0 == pytest.approx(-math.expm1(-ratio) / ratio, rel=1e-12)
    assert c1**2 == pytest.approx(var_mean / ratio**2, rel=1e-7)
    assert c2 == pytest.approx(math.exp(-ratio), rel=1e-12)
    assert c3 * c1 == pytest.approx(with_end / ratio, rel=1e-7)
    assert c3**2 + c4**2 == pytest.approx(-math.expm1(-2.0 * ratio), rel=1e-12)


def test_a_tethered_rotor_keeps_its_spread_and_forgets():
    n = 60_000
    made = rotor("tethered")
    angles = walk(made, n, exposure_s=0.0).advance(n)[0][:, 0] - 0.4
    relaxation_s = 0.2**2 / 5.0
    independent = n * T / (2.0 * relaxation_s)
    assert angles.std() == pytest.approx(0.2, rel=5.0 / math.sqrt(2.0 * independent))
    correlation = np.mean(angles[4:] * angles[:-4]) / angles.var()
    assert correlation == pytest.approx(math.exp(-4 * T / relaxation_s), abs=5 / independent**0.5)


def test_an_arc_is_filled_evenly_and_never_left():
    n = 50_000
    angles = walk(rotor("arc"), n, exposure_s=0.0).advance(n)[0][:, 0] - 0.4
    assert np.abs(angles).max() <= 0.75
    # The slowest mode of a reflecting box decays with D (pi / arc)^2.
    independent = n * T * 50.0 * (math.pi / 1.5) ** 2 / 2.0
    assert angles.var() == pytest.approx(1.5**2 / 12.0, rel=5.0 / math.sqrt(independent))


@pytest.mark.parametrize("arc_rad", [0.1, 0.5, 2.0])
def test_means_over_exposures_between_walls_have_the_law_of_theory(arc_rad):
    n, d = 40_000, 2.5
    moving = walk(rotor("arc", arc_rad=arc_rad, diffusion_rad2_s=d), n)
    assert moving.parts == 1
    angles = moving.advance(n)[0][:, 0] - 0.4
    # The box's modes: covariance 8 arc^2 / (m pi)^4 exp(-D (m pi / arc)^2 t), m odd.
    m = np.arange(1, 2000, 2)
    weight, x = 8.0 * arc_rad**2 / (m * np.pi) ** 4, d * T * (m * np.pi / arc_rad) ** 2
    variance = np.sum(weight * 2.0 * (x - 1.0 + np.exp(-x)) / x**2)
    with_next = np.sum(weight * (np.expm1(-x) / x) ** 2)
    steps = np.diff(angles).var()
    assert steps == pytest.approx(2.0 * (variance - with_next), rel=0.01 + 4.0 * math.sqrt(2.0 / n))
    independent = n * math.tanh(x[0] / 2.0)
    spread = 4.0 * math.sqrt(0.8 / independent)
    assert angles.var() == pytest.approx(variance, rel=0.01 + spread)


def test_a_two_position_rotor_stands_in_opposite_poses():
    n = 20_000
    angles = walk(rotor("two_position", wobble_sd_rad=0.05), n, exposure_s=0.0).advance(n)[0]
    away = (angles[:, 0] - 0.4 + math.pi / 2) % (2 * math.pi) - math.pi / 2
    poses = np.round(away / math.pi)
    assert set(poses.tolist()) == {0.0, 1.0}
    assert np.abs(away - math.pi * poses).max() < 0.3
    switches = np.count_nonzero(np.diff(poses))
    assert switches == pytest.approx(20.0 * n * T, abs=5.0 * math.sqrt(20.0 * n * T))


def test_two_ends_under_a_rolling_shutter_see_the_same_path_later():
    n = 4000
    both = walk(rotor("brownian"), n, delays_s=(0.0, 0.0012)).advance(n)
    steps = both[1].mean(axis=1) - both[0].mean(axis=1)
    # Means over two windows of length T, one r T later: variance 2 D T (r^2 - r^3 / 3).
    r = 0.0012 / T
    expected = 2.0 * 5.0 * T * (r**2 - r**3 / 3.0)
    assert np.var(steps) == pytest.approx(expected, rel=5.0 * math.sqrt(2.0 / n))
    even = walk(rotor(diffusion_rad2_s=0.0), 9, delays_s=(0.0002, 0.0014)).advance(9)
    np.testing.assert_allclose(even[1].mean(axis=1) - even[0].mean(axis=1), 30.0 * 0.0012)


def test_ends_that_are_exposed_together_share_their_angles():
    first, second = walk(rotor(), 5, delays_s=(0.0004, 0.0004)).advance(5)
    assert first is second


def test_a_blur_is_refused():
    with pytest.raises(ConfigurationError, match="is a blur"):
        walk(rotor(omega_rad_s=1e6), 5)
