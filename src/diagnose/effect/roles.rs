//! A model in; which of its quantities, surfaces, sensors and coefficients fill a role that an
//! effect asks for, out.
//!
//! Names tell, together with units; a name in the pipeline file's `roles` tells where they do not.

use std::collections::BTreeMap;

use super::context::Context;
use crate::model::{Model, Quantity};
use crate::units::{Dim, Unit};

/// Something of a model that fills a role.
#[derive(Debug, Clone, PartialEq)]
pub struct Bound {
    /// As expressions, `add` and `replace` name it: `q`, `rate(q)`, `output(alpha)`,
    /// `((eta_L + eta_R)/2)`.
    pub text: String,
    /// As it stands in names: `q`, `qdot`, `alpha`, `eta`.
    pub ident: String,
    pub unit: String,
    /// What belongs to it: `left` and `right` of a pair, `position` and `acceleration` of a hinge.
    pub fields: BTreeMap<&'static str, String>,
}

impl Bound {
    fn new(text: &str, ident: &str, unit: &str) -> Bound {
        Bound { text: text.into(), ident: ident.into(), unit: unit.into(), fields: BTreeMap::new() }
    }

    fn with(mut self, field: &'static str, text: &str) -> Bound {
        self.fields.insert(field, text.into());
        self
    }
}

