"""The columns of every table that rotortrack writes: name, type, unit and meaning.

Units are part of the column names; positions follow the pixel convention of the README (origin at
the outer corner of pixel (0, 0), x along columns, y down along rows) and angles are
counter-clockwise as seen on the displayed image.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rotortrack.errors import TableError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Column:
    """One column; `required` columns must be present in every table that is read."""

    name: str
    dtype: str
    unit: str
    meaning: str
    required: bool = False


@dataclass(frozen=True)
class Schema:
    """A table's name and columns, in the order in which they are written."""

    name: str
    columns: tuple[Column, ...]

    @property
    def names(self) -> list[str]:
        """Column names in order."""
        return [column.name for column in self.columns]

    @property
    def dtypes(self) -> dict[str, str]:
        """Name of the numpy dtype of every column."""
        return {column.name: column.dtype for column in self.columns}

    @property
    def units(self) -> dict[str, str]:
        """Unit of every column."""
        return {column.name: column.unit for column in self.columns}


LOCALISATIONS = Schema(
    "localisations",
    (
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("x_nm", "float64", "nm", "position along columns", required=True),
        Column("y_nm", "float64", "nm", "position along rows, down", required=True),
        Column("photons", "float32", "photons", "detected photo-electrons of the spot"),
        Column("background", "float32", "photons", "fitted background per pixel"),
        Column("background_sd", "float32", "photons", "standard deviation of the fit residuals"),
        Column("sigma_nm", "float32", "nm", "fitted width of the spot"),
        Column("x_sd_nm", "float32", "nm", "standard deviation of x_nm"),
        Column("y_sd_nm", "float32", "nm", "standard deviation of y_nm"),
        Column("uncertainty_nm", "float32", "nm", "rms of the x and y standard deviations"),
        Column("chi2", "float32", "", "Pearson chi-square of the fit"),
        Column("log_likelihood_ratio", "float32", "", "deviance of the fit"),
        Column("fit_flags", "int32", "", "bits of FitFlag: how the fit ended"),
        Column("channel", "int32", "", "colour channel, from 0"),
        Column("rotor", "int64", "", "rotor number, -1 when the spot belongs to none"),
    ),
)

TRACKS = Schema(
    "tracks",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("time_s", "float64", "s", "start of the frame since frame 0"),
        Column("x_nm", "float64", "nm", "position along columns", required=True),
        Column("y_nm", "float64", "nm", "position along rows, down", required=True),
        Column("x_sd_nm", "float64", "nm", "standard deviation of x_nm"),
        Column("y_sd_nm", "float64", "nm", "standard deviation of y_nm"),
        Column("theta_rad", "float64", "rad", "angle about the circle's centre"),
        Column("theta_sd_rad", "float64", "rad", "its standard deviation"),
        Column("step_rad", "float64", "rad", "step from the adjacent frame before"),
        Column("cumulative_rad", "float64", "rad", "turned since the first frame, gaps bridged"),
        Column("used", "bool", "", "whether the frame enters the estimates"),
    ),
)

