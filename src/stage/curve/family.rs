//! The settings of a `[[curve]]` and the groups of its estimate come in; what tells one of its curves from another goes
//! out.

use super::config::Config;
use indexmap::IndexMap;

/// The curves of one setting of everything but the input along which they are drawn.
pub struct Family<'c> {
    pub group: &'c str,
    /// The level of the parameters that have a value for each.
    pub level: Option<f64>,
    pub at: &'c IndexMap<String, f64>,
    /// Both in words.
    pub label: String,
}

/// All of them.
pub fn families<'c>(config: &'c Config, groups: &[&'c str]) -> Vec<Family<'c>> {
    let mut all = Vec::new();
    for group in groups {
        for level in config.levels_or_none() {
            for at in config.settings.all_at() {
                let label = config.label(level, at);
                all.push(Family { group, level, at, label });
            }
        }
    }
    all
}
