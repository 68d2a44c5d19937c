//! The aircraft that trials are flown with: a transport, a light aircraft and an unmanned one of 20 kg; their numbers filled into a
//! model's text.

/// Coefficients of lift, drag and pitching moment about steady flight, per rad.
#[derive(Debug, PartialEq)]
pub struct Aerodynamics {
    /// C_L: constant, angle of attack, elevator, flaps.
    pub lift: [f64; 4],
    /// C_D: constant, square of lift, flaps.
    pub drag: [f64; 3],
    /// C_m: constant, angle of attack, pitch rate, elevator, flaps.
    pub moment: [f64; 5],
}

/// An aircraft with what its maneuvers and sensors are like.
#[derive(Debug, PartialEq)]
pub struct Aircraft {
    pub name: &'static str,
    /// kg, kg m^2, m^2, m, kg/m^3, and the distance between wing and tail, m.
    pub mass: f64,
    pub inertia: f64,
    pub area: f64,
    pub chord: f64,
    pub density: f64,
    pub tail_arm: f64,
    /// True airspeeds that it is flown at, m/s, the slowest first.
    pub speeds: [f64; 3],
    pub truth: Aerodynamics,
    /// Where the estimates start.
    pub starts: Aerodynamics,
    /// Sensor noise of V, alpha, theta, q, ax, az, SI.
    pub noise: [f64; 6],
    /// Times of inputs over those of the transport's: a small aircraft is quick.
    pub quick: f64,
    /// Light turbulence: least and most r.m.s. of a gust, m/s.
    pub gusts: (f64, f64),
    /// Length scale of gusts, m.
    pub gust_length: f64,
}

/// Chosen plausibly, all three.
pub static TRANSPORT: Aircraft = Aircraft {
    name: "transport",
    mass: 17600.0,
    inertia: 252000.0,
    area: 64.0,
    chord: 3.16,
    density: 0.9,
    tail_arm: 9.0,
    speeds: [85.0, 105.0, 125.0],
    truth: Aerodynamics {
        lift: [0.25, 5.0, 0.3, 0.9],
        drag: [0.03, 0.06, 0.08],
        moment: [0.05, -0.8, -20.0, -1.2, -0.25],
    },
    starts: Aerodynamics {
        lift: [0.2, 4.6, 0.2, 0.7],
        drag: [0.04, 0.05, 0.05],
        moment: [0.03, -0.9, -18.0, -1.3, -0.2],
    },
    noise: [0.08, 1.0e-3, 8.0e-4, 1.0e-3, 0.02, 0.05],
    quick: 1.0,
    gusts: (0.2, 0.5),
    gust_length: 533.4,
};

pub static LIGHT: Aircraft = Aircraft {
    name: "light",
    mass: 1100.0,
    inertia: 1825.0,
    area: 16.2,
    chord: 1.49,
    density: 1.1,
    tail_arm: 4.6,
    speeds: [40.0, 50.0, 60.0],
    truth: Aerodynamics {
        lift: [0.3, 5.1, 0.4, 0.8],
        drag: [0.03, 0.055, 0.08],
        moment: [0.04, -0.9, -13.0, -1.25, -0.15],
    },
    starts: Aerodynamics {
        lift: [0.25, 4.6, 0.3, 0.65],
        drag: [0.04, 0.05, 0.05],
        moment: [0.03, -1.0, -11.0, -1.4, -0.12],
    },
    noise: [0.08, 1.5e-3, 1.0e-3, 1.2e-3, 0.025, 0.06],
    quick: 0.6,
    gusts: (0.2, 0.5),
    gust_length: 300.0,
};

pub static UNMANNED: Aircraft = Aircraft {
    name: "unmanned",
    mass: 20.0,
    inertia: 2.6,
    area: 1.1,
    chord: 0.36,
    density: 1.15,
    tail_arm: 1.2,
    speeds: [20.0, 25.0, 30.0],
    truth: Aerodynamics {
        lift: [0.28, 4.6, 0.35, 0.8],
        drag: [0.035, 0.06, 0.07],
        moment: [0.04, -0.7, -14.0, -1.0, -0.12],
    },
    starts: Aerodynamics {
        lift: [0.22, 4.2, 0.25, 0.65],
        drag: [0.045, 0.05, 0.05],
        moment: [0.03, -0.8, -12.0, -1.1, -0.1],
    },
    noise: [0.12, 3.0e-3, 2.0e-3, 3.0e-3, 0.05, 0.12],
    quick: 0.4,
    gusts: (0.1, 0.3),
    gust_length: 150.0,
};

pub static ALL: [&Aircraft; 3] = [&TRANSPORT, &LIGHT, &UNMANNED];

impl Aircraft {
    /// A model's text with `@m@`, `@C_L_0@`, .. replaced by the numbers of `aerodynamics`.
    pub fn filled(&self, text: &str, aerodynamics: &Aerodynamics) -> String {
        let Aerodynamics { lift, drag, moment } = aerodynamics;
        let all = [
            ("m", self.mass),
            ("I_y", self.inertia),
            ("S", self.area),
            ("c", self.chord),
            ("rho", self.density),
            ("r_H", self.tail_arm),
            ("V", (self.speeds[1] / 5.0).floor() * 5.0),
            ("C_L_0", lift[0]),
            ("C_L_alpha", lift[1]),
            ("C_L_de", lift[2]),
            ("C_L_eta", lift[3]),
            ("C_D_0", drag[0]),
            ("C_D_k", drag[1]),
            ("C_D_eta", drag[2]),
            ("C_m_0", moment[0]),
            ("C_m_alpha", moment[1]),
            ("C_m_q", moment[2]),
            ("C_m_de", moment[3]),
            ("C_m_eta", moment[4]),
        ];
        let put = |text: String, (name, value): (&str, f64)| {
            text.replace(&format!("@{name}@"), &format!("{value:?}"))
        };
        all.into_iter().fold(text.to_string(), put)
    }

    /// Trimmed angle of attack, elevator and thrust at an airspeed, with nothing hidden.
    pub fn trim(&self, speed: f64) -> (f64, f64, f64) {
        let (g, qbar) = (9.80665, self.density * speed * speed / 2.0);
        let Aerodynamics { lift, drag, moment } = &self.truth;
        let (mut alpha, mut de, mut thrust) = (0.05f64, 0.0, 0.12 * self.mass * g);
        for _ in 0..60 {
            let c_l = (self.mass * g - thrust * alpha.sin()) / (qbar * self.area);
            alpha = (c_l - lift[0] - lift[2] * de) / lift[1];
            de = -(moment[0] + moment[1] * alpha) / moment[3];
            thrust = qbar * self.area * (drag[0] + drag[1] * c_l * c_l) / alpha.cos();
        }
        (alpha, de, thrust)
    }
}
