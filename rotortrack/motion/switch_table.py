"""The switches of all rotors as a table."""

from __future__ import annotations

import pandas as pd

from rotortrack import parallel
from rotortrack.motion.changepoints import Switches, find_switches
from rotortrack.motion.increments import increments, step_sizes
from rotortrack.motion.options import MotionOptions
from rotortrack.motion.tracks import Track, used_tracks
from rotortrack.tables import SWITCHES, conform
from rotortrack.units import DEGREES_PER_RADIAN


def switch_table(
    tracks: pd.DataFrame,
    rotors: pd.DataFrame,
    options: MotionOptions,
    *,
    frame_interval_s: float,
    exposure_s: float,
    workers: int = 1,
) -> pd.DataFrame:
    """Build one row a switch of speed of each kept rotor; no rows for rotors without any.

    Rotors whose steps outgrow the 180-degree rule are left out: what passes for a switch there may
    be a turn that was lost.

    Parameters
    ----------
    tracks, rotors
        Tables of `build_tracks` and `screen`.
    options
        `switch_min_s` and `switch_false_alarm`.
    frame_interval_s, exposure_s
        Time between frame starts and exposure within it, s.
    workers
        Threads that share the rotors.

    Returns
    -------
    DataFrame
        Columns of `tables.SWITCHES`, by rotor and time.
    """

    def search(track: Track) -> list[dict[str, object]]:
        frame, theta = track.frame, track.theta_rad
        if step_sizes(increments(frame, theta, options.gap_mode)).folded:
            return []
        return _rows(
            find_switches(
                frame,
                theta,
                frame_interval_s=frame_interval_s,
                exposure_s=exposure_s,
                min_segment_s=options.switch_min_s,
                false_alarm=options.switch_false_alarm,
            )
        )

    seen = used_tracks(tracks, rotors)
    found = parallel.map_ordered(search, seen.values(), workers=workers)
    rows = [
        {"rotor": number, "switch": k, **row}
        for number, switches in zip(seen, found, strict=True)
        for k, row in enumerate(switches)
    ]
    table = pd.DataFrame(rows, columns=SWITCHES.names)
    table["frame"] = (table["time_s"] / frame_interval_s).astype("float64").round()
    return conform(table, SWITCHES, "switches")


def _rows(found: Switches) -> list[dict[str, object]]:
    """Columns of each switch of one rotor."""
    speeds = found.speeds
    change, change_sd = speeds.changes()
    sd = speeds.sd_rad_s
    return [
        {
            "time_s": switch.time_s,
            "time_ci_low_s": switch.low_s,
            "time_ci_high_s": switch.high_s,
            "before_rad_s": speeds.omega_rad_s[k],
            "before_sd_rad_s": sd[k],
            "after_rad_s": speeds.omega_rad_s[k + 1],
            "after_sd_rad_s": sd[k + 1],
            "change_deg_s": change[k] * DEGREES_PER_RADIAN,
            "change_sd_deg_s": change_sd[k] * DEGREES_PER_RADIAN,
            "reverses": bool(found.reverses[k]),
            "statistic": found.statistic[k],
            "threshold": found.threshold,
            "residuals_p": found.white.p,
        }
        for k, switch in enumerate(found.times)
    ]
