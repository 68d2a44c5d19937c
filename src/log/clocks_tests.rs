//! Times of which another clock gave some, and such that one clock gave, in; what must be told apart.

use super::*;

const S: i64 = 1_000_000_000;

fn grid(n: i64) -> Vec<i64> {
    (0..n).map(|k| 500 * S + 10_000_000 * k).collect()
}

fn with(n: i64, change: impl Fn(&mut [i64])) -> Vec<i64> {
    let mut times = grid(n);
    change(&mut times);
    times
}

#[test]
fn a_clock_set_back_to_before_the_record_is_found_with_both_spans() {
    let times = with(1000, |t| t[600..].iter_mut().for_each(|t| *t -= 100 * S));
    let found = two_clocks(&times);
    assert_eq!(found.len(), 1);
    let two = &found[0];
    assert_eq!((two.at, two.by), (600, 100 * S - 10_000_000));
    assert_eq!(two.others, (500 * S, 505_990_000_000));
    assert_eq!(two.behind, (406 * S, 409_990_000_000));
    assert_eq!(two.fewer, (600..1000).collect::<Vec<_>>());
    assert_eq!(too_many(&found, 1000), Some(two));
    // a few before it, or a few behind it
    for (at, fewer) in [(50, 0..50), (950, 950..1000)] {
        let times = with(1000, |t| t[at..].iter_mut().for_each(|t| *t -= 100 * S));
        let found = two_clocks(&times);
        assert_eq!(found[0].fewer, fewer.collect::<Vec<_>>());
        assert!(found.len() == 1 && too_many(&found, 1000).is_none());
    }
}

#[test]
fn messages_without_a_stamp_and_of_another_year_keep_their_places() {
    let times = with(1000, |t| t[960..].iter_mut().for_each(|t| *t -= 100 * S));
    let mut stamps: Vec<Option<i64>> = times.into_iter().map(Some).collect();
    (stamps[10], stamps[20]) = (None, Some(i64::MIN));
    let fewer = |stamps: &[Option<i64>]| left_out(stamps).map(|all| all[0].fewer.clone());
    assert_eq!(fewer(&stamps), Ok((960..1000).collect()));
    let many = with(1000, |t| t[600..].iter_mut().for_each(|t| *t -= 100 * S));
    let error = left_out(&many.into_iter().map(Some).collect::<Vec<_>>()).unwrap_err();
    assert!(
        error.contains("set back by 99.990 s")
            && error.contains("500.000 to 505.990 s and 406.000 to 409.990 s"),
        "{error}"
    );
}

#[test]
fn a_clock_that_was_wrong_for_a_while_costs_that_while() {
    let times = with(1000, |t| t[300..340].iter_mut().for_each(|t| *t -= 100 * S));
    let found = two_clocks(&times);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].fewer, (300..340).collect::<Vec<_>>());
    // twice, by other steps
    let times = with(1000, |t| {
        t[300..340].iter_mut().for_each(|t| *t -= 100 * S);
        t[700..720].iter_mut().for_each(|t| *t -= 300 * S);
    });
    let left_out: Vec<usize> = two_clocks(&times).into_iter().flat_map(|t| t.fewer).collect();
    assert_eq!(left_out, (300..340).chain(700..720).collect::<Vec<_>>());
}

#[test]
fn many_short_whiles_are_together_too_many() {
    let wrong = |each: usize| {
        with(3000, |t| {
            (0..15).for_each(|k| t[200 * k + 50..][..each].iter_mut().for_each(|t| *t -= 100 * S))
        })
    };
    let (few, many) = (two_clocks(&wrong(10)), two_clocks(&wrong(40)));
    assert_eq!((few.len(), few[0].turns, few[0].fewer.len()), (1, 15, 150));
    assert!(too_many(&few, 3000).is_none());
    assert!(too_many(&many, 3000).is_some(), "{}", many.len());
}

