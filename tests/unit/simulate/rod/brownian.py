"""Exact laws, equilibrium starts and errors for the tests and the benchmark of thermal noise."""

import numpy as np
from scipy.linalg import eigh

KT = 1.380649e-2 * 300.0


def equilibrium_rod(n, rng, *, edge_nm=9.0, persistence_nm=1500.0):
    """A free rod whose joints are drawn from the Boltzmann law of the bending energy."""
    joints = np.arccos(1.0 - _joint_heights(n - 2, rng, persistence_nm / edge_nm))
    azimuths = rng.uniform(0.0, 2.0 * np.pi, n - 2)
    frame = np.eye(3)
    directions = [frame[0].copy()]
    for theta, azimuth in zip(joints, azimuths, strict=True):
        across = np.cos(azimuth) * frame[1] + np.sin(azimuth) * frame[2]
        ahead = np.cos(theta) * frame[0] + np.sin(theta) * across
        side = np.cross(ahead, frame[1])
        side /= np.linalg.norm(side)
        frame = np.array([ahead, np.cross(side, ahead), side])
        directions.append(ahead)
    x = np.concatenate([np.zeros((1, 3)), edge_nm * np.cumsum(directions, axis=0)])
    return x - x.mean(axis=0)


def _joint_heights(count, rng, ratio):
    """1 - cos(theta) of the density exp(-2 ratio tan^2(theta/2)) in cos(theta), by rejection.

    With h = 1 - cos(theta), tan^2(theta/2) = h/(2 - h) >= h/2: exponential h are proposed.
    """
    heights = np.empty(0)
    while heights.size < count:
        h = rng.exponential(1.0 / ratio, 2 * count)
        h = h[h < 2.0]
        kept = rng.random(h.size) < np.exp(-2.0 * ratio * (h / (2.0 - h) - h / 2.0))
        heights = np.concatenate([heights, h[kept]])
    return heights[:count]


def joint_mean(function, *, edge_nm=9.0, persistence_nm=1500.0):
    """Exact mean of a function of a joint's angle under the discrete bending energy alone."""
    theta = np.linspace(0.0, 1.5, 200_001)
    weight = np.sin(theta) * np.exp(-2.0 * persistence_nm / edge_nm * np.tan(theta / 2.0) ** 2)
    return np.sum(weight * function(theta)) / np.sum(weight)


def joint_variance_ratio(n, theta, dt_us, *, edge_nm=9.0, persistence_nm=1500.0):
    """Joint variance of the discrete modes under a step with implicit part theta, over the exact.

    Each mode k of the free rod, K v = k Z v, has kT/k / (1 + (theta - 1/2) k dt).
    """
    second = np.zeros((n - 2, n))
    for i in range(n - 2):
        second[i, i : i + 3] = [1.0, -2.0, 1.0]
    weight = np.full(n, edge_nm * np.pi * 1e-3)
    weight[[0, -1]] /= 2.0
    stiffness = persistence_nm * KT / edge_nm**3
    rates, modes = eigh(stiffness * second.T @ second, np.diag(weight))
    bent = (second @ modes[:, 2:]) ** 2 / rates[2:]
    return (bent / (1.0 + (theta - 0.5) * rates[2:] * dt_us)).sum() / bent.sum()


def joint_cosines(positions_nm):
    """Cosines of the joints' angles, shape (k, n - 2)."""
    edges = np.diff(positions_nm, axis=1)
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    return np.einsum("kic,kic->ki", edges[:, 1:], edges[:, :-1])


def mean_and_error(values, blocks=30):
    """Mean of correlated values and its standard error, from the scatter of long blocks."""
    length = len(values) // blocks
    means = np.asarray(values)[: blocks * length].reshape(blocks, length).mean(axis=1)
    return means.mean(), means.std(ddof=1) / np.sqrt(blocks)


def diffusion(positions_nm, time_us):
    """Diffusion of a stiff rod between two samples: across, along (nm^2/us) and turning (rad^2/us).

    Gives (mean, standard error) of each. Centre and direction are weighted by friction, as rigid
    motion is: bending modes have no share in them.
    """
    n = positions_nm.shape[1]
    weight = np.full(n, 1.0)
    weight[[0, -1]] = 0.5
    along_rod = np.arange(n) - (n - 1) / 2
    centre = np.einsum("i,kic->kc", weight / weight.sum(), positions_nm)
    axis = np.einsum("i,kic->kc", weight * along_rod, positions_nm)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    step_us = np.diff(time_us)
    mid = axis[1:] + axis[:-1]
    mid /= np.linalg.norm(mid, axis=1, keepdims=True)
    moved = np.diff(centre, axis=0)
    ahead = np.einsum("kc,kc->k", moved, mid)
    beside = np.sum(moved**2, axis=1) - ahead**2
    # <t(0).t(s)> = exp(-2 D s); the mean of each interval, not of the logarithm.
    cosine = np.einsum("kc,kc->k", axis[1:], axis[:-1])
    turn = mean_and_error(cosine)
    lag = step_us.mean()
    return {
        "across": tuple(np.array(mean_and_error(beside)) / (4.0 * lag)),
        "along": tuple(np.array(mean_and_error(ahead**2)) / (2.0 * lag)),
        "turning": (-np.log(turn[0]) / (2.0 * lag), turn[1] / turn[0] / (2.0 * lag)),
    }
