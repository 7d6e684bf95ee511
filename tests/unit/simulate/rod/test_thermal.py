"""Noise: laws of equilibrium and diffusion that are known exactly, and streams of random numbers.

Each estimate is compared with its exact value within four of its own standard errors, which must
themselves be small enough for the law to be told from what a wrong method gives.
"""

import numpy as np
import pytest

from rotortrack.errors import RodError
from rotortrack.simulate.rod import thermal as thermal_module
from rotortrack.simulate.rod.ends import RodEnd
from rotortrack.simulate.rod.explicit import longest_stable_step_us
from rotortrack.simulate.rod.forces import NO_NODES
from rotortrack.simulate.rod.implicit import look, new_room, new_shape
from rotortrack.simulate.rod.options import RodOptions, SteppingOptions, ThermalOptions
from rotortrack.simulate.rod.parameters import (
    BENDING_PN_NM2,
    END_WEIGHT,
    ZETA_PAR_PER_NM,
    ZETA_PERP_PER_NM,
)
from rotortrack.simulate.rod.run import RodRun, run_rod
from rotortrack.simulate.rod.thermal import (
    add_metric_force,
    add_random_force,
    new_walk,
    noise_stream,
    noisy_steps,
)

from .brownian import (
    KT,
    diffusion,
    equilibrium_rod,
    joint_cosines,
    joint_mean,
    joint_variance_ratio,
    mean_and_error,
)
from .steps import at, free_rod, straight, toy_field

SHORT = RodOptions(n_vertices=11, length_nm=90.0)
STIFF = RodOptions(n_vertices=5, length_nm=36.0, persistence_length_nm=3000.0)


def walk_of(rod, duration_us, sample_us, thermal, start=None):
    stepping = SteppingOptions(duration_us=duration_us, sample_us=sample_us)
    if start is None:
        start = equilibrium_rod(rod.n_vertices, np.random.default_rng(1))
    return run_rod(rod, stepping, start, thermal=thermal)


def brief(thermal, *, duration_us=0.02, sample_us=0.005, **stepping):
    options = SteppingOptions(duration_us=duration_us, sample_us=sample_us, **stepping)
    return run_rod(SHORT, options, straight(11, 90.0), thermal=thermal)


@pytest.fixture(scope="module")
def warm():
    """Shapes of short rods at 300 K, rigid links' own preference taken away."""
    return walk_of(SHORT, 30.0, 1e-3, ThermalOptions(seed=5, step_us=2e-4, metric_force=True))


def test_joint_angles_have_the_variance_of_the_bending_energy(warm):
    square = np.arccos(joint_cosines(warm.positions_nm)) ** 2
    mean, error = mean_and_error(square.mean(axis=1))
    exact = joint_mean(np.square)
    # 2 l / Lp to first order in l / Lp.
    assert exact == pytest.approx(2.0 * 9.0 / 1500.0, rel=0.01)
    assert error < 0.008 * exact
    assert abs(mean - exact) < 4.0 * error


def test_persistence_length_from_thermal_shapes_is_that_of_the_rod(warm):
    mean, error = mean_and_error(joint_cosines(warm.positions_nm).mean(axis=1))
    persistence_nm = -9.0 / np.log(mean)
    error_nm = persistence_nm * error / (1.0 - mean)
    assert error_nm < 0.008 * 1500.0
    exact = -9.0 / np.log(joint_mean(np.cos))
    assert abs(persistence_nm - exact) < 4.0 * error_nm
    # The chain of 9-nm links is stiffer than the rod by 0.9 %, as tan exceeds its argument.
    assert exact == pytest.approx(1513.4, abs=0.1)
    assert persistence_nm == pytest.approx(exact, rel=0.015)