#[test]
fn a_part_that_begins_before_the_record_and_ends_in_it_is_of_another_clock() {
    // ten seconds, then eight that end among them: 493 to 501 s
    let times = with(1800, |t| t[1000..].iter_mut().for_each(|t| *t -= 17 * S));
    assert_eq!(two_clocks(&times).len(), 1);
    // one that goes on beyond them: all that has no time twice is of the second clock
    let times = with(4000, |t| t[1000..].iter_mut().for_each(|t| *t -= 17 * S));
    assert_eq!(two_clocks(&times), []);
}

#[test]
fn fault_clocks_that_take_turns_are_told_with_their_own_spans() {
    let turns = |every: usize, by: i64| {
        let times = with(6000, |t| t.iter_mut().skip(7).step_by(every).for_each(|t| *t += by));
        left_out(&times.into_iter().map(Some).collect::<Vec<_>>())
    };
    for by in [-5000 * S, 5000 * S] {
        let few = turns(20, by).expect("a twentieth");
        assert_eq!((few.len(), few[0].fewer.len(), few[0].turns), (1, 300, 300));
        let error = turns(5, by).expect_err("a fifth");
        let by = if by < 0 { "4999.990" } else { "5000.010" };
        assert!(error.contains(&format!("forth and back by {by} s, 1199 times")), "{error}");
        assert!(error.contains("gave 500.000 to 559.990 s and"), "{error}");
    }
    // a block ahead, and a pause
    let times = with(6000, |t| t[2000..2300].iter_mut().for_each(|t| *t += 5000 * S));
    let found = two_clocks(&times);
    assert_eq!((found.len(), &found[0].fewer), (1, &(2000..2300).collect::<Vec<_>>()));
    assert!(found[0].words().contains("went forth and back by 5000.010 s: two clocks"));
    let times = with(6000, |t| t[2000..].iter_mut().for_each(|t| *t += 600 * S));
    assert_eq!(two_clocks(&times), []);
}

#[test]
fn fault_clocks_that_take_turns_over_one_time_are_told_with_name_and_counts() {
    let turns = |every: usize, by: i64| {
        let times = with(6000, |t| t.iter_mut().skip(7).step_by(every).for_each(|t| *t += by));
        left_out(&times.into_iter().map(Some).collect::<Vec<_>>())
    };
    for by in [-5 * S, 5 * S] {
        let few = turns(20, by).expect("a twentieth");
        assert_eq!((few.len(), few[0].fewer.len(), few[0].turns), (1, 300, 300));
        assert!(few[0].fewer.iter().all(|k| k % 20 == 7));
        let error = turns(2, by).expect_err("half");
        assert!(
            error.contains("forth and back by 5.000 s, 2997 times: two clocks gave"),
            "{error}"
        );
        assert!(
            error.ends_with("2997 of 6000 messages (50 %) are of the one that gave fewer"),
            "{error}"
        );
    }
}

#[test]
fn late_blocks_and_small_steps_back_are_of_one_clock() {
    assert_eq!(two_clocks(&grid(1000)), []);
    assert_eq!(two_clocks(&[]), []);
    // the first half stands behind the second, a block stands behind a later one, some come late
    for change in [500, 300] {
        let times = with(1000, |t| t.rotate_left(change));
        assert_eq!(two_clocks(&times), [], "{change}");
    }
    assert_eq!(two_clocks(&with(1000, |t| t[100..400].rotate_left(150))), []);
    assert_eq!(two_clocks(&with(1000, |t| t[500..].iter_mut().for_each(|t| *t -= S))), []);
    // one message, and two, of another year
    let strays = with(1000, |t| t[400..402].iter_mut().for_each(|t| *t = 0));
    assert_eq!(two_clocks(&strays), []);
    let shuffled: Vec<i64> = (0..600).map(|k| 20 * S * (k * 331 % 600)).collect();
    assert_eq!(two_clocks(&shuffled), []);
}
