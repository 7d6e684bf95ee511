import numpy as np
import pytest

from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.options import RodOptions, StartOptions, SteppingOptions
from rotortrack.simulate.rod.parameters import rod_parameters
from rotortrack.simulate.rod.placement import place_rod
from rotortrack.simulate.rod.run import run_rod
from rotortrack.simulate.rod.watch import (
    LOST,
    SETTLED,
    THROUGH,
    UNDECIDED,
    new_watch,
    watch_rod,
)

from .steps import arc, at, straight, toy_field, uniform_field

ROD = rod_parameters(RodOptions(), uniform_field())


def looks(shape_at, rate=0.02, windows=40, rod=ROD):
    """What the watch says of a shape that deforms in its rotating frame, look by look."""
    watch = new_watch(shape_at(0.0))
    for k in range(1, windows + 1):
        t = 10.0 * k
        angle = rate * t
        matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        x = shape_at(t).copy()
        x[:, :2] = x[:, :2] @ matrix.T
        said = watch_rod(t, x, angle, rod, watch)
        if said != UNDECIDED:
            return said, t
    return UNDECIDED, t


def deforming(amplitude_nm, rate):
    bump = np.outer(np.sin(np.linspace(0.0, 9.0, 51)), [0.3, -0.5, 0.8])
    return lambda t: at(arc(), 0.0, 0.0, 12.0) + amplitude_nm * np.exp(rate * t) * bump


def test_rod_that_rotates_rigidly_has_settled_after_two_looks():
    assert looks(deforming(0.0, 0.0)) == (SETTLED, 20.0)


@pytest.mark.parametrize("rate", [-0.1, -0.02, -0.005])
def test_rod_settles_when_little_of_its_way_is_left(rate):
    said, t = looks(deforming(5.0, rate), windows=400)
    assert said == SETTLED
    assert 5.0 * np.exp(rate * t) < 0.012


def test_rod_on_its_way_out_of_an_unstable_state_is_let_go_on():
    assert looks(deforming(1e-3, 0.01))[0] == UNDECIDED


def test_rod_that_keeps_flapping_never_settles():
    def flapping(t):
        return at(arc(), 0.0, 0.0, 12.0 + 0.1 * np.sin(0.3 * t))

    assert looks(flapping)[0] == UNDECIDED


def test_rod_beyond_the_trans_face_is_through_at_once():
    watch = new_watch(straight())
    below = straight() - [0.0, 0.0, 10.1]
    assert watch_rod(0.1, below, 0.0, ROD, watch) == THROUGH
    assert watch_rod(0.1, straight() - [0.0, 0.0, 9.9], 0.0, ROD, watch) == UNDECIDED


def test_rod_far_off_and_receding_is_lost_but_not_one_that_comes():
    assert looks(lambda t: at(straight(), 0.0, 150.0 + t, 12.0), rate=0.0)[0] == LOST
    assert looks(lambda t: at(straight(), 0.0, 900.0 - t, 12.0), rate=0.0)[0] == UNDECIDED


def test_run_stops_where_the_rod_lies_still():
    rod = RodOptions(lambda_eff=0.1, flow_ratio=60.0)
    start = place_rod(rod, StartOptions(offset_x_nm=10.0, offset_y_nm=8.0), membrane_nm=20.0)
    # Weakly drawn, a rod bends into the pore and stays.
    weak = toy_field(strength=0.3, slip=0.5)
    stopped = run_rod(
        rod, SteppingOptions(duration_us=2e3, sample_us=5.0, stop_when_settled=True), start, weak
    )
    assert stopped.end is RodEnd.DOCKED_STILL
    assert stopped.numbers.settled
    assert stopped.simulated_us < 1500.0
    longer = run_rod(rod, SteppingOptions(duration_us=2e3, sample_us=5.0), start, weak)
    assert longer.simulated_us == 2e3
    moved = np.abs(longer.positions_nm[-1] - stopped.positions_nm[-1]).max()
    assert moved < 0.05


def test_run_that_stops_early_went_the_same_way():
    rod = RodOptions(lambda_eff=0.3, flow_ratio=50.0)
    start = place_rod(rod, StartOptions(), membrane_nm=20.0)
    stopping = SteppingOptions(duration_us=50.0, sample_us=0.1, stop_when_settled=True)
    stopped = run_rod(rod, stopping, start, toy_field())
    assert stopped.end is RodEnd.TRANSLOCATED
    assert stopped.simulated_us < 50.0
    going = SteppingOptions(duration_us=50.0, sample_us=0.1)
    longer = run_rod(rod, going, start, toy_field())
    k = len(stopped.time_us) - 1
    np.testing.assert_array_equal(longer.positions_nm[:k], stopped.positions_nm[:k])
