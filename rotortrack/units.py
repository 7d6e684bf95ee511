"""Conversions used across the library."""

from __future__ import annotations

import math

DEGREES_PER_RADIAN = 180.0 / math.pi
TURN_RAD = 2.0 * math.pi
