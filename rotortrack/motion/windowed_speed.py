"""Speed of a rotor against time, in windows, with the band that diffusion alone allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotortrack.motion.timed_steps import TimedSteps, fit_speeds

Floats = NDArray[np.float64]

_WHOLE = np.array([-np.inf, np.inf])


@dataclass(frozen=True)
class WindowedSpeed:
    """Speed in overlapping windows.

    Attributes
    ----------
    time_s
        Middles of the windows since frame 0, s.
    omega_rad_s, sd_rad_s
        Signed speed and its standard deviation, rad/s; nan where a window has too few steps.
    """

    time_s: Floats
    omega_rad_s: Floats
    sd_rad_s: Floats


def windowed_speed(
    steps: TimedSteps, *, window_s: float = 0.5, windows_per_length: int = 4
) -> WindowedSpeed:
    """Fit the speed within each window by generalised least squares.

    Its standard deviation is ``sqrt(2 D / W)`` for a window of W seconds and somewhat more where
    noise is large: for D 20 rad^2/s and 0.5 s, 512 deg/s. Speeds seem to change all the time; what
    stays within the band is diffusion.

    Parameters
    ----------
    steps
        Steps of one rotor, as `timed_steps` makes them.
    window_s
        Length of a window.
    windows_per_length
        How many windows begin within the length of one.

    Returns
    -------
    WindowedSpeed
        No windows where the track is shorter than one.
    """
    if len(steps) == 0:
        return WindowedSpeed(np.empty(0), np.empty(0), np.empty(0))
    begin, end = float(steps.start_s[0]), float(steps.stop_s[-1])
    pace_s = window_s / windows_per_length
    count = int(np.floor((end - begin - window_s) / pace_s + 1e-9)) + 1
    low_s = begin + pace_s * np.arange(max(count, 0), dtype=np.float64)
    slack_s = 1e-9 * window_s
    first = np.searchsorted(steps.start_s, low_s - slack_s)
    last = np.searchsorted(steps.stop_s, low_s + window_s + slack_s)
    omega, sd = np.full(low_s.size, np.nan), np.full(low_s.size, np.nan)
    for k, (start, stop) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        if stop - start >= 2:
            found = fit_speeds(steps.part(start, stop), _WHOLE)
            omega[k], sd[k] = found.omega_rad_s[0], found.sd_rad_s[0]
    middle_s: Floats = low_s + 0.5 * window_s
    return WindowedSpeed(middle_s, omega, sd)
