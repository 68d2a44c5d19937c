//! Settings that no machine could work with, or that nobody can mean: `check` tells all of them at once,
//! with file, line, what is wanted and what is there.

use crate::campaign::Campaign;

#[test]
fn fault_settings_beyond_all_measure_are_told_at_once_with_their_lines() {
    let c = Campaign::new();
    c.edit("pipeline.toml", "against = \"V\"", "against = \"V\"\npoints = 1000000000");
    c.edit(
        "pipeline.toml",
        "kinds = [\"3211\"]",
        "kinds = [\"3211\"]\npre_s = 1e300\npost_s = 4000.0\npreroll_s = 1e9\nsettle_s = 1e9\nsubsteps = 1000000000\nsamples_memory_mib = 9000000000000000000\n[estimate.method]\nmax_ar_order = 1000000000000\nprofile = [\"T\"]\nprofile_level = 7.0\nmax_iterations = 1000000000000\nsmoothing_s = 1e300",
    );
    c.edit(
        "pipeline.toml",
        "[report]",
        "[[diagnose]]\nestimate = \"lag\"\nmethod = { surrogates = 1000000000000 }\n[[validate]]\nestimate = \"lag\"\npre_s = 1e9\n[ingest]\nchunk_memory_mib = 9000000000000000000\n[report]",
    );
    c.edit("channels.toml", "unit = \"m/s\"", "unit = \"m/s\"\ndelay = 40.0");
    let run = c.koehler("check", &[]).ended(2);
    for (key, wanted) in [
        ("points", "at most 10000, not 1000000000"),
        ("pre_s", "at most 3600, not 1e300"),
        ("post_s", "at most 3600, not 4000.0"),
        ("preroll_s", "at most 3600"),
        ("settle_s", "at most 3600"),
        ("substeps", "at most 256, not 1000000000"),
        ("samples_memory_mib", "at most 1048576"),
        ("chunk_memory_mib", "at most 1048576, not 9000000000000000000"),
        ("max_ar_order", "at most 1000, not 1000000000000"),
        ("profile_level", "less than 1, not 7.0"),
        ("max_iterations", "at most 100000"),
        ("smoothing_s", "at most 60, not 1e300"),
        ("surrogates", "at most 100000, not 1000000000000"),
        ("validate.0.pre_s", "at most 3600"),
        ("signal.V.delay", "at most 10, not 40.0"),
    ] {
        let is_it = |line: &&str| line.contains(&format!("{key}\" must be {wanted}"));
        let line = run.err.lines().find(is_it);
        let line = line.unwrap_or_else(|| panic!("{key}: {wanted} is not in\n{}", run.err));
        let file = if key.ends_with("delay") { "channels.toml:" } else { "pipeline.toml:" };
        assert!(line.starts_with(&format!("error: {file}")), "{line}");
    }
}

#[test]
fn fault_windows_without_length_are_told() {
    let c = Campaign::new();
    let (text, _) = crate::campaign::PIPELINE.split_once("[[fit]]").expect("a fit");
    let windows = text.replace("input = \"drive\"\nkinds = [\"3211\"]", "window_s = 1e-300");
    c.write("pipeline.toml", &windows);
    let run = c.koehler("check", &[]).ended(2);
    let wanted = "a record is cut into segments of 0.1 s or more, not 0.000";
    assert!(run.err.contains("pipeline.toml:17:12: ") && run.err.contains(wanted), "{}", run.err);
}

#[test]
fn fault_a_delay_that_is_no_delay_is_told_by_every_way_into_a_model() {
    let told = |start: &str, tau: &str| {
        let c = Campaign::new();
        let parameter =
            format!("[parameters]\ntau = {{ unit = \"s\", start = {start}, min = 0.0 }}");
        c.edit("lag.model.toml", "[parameters]", &parameter);
        c.edit("lag.model.toml", "(K*u - x)/T", &format!("(K*delay(u, {tau}) - x)/T"));
        c.koehler("check", &[])
    };
    let wanted = "a delay is at most 10 s, this one is 40 s";
    let run = told("40.0", "tau").ended(2);
    assert!(run.err.contains("lag.model.toml:14:") && run.err.contains(wanted), "{}", run.err);
    let c = Campaign::new();
    let known = "[constants]\ntau = { unit = \"s\", value = 40.0 }\n\n[parameters]";
    c.edit("lag.model.toml", "[parameters]", known);
    c.edit("lag.model.toml", "(K*u - x)/T", "(K*delay(u, tau) - x)/T");
    let run = c.koehler("check", &[]).ended(2);
    assert!(run.err.contains(wanted), "{}", run.err);
    told("0.3", "tau").ended(0);
}
