"""Diffusion coefficient of particles by the covariance of their steps (CVE)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.motion.readings import Timing

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class StepProducts:
    """Sums over the steps between adjacent frames of one or more particles, both axes together.

    Attributes
    ----------
    steps, pairs
        Number of steps, and of pairs of steps that adjoin.
    squares, products
        Sum of dx^2 + dy^2 over the steps, and of the products of both steps of a pair, nm^2.
    """

    steps: int
    pairs: int
    squares: float
    products: float

    def __add__(self, other: StepProducts) -> StepProducts:
        return StepProducts(
            self.steps + other.steps,
            self.pairs + other.pairs,
            self.squares + other.squares,
            self.products + other.products,
        )

    def __sub__(self, other: StepProducts) -> StepProducts:
        return self + StepProducts(-other.steps, -other.pairs, -other.squares, -other.products)


@dataclass(frozen=True)
class Covariance:
    """D (nm^2/s) with its standard deviation, and the variance of localisation (nm^2) per axis."""

    diffusion_nm2_s: float
    diffusion_sd_nm2_s: float
    noise_nm2: float


def step_products(
    frame: Integers, x_nm: Floats, y_nm: Floats, flow_nm: tuple[float, float] = (0.0, 0.0)
) -> StepProducts:
    """Sum what the covariance estimator needs; steps over missing frames are left out.

    Parameters
    ----------
    frame, x_nm, y_nm
        One particle, frames ascending without repeats, shape (n,).
    flow_nm
        Common motion per frame in x and y that is taken off.
    """
    adjacent = np.diff(frame) == 1
    joined = adjacent[1:] & adjacent[:-1]
    squares = products = 0.0
    for place, flow in zip((x_nm, y_nm), flow_nm, strict=True):
        step = np.diff(place) - flow
        squares += float((step[adjacent] ** 2).sum())
        products += float((step[1:] * step[:-1])[joined].sum())
    return StepProducts(
        int(np.count_nonzero(adjacent)), int(np.count_nonzero(joined)), squares, products
    )


def covariance_estimate(sums: StepProducts, timing: Timing) -> Covariance:
    """Unbiased D and localisation variance from the variance and covariance of steps.

        D = <d^2> / (2 dt) + <d_k d_k+1> / dt,   s^2 = R <d^2> + (2 R - 1) <d_k d_k+1>

    per axis, with R = exposure / (6 dt). Both may come out negative by chance.

    Returns
    -------
    Covariance
        All nan without two steps that adjoin. The standard deviation is that of a free particle.

    Notes
    -----
    Source: Vestergaard, Blainey and Flyvbjerg, PRE 89, 022726 (2014).
    """
    if sums.pairs < 1:
        return Covariance(math.nan, math.nan, math.nan)
    dt = timing.frame_interval_s
    blur = timing.exposure_s / (6.0 * dt)
    square = sums.squares / (2.0 * sums.steps)
    product = sums.products / (2.0 * sums.pairs)
    diffusion = square / (2.0 * dt) + product / dt
    noise = blur * square + (2.0 * blur - 1.0) * product
    # D (1, epsilon) of the source, which leaves D = 0 an error.
    rough = max(noise, 0.0) / dt - 2.0 * blur * diffusion
    variance = (6.0 * diffusion**2 + 4.0 * diffusion * rough + 2.0 * rough**2) / sums.steps
    variance += 4.0 * (diffusion + rough) ** 2 / sums.steps**2
    return Covariance(diffusion, math.sqrt(max(variance, 0.0) / 2.0), noise)