/// How a role is found.
enum Find {
    /// The first name with that dimension among inputs, states and equations.
    Value(&'static str, &'static [&'static str]),
    /// The first coefficient (an equation without unit) of these names; without one, the
    /// acceleration of a role.
    Coefficient(&'static [&'static str], &'static str),
    /// The first coefficient of these names.
    Named(&'static [&'static str]),
    /// The rate of the state that fills a role: an equation where the state's line is just a name.
    Acceleration(&'static str),
    /// The first constant of the model or of the aircraft file with that dimension.
    Constant(&'static str, &'static [&'static str]),
    /// The first constant that the model itself reads, with that dimension.
    OwnConstant(&'static str, &'static [&'static str]),
    /// The first output of these names.
    Output(&'static str, &'static [&'static str]),
    /// All outputs of these names.
    Outputs(&'static str, &'static [&'static str]),
    /// All roles of a list.
    Any(&'static [&'static str]),
    /// All of a kind.
    List(fn(&Model) -> Vec<Bound>),
}

use Find::*;

const ELEVATORS: &[&str] = &["delta_e", "de", "elevator", "elev", "delta_elevator"];
const AILERONS: &[&str] = &["xi", "delta_a", "da", "aileron", "ail", "delta_aileron"];
const RUDDERS: &[&str] = &["zeta", "delta_r", "dr", "rudder", "rud", "delta_rudder"];
const SPEEDS: &[&str] = &["V", "tas", "V_tas", "airspeed", "true_airspeed", "VT"];
const ALPHAS: &[&str] = &["alpha", "alf", "aoa", "alpha_vane"];
const BETAS: &[&str] = &["beta", "sideslip", "beta_vane"];

const FLOW: &[&str] = &["alpha", "beta", "alf", "aoa", "sideslip", "alpha_vane", "beta_vane"];

/// Role, how it is found, and what it means.
const ROLES: &[(&str, Find, &str)] = &[
    ("airspeed", Value("m/s", SPEEDS), "true airspeed"),
    ("alpha", Value("rad", ALPHAS), "angle of attack"),
    ("beta", Value("rad", BETAS), "sideslip"),
    ("roll-rate", Value("rad/s", &["p", "p_cg"]), "roll rate"),
    ("pitch-rate", Value("rad/s", &["q", "q_cg"]), "pitch rate"),
    ("yaw-rate", Value("rad/s", &["r", "r_cg"]), "yaw rate"),
    ("bank", Value("rad", &["phi"]), "angle of bank"),
    ("pitch", Value("rad", &["theta", "the"]), "pitch attitude"),
    ("heading", Value("rad", &["psi"]), "heading"),
    ("altitude", Value("m", &["h", "altitude"]), "altitude"),
    ("mach", Value("-", &["Mach", "Ma", "mach"]), "Mach number"),
    ("qbar", Value("Pa", &["qbar", "q_dyn", "dynamic_pressure"]), "dynamic pressure"),
    ("thrust", Value("N", &["thrust", "F_T", "F_thrust"]), "thrust"),
    (
        "lift",
        Coefficient(&["C_L", "CL", "C_Z", "CZ"], "alpha"),
        "lift coefficient, or the rate of alpha",
    ),
    (
        "drag",
        Coefficient(&["C_D", "CD", "C_X", "CX"], "airspeed"),
        "drag coefficient, or the rate of airspeed",
    ),
    (
        "side-force",
        Coefficient(&["C_Y", "CY"], "beta"),
        "side force coefficient, or the rate of sideslip",
    ),
    (
        "roll-moment",
        Coefficient(&["C_l", "Cl"], "roll-rate"),
        "rolling moment coefficient, or roll acceleration",
    ),
    (
        "pitch-moment",
        Coefficient(&["C_m", "Cm", "CM"], "pitch-rate"),
        "pitching moment coefficient, or pitch acceleration",
    ),
    (
        "yaw-moment",
        Coefficient(&["C_n", "Cn", "CN"], "yaw-rate"),
        "yawing moment coefficient, or yaw acceleration",
    ),
    (
        "condition",
        Any(&["alpha", "airspeed", "mach"]),
        "each of angle of attack, airspeed and Mach number",
    ),
    (
        "longitudinal",
        Any(&["lift", "drag", "pitch-moment"]),
        "each of lift, drag and pitching moment",
    ),
    (
        "lateral",
        Any(&["side-force", "roll-moment", "yaw-moment"]),
        "each of side force, rolling and yawing moment",
    ),
    ("lift-coefficient", Named(&["C_L", "CL"]), "lift coefficient"),
    ("drag-coefficient", Named(&["C_D", "CD"]), "drag coefficient"),
    ("lateral-rate", Any(&["roll-rate", "yaw-rate"]), "each of roll and yaw rate"),
    ("hinge-moment-total", List(hinge_moments), "each sum of hinge moment coefficients"),
    (
        "surface-sensor",
        List(surface_sensors),
        "each measured position of a surface that moves by itself",
    ),
    ("speed-rate", Acceleration("airspeed"), "rate of airspeed"),
    ("alpha-rate", Acceleration("alpha"), "rate of the angle of attack"),
    ("roll-acceleration", Acceleration("roll-rate"), "roll acceleration"),
    ("pitch-acceleration", Acceleration("pitch-rate"), "pitch acceleration"),
    ("yaw-acceleration", Acceleration("yaw-rate"), "yaw acceleration"),
    (
        "angular-acceleration",
        Any(&["roll-acceleration", "pitch-acceleration", "yaw-acceleration"]),
        "each of these",
    ),
    (
        "tail-arm",
        Constant("m", &["r_H", "l_h", "l_t", "l_H", "tail_arm"]),
        "distance between wing and tail",
    ),
    (
        "roll-inertia",
        Constant("kg m^2", &["I_x", "Ix", "I_xx", "Ixx"]),
        "moment of inertia about x",
    ),
    (
        "pitch-inertia",
        Constant("kg m^2", &["I_y", "Iy", "I_yy", "Iyy"]),
        "moment of inertia about y",
    ),
    ("yaw-inertia", Constant("kg m^2", &["I_z", "Iz", "I_zz", "Izz"]), "moment of inertia about z"),
    (
        "product-of-inertia",
        OwnConstant("kg m^2", &["I_xz", "Ixz", "I_zx", "Izx"]),
        "product of inertia in the plane of symmetry",
    ),
    ("mass", Constant("kg", &["m", "mass"]), "mass"),
    ("surface", List(surfaces), "each control surface"),
    ("elevator", Value("rad", ELEVATORS), "elevator"),
    ("aileron", Value("rad", AILERONS), "aileron"),
    ("rudder", Value("rad", RUDDERS), "rudder"),
    (
        "longitudinal-control",
        List(longitudinal),
        "elevator and each surface or mean of a left and right pair that is no aileron or rudder",
    ),
    (
        "lateral-control",
        List(lateral),
        "aileron, rudder, and the difference of each left and right pair",
    ),
    ("pair", List(pairs), "each left and right pair of surfaces, with .left and .right"),
    ("drive", List(drives), "each servo current, voltage, torque or force"),
    (
        "control-load",
        Value("m/s^2", &["az_bw", "az_bob", "az", "a_z"]),
        "specific force along z at a weight in the controls, else at the centre of gravity",
    ),
    (
        "hinge",
        List(hinges),
        "each surface that moves by itself: its velocity, with .position and .acceleration",
    ),
    (
        "actuator",
        List(actuators),
        "each measured surface that follows its command in one state, with .rate",
    ),
    ("input", List(inputs), "each input"),
    (
        "motion-input",
        List(motion_inputs),
        "each input that is an angle or a rate of the aircraft's motion",
    ),
    ("sensor", List(sensors), "each output"),
    ("instrument", List(instruments), "each output that is no flow vane"),
    (
        "rate-sensor",
        Outputs("rad/s", &["p", "q", "r", "p_imu", "q_imu", "r_imu"]),
        "each rate gyro",
    ),
    (
        "accelerometer",
        Outputs("m/s^2", &["ax", "ay", "az", "ax_imu", "ay_imu", "az_imu"]),
        "each accelerometer",
    ),
    ("longitudinal-accelerometer", Output("m/s^2", &["ax", "ax_imu"]), "accelerometer along x"),
    ("lateral-accelerometer", Output("m/s^2", &["ay", "ay_imu"]), "accelerometer along y"),
    ("normal-accelerometer", Output("m/s^2", &["az", "az_imu"]), "accelerometer along z"),
    ("flow-sensor", Outputs("rad", FLOW), "each flow vane"),
    ("alpha-sensor", Output("rad", ALPHAS), "vane of the angle of attack"),
    ("beta-sensor", Output("rad", BETAS), "vane of sideslip"),
    ("airspeed-sensor", Output("m/s", SPEEDS), "airspeed"),
    ("attitude-sensor", Outputs("rad", &["phi", "theta", "psi"]), "each attitude angle"),
    ("roll-rate-sensor", Output("rad/s", &["p", "p_imu"]), "roll gyro"),
    ("pitch-rate-sensor", Output("rad/s", &["q", "q_imu"]), "pitch gyro"),
    ("yaw-rate-sensor", Output("rad/s", &["r", "r_imu"]), "yaw gyro"),
];

pub fn exists(role: &str) -> bool {
    ROLES.iter().any(|r| r.0 == role)
}

pub fn names() -> Vec<&'static str> {
    ROLES.iter().map(|r| r.0).collect()
}

/// Whether a role may stand for several things, each a binding of its own.
pub fn is_list(role: &str) -> bool {
    let found = ROLES.iter().find(|r| r.0 == role);
    found.is_some_and(|r| matches!(r.1, List(_) | Outputs(..) | Any(_)))
}

/// Role and meaning, for the documentation.
#[cfg(test)]
pub fn list() -> impl Iterator<Item = (&'static str, &'static str)> {
    ROLES.iter().map(|r| (r.0, r.2))
}

/// Whether a state is one of the aircraft's motion, by its name.
pub fn is_motion(state: &str) -> bool {
    const MOTION: [&str; 10] = [
        "airspeed",
        "alpha",
        "beta",
        "roll-rate",
        "pitch-rate",
        "yaw-rate",
        "bank",
        "pitch",
        "heading",
        "altitude",
    ];
    let of = |how: &Find| matches!(how, Value(_, names) if names.contains(&state));
    ROLES.iter().any(|(role, how, _)| MOTION.contains(role) && of(how))
}

pub fn meaning(role: &str) -> &'static str {
    ROLES.iter().find(|r| r.0 == role).map_or("", |r| r.2)
}

/// The SI unit of what fills a role; none where that is of several kinds.
pub fn unit(role: &str) -> Option<&'static str> {
    match ROLES.iter().find(|r| r.0 == role)?.1 {
        Value(unit, _)
        | Constant(unit, _)
        | OwnConstant(unit, _)
        | Output(unit, _)
        | Outputs(unit, _) => Some(unit),
        _ => None,
    }
}

/// Everything of the model that fills the role, in the model's order.
pub fn find(role: &str, model: &Model, context: &Context) -> Vec<Bound> {
    if let Some(names) = context.roles.get(role) {
        return names.iter().filter_map(|name| named(model, name)).collect();
    }
    let Some((_, how, _)) = ROLES.iter().find(|r| r.0 == role) else { return Vec::new() };
    let measured = |b: &Bound| {
        !b.text.starts_with("output(")
            || context.measured.is_empty()
            || context.measured.contains(&b.ident)
    };
    let mut found = found(how, model, context);
    found.retain(measured);
    found
}

fn found(how: &Find, model: &Model, context: &Context) -> Vec<Bound> {
    match how {
        Value(unit, names) => value(model, unit, names).into_iter().collect(),
        Coefficient(names, state) => coefficient(model, names)
            .or_else(|| rate_of(model, state, context))
            .into_iter()
            .collect(),
        Named(names) => coefficient(model, names).into_iter().collect(),
        Acceleration(state) => rate_of(model, state, context).into_iter().collect(),
        Constant(unit, names) => constant(model, unit, names).into_iter().collect(),
        OwnConstant(unit, names) => {
            let own = |b: &Bound| model.dims.contains_key(&b.text);
            constant(model, unit, names).into_iter().filter(own).collect()
        }
        Output(unit, names) => outputs(model, unit, names).into_iter().take(1).collect(),
        Outputs(unit, names) => outputs(model, unit, names),
        Any(roles) => roles.iter().flat_map(|r| find(r, model, context)).collect(),
        List(all) => all(model),
    }
}

fn dim(unit: &str) -> Option<Dim> {
    Unit::parse(unit).ok().map(|u| u.dim)
}

/// The unit of what the pipeline file gives to a role: an expression's name, or `output(name)`; none where
/// the model has nothing of that name.
pub fn unit_in(model: &Model, name: &str) -> Option<String> {
    named(model, name).map(|bound| bound.unit)
}

/// What a name of the pipeline file stands for: an expression's name, or an output.
fn named(model: &Model, name: &str) -> Option<Bound> {
    if let Some(output) = name.strip_prefix("output(").and_then(|n| n.strip_suffix(')')) {
        return model.output(output).map(|o| sensor(&model.outputs[o]));
    }
    model.dims.get(name).map(|_| Bound::new(name, name, &unit_of(model, name)))
}

/// The unit as declared, or as found for an equation.
fn unit_of(model: &Model, name: &str) -> String {
    let declared = model
        .inputs
        .iter()
        .chain(model.states.iter().map(|s| &s.quantity))
        .chain(model.constants.iter().map(|c| &c.quantity));
    let mut declared = declared.chain(model.parameters.iter().map(|p| &p.quantity));
    match declared.find(|q| q.name == name) {
        Some(q) => q.unit.clone(),
        None => model.dims.get(name).map_or("-".to_string(), Dim::to_string),
    }
}

fn value(model: &Model, unit: &str, names: &[&str]) -> Option<Bound> {
    let is_value = |n: &str| {
        model.input(n).is_some() || model.state(n).is_some() || model.equations.contains_key(n)
    };
    let name = names.iter().find(|n| is_value(n) && model.dims.get(**n).copied() == dim(unit))?;
    Some(Bound::new(name, name, unit))
}

fn coefficient(model: &Model, names: &[&str]) -> Option<Bound> {
    let is_coefficient =
        |n: &str| model.equations.contains_key(n) && model.dims.get(n) == Some(&Dim::NONE);
    names.iter().find(|n| is_coefficient(n)).map(|name| Bound::new(name, name, "-"))
}

/// Where the rate of a state is made.
fn rate_of(model: &Model, role: &str, context: &Context) -> Option<Bound> {
    let state = find(role, model, context).into_iter().find(|b| model.state(&b.text).is_some())?;
    Some(rate_line(model, &state.text))
}

fn rate_line(model: &Model, state: &str) -> Bound {
    let second = dim("s").unwrap_or(Dim::NONE);
    let unit = model.dims.get(state).map_or("1/s".into(), |d| d.over(second).to_string());
    let ident = format!("{state}dot");
    let line = model.files().find_map(|f| f.states.get(state)).map(|s| s.rate.trim());
    match line.filter(|line| model.equations.contains_key(*line)) {
        Some(equation) => Bound::new(equation, &ident, &unit),
        None => Bound::new(&format!("rate({state})"), &ident, &unit),
    }
}

fn constant(model: &Model, unit: &str, names: &[&str]) -> Option<Bound> {
    let of_model = |n: &str| {
        model.constants.iter().any(|c| c.quantity.name == n)
            && model.dims.get(n).copied() == dim(unit)
    };
    let of_aircraft = |n: &str| {
        let given = model.given().and_then(|g| g.0.get(n));
        given.is_some_and(|g| dim(&g.unit) == dim(unit)) && !model.dims.contains_key(n)
    };
    names.iter().find(|n| of_model(n) || of_aircraft(n)).map(|name| Bound::new(name, name, unit))
}

fn sensor(output: &Quantity) -> Bound {
    Bound::new(&format!("output({})", output.name), &output.name, &output.unit)
}

fn outputs(model: &Model, unit: &str, names: &[&str]) -> Vec<Bound> {
    let fits = |o: &&Quantity| names.contains(&o.name.as_str()) && dim(&o.unit) == dim(unit);
    model.outputs.iter().filter(fits).map(sensor).collect()
}

fn sensors(model: &Model) -> Vec<Bound> {
    model.outputs.iter().map(sensor).collect()
}

fn instruments(model: &Model) -> Vec<Bound> {
    model.outputs.iter().filter(|o| !FLOW.contains(&o.name.as_str())).map(sensor).collect()
}

fn inputs(model: &Model) -> Vec<Bound> {
    model.inputs.iter().map(|i| Bound::new(&i.name, &i.name, &i.unit)).collect()
}

/// Angles and rates that are measured and drive a model.
fn motion_inputs(model: &Model) -> Vec<Bound> {
    let is_motion = |i: &&Quantity| i.unit == "rad/s" || (i.unit == "rad" && !is_surface(i));
    model.inputs.iter().filter(is_motion).map(|i| Bound::new(&i.name, &i.name, &i.unit)).collect()
}

/// Inputs in rad that are no angle of the motion.
fn surfaces(model: &Model) -> Vec<Bound> {
    let is_surface = |i: &&Quantity| is_surface(i);
    model.inputs.iter().filter(is_surface).map(|i| Bound::new(&i.name, &i.name, &i.unit)).collect()
}

/// An angle that is none of the motion.
fn is_surface(angle: &Quantity) -> bool {
    let motion = [
        "alpha", "beta", "phi", "theta", "psi", "gamma", "chi", "track", "bank", "pitch",
        "heading", "aoa", "alf", "the",
    ];
    let of = |m: &&str| {
        angle.name == *m || angle.name.strip_prefix(*m).is_some_and(|rest| rest.starts_with('_'))
    };
    angle.unit == "rad" && !motion.iter().any(of)
}

/// Measured surfaces whose rate is no other state.
fn actuators(model: &Model) -> Vec<Bound> {
    let hinges = hinges(model);
    let is_one = |s: &&Quantity| {
        is_surface(s) && model.output(&s.name).is_some() && hinges.iter().all(|h| h.ident != s.name)
    };
    let of = |s: &Quantity| {
        Bound::new(&s.name, &s.name, &s.unit).with("rate", &rate_line(model, &s.name).text)
    };
    model.states.iter().map(|s| &s.quantity).filter(is_one).map(of).collect()
}

/// Name of a pair and whether this is its left one.
fn side(name: &str) -> Option<(&str, bool)> {
    let ends = [
        ("_L", true),
        ("_R", false),
        ("_l", true),
        ("_r", false),
        ("_left", true),
        ("_right", false),
    ];
    ends.iter().find_map(|(end, left)| name.strip_suffix(end).map(|stem| (stem, *left)))
}

fn pairs(model: &Model) -> Vec<Bound> {
    let all = surfaces(model);
    let mut out = Vec::new();
    for left in &all {
        let Some((stem, true)) = side(&left.text) else { continue };
        let Some(right) = all.iter().find(|b| side(&b.text) == Some((stem, false))) else {
            continue;
        };
        // In parentheses: effects take powers of it and divide by it.
        let mean = format!("(({} + {})/2)", left.text, right.text);
        out.push(
            Bound::new(&mean, stem, &left.unit).with("left", &left.text).with("right", &right.text),
        );
    }
    out
}

/// Surfaces that are not one of a pair.
fn singles(model: &Model) -> Vec<Bound> {
    let pairs = pairs(model);
    let of_pair = |b: &Bound| {
        pairs.iter().any(|p| p.fields.values().any(|side| *side == b.text) || p.ident == b.text)
    };
    surfaces(model).into_iter().filter(|b| !of_pair(b)).collect()
}

fn is_lateral(b: &Bound) -> bool {
    AILERONS.iter().chain(RUDDERS).any(|n| *n == b.text)
}

fn longitudinal(model: &Model) -> Vec<Bound> {
    let singles = singles(model).into_iter().filter(|b| !is_lateral(b));
    singles.chain(pairs(model)).collect()
}

fn lateral(model: &Model) -> Vec<Bound> {
    let differences = pairs(model).into_iter().map(|p| {
        let text = format!("({} - {})", p.fields["left"], p.fields["right"]);
        Bound { text, ident: format!("{}_diff", p.ident), ..p }
    });
    singles(model).into_iter().filter(is_lateral).chain(differences).collect()
}

fn drives(model: &Model) -> Vec<Bound> {
    let units: Vec<Option<Dim>> = ["A", "V", "N m", "N"].iter().map(|u| dim(u)).collect();
    let drives = |i: &&Quantity| units.contains(&dim(&i.unit)) && i.name != "thrust";
    model.inputs.iter().filter(drives).map(|i| Bound::new(&i.name, &i.name, &i.unit)).collect()
}

/// States whose rate is another state, except pitch angle and pitch rate.
fn hinges(model: &Model) -> Vec<Bound> {
    let mut out = Vec::new();
    for position in model.states.iter().map(|s| &s.quantity) {
        let line = model.files().find_map(|f| f.states.get(&position.name)).map(|s| s.rate.trim());
        let velocity = line
            .and_then(|line| model.states.iter().find(|s| s.quantity.name == line))
            .map(|s| &s.quantity);
        let Some(velocity) = velocity
            .filter(|v| !["p", "q", "r"].contains(&v.name.as_str()) && position.unit == "rad")
        else {
            continue;
        };
        let acceleration = rate_line(model, &velocity.name);
        let bound = Bound::new(&velocity.name, &position.name, &velocity.unit);
        out.push(bound.with("position", &position.name).with("acceleration", &acceleration.text));
    }
    out
}

/// Equations without unit whose name begins with `C_h` and ends in the letter of a surface.
fn hinge_moments(model: &Model) -> Vec<Bound> {
    let is_one = |n: &&String| {
        matches!(n.as_str(), "C_h" | "C_he" | "C_ha" | "C_hr" | "Che" | "Cha" | "Chr")
    };
    let is_coefficient = |n: &&String| model.dims.get(*n) == Some(&Dim::NONE);
    model
        .equations
        .keys()
        .filter(is_one)
        .filter(is_coefficient)
        .map(|n| Bound::new(n, n, "-"))
        .collect()
}

fn surface_sensors(model: &Model) -> Vec<Bound> {
    let positions: Vec<String> = hinges(model).into_iter().map(|h| h.ident).collect();
    model.outputs.iter().filter(|o| positions.contains(&o.name)).map(sensor).collect()
}
