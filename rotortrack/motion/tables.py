"""The columns of the tables that motion analysis writes beside rotors and tracks."""

from __future__ import annotations

from rotortrack.tables import Column, Schema

POSTERIOR = Schema(
    "posterior",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("frame", "int64", "", "frame number, from 0, missing ones too", required=True),
        Column("seen", "bool", "", "whether the rotor was localised in it", required=True),
        Column("theta_rad", "float64", "rad", "angle given all frames", required=True),
        Column("theta_sd_rad", "float64", "rad", "its circular standard deviation"),
        Column("x_nm", "float64", "nm", "position given all frames", required=True),
        Column("y_nm", "float64", "nm", "position given all frames", required=True),
        Column("x_sd_nm", "float64", "nm", "standard deviation of x_nm"),
        Column("y_sd_nm", "float64", "nm", "standard deviation of y_nm"),
    ),
)
"""Averages over the exposure; never fed back into circles or distances."""

PROFILES = Schema(
    "profiles",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("bin", "int64", "", "number of the bin, from 0", required=True),
        Column("angle_rad", "float64", "rad", "centre of the bin", required=True),
        Column("n_frames", "int64", "", "frames in it"),
        Column("occupancy", "float64", "", "share of the frames in it"),
        Column("occupancy_sd", "float64", "", "its standard deviation"),
        Column("omega_rad_s", "float64", "rad/s", "mean speed there"),
        Column("omega_sd_rad_s", "float64", "rad/s", "its standard deviation"),
    ),
)

MSDS = Schema(
    "msd",
    (
        Column("rotor", "int64", "", "rotor number; -1: mean of all", required=True),
        Column("lag_s", "float64", "s", "lag", required=True),
        Column("angle_msd_rad2", "float64", "rad^2", "of the cumulative angle", required=True),
        Column("angle_msd_sd_rad2", "float64", "rad^2", "its standard deviation"),
        Column("xy_msd_nm2", "float64", "nm^2", "mean-square displacement in the plane"),
        Column("xy_msd_sd_nm2", "float64", "nm^2", "its standard deviation"),
        Column("n_pairs", "int64", "", "pairs of frames, which overlap"),
        Column("n_independent", "float64", "", "independent ones of equal error; -1: rotors"),
    ),
)

SWITCHES = Schema(
    "switches",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("switch", "int64", "", "number of the switch within the rotor, from 0"),
        Column("time_s", "float64", "s", "time of the switch since frame 0", required=True),
        Column("time_ci_low_s", "float64", "s", "lower end of its 95 % interval"),
        Column("time_ci_high_s", "float64", "s", "upper end of its 95 % interval"),
        Column("frame", "int64", "", "frame at that time"),
        Column("before_rad_s", "float64", "rad/s", "signed speed since the switch before"),
        Column("before_sd_rad_s", "float64", "rad/s", "its standard deviation"),
        Column("after_rad_s", "float64", "rad/s", "signed speed until the next switch"),
        Column("after_sd_rad_s", "float64", "rad/s", "its standard deviation"),
        Column("change_deg_s", "float64", "deg/s", "speed after less speed before"),
        Column("change_sd_deg_s", "float64", "deg/s", "its standard deviation"),
        Column("reverses", "bool", "", "whether both speeds are sure and differ in sign"),
        Column("statistic", "float64", "", "twice the log-likelihood that the switch explains"),
        Column("threshold", "float64", "", "value that chance exceeds at the chosen rate"),
        Column("residuals_p", "float64", "", "probability of residuals so uneven beside switches"),
    ),
)

VOLTAGES = Schema(
    "voltages",
    (
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("exposure_start_s", "float64", "s", "start of the exposure on the trace's clock"),
        Column("voltage_v", "float64", "V", "mean over the exposure"),
        Column("voltage_min_v", "float64", "V", "least value in the exposure"),
        Column("voltage_max_v", "float64", "V", "greatest value in the exposure"),
        Column("transition", "bool", "", "whether the voltage was not constant, or is not known"),
        Column("step", "int64", "", "number of the voltage step, -1 in a transition"),
    ),
)