def test_ends_of_a_flexible_rod_are_as_far_apart_as_kratky_and_porod_say():
    length_nm = persistence_nm = 54.0

    def worm_like(p):
        return 2.0 * p * length_nm * (1.0 - p / length_nm * (1.0 - np.exp(-length_nm / p)))

    def jointed(links):
        """Chain of links whose joints have the law of the bending energy: tends to the formula."""
        edge = length_nm / links
        c = joint_mean(np.cos, edge_nm=edge, persistence_nm=persistence_nm)
        row = (1.0 + c) / (1.0 - c) - 2.0 * c * (1.0 - c**links) / (links * (1.0 - c) ** 2)
        return links * edge**2 * row

    assert jointed(600) == pytest.approx(worm_like(persistence_nm), rel=1e-3)
    soft = RodOptions(n_vertices=7, length_nm=length_nm, persistence_length_nm=persistence_nm)
    thermal = ThermalOptions(seed=11, step_us=5e-4, metric_force=True)
    run = walk_of(soft, 100.0, 0.01, thermal, straight(7, length_nm))
    # The longest mode forgets the straight start in 0.1 us.
    ends = (run.positions_nm[:, -1] - run.positions_nm[:, 0])[100:]
    mean, error = mean_and_error(np.sum(ends**2, axis=1))
    assert error < 0.008 * mean
    assert abs(mean - jointed(6)) < 4.0 * error
    # Its six links are 6 % off the formula; half or twice the stiffness would be 23 or 16 %.
    assert mean == pytest.approx(worm_like(persistence_nm), rel=0.09)


def test_fully_implicit_step_is_too_stiff_by_the_formula_of_its_modes():
    run = walk_of(SHORT, 10.0, 1e-3, ThermalOptions(seed=6, theta=1.0, metric_force=True))
    square = np.arccos(joint_cosines(run.positions_nm)) ** 2
    mean, error = mean_and_error(square.mean(axis=1))
    exact = joint_mean(np.square)
    predicted = joint_variance_ratio(11, 1.0, 1e-4)
    assert 0.90 < predicted < 0.93
    assert joint_variance_ratio(11, 0.5, 1e-4) == 1.0
    # The formula is that of small angles and of steps that change no drag: good to 1 %.
    assert abs(mean / exact - predicted) < 4.0 * error / exact + 0.01


def test_steps_far_beyond_explicit_ones_keep_the_joints_of_fine_links():
    rod = RodOptions(n_vertices=11, length_nm=45.0)
    thermal = ThermalOptions(seed=9, metric_force=True)
    parameters = free_rod(11, length_nm=45.0)
    assert thermal.step_us > 3.8 * longest_stable_step_us(parameters)
    start = equilibrium_rod(11, np.random.default_rng(2), edge_nm=4.5)
    run = walk_of(rod, 12.0, 1e-3, thermal, start)
    square = np.arccos(joint_cosines(run.positions_nm)) ** 2
    mean, error = mean_and_error(square.mean(axis=1))
    exact = joint_mean(np.square, edge_nm=4.5)
    assert error < 0.008 * exact
    assert abs(mean / exact - 1.0) < 4.0 * error / exact
    assert abs(mean / exact - 1.0) < 0.02


def test_stiff_rod_diffuses_and_turns_by_its_friction():
    run = walk_of(STIFF, 60.0, 4e-3, ThermalOptions(seed=7, step_us=2e-4, metric_force=True))
    found = diffusion(run.positions_nm, run.time_us)
    drag = np.pi * 1e-3 * 36.0
    arms = 9.0 * np.arange(-2, 3)
    weight = np.array([0.5, 1.0, 1.0, 1.0, 0.5]) * np.pi * 1e-3 * 9.0
    exact = {
        "across": KT / drag,
        "along": 2.0 * KT / drag,
        "turning": KT / np.sum(weight * arms**2),
    }
    for name, (mean, error) in found.items():
        assert error < 0.02 * exact[name], name
        assert abs(mean - exact[name]) < 4.0 * error, name
    assert found["turning"][0] == pytest.approx(exact["turning"], rel=0.03)


