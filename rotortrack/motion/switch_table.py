"""The switches of all rotors as a table."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from rotortrack.motion.changepoints import Switches
from rotortrack.motion.tables import SWITCHES
from rotortrack.tables import conform
from rotortrack.units import DEGREES_PER_RADIAN


def switch_table(found: Mapping[int, Switches], *, frame_interval_s: float) -> pd.DataFrame:
    """Build one row a switch of speed; no rows for rotors without any.

    Parameters
    ----------
    found
        Switches by the number of the rotor.
    frame_interval_s
        Time between frame starts, s.

    Returns
    -------
    DataFrame
        Columns of `motion.tables.SWITCHES`, by rotor and time.
    """
    rows = [
        {"rotor": number, "switch": k, **row}
        for number, switches in found.items()
        for k, row in enumerate(_rows(switches))
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
