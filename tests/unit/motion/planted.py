"""Rotors of known behaviour, simulated in ten parts a frame and filmed as positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

FRAME_S = 0.002
PARTS = 10
NAMES = (
    "driven_ccw",
    "driven_cw",
    "switching",
    "brownian",
    "toggling",
    "confined",
    "stuck",
    "unclassified",
)


@dataclass(frozen=True)
class Planted:
    """Positions about the origin on a circle of 100 nm, and what was put in."""

    frame: np.ndarray
    x_nm: np.ndarray
    y_nm: np.ndarray
    sd_nm: np.ndarray
    omega: float
    diffusion: float
    sigma: float

    @property
    def theta(self):
        return np.arctan2(-self.y_nm, self.x_nm)


def plant(name, rng, n=8000, *, missing=0.1, exposed=1.0, speed_range=(4.0, 40.0)) -> Planted:
    """Simulate a rotor: D 2 to 60 rad2/s, sigma 0.1 to 0.3, |omega| from 4 sd."""
    diffusion = float(np.exp(rng.uniform(np.log(2.0), np.log(60.0))))
    sigma = rng.uniform(0.1, 0.3)
    speed = np.sqrt(2 * diffusion / (n * FRAME_S)) * np.exp(rng.uniform(*np.log(speed_range)))
    omega, steps = 0.0, n * PARTS
    if name in ("driven_ccw", "driven_cw"):
        omega = speed if name == "driven_ccw" else -speed
        path = free(rng, steps, diffusion, omega)
    elif name == "switching":
        cut = rng.uniform(0.3, 0.7)
        speed *= rng.choice([-1.0, 1.0]) * rng.uniform(1.2, 1.5) / np.sqrt(min(cut, 1 - cut))
        path = free(rng, steps, diffusion, np.where(np.arange(steps) < cut * steps, speed, -speed))
    elif name == "brownian":
        path = free(rng, steps, diffusion, 0.0)
    elif name == "stuck":
        path = np.zeros(steps)
    elif name == "confined":
        path = held(rng, steps, diffusion, rng.uniform(0.25, 0.6))
    elif name == "toggling":
        changes = np.cumsum(rng.random(steps) < rng.uniform(1.0, 5.0) * FRAME_S / PARTS)
        apart = np.pi + rng.uniform(-0.35, 0.35)
        path = apart * (changes % 2) + held(rng, steps, diffusion, rng.uniform(0.2, 0.4))
    else:
        # Three dwell places and barriers of 3.6 kT: none of the other seven.
        path = washboard(rng, steps, diffusion, 0.0, (0.0, 0.0, 1.8))
    return filmed(rng, path + rng.uniform(0, 2 * np.pi), sigma, missing, exposed, omega, diffusion)


def filmed(rng, path, sigma, missing, exposed, omega, diffusion) -> Planted:
    parts = np.exp(1j * path).reshape(-1, PARTS)[:, : max(round(PARTS * exposed), 1)]
    place = 100 * parts.mean(axis=1)
    frame = np.flatnonzero(rng.random(place.size) >= missing)
    x, y = rng.normal(0.0, 100 * sigma, (2, place.size)) + np.stack([place.real, -place.imag])
    sd = np.full(frame.size, 100 * sigma)
    return Planted(frame, x[frame], y[frame], sd, omega, diffusion, sigma)


def free(rng, steps, diffusion, omega):
    part_s = FRAME_S / PARTS
    return np.cumsum(omega * part_s + rng.normal(0.0, np.sqrt(2 * diffusion * part_s), steps))


def held(rng, steps, diffusion, spread):
    """Diffuse in a harmonic well with this standard deviation."""
    decay = np.exp(-diffusion / spread**2 * FRAME_S / PARTS)
    return lfilter([1.0], [1.0, -decay], rng.normal(0.0, spread * np.sqrt(1 - decay**2), steps))


def washboard(rng, steps, diffusion, tilt, cosines, count=None):
    """Diffuse under a tilt (kT per rad) in ``sum a_n cos(n theta)`` kT; `count` rotors at once."""
    part_s = FRAME_S / PARTS
    kicks = rng.normal(0.0, np.sqrt(2 * diffusion * part_s), (steps, *([count] if count else [])))
    pull = diffusion * part_s * np.array(cosines) * np.arange(1, len(cosines) + 1)
    theta = np.zeros(count) if count else 0.0
    path = np.empty(kicks.shape)
    for k in range(steps):
        theta = theta + diffusion * part_s * tilt + kicks[k]
        for n, strength in enumerate(pull, start=1):
            if strength:
                theta = theta + strength * np.sin(n * theta)
        path[k] = theta
    return path
