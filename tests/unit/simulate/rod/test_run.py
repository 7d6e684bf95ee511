import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import simpson

from rotortrack.errors import RodError
from rotortrack.simulate.field.embedded import embedded_table
from rotortrack.simulate.rod.balance import force_balance
from rotortrack.simulate.rod.contact import contact_energy
from rotortrack.simulate.rod.elasticity import bending_energy
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.parameters import rod_parameters
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import RodRun, run_rod

from .steps import arc, straight, toy_field, uniform_field

ACROSS = np.pi * 1e-3
FREELY = RodOptions(wall="none", flow_ratio=0.0)


def velocity(direction, n=51, field=None, rod=FREELY):
    rod = dataclasses.replace(rod, n_vertices=n)
    run = run_rod(
        rod,
        SteppingOptions(duration_us=4.0, sample_us=1.0),
        straight(n, direction=direction),
        field or uniform_field(e_z_v_m=2e3),
    )
    moved = np.diff(run.positions_nm, axis=0)
    # A straight rod in a uniform field does nothing but drift.
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0, 0], moved.shape), atol=1e-8)
    return moved[0, 0]


PULL = 0.26 * 12 * 1.602176634e-19 / 0.34e-9 * 1e3 * 2e3
"""Force per length of the default rod at 2 kV/m, pN/nm."""


@pytest.mark.parametrize("n", [3, 26, 51])
def test_straight_rod_sediments_at_force_over_friction(n):
    np.testing.assert_allclose(velocity((1, 0, 0), n), [0, 0, -PULL / ACROSS], atol=1e-9)
    np.testing.assert_allclose(velocity((0, 0, 1), n), [0, 0, -2.0 * PULL / ACROSS], atol=1e-9)


@pytest.mark.parametrize("tilt_deg", [10.0, 30.0, 60.0])
def test_tilted_rod_drifts_aside(tilt_deg):
    tilt = math.radians(tilt_deg)
    along = np.array([math.cos(tilt), 0.0, math.sin(tilt)])
    pull = np.array([0.0, 0.0, -PULL])
    exact = pull / ACROSS + (2.0 - 1.0) / ACROSS * (along @ pull) * along
    np.testing.assert_allclose(velocity(along), exact, atol=1e-9)


def test_rod_goes_with_a_uniform_flow():
    """At flow factor 1 the rod is carried along, whichever way it points."""
    rod = RodOptions(wall="none", lambda_eff=0.5, flow_ratio=2.0)
    field = uniform_field(u_z_nm_us=3.0)
    for direction in ((1, 0, 0), (1, 2, 3)):
        np.testing.assert_allclose(velocity(direction, field=field, rod=rod), [0, 0, 3], atol=1e-9)


def dock(duration_us=20.0, field=None, rod=None, **start):
    rod = rod or RodOptions()
    options = StartOptions(**{"offset_x_nm": 40.0, "offset_y_nm": 8.0, **start})
    stepping = SteppingOptions(duration_us=duration_us, sample_us=1.0)
    return run_rod(rod, stepping, place_rod(rod, options, membrane_nm=20.0), field or toy_field())


@pytest.fixture(scope="module")
def docked():
    return dock()


def test_mirrored_start_turns_the_other_way(docked):
    mirrored = dock(mirrored=True)
    assert abs(docked.turned_rad[-1]) > 0.01
    np.testing.assert_allclose(mirrored.turned_rad, -docked.turned_rad, atol=1e-10)
    np.testing.assert_allclose(
        mirrored.positions_nm * [1.0, -1.0, 1.0], docked.positions_nm, atol=1e-7
    )


def test_start_turned_about_the_pore_gives_the_same_run_turned(docked):
    angle = math.radians(77.0)
    turned = dock(azimuth_deg=77.0)
    np.testing.assert_allclose(turned.turned_rad, docked.turned_rad, atol=1e-6)
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(turned.positions_nm, docked.positions_nm @ matrix, atol=1e-4)


def test_voltage_and_time_scale_together_without_bending_and_wall():
    """Twice the field in half the time: the same way."""
    soft = RodOptions(persistence_length_nm=1e-9, wall="none", n_vertices=11)
    runs = [
        run_rod(
            soft,
            SteppingOptions(duration_us=4.0 / factor, sample_us=1.0 / factor, tolerance_nm=1e-5),
            place_rod(soft, StartOptions(offset_x_nm=40.0, offset_y_nm=8.0), membrane_nm=20.0),
            toy_field(strength=0.1 * factor),
        )
        for factor in (1.0, 2.0)
    ]
    moved = np.abs(runs[0].positions_nm[-1] - runs[0].positions_nm[0]).max()
    assert moved > 5.0
    np.testing.assert_allclose(runs[0].positions_nm, runs[1].positions_nm, atol=1e-3)


@pytest.mark.parametrize(
    ("flow_ratio", "duration_us", "sample_us", "pushed"),
    [(130.0, 4.0, 0.02, False), (20.0, 0.3, 2e-4, True)],
    ids=["docked", "pressed"],
)
def test_power_of_the_field_is_stored_or_taken_by_the_drag(
    docked, flow_ratio, duration_us, sample_us, pushed
):
    """Samples are as dense as the power changes, which it does within 1 ns where the rod hits."""
    rod, field = RodOptions(flow_ratio=flow_ratio), toy_field()
    start = docked.positions_nm[0 if pushed else -1]
    stepping = SteppingOptions(duration_us=duration_us, sample_us=sample_us, tolerance_nm=1e-5)
    run = run_rod(rod, stepping, start, field)
    parameters = rod_parameters(rod, field)
    bent = np.array([bending_energy(x, parameters) for x in run.positions_nm])
    pressed = np.array([contact_energy(x, parameters) for x in run.positions_nm])
    balances = [force_balance(x, rod, field) for x in run.positions_nm]
    given = [np.sum(balance.driving * balance.velocity_nm_us) for balance in balances]
    taken = [balance.power_pn_nm_us("net") for balance in balances]
    work, heat = (simpson(power, x=run.time_us) for power in (given, taken))
    assert work > 20.0
    assert pressed[-1] > 20.0 if pushed else not pressed.any()
    stored = (bent + pressed)[-1] - (bent + pressed)[0]
    assert stored == pytest.approx(work - heat, abs=2e-5 * work)


