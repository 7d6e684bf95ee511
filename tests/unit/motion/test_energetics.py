from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.motion.energetics import BOLTZMANN_PN_NM_K, energetics
from rotortrack.motion.estimate import estimate_motion
from rotortrack.motion.likelihood import NO_FIT, Fit
from rotortrack.motion.readings import Circle

from .planted import FRAME_S, filmed, free


def estimated(omega, omega_sd, d, relative_sd):
    """Build estimates as far from normal as those of a likelihood."""
    spread = np.exp(1.96 * relative_sd)
    return Fit(
        omega_rad_s=omega,
        omega_sd_rad_s=omega_sd,
        omega_interval_rad_s=(omega - 1.96 * omega_sd, omega + 1.96 * omega_sd),
        drift_p=0.5,
        diffusion_rad2_s=d,
        diffusion_sd_rad2_s=relative_sd * d,
        diffusion_interval_rad2_s=(d / spread, d * spread),
        diffusion_relative_sd=relative_sd,
        noise_factor=1.0,
    )


def test_the_published_rotor_has_its_published_torque_power_and_friction():
    # Fig. S4: steps of -3.6 +- 30.1 degrees at 500 frames/s.
    omega = -np.deg2rad(3.6) * 500
    diffusion = np.deg2rad(30.1) ** 2 * 500 / 2
    found = energetics(estimated(omega, 1.9, diffusion, 0.02))
    assert found.torque_pn_nm == pytest.approx(-1.9, abs=0.05)
    assert found.power_pn_nm_s == pytest.approx(58.0, abs=1.5)
    assert found.friction_pn_nm_s == pytest.approx(0.06, abs=0.001)
    assert pytest.approx(4.1419, abs=1e-4) == BOLTZMANN_PN_NM_K * 300


@given(
    omega=st.floats(-100, 100),
    sd=st.floats(0.01, 10),
    d=st.floats(0.1, 100),
    relative=st.floats(0.01, 0.149),
)
def test_intervals_hold_the_estimates_and_mirror_with_the_speed(omega, sd, d, relative):
    here, there = (energetics(estimated(sign * omega, sd, d, relative)) for sign in (1, -1))
    low, high = here.torque_interval_pn_nm
    assert low <= here.torque_pn_nm <= high
    assert there.torque_interval_pn_nm == pytest.approx((-high, -low), rel=1e-4, abs=1e-6)
    low, high = here.power_interval_pn_nm_s
    assert 0.0 <= low <= here.power_pn_nm_s * (1 + 1e-6) <= high * (1 + 1e-5)
    assert here.friction_interval_pn_nm_s[0] < here.friction_pn_nm_s
    assert here.row()["friction_ci_high_pn_nm_s"] > here.friction_pn_nm_s


def test_all_scale_with_temperature():
    fit = estimated(20.0, 1.0, 10.0, 0.05)
    cold, warm = energetics(fit, 280.0), energetics(fit, 308.0)
    for name, value in cold.row().items():
        assert warm.row()[name] == pytest.approx(1.1 * value)


@pytest.mark.parametrize("z", [0.0, 3.0, 30.0])
@pytest.mark.parametrize("relative", [0.02, 0.14])
def test_intervals_of_torque_and_power_cover(z, relative):
    # Speed and log-variance of a normal sample, as long tracks give them.
    rng = np.random.default_rng([int(10 * z), int(100 * relative)])
    n, true_d = 1000, 10.0
    degrees = 2 / relative**2
    omega = z
    torques, powers = [], []
    for _ in range(n):
        d = true_d * rng.chisquare(degrees) / degrees
        sd = np.sqrt(d / true_d)
        fit = estimated(omega + rng.normal(), sd, d, relative)
        # The likelihood's interval of D is that of chi-square.
        found = energetics(fit, 1.0 / BOLTZMANN_PN_NM_K)
        low, high = found.torque_interval_pn_nm
        torques.append(low <= omega / true_d <= high)
        low, high = found.power_interval_pn_nm_s
        powers.append(low <= omega**2 / true_d <= high)
    assert 0.93 <= np.mean(torques) <= 0.97
    assert 0.93 <= np.mean(powers) <= (0.97 if z > 2 else 1.0)


def test_where_d_is_hardly_known_only_limits_are_told():
    fit = replace(
        estimated(20.0, 1.0, 0.5, 0.4),
        diffusion_interval_rad2_s=(0.0, 2.0),
        diffusion_relative_sd=0.4,
    )
    found = energetics(fit, 1.0 / BOLTZMANN_PN_NM_K)
    assert found.friction_interval_pn_nm_s == (0.5, np.inf)
    assert found.torque_interval_pn_nm == pytest.approx((18.04 / 2, np.inf))
    assert found.power_interval_pn_nm_s == pytest.approx((18.04**2 / 2, np.inf))
    unsure = energetics(replace(fit, omega_interval_rad_s=(-1.0, 2.0)))
    assert unsure.torque_interval_pn_nm == (-np.inf, np.inf)
    assert unsure.power_interval_pn_nm_s == (0.0, np.inf)
    still = energetics(replace(fit, diffusion_rad2_s=0.0, diffusion_relative_sd=np.inf))
    assert still.torque_pn_nm == still.friction_pn_nm_s == np.inf


def test_nothing_is_told_of_a_rotor_that_was_not_measured():
    assert all(np.isnan(value) for value in energetics(NO_FIT).row().values())


@pytest.mark.parametrize("omega", [0.0, 60.0])
def test_intervals_cover_from_positions_to_torque(omega):
    rng = np.random.default_rng(7)
    n, diffusion, scale = 250, 10.0, 1.0 / BOLTZMANN_PN_NM_K
    held = []
    for _ in range(n):
        rotor = filmed(rng, free(rng, 10_000, diffusion, omega), 0.2, 0.1, 1.0, omega, diffusion)
        fit = estimate_motion(
            rotor.frame,
            rotor.x_nm,
            rotor.y_nm,
            rotor.sd_nm,
            rotor.sd_nm,
            Circle(0.0, 0.0, 100.0),
            frame_interval_s=FRAME_S,
            exposure_s=FRAME_S,
            method="increments",
        ).fit
        found = energetics(fit, scale)
        low, high = found.torque_interval_pn_nm
        held.append((low <= omega / diffusion <= high, found.power_interval_pn_nm_s[0]))
    covered, least_power = np.array(held).T
    # Three standard errors of 250 rotors.
    assert np.mean(covered) >= 0.91
    if omega == 0.0:
        assert np.mean(least_power == 0.0) >= 0.91
