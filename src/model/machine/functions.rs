//! Functions without an instruction, over lanes: the interpreter's own.

use super::list::Function;
use crate::model::arithmetic::{apply, sin_cos};
use crate::model::op::Op;
use crate::model::tables::Tables;

/// Lane by lane; results go where the first arguments were.
///
/// # Safety
/// `arguments` points to three rows; `lanes` is at most eight.
#[inline(always)]
unsafe fn each<const N: usize>(
    arguments: *mut [f64; 8],
    lanes: usize,
    of: impl Fn([f64; 3]) -> [f64; N],
) {
    // SAFETY: the caller's promise.
    let rows = unsafe { &mut *arguments.cast::<[[f64; 8]; 3]>() };
    for lane in 0..lanes.min(8) {
        let results = of([rows[0][lane], rows[1][lane], rows[2][lane]]);
        rows.iter_mut().zip(results).for_each(|(row, result)| row[lane] = result);
    }
}

/// Sine and cosine.
///
/// # Safety
/// As `each`.
pub unsafe extern "C" fn sines(arguments: *mut [f64; 8], _: *const Tables, lanes: usize) {
    // SAFETY: the caller's promise.
    unsafe { each(arguments, lanes, |[x, ..]| <[f64; 2]>::from(sin_cos(x))) }
}

macro_rules! functions {
    ($($op:ident),*; |$t:ident, $a:ident, $b:ident, $c:ident| $($table:ident = $e:expr),*) => {
        /// The function of an operation that has one.
        pub fn function(op: Op) -> Option<Function> {
            match op {
                $(Op::$op => {
                    unsafe extern "C" fn call(at: *mut [f64; 8], _: *const Tables, n: usize) {
                        // SAFETY: the code that calls it has three rows.
                        unsafe { each(at, n, |[a, b, c]| [apply(Op::$op, a, b, c)]) }
                    }
                    Some(call)
                })*
                $(Op::$table => {
                    #[allow(unused_variables)]
                    unsafe extern "C" fn call(at: *mut [f64; 8], t: *const Tables, n: usize) {
                        // SAFETY: as above; the tables live as long as the code runs.
                        unsafe {
                            let $t = &*t;
                            each(at, n, |[$a, $b, $c]| [$e])
                        }
                    }
                    Some(call)
                })*
                _ => None,
            }
        }
    };
}
functions!(Tan, Asin, Acos, Atan, Atan2, Exp, Log, Tanh, Pow; |t, a, b, c|
    Table = t.one(b, a, false),
    TableSlope = t.one(b, a, true),
    Table2 = t.two(c, a, b)[0],
    Table2SlopeX = t.two(c, a, b)[1],
    Table2SlopeY = t.two(c, a, b)[2]
);
