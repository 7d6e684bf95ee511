"""Physical constants and conversions used across the library."""

from __future__ import annotations

import math

BOLTZMANN_PN_NM_K = 0.01380649
"""Boltzmann constant in pN nm / K (exact, SI 2019)."""

ROOM_TEMPERATURE_K = 298.15

DEGREES_PER_RADIAN = 180.0 / math.pi
TURN_RAD = 2.0 * math.pi
