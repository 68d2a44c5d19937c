//! A kinematic model and the signals of its inputs and outputs in; the outputs that are not to be
//! compared with theirs, and why, out.
//!
//! An output that is compared with the signal that drives it compares a sensor with itself: any
//! bias fits, the best one is zero, and it looks very well known. And a signal that was given to
//! one output (the angle of attack at a vane) says nothing new of another one that happens to have
//! its name (the angle of attack at the centre of gravity).

use super::settings::{Settings, signal_of};
use crate::model::Model;
use crate::model::graph::Leaf;

/// Why an output is not compared with a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken {
    /// By this input, which drives the model.
    Input(usize),
    /// By this other output.
    Output(usize),
}

/// An output that is not compared with the signal that has its name, or is mapped to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Apart {
    pub output: usize,
    pub taken: Taken,
    /// The settings map this signal to this output by name.
    pub asked: bool,
}

/// The outputs whose signals are taken; `same` tells whether two names of signals are one
/// measurement.
pub fn apart(model: &Model, settings: &Settings, same: impl Fn(&str, &str) -> bool) -> Vec<Apart> {
    let leaves = model
        .graph
        .leaves(&model.rates.iter().chain(&model.output_nodes).copied().collect::<Vec<_>>());
    // an input that only begins the states (the attitude of a quaternion) drives nothing
    let drives =
        |i: usize| leaves.contains(&Leaf::Input(i)) || leaves.contains(&Leaf::InputRate(i));
    let asked = |output: usize| settings.signals.contains_key(&model.outputs[output].name);
    let of = |output: usize| signal_of(settings, &model.outputs[output].name);
    let one = |output: usize| {
        let input = (0..model.inputs.len())
            .find(|&i| drives(i) && same(signal_of(settings, &model.inputs[i].name), of(output)));
        let first = |&other: &usize| {
            other != output && (asked(other) || other < output) && same(of(other), of(output))
        };
        let other = || (0..model.outputs.len()).find(first).filter(|_| !asked(output));
        let taken = input.map(Taken::Input).or_else(|| other().map(Taken::Output))?;
        Some(Apart { output, taken, asked: asked(output) })
    };
    (0..model.outputs.len()).filter_map(one).collect()
}

/// What is said of outputs that are not compared, by their names.
pub fn words(model: &Model, apart: &[Apart]) -> String {
    let inputs: Vec<&str> = apart
        .iter()
        .filter(|a| matches!(a.taken, Taken::Input(_)))
        .map(|a| model.outputs[a.output].name.as_str())
        .collect();
    let others = apart.iter().filter_map(|a| match a.taken {
        Taken::Output(other) => {
            Some(format!("{} (as {})", model.outputs[a.output].name, model.outputs[other].name))
        }
        Taken::Input(_) => None,
    });
    let others: Vec<String> = others.collect();
    let mut parts = Vec::new();
    if !inputs.is_empty() {
        parts.push(format!("their signals drive the kinematics: {}", inputs.join(", ")));
    }
    if !others.is_empty() {
        parts.push(format!("their signals are compared already: {}", others.join(", ")));
    }
    format!("outputs not compared with a signal, because {}", parts.join("; "))
}

#[cfg(test)]
mod tests {
    use super::super::tests::embedded;
    use super::*;

    fn names(settings: &Settings, model: &Model, same: impl Fn(&str, &str) -> bool) -> Vec<String> {
        let word = |a: &Apart| match a.taken {
            Taken::Input(i) => {
                format!("{} is {}", model.outputs[a.output].name, model.inputs[i].name)
            }
            Taken::Output(o) => {
                format!("{} is {}", model.outputs[a.output].name, model.outputs[o].name)
            }
        };
        apart(model, settings, same).iter().map(word).collect()
    }

    fn mapped(pairs: &[(&str, &str)]) -> Settings {
        let signals = pairs.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect();
        Settings { signals, ..Settings::default() }
    }

    #[test]
    fn a_signal_that_drives_or_is_given_to_another_output_is_taken() {
        let model = embedded("kinematics");
        let same = |a: &str, b: &str| a == b;
        assert!(names(&Settings::default(), &model, same).is_empty());
        let natural = mapped(&[("ax_imu", "ax"), ("q_imu", "q"), ("alpha_vane", "alpha")]);
        assert_eq!(
            names(&natural, &model, same),
            ["alpha is alpha_vane", "q is q_imu", "ax is ax_imu"]
        );
        // two names of the channel map for one field of the log
        let alias = |a: &str, b: &str| a == b || [a, b] == ["q_imu", "q"];
        assert_eq!(names(&Settings::default(), &model, alias), ["q is q_imu"]);
        let asked = mapped(&[("ax_imu", "nx"), ("ax", "nx")]);
        assert_eq!(apart(&model, &asked, same).iter().map(|a| a.asked).collect::<Vec<_>>(), [true]);
    }

    #[test]
    fn attitude_that_only_begins_a_quaternion_is_compared() {
        let text = "title = \"loops\"\nuse = [\"path_imu\", \"path_air\", \"path_quaternion\", \"path_altitude\", \"path_flat_earth\", \
                    \"path_vanes\", \"path_outputs\"]\n[inputs]\ntemperature = { unit = \"K\" }\n[constants]\nx_cg = { unit = \"m\", value = 0.0 }\n\
                    y_cg = { unit = \"m\", value = 0.0 }\nz_cg = { unit = \"m\", value = 0.0 }\n[equations]\nT_air = \"temperature\"\n";
        let model = super::super::tests::from_fragments("loops", text);
        assert!(names(&Settings::default(), &model, |a, b| a == b).is_empty());
    }
}
