"""The columns of the tables of end-to-end distances."""

from __future__ import annotations

from rotortrack.tables import LOCALISATIONS, Column, Schema

SECOND_LOCALISATIONS = Schema(
    "second_localisations",
    tuple(column for column in LOCALISATIONS.columns if column.name != "rotor"),
)
"""Spots of the second colour as they were seen: neither mapped onto the first nor corrected."""

END_TO_END = Schema(
    "end_to_end",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("time_s", "float64", "s", "start of the frame since frame 0"),
        Column("dx_nm", "float64", "nm", "second end less first, along columns", required=True),
        Column("dy_nm", "float64", "nm", "second end less first, along rows, down", required=True),
        Column("x_sd_nm", "float64", "nm", "standard deviation of dx_nm", required=True),
        Column("y_sd_nm", "float64", "nm", "standard deviation of dy_nm", required=True),
        Column("distance_nm", "float64", "nm", "length of dx, dy as measured", required=True),
        Column("distance_sd_nm", "float64", "nm", "its standard deviation along dx, dy"),
        Column("moving_median_nm", "float64", "nm", "median of 40 frames' distances"),
        Column("angle_rad", "float64", "rad", "direction from the first end to the second"),
        Column("late_s", "float64", "s", "by how much the second end was exposed later"),
    ),
)

END_TO_END_ROTORS = Schema(
    "end_to_end_rotors",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("n_frames", "int64", "", "frames with both ends", required=True),
        Column("end_to_end_nm", "float64", "nm", "mean of the true distance", required=True),
        Column("end_to_end_sd_nm", "float64", "nm", "its standard deviation", required=True),
        Column("end_to_end_ci_low_nm", "float64", "nm", "lower end of its 95 % interval"),
        Column("end_to_end_ci_high_nm", "float64", "nm", "upper end of its 95 % interval"),
        Column("breathing_nm", "float64", "nm", "sd of the true distance over time"),
        Column("breathing_sd_nm", "float64", "nm", "its standard deviation"),
        Column("noise_nm", "float64", "nm", "noise of dx or dy as fitted"),
        Column("noise_sd_nm", "float64", "nm", "its standard deviation"),
        Column("told_noise_nm", "float64", "nm", "noise of dx or dy as the uncertainties tell it"),
        Column("known_nm", "float64", "nm", "mean true distance with the told noise"),
        Column("known_sd_nm", "float64", "nm", "its standard deviation"),
        Column("free_nm", "float64", "nm", "mean true distance with the noise free"),
        Column("free_sd_nm", "float64", "nm", "its standard deviation"),
        Column("free_ci_low_nm", "float64", "nm", "lower end of its 95 % interval"),
        Column("free_ci_high_nm", "float64", "nm", "upper end of its 95 % interval"),
        Column("plain_mean_nm", "float64", "nm", "mean of the distances as measured"),
        Column("moment_nm", "float64", "nm", "root of mean square less noise"),
        Column("moving_median_nm", "float64", "nm", "median of the moving medians"),
        Column("registration_error_nm", "float64", "nm", "expected error of the map there"),
        Column("extrapolated", "bool", "", "whether it lies outside the registration's beads"),
        Column("first_radius_nm", "float64", "nm", "radius of the first end's ring"),
        Column("first_radius_sd_nm", "float64", "nm", "its standard deviation"),
        Column("second_radius_nm", "float64", "nm", "radius of the second end's ring"),
        Column("second_radius_sd_nm", "float64", "nm", "its standard deviation"),
        Column("centres_apart_nm", "float64", "nm", "distance of the rings' centres"),
        Column("centres_apart_sd_nm", "float64", "nm", "its standard deviation per axis"),
        Column("phase_rad", "float64", "rad", "angle of the second end ahead of the first"),
        Column("phase_sd_rad", "float64", "rad", "spread of that angle over time"),
        Column("arrangement", "str", "", "tandem, opposed, skew, centred or unknown"),
        Column("docking", "str", "", "off-centre, centred or unknown"),
        Column("turns", "float64", "", "full turns of the end-to-end vector, either way"),
        Column("shift_x_nm", "float64", "nm", "local registration error found, x"),
        Column("shift_y_nm", "float64", "nm", "local registration error found, y"),
        Column("shift_sd_nm", "float64", "nm", "its standard deviation per axis"),
        Column("corrected_nm", "float64", "nm", "mean true distance less that error"),
        Column("corrected_sd_nm", "float64", "nm", "its standard deviation"),
        Column("rigid", "bool", "", "whether the assumptions of that error held"),
        Column("rigid_reason", "str", "", "which did not"),
        Column("axis_deg", "float64", "deg", "direction of the end-to-end axis, 0 to 180"),
        Column("order", "float64", "", "order parameter of that axis, 0 to 1"),
        Column("order_p", "float64", "", "probability of such order without a preferred axis"),
    ),
)
