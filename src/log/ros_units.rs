//! The type of a ROS message and the path of one of its fields in; the unit that ROS prescribes for it
//! out.
//!
//! Definitions of messages name no units in a form that can be read; REP 103 (standard units of measure)
//! and the comments of the definitions do. Only the packages that they speak of are known here.

/// What a type ends with (any if empty), what a path ends with, and the unit; the first that fits counts.
const UNITS: [(&str, &str, &str); 22] = [
    ("NavSatFix", "latitude", "deg"),
    ("NavSatFix", "longitude", "deg"),
    ("NavSatFix", "altitude", "m"),
    ("FluidPressure", "fluid_pressure", "Pa"),
    ("Temperature", "temperature", "degC"),
    ("Range", "range", "m"),
    ("", "angular_velocity.*", "rad/s"),
    ("", "linear_acceleration.*", "m/s^2"),
    ("Accel", "linear.*", "m/s^2"),
    ("AccelStamped", "linear.*", "m/s^2"),
    ("Accel", "angular.*", "rad/s^2"),
    ("AccelStamped", "angular.*", "rad/s^2"),
    ("", "twist.linear.*", "m/s"),
    ("", "twist.angular.*", "rad/s"),
    ("Twist", "linear.*", "m/s"),
    ("Twist", "angular.*", "rad/s"),
    ("", "force.*", "N"),
    ("", "torque.*", "N m"),
    ("", "position.*", "m"),
    ("", "translation.*", "m"),
    ("", "orientation.*", "-"),
    ("", "rotation.*", "-"),
];

/// Packages whose messages keep to REP 103.
const PACKAGES: [&str; 3] = ["geometry_msgs/", "nav_msgs/", "sensor_msgs/"];

/// The unit of a field of a message of this type (`geometry_msgs/msg/PoseStamped`); none where nothing
/// is prescribed.
pub(super) fn of(schema: &str, path: &str) -> Option<&'static str> {
    if !PACKAGES.iter().any(|package| schema.starts_with(package)) {
        return None;
    }
    let kind = schema.rsplit('/').next().unwrap_or_default();
    // `position.x` is one of `position.*`
    let axis = |path: &str, group: &str| {
        let of = path.rsplit_once('.').filter(|(_, last)| ["x", "y", "z", "w"].contains(last));
        of.is_some_and(|(before, _)| is_end(before, group))
    };
    let fits = |(end, field, _): &&(&str, &str, &str)| {
        (end.is_empty() || kind == *end)
            && match field.strip_suffix(".*") {
                Some(group) => axis(path, group),
                None => is_end(path, field),
            }
    };
    UNITS.iter().find(fits).map(|(.., unit)| *unit)
}

/// Whether a path is this one, or ends with it behind a point.
fn is_end(path: &str, end: &str) -> bool {
    path.strip_suffix(end).is_some_and(|before| before.is_empty() || before.ends_with('.'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Unit;

    #[test]
    fn units_are_those_that_ros_prescribes() {
        let pose = "geometry_msgs/msg/PoseStamped";
        assert_eq!(of(pose, "pose.position.x"), Some("m"));
        assert_eq!(of(pose, "pose.orientation.w"), Some("-"));
        assert_eq!(of(pose, "header.stamp.sec"), None);
        assert_eq!(of("sensor_msgs/msg/Imu", "angular_velocity.y"), Some("rad/s"));
        assert_eq!(of("sensor_msgs/msg/Imu", "linear_acceleration.z"), Some("m/s^2"));
        assert_eq!(of("geometry_msgs/msg/Twist", "angular.z"), Some("rad/s"));
        assert_eq!(of("geometry_msgs/msg/AccelStamped", "accel.linear.x"), Some("m/s^2"));
        assert_eq!(of("nav_msgs/msg/Odometry", "twist.twist.linear.x"), Some("m/s"));
        assert_eq!(of("my_msgs/msg/Pose", "position.x"), None);
        assert!(UNITS.iter().all(|(.., unit)| Unit::parse(unit).is_ok()));
    }
}