def test_angle_counts_full_turns_of_a_rigid_rotation():
    """A rod that lies still in a field that only turns would turn for ever; here the count of a
    known rotation is checked, sample by sample."""
    from rotortrack.simulate.rod.watch import turn_between

    x = arc()
    drag = np.ones((51, 2))
    for angle in (-3.1, -0.2, 1e-6, 1.5, 3.1):
        matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        y = x.copy()
        y[:, :2] = x[:, :2] @ matrix.T
        np.testing.assert_allclose(turn_between(x, y, drag), angle, rtol=1e-9)


def test_run_comes_back_from_its_file(docked, tmp_path):
    docked.save(tmp_path / "rod.npz")
    loaded = RodRun.load(tmp_path / "rod.npz")
    for name in ("time_us", "positions_nm", "turned_rad"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(docked, name))
    for name in ("end", "numbers", "n_steps", "n_rejected", "rod", "stepping", "seconds"):
        assert getattr(loaded, name) == getattr(docked, name)
    assert loaded.about_field["voltage_v"] == 0.1


def test_samples_are_at_their_times_and_the_last_is_the_end():
    run = run_rod(RodOptions(), SteppingOptions(duration_us=1.05, sample_us=0.2), arc())
    np.testing.assert_allclose(run.time_us, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.05], rtol=1e-12)
    whole = run_rod(RodOptions(), SteppingOptions(duration_us=1.0, sample_us=0.2), arc())
    np.testing.assert_allclose(whole.time_us, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0], rtol=1e-12)
    assert whole.simulated_us == 1.0


def test_samples_do_not_change_the_steps():
    coarse = run_rod(RodOptions(), SteppingOptions(duration_us=5.0, sample_us=5.0), arc())
    fine = run_rod(RodOptions(), SteppingOptions(duration_us=5.0, sample_us=0.01), arc())
    assert coarse.n_steps == fine.n_steps
    np.testing.assert_array_equal(coarse.positions_nm[-1], fine.positions_nm[-1])


@pytest.mark.parametrize(
    ("start", "stepping", "words"),
    [
        (straight(50), {}, "n_vertices"),
        (1.01 * straight(), {}, "length_nm"),
        (straight() * np.nan, {}, "finite"),
        (straight(), {"sample_us": 1e-6, "duration_us": 1e4}, "sample_us"),
    ],
)
def test_starts_that_cannot_be_run_are_refused(start, stepping, words):
    with pytest.raises(RodError, match=words):
        run_rod(RodOptions(), SteppingOptions(**stepping), start)


def test_run_without_a_field_ends_with_its_time():
    run = run_rod(RodOptions(), SteppingOptions(duration_us=1.0), arc())
    assert run.end is RodEnd.TIME_REACHED
    assert math.isnan(run.numbers.nearest_nm)


@pytest.fixture(scope="module")
def rotor():
    """The paper's rod on the paper's pore."""
    rod = RodOptions(lambda_eff=0.26, flow_ratio=130.0)
    field = embedded_table()

    def run(duration_us=250.0, start=None, mirrored=False, azimuth_deg=0.0, **stepping):
        if start is None:
            options = StartOptions(
                offset_x_nm=90.0, offset_y_nm=15.0, mirrored=mirrored, azimuth_deg=azimuth_deg
            )
            start = place_rod(rod, options, membrane_nm=field.membrane_nm)
        return run_rod(rod, SteppingOptions(duration_us=duration_us, **stepping), start, field)

    return run


def test_rod_on_the_papers_pore_rotates_steadily_at_any_tolerance(rotor):
    """In the turning frame the steady state is a fixed point of the step itself."""
    rates = [rotor(tolerance_nm=tolerance).numbers.rate_rev_s for tolerance in (2e-3, 1e-2)]
    np.testing.assert_allclose(np.abs(rates), 6200.0, rtol=0.02)
    np.testing.assert_allclose(rates[0], rates[1], rtol=1e-6)


def test_steady_rate_is_that_of_explicit_euler(rotor):
    steady = rotor()
    assert steady.end is RodEnd.ROTATING_STEADILY
    checked = rotor(2.0, start=steady.positions_nm[-1], method="explicit", step_us=2e-4)
    rate = checked.turned_rad[-1] / 2.0
    np.testing.assert_allclose(rate, steady.numbers.rate_rad_us, rtol=1e-5)


def test_settled_run_stops_early_with_the_same_rate(rotor):
    steady = rotor()
    stopped = rotor(stop_when_settled=True)
    assert stopped.end is RodEnd.ROTATING_STEADILY
    assert stopped.numbers.settled
    assert stopped.simulated_us < 200.0
    np.testing.assert_allclose(stopped.numbers.rate_rad_us, steady.numbers.rate_rad_us, rtol=1e-4)


def test_mirrored_and_turned_starts_give_the_rate_to_1e_4(rotor):
    rate = rotor().numbers.rate_rad_us
    np.testing.assert_allclose(rotor(mirrored=True).numbers.rate_rad_us, -rate, rtol=1e-6)
    np.testing.assert_allclose(rotor(azimuth_deg=123.0).numbers.rate_rad_us, rate, rtol=1e-6)
