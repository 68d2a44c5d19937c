//! Trials that ended in; lines of a file, and the confusion matrix with the figures that the
//! requirements speak of, out.

use std::collections::BTreeMap;
use std::fmt::Write;

/// How a trial ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum End {
    /// The truth, or a class of at most three with the truth in it, and nothing else.
    Right,
    /// A class with the truth in it that is larger.
    Broad,
    /// Located but unexplained.
    Located,
    /// Nothing missing.
    Nothing,
    /// A name that is not the truth.
    Wrong,
    /// No verdict.
    None,
    /// The size wanted cannot be flown.
    Unflown,
}

const ENDS: [(End, &str); 7] = [
    (End::Right, "right"),
    (End::Broad, "class > 3"),
    (End::Located, "located"),
    (End::Nothing, "nothing"),
    (End::Wrong, "wrong"),
    (End::None, "no verdict"),
    (End::Unflown, "unflown"),
];

pub fn word(end: End) -> &'static str {
    ENDS.iter().find(|e| e.0 == end).map_or("", |e| e.1)
}

/// What is hidden in a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Inside,
    Outside,
    Nothing,
}

const KINDS: [(Kind, &str); 3] =
    [(Kind::Inside, "inside"), (Kind::Outside, "outside"), (Kind::Nothing, "nothing")];

/// One trial that ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub kind: Kind,
    pub hidden: String,
    pub seed: u64,
    pub turbulence: bool,
    pub size: f64,
    pub channel: String,
    pub end: End,
    /// Names that were given, "one then another", "one|like it".
    pub names: String,
    /// On one core.
    pub seconds: f64,
}

impl Row {
    /// As a line of tab-separated fields, without its end.
    pub fn line(&self) -> String {
        let kind = KINDS.iter().find(|k| k.0 == self.kind).map_or("", |k| k.1);
        let air = if self.turbulence { "turbulence" } else { "clear" };
        format!(
            "{kind}\t{}\t{}\t{air}\t{:.2}\t{}\t{}\t{}\t{:.1}",
            self.hidden,
            self.seed,
            self.size,
            self.channel,
            word(self.end),
            self.names,
            self.seconds
        )
    }

    pub fn parse(line: &str) -> Option<Row> {
        let fields: Vec<&str> = line.split('\t').collect();
        let [kind, hidden, seed, air, size, channel, end, names, seconds] = fields[..] else {
            return None;
        };
        Some(Row {
            kind: KINDS.iter().find(|k| k.1 == kind)?.0,
            hidden: hidden.to_string(),
            seed: seed.parse().ok()?,
            turbulence: air == "turbulence",
            size: size.parse().ok()?,
            channel: channel.to_string(),
            end: ENDS.iter().find(|e| e.1 == end)?.0,
            names: names.to_string(),
            seconds: seconds.parse().ok()?,
        })
    }
}

/// Counts of the ends by what was hidden, with the seed, size and names of every trial that did not
/// end as it should.
pub fn table(rows: &[Row]) -> String {
    let mut groups: Vec<(&str, BTreeMap<End, usize>, Vec<String>)> = Vec::new();
    let mut order: Vec<&Row> = rows.iter().collect();
    order.sort_by_key(|r| (r.kind as usize, r.seed));
    for row in order {
        let at = groups.iter().position(|g| g.0 == row.hidden).unwrap_or_else(|| {
            groups.push((&row.hidden, BTreeMap::new(), Vec::new()));
            groups.len() - 1
        });
        *groups[at].1.entry(row.end).or_default() += 1;
        let expected = match row.kind {
            Kind::Inside => End::Right,
            Kind::Outside => End::Located,
            Kind::Nothing => End::Nothing,
        };
        if row.end != expected {
            let end = word(row.end);
            groups[at].2.push(
                format!("#{} {:.1} {end} {}", row.seed, row.size, row.names).trim_end().to_string(),
            );
        }
    }
    let mut text = format!("{:<38}", "hidden");
    ENDS.iter().for_each(|(_, name)| text += &format!("{name:>11}"));
    for (name, counts, notes) in groups {
        let _ = write!(text, "\n{name:<38}");
        ENDS.iter().for_each(|(end, _)| {
            text += &format!("{:>11}", counts.get(end).map_or(String::new(), usize::to_string))
        });
        let _ = write!(text, "   {}", notes.join("; "));
    }
    text
}

/// The figures that the requirements speak of: together, and by the air.
pub fn totals(rows: &[Row]) -> String {
    let mut text = of_air(rows.iter().collect());
    for (turbulence, air) in [(false, "in clear air"), (true, "in turbulence")] {
        let _ = write!(
            text,
            "\n{air}:\n  {}",
            of_air(rows.iter().filter(|r| r.turbulence == turbulence).collect())
                .replace('\n', "\n  ")
        );
    }
    let mut seconds: Vec<f64> = rows.iter().map(|r| r.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    let (middle, most) =
        (seconds.get(seconds.len() / 2).unwrap_or(&0.0), seconds.last().unwrap_or(&0.0));
    let _ = write!(
        text,
        "\n{} trials; one takes {middle:.1} s of one core (median), {most:.1} s at most (20 required), {:.0} s in sum",
        rows.len(),
        seconds.iter().sum::<f64>()
    );
    text
}

fn of_air(rows: Vec<&Row>) -> String {
    let count = |kind: Kind, is: &dyn Fn(&Row) -> bool| {
        rows.iter().filter(|r| r.kind == kind && is(r)).count()
    };
    let share = |kind: Kind, ends: &[End]| {
        // Sizes come out within 15% of what was wanted, which is 1 at least.
        let counts = |r: &Row| r.end != End::Unflown && (kind == Kind::Nothing || r.size >= 0.84);
        let (part, all) =
            (count(kind, &|r| counts(r) && ends.contains(&r.end)), count(kind, &counts));
        format!("{part} of {all} ({:.1}%)", 100.0 * part as f64 / all.max(1) as f64)
    };
    format!(
        "inside the library: right {} (required 90%), wrong {} (at most 3%)\n\
         nothing hidden: named {} (at most 2%), located {}\n\
         outside the library: located {} (required 90%), wrong {} (at most 5%)",
        share(Kind::Inside, &[End::Right]),
        share(Kind::Inside, &[End::Wrong]),
        share(Kind::Nothing, &[End::Right, End::Broad, End::Wrong]),
        share(Kind::Nothing, &[End::Located]),
        share(Kind::Outside, &[End::Located]),
        share(Kind::Outside, &[End::Right, End::Broad, End::Wrong])
    )
}