ROTORS = Schema(
    "rotors",
    (
        Column("rotor", "int64", "", "rotor number, from 0", required=True),
        Column("x_nm", "float64", "nm", "centre of the circle", required=True),
        Column("y_nm", "float64", "nm", "centre of the circle", required=True),
        Column("radius_nm", "float64", "nm", "radius, corrected for motion blur by `motion`"),
        Column("radius_sd_nm", "float64", "nm", "its standard deviation from localisation noise"),
        Column("x_sd_nm", "float64", "nm", "standard deviation of x_nm"),
        Column("y_sd_nm", "float64", "nm", "standard deviation of y_nm"),
        Column("axis_ratio", "float64", "", "short over long axis of the ring, 1 for a circle"),
        Column("axis_ratio_sd", "float64", "", "its standard deviation"),
        Column("arc_deg", "float64", "deg", "360 minus the largest gap between angles"),
        Column("n_localisations", "int64", "", "frames with a localisation"),
        Column("verdict", "str", "", "kept or refused"),
        Column("reason", "str", "", "why it was refused, empty when kept"),
        Column("behaviour", "str", "", "what it does, as `motion.behaviour` names it"),
        Column("behaviour_evidence", "str", "", "why it is called so"),
        Column("behaviour_margin", "float64", "", "feature over threshold, above 1 where named"),
        Column("paper_class", "str", "", "fast, slow, between or none, by msd_speed_deg_s"),
        Column("omega_rad_s", "float64", "rad/s", "signed angular speed"),
        Column("omega_sd_rad_s", "float64", "rad/s", "its standard deviation"),
        Column("speed_deg_s", "float64", "deg/s", "signed angular speed"),
        Column("speed_ci_low_deg_s", "float64", "deg/s", "lower end of its 95 % interval"),
        Column("speed_ci_high_deg_s", "float64", "deg/s", "upper end of its 95 % interval"),
        Column("rev_per_s", "float64", "1/s", "signed revolutions per second"),
        Column("diffusion_rad2_s", "float64", "rad^2/s", "rotational diffusion coefficient"),
        Column("diffusion_sd_rad2_s", "float64", "rad^2/s", "its standard deviation"),
        Column("diffusion_ci_low_rad2_s", "float64", "rad^2/s", "lower end of its 95 % interval"),
        Column("diffusion_ci_high_rad2_s", "float64", "rad^2/s", "upper end of its 95 % interval"),
        Column("drift_p", "float64", "", "probability of such a speed, or more, without drift"),
        Column("drift_q", "float64", "", "false-discovery rate of calling it driven"),
        Column("theta_noise_rad", "float64", "rad", "noise of an angle, as its steps tell it"),
        Column("speed_method", "str", "", "increments, circular, paper or none"),
        Column("speed_reason", "str", "", "why that method"),
        Column("residuals_p", "float64", "", "probability of residuals so uneven in the model"),
        Column("resampled", "bool", "", "whether intervals come from the block bootstrap"),
        Column("n_switches", "int64", "", "switches of speed"),
        Column("torque_pn_nm", "float64", "pN nm", "kT omega / D of driven and Brownian rotors"),
        Column("torque_sd_pn_nm", "float64", "pN nm", "its standard deviation"),
        Column("torque_ci_low_pn_nm", "float64", "pN nm", "lower end of its 95 % interval"),
        Column("torque_ci_high_pn_nm", "float64", "pN nm", "upper end of its 95 % interval"),
        Column("power_pn_nm_s", "float64", "pN nm/s", "kT omega^2 / D of these"),
        Column("power_ci_low_pn_nm_s", "float64", "pN nm/s", "lower end of its 95 % interval"),
        Column("power_ci_high_pn_nm_s", "float64", "pN nm/s", "upper end of its 95 % interval"),
        Column("friction_pn_nm_s", "float64", "pN nm s", "kT / D of these"),
        Column("friction_ci_low_pn_nm_s", "float64", "pN nm s", "lower end of its 95 % interval"),
        Column("friction_ci_high_pn_nm_s", "float64", "pN nm s", "upper end of its 95 % interval"),
        Column("barrier_kt", "float64", "kT", "height of the potential that pins it"),
        Column("barrier_ci_low_kt", "float64", "kT", "lower end of its 95 % interval"),
        Column("barrier_ci_high_kt", "float64", "kT", "upper end of its 95 % interval"),
        Column("preferred_rad", "float64", "rad", "angle at which that potential is lowest"),
        Column("pinning_p", "float64", "", "probability of such preferences without potential"),
        Column("msd_speed_deg_s", "float64", "deg/s", "unsigned speed v of v^2 t^2 + 2 D t"),
        Column("msd_diffusion_rad2_s", "float64", "rad^2/s", "D of v^2 t^2 + 2 D t"),
        Column("msd_lag_min_s", "float64", "s", "first lag of that fit"),
        Column("msd_lag_max_s", "float64", "s", "last lag of that fit"),
        Column("msd_at_bound", "bool", "", "whether that fit ended at v = 0 or D = 0"),
        Column("msd_gls_speed_deg_s", "float64", "deg/s", "speed of the MSD fit with covariance"),
        Column("msd_gls_speed_ci_low_deg_s", "float64", "deg/s", "lower end of its 95 % interval"),
        Column("msd_gls_speed_ci_high_deg_s", "float64", "deg/s", "upper end of its 95 % interval"),
        Column("msd_gls_diffusion_rad2_s", "float64", "rad^2/s", "diffusion of that fit"),
        Column(
            "msd_gls_diffusion_ci_low_rad2_s",
            "float64",
            "rad^2/s",
            "lower end of its 95 % interval",
        ),
        Column(
            "msd_gls_diffusion_ci_high_rad2_s",
            "float64",
            "rad^2/s",
            "upper end of its 95 % interval",
        ),
        Column("residual_sd_nm", "float64", "nm", "rms distance of the spots from the circle"),
        Column("localisation_sd_nm", "float64", "nm", "median localisation uncertainty"),
        Column("circle", "str", "", "how the circle fit ended, fitted or why there is none"),
        Column("radius_fit_nm", "float64", "nm", "radius of the circle through the positions"),
        Column("n_steps", "int64", "", "steps between adjacent frames"),
        Column("step_sd_rad", "float64", "rad", "standard deviation of those steps"),
        Column("wrapped_step_rad", "float64", "rad", "mean of a wrapped normal fit to them"),
        Column("wrapped_step_sd_rad", "float64", "rad", "its sd, which wide steps do not shorten"),
    ),
)

