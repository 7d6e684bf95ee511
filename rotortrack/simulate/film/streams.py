"""Random streams: one for each effect and thing, so that adding an effect changes no other."""

from __future__ import annotations

import enum

import numpy as np


class Effect(enum.IntEnum):
    """First number of a stream's key. Numbers stay for ever, since films are named by them."""

    PLACES = 0
    LATTICE = 1
    ROTOR = 2
    MOTION = 3
    BREATHING = 4
    LABELS = 5
    BLEACHING = 6
    BLINKING = 7
    FREE_RODS = 8
    TEXTURE = 9
    FLICKER = 10
    DRIFT = 11
    PIXEL_MAPS = 12
    HOT_PIXELS = 13
    SHOT_NOISE = 14
    READ_NOISE = 15
    COLUMN_NOISE = 16
    DROPPED = 17
    TIMESTAMPS = 18
    VOLTAGE = 19
    FIDUCIALS = 20
    SHAPE = 21
    EVENTS = 22


def stream(seed: int, effect: Effect, *numbers: int) -> np.random.Generator:
    """Give the stream of an effect, and of one rotor, end or frame by its numbers."""
    key = np.random.SeedSequence(seed, spawn_key=(int(effect), *numbers))
    return np.random.default_rng(key)