VOLTAGE_SPEEDS = Schema(
    "voltage_speeds",
    (
        Column("rotor", "int64", "", "rotor number", required=True),
        Column("step", "int64", "", "number of the voltage step, from 0", required=True),
        Column("voltage_v", "float64", "V", "mean voltage of the step", required=True),
        Column("voltage_sd_v", "float64", "V", "standard deviation of its samples"),
        Column("start_s", "float64", "s", "start of the step since frame 0"),
        Column("stop_s", "float64", "s", "end of the step since frame 0"),
        Column("n_frames", "int64", "", "frames of the rotor within the step"),
        Column("omega_rad_s", "float64", "rad/s", "signed angular speed", required=True),
        Column("omega_sd_rad_s", "float64", "rad/s", "its standard deviation", required=True),
        Column("speed_deg_s", "float64", "deg/s", "signed angular speed"),
        Column("speed_sd_deg_s", "float64", "deg/s", "its standard deviation"),
    ),
)

PARTICLE_TRACKS = Schema(
    "particle_tracks",
    (
        Column("particle", "int64", "", "particle number, from 0", required=True),
        Column("frame", "int64", "", "frame number, from 0", required=True),
        Column("time_s", "float64", "s", "start of the frame since frame 0"),
        Column("x_nm", "float64", "nm", "position along columns", required=True),
        Column("y_nm", "float64", "nm", "position along rows, down", required=True),
        Column("x_sd_nm", "float64", "nm", "standard deviation of x_nm by the fit"),
        Column("y_sd_nm", "float64", "nm", "standard deviation of y_nm by the fit"),
    ),
)

PARTICLES = Schema(
    "particles",
    (
        Column("particle", "int64", "", "particle number, from 0", required=True),
        Column("n_frames", "int64", "", "frames in which it was seen", required=True),
        Column("first_frame", "int64", "", "first of them"),
        Column("last_frame", "int64", "", "last of them"),
        Column("missing_frames", "int64", "", "frames between these in which it was not seen"),
        Column("x_nm", "float64", "nm", "mean position along columns"),
        Column("y_nm", "float64", "nm", "mean position along rows, down"),
        Column("diffusion_um2_s", "float64", "um^2/s", "diffusion coefficient, exact likelihood"),
        Column("diffusion_sd_um2_s", "float64", "um^2/s", "its standard deviation"),
        Column("diffusion_ci_low_um2_s", "float64", "um^2/s", "lower end of its 95 % interval"),
        Column("diffusion_ci_high_um2_s", "float64", "um^2/s", "upper end of its 95 % interval"),
        Column("cve_um2_s", "float64", "um^2/s", "diffusion by the covariance estimator"),
        Column("cve_sd_um2_s", "float64", "um^2/s", "its standard deviation"),
        Column("localisation_sd_nm", "float64", "nm", "error per axis that the track shows"),
        Column("velocity_x_nm_s", "float64", "nm/s", "mean velocity along columns"),
        Column("velocity_y_nm_s", "float64", "nm/s", "mean velocity along rows, down"),
        Column("velocity_sd_nm_s", "float64", "nm/s", "standard deviation of either"),
        Column("net_nm", "float64", "nm", "distance between first and last position"),
        Column("directed_p", "float64", "", "test of no mean velocity"),
        Column("directed_q", "float64", "", "false discovery rate of that test over particles"),
    ),
)

PARTICLE_MSD = Schema(
    "particle_msd",
    (
        Column("lag_s", "float64", "s", "lag", required=True),
        Column("xy_msd_nm2", "float64", "nm^2", "mean-square displacement", required=True),
        Column("xy_msd_sd_nm2", "float64", "nm^2", "its standard deviation over particles"),
        Column("n_pairs", "int64", "", "pairs of frames, which overlap"),
        Column("n_particles", "int64", "", "particles with such pairs"),
    ),
)

TRACE = Schema(
    "trace",
    (
        Column("time_s", "float64", "s", "time of the sample", required=True),
        Column("trigger_v", "float64", "V", "exposure output of the camera", required=True),
        Column("voltage_v", "float64", "V", "voltage across the membrane", required=True),
    ),
)
"""A recorded trace that is read, never written."""
