//! What may be hidden: an aircraft's text with one effect written into it, by hand and not with the
//! library's lines.

use super::aircraft::Aircraft;
use koehler::model::{Constants, Model};

/// The aircraft as the analysis knows it, with starts off the truth; `@...@` are numbers of the aircraft.
const BASE: &str = r#"
title = "Longitudinal motion of an aircraft"
[inputs]
de = { unit = "rad", doc = "elevator" }
eta = { unit = "rad", doc = "flaps" }
thrust = "N"
[constants]
g = { unit = "m/s^2", value = 9.80665 }
m = { unit = "kg", value = @m@ }
I_y = { unit = "kg m^2", value = @I_y@ }
S = { unit = "m^2", value = @S@ }
c = { unit = "m", value = @c@ }
rho = { unit = "kg/m^3", value = @rho@ }
r_H = { unit = "m", value = @r_H@ }
[parameters]
C_L_0 = { unit = "-", start = @C_L_0@ }
C_L_alpha = { unit = "1/rad", start = @C_L_alpha@ }
C_L_de = { unit = "1/rad", start = @C_L_de@ }
C_L_eta = { unit = "1/rad", start = @C_L_eta@ }
C_D_0 = { unit = "-", start = @C_D_0@ }
C_D_k = { unit = "-", start = @C_D_k@ }
C_D_eta = { unit = "1/rad", start = @C_D_eta@ }
C_m_0 = { unit = "-", start = @C_m_0@ }
C_m_alpha = { unit = "1/rad", start = @C_m_alpha@ }
C_m_q = { unit = "1/rad", start = @C_m_q@ }
C_m_de = { unit = "1/rad", start = @C_m_de@ }
C_m_eta = { unit = "1/rad", start = @C_m_eta@ }
[equations]
qbar = "rho*V^2/2"
C_L = "C_L_0 + C_L_alpha*alpha + C_L_de*de + C_L_eta*eta"
C_D = "C_D_0 + C_D_k*C_L^2 + C_D_eta*eta"
C_m = "C_m_0 + C_m_alpha*alpha + C_m_q*q*c/(2*V) + C_m_de*de + C_m_eta*eta"
ax = "(qbar*S*(C_L*sin(alpha) - C_D*cos(alpha)) + thrust)/m"
az = "-qbar*S*(C_L*cos(alpha) + C_D*sin(alpha))/m"
qdot = "qbar*S*c*C_m/I_y"
[states]
V = { unit = "m/s", rate = "ax*cos(alpha) + az*sin(alpha) - g*sin(theta - alpha)", start = "measured" }
alpha = { unit = "rad", rate = "q + (az*cos(alpha) - ax*sin(alpha) + g*cos(theta - alpha))/V", start = "measured" }
theta = { unit = "rad", rate = "q", start = "measured" }
q = { unit = "rad/s", rate = "qdot", start = "measured" }
[outputs]
V = { unit = "m/s", value = "V" }
alpha = { unit = "rad", value = "alpha" }
theta = { unit = "rad", value = "theta" }
q = { unit = "rad/s", value = "q" }
ax = { unit = "m/s^2", value = "ax" }
az = { unit = "m/s^2", value = "az" }
"#;

/// The aircraft as it is; `<...>` are the places where something may be hidden.
const TRUTH: &str = r#"
title = "The aircraft as it is"
[inputs]
de_seen = "rad"
eta_seen = "rad"
thrust_seen = "N"
u_gust = "m/s"
w_gust = "m/s"
[constants]
g = { unit = "m/s^2", value = 9.80665 }
m = { unit = "kg", value = @m@ }
I_y = { unit = "kg m^2", value = @I_y@ }
S = { unit = "m^2", value = @S@ }
c = { unit = "m", value = @c@ }
rho = { unit = "kg/m^3", value = @rho@ }
r_H = { unit = "m", value = @r_H@ }
sec = { unit = "s", value = 1.0 }
meter = { unit = "m", value = 1.0 }
[parameters]
A = { unit = "<A>", start = 0.0 }
[equations]
<equations>
de = "<de>"
eta = "<eta>"
thrust = "<thrust>"
V_air = "V + u_gust"
alpha_air = "alpha + w_gust/V"
qbar = "rho*V_air^2/2"
C_L_1 = "@C_L_0@ + @C_L_alpha@*alpha_air + @C_L_de@*de + @C_L_eta@*eta"
C_L = "<lift>"
C_D = "@C_D_0@ + @C_D_k@*C_L^2 + @C_D_eta@*eta"
C_m = "@C_m_0@ + @C_m_alpha@*alpha_air + @C_m_q@*q*c/(2*V_air) + @C_m_de@*de + @C_m_eta@*eta + <moment>"
ax = "(qbar*S*(C_L*sin(alpha) - C_D*cos(alpha)) + thrust)/m"
az = "-qbar*S*(C_L*cos(alpha) + C_D*sin(alpha))/m"
qdot = "qbar*S*c*C_m/I_y"
[states]
V = { unit = "m/s", rate = "ax*cos(alpha) + az*sin(alpha) - g*sin(theta - alpha) + <vdot>", start = @V@ }
alpha = { unit = "rad", rate = "q + (az*cos(alpha) - ax*sin(alpha) + g*cos(theta - alpha))/V", start = 0.0 }
theta = { unit = "rad", rate = "q", start = 0.0 }
q = { unit = "rad/s", rate = "qdot", start = 0.0 }
<states>
[outputs]
V = { unit = "m/s", value = "<V>" }
alpha = { unit = "rad", value = "<alpha>" }
theta = { unit = "rad", value = "<theta>" }
q = { unit = "rad/s", value = "<q>" }
ax = { unit = "m/s^2", value = "<ax>" }
az = { unit = "m/s^2", value = "<az>" }
"#;

