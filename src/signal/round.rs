//! An angle that is logged within one turn, in; the same without the steps of a whole turn, out.

/// A step of a whole turn, give or take this share of it.
pub const ROUND: f64 = 0.25;

/// By how much a step is longer than the shorter way round: a whole turn with its sign, or nothing. A
/// step of several turns has nothing to do with going round.
pub fn beyond(step: f64, turn: f64) -> f64 {
    if (step.abs() / turn - 1.0).abs() < ROUND { turn * step.signum() } else { 0.0 }
}

/// Lets the angles of samples (time, angle) go on beyond a turn; how often they went round, and how often
/// they stepped as far without: `moves` says of two times whether the angle may move so far between them.
pub fn unroll<T: Copy>(
    samples: &mut [(T, f64)],
    turn: f64,
    moves: impl Fn(T, T, f64) -> bool,
) -> [u64; 2] {
    let (mut shift, mut counts) = (0.0, [0, 0]);
    let Some(mut last) = samples.first().copied() else { return counts };
    for (time, angle) in samples {
        let step = *angle - last.1;
        let mut more = beyond(step, turn);
        if more != 0.0 {
            let does = moves(last.0, *time, (step - more).abs());
            counts[usize::from(!does)] += 1;
            more = if does { more } else { 0.0 };
        }
        last = (*time, *angle);
        shift -= more;
        *angle += shift;
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_goes_on_beyond_a_turn_and_comes_back() {
        let mut heading: Vec<(i64, f64)> =
            [358.0, 359.9, 0.4, 1.0, 359.0, 180.0, 10.0].map(|angle| (0, angle)).into();
        assert_eq!(unroll(&mut heading, 360.0, |_, _, _| true), [2, 0]);
        let angles: Vec<f64> = heading.iter().map(|of| of.1).collect();
        assert_eq!(angles, [358.0, 359.9, 360.4, 361.0, 359.0, 180.0, 10.0]);
    }
}
