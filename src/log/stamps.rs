//! Logs in; which time stamp counts in a starter campaign, and which others messages bear, out.

use super::decode::FieldInfo;
use super::flight::stamp_paths;
use super::inspect::Survey;
use std::fmt::Write;

/// Time stamps within messages that are named.
const SHOWN: usize = 5;

/// Which time stamp counts, and which others there are.
pub(super) fn of(surveys: &[Survey]) -> String {
    let topics = || surveys.iter().flat_map(|s| &s.topics);
    let (time, why) = if topics().any(|t| t.has_publish_time) {
        ("publish", "when a message was sent; \"log\" is when the recorder received it")
    } else {
        ("log", "when the recorder received a message; the logs have no other publish times")
    };
    let mut text = format!("# The time of a sample: {why}.\n");
    let mut own: Vec<String> = topics()
        .flat_map(|t| {
            let fields: Vec<FieldInfo> = t.fields.iter().map(|f| f.info.clone()).collect();
            // names may hold anything, and must not end the comment
            stamps(&fields).into_iter().map(|path| format!("{:?} {path:?}", t.topic))
        })
        .collect();
    own.sort();
    own.dedup();
    if !own.is_empty() {
        let more = if own.len() > SHOWN { ", ..." } else { "" };
        own.truncate(SHOWN);
        let _ = write!(
            text,
            "# Messages that bear a time stamp of their own, which is not used so: {}{more}.\n# It is taken by time = \"header.stamp\", say, here or in a signal; a stamp that is one number needs its time_unit.\n",
            own.join(", ")
        );
    }
    let _ = write!(text, "[defaults]\ntime = \"{time}\"\n");
    text
}

/// Names of fields that hold the time of a message.
const NAMES: [&str; 7] =
    ["stamp", "timestamp", "timestampns", "timestampus", "timeus", "timens", "utime"];

/// The time stamps that messages with these fields bear: of two fields (`header.stamp`), or one number.
fn stamps(fields: &[FieldInfo]) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for field in fields {
        let (above, last) = field.path.rsplit_once('.').unwrap_or(("", &field.path));
        let plain: String = last.to_lowercase().chars().filter(|c| c.is_alphanumeric()).collect();
        let of_two = !above.is_empty() && stamp_paths(above, None, fields).len() == 2;
        let stamp = match (of_two, NAMES.contains(&plain.as_str())) {
            (true, _) => above,
            (false, true) => field.path.as_str(),
            (false, false) => continue,
        };
        if !found.iter().any(|known| known == stamp) {
            found.push(stamp.to_string());
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stamps_within_messages_are_recognised() {
        let paths =
            ["header.stamp.sec", "header.stamp.nanosec", "x", "time_us", "age.sec", "s.stamp"];
        let field = |path: &str| FieldInfo { path: path.into(), ..FieldInfo::default() };
        assert_eq!(stamps(&paths.map(field)), ["header.stamp", "time_us", "s.stamp"]);
    }
}
