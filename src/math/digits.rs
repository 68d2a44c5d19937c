//! A number in, its three significant digits as text out.

/// Three significant digits.
pub fn digits(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let before_point = libm::floor(libm::log10(v.abs())) as i32 + 1;
    if (-2..6).contains(&before_point) {
        format!("{v:.*}", (3 - before_point).max(0) as usize)
    } else {
        format!("{v:.2e}")
    }
}
