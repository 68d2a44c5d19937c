//! `docs/first-estimate.md` as a new user follows it: its files are written as they stand there, its commands
//! are run on flights of a short period that is known, and what comes out is that.

use crate::campaign::Campaign;
use koehler::simulate::Stream;
use std::fmt::Write;

const PAGE: &str = include_str!("../../docs/first-estimate.md");

/// `Z_alpha`, `Z_delta`, `M_alpha`, `M_q_hat`, `M_delta` of the aircraft that flies.
const TRUTH: [(&str, f64); 5] = [
    ("Z_alpha", -1.3),
    ("Z_delta", -0.12),
    ("M_alpha", -6.0),
    ("M_q_hat", -210.0),
    ("M_delta", -10.0),
];
const CHORD: f64 = 1.6;

/// A flight with six maneuvers, as its data system writes it.
fn flight(seed: u64) -> String {
    const DT: f64 = 0.005;
    let mut noise = Stream::new(seed, &["noise"]);
    let speed = 78.0 + 4.0 * seed as f64;
    // 3-2-1-1 of half a second, by turns up and down, every 15 s.
    let elevator = |t: f64| -> f64 {
        let (maneuver, since) = (libm::floor((t - 5.0) / 15.0), (t - 5.0) % 15.0);
        let sign = if maneuver as i64 % 2 == 0 { 1.0 } else { -1.0 };
        let step = if t < 5.0 || maneuver > 5.0 {
            0.0
        } else {
            match since {
                s if s < 1.5 => 1.0,
                s if s < 2.5 => -1.0,
                s if s < 3.0 => 1.0,
                s if s < 3.5 => -1.0,
                _ => 0.0,
            }
        };
        sign * step * 0.03
    };
    let rates = |[alpha, q]: [f64; 2], delta: f64| {
        let [z_alpha, z_delta, m_alpha, m_q, m_delta] = TRUTH.map(|(_, value)| value);
        [
            q + z_alpha * alpha + z_delta * delta,
            m_alpha * alpha + m_q * q * CHORD / (2.0 * speed) + m_delta * delta,
        ]
    };
    let along = |x: [f64; 2], dx: [f64; 2], h: f64| [x[0] + h * dx[0], x[1] + h * dx[1]];
    let mut text = "time_s,elevator_deg,aoa_deg,pitch_rate_dps,tas_kt\n".to_string();
    let mut x = [0.0, 0.0];
    for k in 0..20_000 {
        let t = f64::from(k) * DT;
        if k % 4 == 0 {
            let mut measured = |value: f64, sd: f64| value + sd * noise.normal();
            let (alpha, q) = (measured(x[0], 0.001), measured(x[1], 0.001));
            let tas = measured(speed, 0.1);
            // Trimmed at 4 deg of alpha and -1 deg of elevator.
            let row = [
                elevator(t).to_degrees() - 1.0,
                alpha.to_degrees() + 4.0,
                q.to_degrees(),
                tas / 0.514_444_444,
            ];
            let _ = write!(text, "{t:.2}");
            for value in row {
                let _ = write!(text, ",{value:.6}");
            }
            text.push('\n');
        }
        // The surface moves between two samples as it does on a straight line between them.
        let at = |t: f64| {
            let (from, share) =
                (libm::floor(t / 0.02 + 1e-9), t / 0.02 - libm::floor(t / 0.02 + 1e-9));
            (1.0 - share) * elevator(from * 0.02) + share * elevator((from + 1.0) * 0.02)
        };
        let k1 = rates(x, at(t));
        let k2 = rates(along(x, k1, DT / 2.0), at(t + DT / 2.0));
        let k3 = rates(along(x, k2, DT / 2.0), at(t + DT / 2.0));
        let k4 = rates(along(x, k3, DT), at(t + DT));
        x = std::array::from_fn(|i| x[i] + DT / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    text
}

#[test]
fn the_page_leads_from_text_files_to_an_estimate() {
    let c = Campaign { folder: tempfile::tempdir().expect("a temporary folder") };
    let blocks = PAGE.split("```toml\n# ").skip(1).filter_map(|b| b.split("```").next());
    let mut files = 0;
    for block in blocks {
        let (name, text) = block.split_once('\n').expect("a file");
        c.write(name, text);
        files += 1;
    }
    assert_eq!(files, 5);
    std::fs::create_dir(c.path("data")).expect("a folder");
    for seed in [1, 2] {
        c.write(&format!("data/flight-{seed}.csv"), &flight(seed));
    }
    for line in PAGE.lines().filter_map(|line| line.strip_prefix("    koehler ")) {
        let quoted: Vec<&str> = line.split('"').collect();
        let mut words: Vec<&str> = quoted[0].split_whitespace().collect();
        words.extend(quoted.get(1));
        let run = c.command(words[0], &words[1..]).ended(0);
        if words[0] == "sql" {
            assert!(run.out.contains("M_delta"), "{}", run.out);
        }
    }
    let query = "SELECT parameter, value, sd FROM estimates WHERE segment IS NULL";
    let rows = c.koehler("sql", &[query, "--csv"]).ended(0).out;
    for (name, truth) in TRUTH {
        let row = rows.lines().find_map(|line| line.strip_prefix(&format!("{name},")));
        let (value, sd) = row.and_then(|row| row.split_once(',')).expect("a row");
        let (value, sd) = (value.parse::<f64>().expect("one"), sd.parse::<f64>().expect("one"));
        assert!((value - truth).abs() < 4.0 * sd, "{name}: {value} +- {sd}, {truth} is true");
        assert!(sd < 0.2 * truth.abs(), "{name}: {sd}");
    }
    let validated = c.koehler("sql", &["SELECT segment, output, theil FROM validation", "--csv"]);
    assert!(validated.ended(0).out.lines().count() > 10);
}