DRIFT = Schema(
    "drift",
    (
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("dx_nm", "float64", "nm", "drift subtracted from x", required=True),
        Column("dy_nm", "float64", "nm", "drift subtracted from y", required=True),
        Column("sd_nm", "float64", "nm", "standard deviation per axis, nan when unknown"),
    ),
)

DECISIONS = Schema(
    "decisions",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("feature", "str", "", "what was looked at", required=True),
        Column("value", "float64", "", "its value", required=True),
        Column("rule", "str", "", ">= or <=", required=True),
        Column("threshold", "float64", "", "the limit that it was held against", required=True),
        Column("passed", "bool", "", "whether it kept the limit", required=True),
        Column("reason", "str", "", "why it is refused where it did not", required=True),
        Column("option", "str", "", "option of [screen] that is the limit"),
        Column("verdict_before", "str", "", "the verdict and reason that a person overruled"),
        Column("verdict_after", "str", "", "the verdict of that person"),
        Column("remark", "str", "", "why, by whom and when"),
    ),
)


def empty(schema: Schema) -> pd.DataFrame:
    """Return a table without rows that has every column of the schema."""
    import pandas as pd

    return pd.DataFrame({c.name: pd.Series(dtype=c.dtype) for c in schema.columns})


def conform(table: pd.DataFrame, schema: Schema, source: str) -> pd.DataFrame:
    """Return the table with the schema's dtypes and column order, unknown columns last.

    Parameters
    ----------
    table
        Any table; columns that the schema knows are converted.
    schema
        What the table should be.
    source
        File or variable named in errors.

    Raises
    ------
    TableError
        Required columns are missing or a column holds values of the wrong kind.
    """
    import pandas as pd

    twice = table.columns[table.columns.duplicated()]
    if len(twice):
        raise TableError(f"{source} has the column {twice[0]} more than once")
    missing = [c.name for c in schema.columns if c.required and c.name not in table.columns]
    if missing:
        raise TableError(
            f"{source} lacks the {schema.name} column(s) {', '.join(missing)}: it has "
            f"{', '.join(map(str, table.columns)) or 'none'}"
        )
    known = [c for c in schema.columns if c.name in table.columns]
    others = [name for name in table.columns if name not in schema.dtypes]
    dtypes = schema.dtypes
    converted = {}
    for name in [*(c.name for c in known), *others]:
        try:
            converted[name] = _cast(table[name], dtypes[name]) if name in dtypes else table[name]
        except (ValueError, TypeError, OverflowError) as error:
            raise TableError(
                f"{source}: column {name} cannot be read as {dtypes[name]} ({error})"
            ) from error
    return pd.DataFrame(converted, index=table.index, copy=False)


def _cast(values: pd.Series[Any], dtype: Any) -> pd.Series[Any]:
    """Convert without the silent losses of `astype`: 1.5 is no integer and "False" no truth."""
    import pandas as pd

    if values.dtype == dtype:
        return values
    if dtype == "bool":
        known = {True: True, False: False, "true": True, "false": False}
        words = values.map(lambda value: value.lower() if isinstance(value, str) else value)
        strange = values[~words.isin(list(known))]
        if len(strange):
            raise ValueError(f"{strange.iloc[0]!r} is neither true nor false")
        return words.map(known).astype(bool)
    if not dtype.startswith("int"):
        converted: pd.Series[Any] = values.astype(dtype)
        return converted
    numbers = pd.to_numeric(values)
    fraction = numbers[~(numbers % 1 == 0)]
    if len(fraction):
        raise ValueError(f"{fraction.iloc[0]} is not a whole number")
    bound = 2.0 ** (int(dtype[3:]) - 1)
    large = numbers[(numbers >= bound) | (numbers < -bound)]
    if len(large):
        raise ValueError(f"{large.iloc[0]} is too large")
    whole: pd.Series[Any] = numbers.astype(dtype)
    return whole


def schema_metadata(schema: Schema, provenance: Mapping[str, object]) -> dict[str, object]:
    """Build what a native table file records beside its rows: schema name, units, provenance."""
    return {"table": schema.name, "units": schema.units, "provenance": dict(provenance)}