/// Something hidden.
pub struct Hidden {
    pub name: &'static str,
    /// Candidates that are this effect.
    pub is: &'static [&'static str],
    /// Unit of the size `A`, and a value of it that is seen; larger is more.
    unit: &'static str,
    pub nominal: f64,
    /// Places and what stands there.
    text: &'static [(&'static str, &'static str)],
}

const DEFAULTS: &[(&str, &str)] = &[
    ("equations", ""),
    ("states", ""),
    ("de", "de_seen"),
    ("eta", "eta_seen"),
    ("thrust", "thrust_seen"),
    ("lift", "C_L_1"),
    ("moment", "0"),
    ("vdot", "0"),
    ("V", "V_air"),
    ("alpha", "alpha_air"),
    ("theta", "theta"),
    ("q", "q"),
    ("ax", "ax"),
    ("az", "az"),
];

/// The base model of an aircraft.
pub fn base(aircraft: &Aircraft) -> Model {
    let text = aircraft.filled(BASE, &aircraft.starts);
    Model::parse("trial", &text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// The aircraft with several things hidden at once, in amounts `A1`, `A2`, .. and its mass off by a factor. Terms
/// are added, what is measured or moved passes through one after the other.
pub fn together(all: &[&Hidden], aircraft: &Aircraft, heavier: f64) -> Model {
    let mut text = TRUTH.replace("@m@", &format!("{:?}", heavier * aircraft.mass));
    let parameter = |(k, h): (usize, &&Hidden)| {
        format!("A{} = {{ unit = \"{}\", start = 0.0 }}\n", k + 1, h.unit)
    };
    let parameters: String = all.iter().enumerate().map(parameter).collect();
    text = text.replace("A = { unit = \"<A>\", start = 0.0 }\n", &parameters);
    for (place, plain) in DEFAULTS {
        let mut filled = plain.to_string();
        for (k, hidden) in all.iter().enumerate() {
            let Some((_, own)) = hidden.text.iter().find(|t| t.0 == *place) else { continue };
            let own = numbered(own, k + 1);
            filled = match *plain {
                "" => format!("{filled}{own}\n"),
                "0" => format!("{filled} + {own}"),
                before => replaced(&own, before, &format!("({filled})")),
            };
        }
        text = text.replace(&format!("<{place}>"), &filled);
    }
    let text = aircraft.filled(&text, &aircraft.truth);
    Model::parse("together", &text, &Constants::default()).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// With a number behind the amount and the names of states that an effect brings.
fn numbered(text: &str, k: usize) -> String {
    ["A", "z", "n1", "d1", "n2", "d2", "s1", "s2", "v1", "v2", "X"].iter().fold(
        text.to_string(),
        |text, name| {
            let to = if *name == "A" { format!("A{k}") } else { format!("{name}_{k}") };
            replaced(&text, name, &to)
        },
    )
}

/// Whole names replaced.
fn replaced(text: &str, name: &str, by: &str) -> String {
    let is_part = |c: Option<char>| c.is_some_and(|c| c.is_ascii_alphanumeric() || c == '_');
    let (mut out, mut rest) = (String::new(), text);
    while let Some(at) = rest.find(name) {
        let (before, after) = (&rest[..at], &rest[at + name.len()..]);
        let whole = !is_part(before.chars().last().or(out.chars().last()))
            && !is_part(after.chars().next());
        out += before;
        out += if whole { by } else { name };
        rest = after;
    }
    out + rest
}

impl Hidden {
    /// Something that no candidate is.
    pub const fn new(
        name: &'static str,
        unit: &'static str,
        nominal: f64,
        text: &'static [(&'static str, &'static str)],
    ) -> Hidden {
        Hidden { name, is: &[], unit, nominal, text }
    }

    pub fn model(&self, aircraft: &Aircraft) -> Model {
        let mut text = TRUTH.replace("<A>", self.unit);
        for (place, plain) in DEFAULTS {
            let filled = self.text.iter().find(|t| t.0 == *place).map_or(*plain, |t| t.1);
            text = text.replace(&format!("<{place}>"), filled);
        }
        let text = aircraft.filled(&text, &aircraft.truth);
        Model::parse(self.name, &text, &Constants::default())
            .unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }
}

/// Nothing hidden.
pub const NOTHING: Hidden = Hidden { name: "nothing", is: &[], unit: "-", nominal: 0.0, text: &[] };

macro_rules! hidden {
    ($($name:literal = [$($is:literal),*], $unit:literal, $nominal:literal, { $($place:literal: $text:literal),* };)*) => {
        &[$(Hidden { name: $name, is: &[$($is),*], unit: $unit, nominal: $nominal, text: &[$(($place, $text)),*] }),*]
    };
}

/// Effects that the library has, one way or another.
pub const INSIDE: &[Hidden] = hidden![
    // sensors
    "late vane" = ["sensor-delay:alpha"], "s", 0.06, { "alpha": "delay(alpha_air, A)" };
    "slow gyro" = ["sensor-lag:q"], "s", 0.06, { "q": "lag(q, A)" };
    "scale of az" = ["sensor-scale:az"], "-", 0.05, { "az": "az*(1 + A)" };
    "upwash" = ["upwash:alpha"], "-", 0.1, { "alpha": "alpha_air*(1 + A)" };
    "drift of theta" = ["sensor-drift:theta"], "1/s", 0.001, { "theta": "theta + A*t" };
    "vane off its place" = ["vane-lever-alpha"], "m", 3.0, { "alpha": "alpha_air - A*q/V" };
    "accelerometer off its place" = ["accelerometer-lever-normal"], "m", 1.5, { "az": "az - A*qdot" };
    "position error" = ["airspeed-position-error"], "-", 0.3, { "V": "V_air*(1 + A*alpha_air)" };
    "turned accelerometers" = ["accelerometer-misalignment:ax,az"], "-", 0.01, { "ax": "ax + A*az", "az": "az - A*ax" };
    "vane in the flaps' upwash" = ["upwash-of-control:eta"], "-", 0.05, { "alpha": "alpha_air + A*eta" };
    // actuators and mechanics
    "elevator lag" = ["actuator-lag:de"], "s", 0.06, { "de": "lag(de_seen, A)" };
    "elevator delay" = ["actuator-delay:de"], "s", 0.06, { "de": "delay(de_seen, A)" };
    "elevator rate limit" = ["actuator-rate-limit:de"], "s/rad", 8.0, {
        "states": "z = { unit = \"rad\", rate = \"clamp(500*(de_seen - z)/sec, -1/A, 1/A)\", start = \"de_seen\" }", "de": "z" };
    "elevator stop" = ["actuator-limit:de"], "rad", 0.03, { "de": "min(de_seen, 0.07 - A)" };
    "elevator backlash" = ["actuator-backlash:de"], "rad", 0.006, {
        "states": "z = { unit = \"rad\", rate = \"100*deadband(de_seen - z, A)/sec\", start = \"de_seen\" }", "de": "z + deadband(de_seen - z, A)" };
    "flap lag" = ["actuator-lag:eta"], "s", 0.1, { "eta": "lag(eta_seen, A)" };
    "flap delay" = ["actuator-delay:eta"], "s", 0.1, { "eta": "delay(eta_seen, A)" };
    "elastic elevator" = ["surface-stretch:de"], "1/Pa", 3e-5, { "de": "de_seen*(1 - A*qbar)" };
    "thrust line" = ["thrust-line-moment"], "1/(kg m)", 1e-6, { "moment": "A*thrust*I_y/(qbar*S*c)" };
    "engine lag" = ["thrust-lag"], "s", 0.5, { "thrust": "lag(thrust_seen, A)" };
    // aerodynamics
    "downwash of the flaps" = ["downwash-lag:eta"], "-", 0.15, { "moment": "A*delay(eta_seen, r_H/V)" };
    "downwash of the wing" = ["downwash-lag-alpha", "alphadot-moment"], "-", 0.8, { "moment": "A*(delay(alpha_air, r_H/V) - alpha_air)" };
    "elevator square" = ["control-square-longitudinal:de,C_m"], "-", 4.0, { "moment": "A*de^2" };
    "elevator cubic" = ["control-cubic-longitudinal:de,C_m"], "-", 50.0, { "moment": "A*de^3" };
    "flaps one-sided" = ["control-one-sided-longitudinal:eta,C_L"], "-", 0.2, { "lift": "C_L_1 + A*max(eta, 0)" };
    "elevator fades with alpha" = ["control-loss-alpha-longitudinal:de,C_m"], "-", 4.0, { "moment": "A*de*alpha_air" };
    "flaps fade with airspeed" = ["control-loss-speed-longitudinal:eta,C_L"], "s^2/m^2", 2e-5, { "lift": "C_L_1 - A*eta*V_air^2" };
    "curved moment" = ["alpha-square:C_m"], "-", 1.0, { "moment": "A*alpha_air^2" };
    "cubic lift" = ["alpha-cubic:C_L"], "-", 20.0, { "lift": "C_L_1 - A*alpha_air^3" };
    "elevator behind the flaps" = ["control-interference-longitudinal:de,eta,C_m"], "-", 2.0, { "moment": "A*de*eta" };
    "moment with airspeed" = ["speed-dependence:C_m"], "s/m", 4e-4, { "moment": "A*V_air" };
    "lift slope with airspeed" = ["mach-lift"], "s^2/m^2", 3e-5, { "lift": "C_L_1 + A*alpha_air*V_air^2" };
    "thrust on the moment" = ["thrust-effect:C_m"], "-", 0.15, { "moment": "A*thrust/(qbar*S)" };
    "stall" = ["stall-separation"], "-", 1.0, {
        "states": "X = { unit = \"-\", rate = \"(0.5*(1 - tanh(25*(alpha_air - 0.19))) - X)/(0.4*sec)\", start = \"0.5*(1 - tanh(25*(alpha_air - 0.19)))\" }",
        "lift": "C_L_1 + A*((1 + sqrt(max(X, 0)))^2/4 - 1)*@C_L_alpha@*alpha_air" };
    "unsteady lift" = ["wing-lift-lag"], "s", 0.08, { "lift": "lag(C_L_1, A)" };
    "flap rate" = ["control-rate-longitudinal:eta,C_m"], "m", 2.0, { "moment": "A*rate(eta_seen)/V" };
    "shear" = ["wind-shear"], "1/s", 0.01, { "vdot": "A*V*sin(theta - alpha)" };
];

/// Effects that no file describes.
pub const OUTSIDE: &[Hidden] = hidden![
    "two structural modes" = [], "-", 1.0, {
        "states": "n1 = { unit = \"rad\", rate = \"d1\", start = 0.0 }\nd1 = { unit = \"rad/s\", rate = \"-330*n1/sec^2 - 1.2*d1/sec + 40*rate(de_seen)/sec\", start = 0.0 }\nn2 = { unit = \"rad\", rate = \"d2\", start = 0.0 }\nd2 = { unit = \"rad/s\", rate = \"-800*n2/sec^2 - 1.5*d2/sec - 60*rate(de_seen)/sec\", start = 0.0 }",
        "q": "q + 0.05*A*(d1 + d2)", "az": "az + A*meter*(n1 - n2)/sec^2" };
    "sloshing fuel" = [], "-", 0.5, {
        "states": "s1 = { unit = \"rad\", rate = \"s2\", start = 0.0 }\ns2 = { unit = \"rad/s\", rate = \"-6*s1/sec^2 - 0.15*s2/sec + qdot\", start = 0.0 }",
        "moment": "A*s1" };
    "elevator effect that comes and goes" = [], "-", 0.4, { "moment": "A*sin(2.3*t/sec)*de" };
    "vortex shed by the flaps" = [], "-", 0.3, {
        "states": "v1 = { unit = \"rad\", rate = \"v2\", start = 0.0 }\nv2 = { unit = \"rad/s\", rate = \"-25*v1/sec^2 - 1.0*v2/sec + 5*rate(eta_seen)/sec\", start = 0.0 }",
        "lift": "C_L_1 + A*v1", "moment": "A*v1" };
    "beat in the gyro" = [], "rad/s", 0.004, { "q": "q + A*sin(9*t/sec)*sin(0.8*t/sec)" };
];
