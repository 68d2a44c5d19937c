//! Smoothed disturbances of several runs in; their sums, which judge the noise levels (see
//! `backward`), out.

/// Per channel, input and walk: `sum u^2` and `sum d`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sums {
    pub channels: Vec<[f64; 2]>,
    pub inputs: Vec<[f64; 2]>,
    pub walks: Vec<[f64; 2]>,
}

impl Sums {
    /// As many zeros.
    pub fn zero(&self) -> Sums {
        let none = |list: &[[f64; 2]]| vec![[0.0; 2]; list.len()];
        Sums {
            channels: none(&self.channels),
            inputs: none(&self.inputs),
            walks: none(&self.walks),
        }
    }

    pub fn add(&mut self, other: &Sums) {
        let lists = [
            (&mut self.channels, &other.channels),
            (&mut self.inputs, &other.inputs),
            (&mut self.walks, &other.walks),
        ];
        for (to, from) in lists {
            for (to, from) in to.iter_mut().zip(from) {
                to[0] += from[0];
                to[1] += from[1];
            }
        }
    }
}