def trimer_cosines(*, along, metric, steps, seed):
    """Cosines of a freely jointed trimer with heavy ends."""
    rod = free_rod(3, length_nm=18.0)
    rod[BENDING_PN_NM2] = 0.0
    rod[END_WEIGHT] = 10.0
    rod[ZETA_PAR_PER_NM] = along * rod[ZETA_PERP_PER_NM]
    walk = new_walk(np.array([[-9.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 9.0, 0.0]]))
    rng = np.random.default_rng(seed)
    cosines = np.empty(steps // 20)
    for k in range(len(cosines)):
        noise = rng.standard_normal((20, 3, 3))
        taken, _ = noisy_steps(walk, rod, *NO_NODES, noise, 2e-3, 0.5, KT, metric, False)
        assert taken == 20
        cosines[k] = (walk.x[2] - walk.x[1]) @ (walk.x[1] - walk.x[0]) / 81.0
    return cosines


@pytest.mark.parametrize(
    ("along", "metric"), [(1.0, False), (1.0, True), (0.5, True)], ids=["rigid", "metric", "both"]
)
def test_freely_jointed_trimer_has_the_angles_of_its_links(along, metric):
    cosines = trimer_cosines(along=along, metric=metric, steps=160_000, seed=3)
    mean, error = mean_and_error(cosines**2)
    c = np.linspace(-1.0, 1.0, 20_001)
    # Rigid links: det of the links' matrix, 1/10 + 1 on its diagonal and -cos beside it.
    weight = np.ones_like(c) if metric else np.sqrt(1.1**2 - c**2)
    exact = np.sum(weight * c**2) / np.sum(weight)
    assert error < 0.013
    assert abs(mean - exact) < 4.0 * error
    # The other law is more than four errors away.
    other = 1.0 / 3.0 if not metric else 0.27
    assert abs(exact - other) > 4.0 * error


def test_metric_force_is_the_gradient_of_the_links_matrix(gradient):
    rng = np.random.default_rng(2)
    x = equilibrium_rod(7, rng, persistence_nm=9.0)
    rod = free_rod(7, length_nm=54.0)
    rod[ZETA_PAR_PER_NM] = rod[ZETA_PERP_PER_NM]
    shape = new_shape(7)
    look(x, rod, *NO_NODES, shape)
    shape.force[:] = 0.0
    add_metric_force(x, rod, shape, new_room(7), KT)

    def half_logarithm(y, _):
        links = np.diff(y, axis=0)
        units = links / np.linalg.norm(links, axis=1, keepdims=True)
        jacobian = np.zeros((6, 7, 3))
        for a, u in enumerate(units):
            jacobian[a, a], jacobian[a, a + 1] = -u, u
        matrix = np.einsum("aic,i,bic->ab", jacobian, 1.0 / shape.drag[:, 0], jacobian)
        return 0.5 * KT * np.linalg.slogdet(matrix)[1]

    np.testing.assert_allclose(shape.force, gradient(half_logarithm, x, rod), atol=1e-7)
    np.testing.assert_allclose(shape.force.sum(axis=0), 0.0, atol=1e-12)


def test_random_force_has_the_covariance_of_the_friction():
    x = straight(3, 18.0, (1.0, 2.0, -1.0))
    shape = new_shape(3)
    look(x, free_rod(3, length_nm=18.0), *NO_NODES, shape)
    forces = []
    for normal in np.eye(9):
        shape.force[:] = 0.0
        add_random_force(shape, normal.reshape(3, 3), 7.0)
        forces.append(shape.force.ravel().copy())
    covariance = np.transpose(forces) @ np.array(forces)
    exact = np.zeros((9, 9))
    for i in range(3):
        t, (across, along) = shape.tangent[i], shape.drag[i]
        block = across * np.eye(3) + (along - across) * np.outer(t, t)
        exact[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = 7.0 * block
    np.testing.assert_allclose(covariance, exact, atol=1e-12)


def test_links_keep_their_length_under_noise(warm):
    lengths = np.linalg.norm(np.diff(warm.positions_nm, axis=1), axis=2)
    np.testing.assert_allclose(lengths, 9.0, rtol=2e-9)
    assert warm.n_steps == 150_000
    assert warm.end is not RodEnd.STEP_LIMIT


def test_run_without_noise_draws_no_random_number(monkeypatch):
    def draw(*_, **__):
        raise AssertionError("a random number was drawn")

    monkeypatch.setattr(np.random, "default_rng", draw)
    monkeypatch.setattr(np.random, "SeedSequence", draw)
    brief(None)
    with pytest.raises(AssertionError, match="drawn"):
        brief(ThermalOptions())


def test_noise_depends_on_its_seed_alone(monkeypatch):
    first = brief(ThermalOptions(seed=4))
    monkeypatch.setattr(thermal_module, "_BLOCK_NUMBERS", 33 * 7)
    again = brief(ThermalOptions(seed=4))
    seldom = brief(ThermalOptions(seed=4), sample_us=0.01)
    other = brief(ThermalOptions(seed=5))
    assert np.array_equal(first.positions_nm, again.positions_nm)
    assert np.array_equal(first.turned_rad, again.turned_rad)
    assert np.array_equal(first.positions_nm[::2], seldom.positions_nm)
    assert np.abs(first.positions_nm[-1] - other.positions_nm[-1]).max() > 0.1


def test_noise_is_not_the_stream_of_a_start_with_the_same_seed():
    ours = noise_stream(ThermalOptions(seed=9)).standard_normal(4)
    assert not np.array_equal(ours, np.random.default_rng(9).standard_normal(4))
    assert np.array_equal(ours, noise_stream(ThermalOptions(seed=9)).standard_normal(4))


def test_samples_fall_on_whole_steps_and_the_last_on_the_end():
    run = brief(ThermalOptions(step_us=1.5e-4), duration_us=0.012, sample_us=0.005)
    np.testing.assert_allclose(run.time_us, [0.0, 0.005, 0.01, 0.012], rtol=1e-12)
    assert run.n_steps == 34 + 34 + 14


def test_step_limit_ends_a_noisy_run_and_says_so():
    run = brief(ThermalOptions(), max_steps=70)
    assert run.end is RodEnd.STEP_LIMIT
    assert run.n_steps == 70
    np.testing.assert_allclose(run.time_us, [0.0, 0.005, 0.007], rtol=1e-12)


def test_noise_is_kept_in_the_archive(tmp_path):
    run = brief(ThermalOptions(seed=8, temperature_k=310.0))
    run.save(tmp_path / "run.npz")
    assert RodRun.load(tmp_path / "run.npz").thermal == run.thermal
    brief(None).save(tmp_path / "still.npz")
    assert RodRun.load(tmp_path / "still.npz").thermal is None


def test_step_beyond_the_links_is_refused_with_the_longest_that_is_not():
    with pytest.raises(RodError, match=r"step_us 0\.01 .* give at most 0\.0014"):
        brief(ThermalOptions(step_us=0.01))


def test_rod_that_folds_under_noise_is_an_error_naming_the_step():
    soft = RodOptions(n_vertices=11, length_nm=90.0, persistence_length_nm=0.5)
    with pytest.raises(RodError, match=r"step \d+ at .* a joint folds"):
        walk_of(soft, 5.0, 0.1, ThermalOptions(), straight(11, 90.0))


def test_cold_noise_leaves_the_motion_without_noise():
    start = equilibrium_rod(11, np.random.default_rng(3))
    still = walk_of(SHORT, 0.05, 0.01, None, start)
    cold = walk_of(SHORT, 0.05, 0.01, ThermalOptions(temperature_k=1e-12), start)
    np.testing.assert_allclose(cold.positions_nm, still.positions_nm, atol=0.02)


def test_noise_joins_field_and_wall_and_stops_behind_the_membrane():
    rod = RodOptions(n_vertices=6, length_nm=45.0, lambda_eff=1.0, flow_ratio=0.0)
    stepping = SteppingOptions(duration_us=400.0, sample_us=0.5, stop_when_settled=True)
    start = at(straight(6, 45.0, (0.3, 0.0, 1.0)), 0.0, 0.0, 35.0)
    run = run_rod(rod, stepping, start, toy_field(), ThermalOptions(seed=2, step_us=2e-4))
    assert run.end is RodEnd.TRANSLOCATED
    assert run.simulated_us < 400.0
    assert np.sum(run.positions_nm[-1, :, 2] < -10.0) > 3
    assert run.about_field is not None


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_force_that_is_not_finite_is_an_error_naming_the_step(bad):
    field = toy_field()
    field.nodes[:] = bad
    stepping = SteppingOptions(duration_us=0.01, sample_us=0.005)
    start = at(straight(6, 45.0), 0.0, 0.0, 35.0)
    with pytest.raises(RodError, match=r"step 1 at 0 us: a vertex or a force is not finite"):
        run_rod(RodOptions(n_vertices=6, length_nm=45.0), stepping, start, field, ThermalOptions())
