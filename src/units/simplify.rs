//! A unit that was put together from others in, the same unit with each name once out.

/// Collects the factors of `text`, a unit that `Unit::parse` reads: `1/(rad rad)` becomes `1/rad^2`,
/// `(m/s) s` becomes `m`. A text that is no unit stays as it is.
pub fn simplified(text: &str) -> String {
    let mut factors = Vec::new();
    let mut rest = text.trim();
    if product(&mut rest, 1.0, &mut factors).is_none() || !rest.is_empty() {
        return text.to_string();
    }
    let side = |sign: f64| -> Vec<String> {
        let there = factors.iter().filter(|(_, power)| power * sign > 0.0);
        there
            .map(|(name, power)| match power.abs() {
                1.0 => name.clone(),
                power => format!("{name}^{power}"),
            })
            .collect()
    };
    let (up, down) = (side(1.0), side(-1.0));
    let up = if up.is_empty() { "1".to_string() } else { up.join(" ") };
    match (down.len(), up.as_str()) {
        (0, "1") => "-".to_string(),
        (0, _) => up,
        (1, _) => format!("{up}/{}", down[0]),
        (_, _) => format!("{up}/({})", down.join(" ")),
    }
}

/// Factors up to the end or a closing parenthesis, each to the power `sign` times its own.
fn product(rest: &mut &str, sign: f64, factors: &mut Vec<(String, f64)>) -> Option<()> {
    let mut of_next = sign;
    loop {
        *rest = rest.trim_start();
        if let Some(inner) = rest.strip_prefix('(') {
            *rest = inner;
            product(rest, of_next, factors)?;
            *rest = rest.strip_prefix(')')?;
        } else {
            factor(rest, of_next, factors)?;
        }
        *rest = rest.trim_start();
        of_next = sign;
        if rest.is_empty() || rest.starts_with(')') {
            return Some(());
        }
        if let Some(behind) = rest.strip_prefix('/') {
            (*rest, of_next) = (behind, -sign);
        } else if let Some(behind) = rest.strip_prefix('*') {
            *rest = behind;
        }
    }
}

/// One name with its power.
fn factor(rest: &mut &str, sign: f64, factors: &mut Vec<(String, f64)>) -> Option<()> {
    let end = rest.find(|c: char| !c.is_alphabetic()).unwrap_or(rest.len());
    let (name, behind) = match rest.strip_prefix(['1', '-']) {
        Some(behind) => ("", behind),
        None if end == 0 => return None,
        None => rest.split_at(end),
    };
    *rest = behind;
    let mut power = 1.0;
    if let Some(behind) = rest.strip_prefix('^') {
        let end = behind
            .char_indices()
            .find(|(i, c)| !(c.is_ascii_digit() || *c == '.' || *i == 0 && *c == '-'))
            .map_or(behind.len(), |(i, _)| i);
        power = behind[..end].parse().ok()?;
        *rest = &behind[end..];
    }
    if name.is_empty() {
        return Some(());
    }
    match factors.iter_mut().find(|(known, _)| known == name) {
        Some((_, sum)) => *sum += sign * power,
        None => factors.push((name.to_string(), sign * power)),
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Unit;

    #[test]
    fn a_unit_keeps_its_meaning_and_has_each_name_once() {
        for (text, simple) in [
            ("1/(rad rad)", "1/rad^2"),
            ("1/1", "-"),
            ("(m/s) s", "m"),
            ("1/(m/s)", "s/m"),
            ("N m/(rad/s)", "N m s/rad"),
            ("rad^2/(rad s^-1)", "rad s"),
            ("kg m^2/s^2", "kg m^2/s^2"),
            ("rad/s s^-0.5", "rad/s^1.5"),
            ("m/s^0.5 s^0.5", "m"),
            ("-", "-"),
        ] {
            assert_eq!(simplified(text), simple, "{text}");
            assert_eq!(Unit::parse(text).expect("a unit"), Unit::parse(simple).expect("a unit"));
        }
        assert_eq!(simplified("{of}/s"), "{of}/s");
    }
}
