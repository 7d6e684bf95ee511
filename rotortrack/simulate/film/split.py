"""Two colours on one sensor: where the second colour's image of a place lies, and back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotortrack.simulate.film.options import SplitOptions

Floats = NDArray[np.float64]

_ROUNDS = 50
_EXACT_NM = 1e-9


class Split:
    """The second colour's optics.

    A place of the first colour's half is mirrored where the scene says so, sheared, turned and
    magnified about the middle of the half. There its image is distorted: radially outwards by
    `radial_nm` (rho / rho_edge)^3, with rho_edge half of the longer side, and as a keystone by
    `keystone_nm` x y / (half width half height) along x. Last it is shifted and moved to the
    second half of the sensor.

    Parameters
    ----------
    options
        Layout and distortion.
    shape_px
        Height and width of the sensor, both colours together.
    pixel_size_nm
        Size of a pixel in the specimen.
    """

    def __init__(
        self, options: SplitOptions, shape_px: tuple[int, int], pixel_size_nm: float
    ) -> None:
        height, width = (side * pixel_size_nm for side in shape_px)
        beside = options.layout == "left-right"
        self.origin_nm = (width / 2.0, 0.0) if beside else (0.0, height / 2.0)
        half = (width / 2.0, height) if beside else (width, height / 2.0)
        self._middle = (half[0] / 2.0, half[1] / 2.0)
        self._edge = max(self._middle)
        self._options = options
        turn = math.radians(options.rotation_deg)
        # y points down, so that a positive turn is counter-clockwise on the image.
        rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        shear = np.array([[1.0, options.shear], [0.0, 1.0]])
        mirror = np.diag([-1.0 if options.mirrored else 1.0, 1.0])
        self._linear = options.scale * rotation @ shear @ mirror

    def to_second(self, x_nm: Floats, y_nm: Floats) -> tuple[Floats, Floats]:
        """Give the place on the sensor, in the second colour, of places in the first, nm."""
        u, v = self._distorted(x_nm - self._middle[0], y_nm - self._middle[1])
        return (
            u + self._middle[0] + self.origin_nm[0],
            v + self._middle[1] + self.origin_nm[1],
        )

    def to_first(self, x_nm: Floats, y_nm: Floats) -> tuple[Floats, Floats]:
        """Give the place in the first colour of places on the sensor in the second, nm.

        By repeated correction; exact to 1e-9 nm.

        Raises
        ------
        ArithmeticError
            The distortion is too strong to be undone.
        """
        u = x_nm - self.origin_nm[0] - self._middle[0]
        v = y_nm - self.origin_nm[1] - self._middle[1]
        back = np.linalg.inv(self._linear)
        shift_x, shift_y = self._options.shift_nm
        x = back[0, 0] * (u - shift_x) + back[0, 1] * (v - shift_y)
        y = back[1, 0] * (u - shift_x) + back[1, 1] * (v - shift_y)
        # What diverges does so to infinity.
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(_ROUNDS):
                there = self._distorted(x, y)
                off_u, off_v = u - there[0], v - there[1]
                x = x + back[0, 0] * off_u + back[0, 1] * off_v
                y = y + back[1, 0] * off_u + back[1, 1] * off_v
                if max(np.abs(off_u).max(initial=0.0), np.abs(off_v).max(initial=0.0)) < _EXACT_NM:
                    return x + self._middle[0], y + self._middle[1]
        raise ArithmeticError("the distortion of [split] is too strong to be undone")

    def _distorted(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Map places about the middle of the half."""
        options, linear = self._options, self._linear
        p = linear[0, 0] * x + linear[0, 1] * y
        q = linear[1, 0] * x + linear[1, 1] * y
        u, v = p + options.shift_nm[0], q + options.shift_nm[1]
        if options.radial_nm:
            outwards = options.radial_nm * (p**2 + q**2) / self._edge**3
            u, v = u + outwards * p, v + outwards * q
        if options.keystone_nm:
            u = u + options.keystone_nm * p * q / (self._middle[0] * self._middle[1])
        return u, v
