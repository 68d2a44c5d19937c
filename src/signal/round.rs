//! An angle that is logged within one turn, in; the same without the steps of a whole turn, out.

/// A step of a whole turn, give or take this share of it.
pub const ROUND: f64 = 0.25;

/// By how much a step is longer than the shorter way round: a whole turn with its sign, or nothing. A
/// step of several turns has nothing to do with going round.
pub fn beyond(step: f64, turn: f64) -> f64 {
    if (step.abs() / turn - 1.0).abs() < ROUND { turn * step.signum() } else { 0.0 }
}

/// Lets the angles of samples (time, angle) go on beyond a turn; how often they went round.
pub fn unroll<T>(samples: &mut [(T, f64)], turn: f64) -> u64 {
    let (mut shift, mut count) = (0.0, 0);
    let mut last = samples.first().map_or(0.0, |sample| sample.1);
    for (_, angle) in samples {
        let more = beyond(*angle - last, turn);
        last = *angle;
        count += u64::from(more != 0.0);
        shift -= more;
        *angle += shift;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_goes_on_beyond_a_turn_and_comes_back() {
        let mut heading: Vec<(i64, f64)> =
            [358.0, 359.9, 0.4, 1.0, 359.0, 180.0, 10.0].map(|angle| (0, angle)).into();
        assert_eq!(unroll(&mut heading, 360.0), 2);
        let angles: Vec<f64> = heading.iter().map(|of| of.1).collect();
        assert_eq!(angles, [358.0, 359.9, 360.4, 361.0, 359.0, 180.0, 10.0]);
    }
}
