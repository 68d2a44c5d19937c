//! The files that a campaign begins with, but for what is filled in: nothing in, their texts out.

pub(super) const CHANNELS: &str = r#"# Which topic and field of a log is which signal.
#
# value = sign * scale * (number in SI units) + offset      at the time    stamp - delay
# Every entry was guessed from a name: check topic, unit and sign. Complete each unit "?".
# Signs: x forward, y right, z down; right wing down, nose up, nose right positive. Turn one round with sign = -1.

"#;

pub(super) const PIPELINE: &str = r##"# What is done with the logs, stage by stage. Paths are relative to this file.
title = {title}
aircraft = "aircraft.toml"
channels = "channels.toml"
logs = [
{logs}]

# The uniform grid on which signals are put.
[derive]
rate_hz = {rate}

# The report: report/index.html in the folder out/, and a page per flight.
[report]

# The flight path from the inertial sensors: signals {inputs} are needed{missing}, and it is compared
# with whatever there is of {outputs}. It wants the sensors' places in aircraft.toml. Take away the "# " of these lines:
# [reconstruct]
#
# [reconstruct.method]
# by = "smoother"

# Maneuvers, estimates and fits come next: see the pipelines that come with the program for complete examples, and
# `koehler schema pipeline` for every key.
"##;

pub(super) const AIRCRAFT: &str = r#"# Constants of the aircraft, by the names that the models use, in SI units. None has a default.
# sd is the uncertainty (one standard deviation) of the value; source says where it comes from.
#
# m   = { value = 0.0, unit = "kg",     sd = 0.0, source = "" }    # mass
# I_x = { value = 0.0, unit = "kg m^2", sd = 0.0, source = "" }    # moments of inertia
# I_y = { value = 0.0, unit = "kg m^2", sd = 0.0, source = "" }
# I_z = { value = 0.0, unit = "kg m^2", sd = 0.0, source = "" }
# S   = { value = 0.0, unit = "m^2",    sd = 0.0, source = "" }    # wing area
# c   = { value = 0.0, unit = "m",      sd = 0.0, source = "" }    # mean chord
# b   = { value = 0.0, unit = "m",      sd = 0.0, source = "" }    # span
#
# For [reconstruct], in body axes from the centre of gravity (x forward, y right, z down):
# x_imu   = { value = 0.0, unit = "m", sd = 0.0, source = "" }    # inertial sensors
# y_imu   = { value = 0.0, unit = "m", sd = 0.0, source = "" }
# z_imu   = { value = 0.0, unit = "m", sd = 0.0, source = "" }
# x_alpha = { value = 0.0, unit = "m", sd = 0.0, source = "" }    # angle-of-attack vane
# y_alpha = { value = 0.0, unit = "m", sd = 0.0, source = "" }
# x_beta  = { value = 0.0, unit = "m", sd = 0.0, source = "" }    # sideslip vane
# z_beta  = { value = 0.0, unit = "m", sd = 0.0, source = "" }
# upwash  = { value = 0.0, unit = "-", sd = 0.0, source = "" }    # the alpha vane shows (1 + upwash) times the local angle
"#;
