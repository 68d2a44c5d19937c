//! One estimate of one maneuver, with what is known of the maneuver: what `repeats` compares.

use super::trim::Trim;

/// One maneuver's estimate of one parameter.
#[derive(Debug, Clone)]
pub struct One<'a> {
    pub parameter: &'a str,
    pub unit: &'a str,
    pub segment: &'a str,
    pub value: f64,
    pub sd: f64,
    pub trim: Option<&'a Trim>,
    pub flight: Option<&'a str>,
    pub input: Option<&'a str>,
    pub kind: Option<&'a str>,
}

impl<'a> One<'a> {
    /// How it was flown: flight, input and kind.
    pub fn flown(&self) -> [Option<&'a str>; 3] {
        [self.flight, self.input, self.kind]
    }
}
