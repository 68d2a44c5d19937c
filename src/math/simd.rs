//! Eight numbers at a time: vectors of the width this machine has, chosen once at run time, for the
//! kernels that need the speed.
//!
//! A kernel is written once over [`Eight`] and compiled for every [`Width`] by [`by_width!`]. All
//! widths do the same operations in the same order, multiply-adds always fused (rounded once), so
//! the width changes no bit. Without hardware for fused multiply-adds they are computed in
//! software: slow, but equal.

#[cfg(feature = "internals")]
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

/// How wide the vectors are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// What every machine of the architecture has.
    Plain,
    /// Four numbers, with fused multiply-adds.
    Avx2,
    /// Eight numbers.
    Avx512,
}

/// What a benchmark asks for: one more than the width; 0 is the widest.
#[cfg(feature = "internals")]
static NARROW: AtomicU8 = AtomicU8::new(0);

impl Width {
    /// The widest of this machine.
    pub fn detect() -> Width {
        #[cfg(feature = "internals")]
        match NARROW.load(Relaxed) {
            1 => return Width::Plain,
            2 => return Width::Avx2,
            _ => {}
        }
        Width::widest()
    }

    /// From now on `width`, which this machine has: for benchmarks.
    #[cfg(feature = "internals")]
    pub fn narrow(width: Width) {
        assert!(Width::widest() as u8 >= width as u8, "{width:?} is not on this machine");
        NARROW.store(1 + width as u8, Relaxed);
    }

    fn widest() -> Width {
        #[cfg(target_arch = "x86_64")]
        {
            // the answers are kept by the standard library
            use std::arch::is_x86_feature_detected as has;
            if has!("avx2") && has!("fma") && has!("bmi2") {
                let wide =
                    has!("avx512f") && has!("avx512dq") && has!("avx512vl") && has!("avx512bw");
                return if wide { Width::Avx512 } else { Width::Avx2 };
            }
        }
        Width::Plain
    }

    /// All widths this machine can run, narrowest first.
    #[cfg(any(test, feature = "internals"))]
    pub fn available() -> &'static [Width] {
        match Width::widest() {
            Width::Plain => &[Width::Plain],
            Width::Avx2 => &[Width::Plain, Width::Avx2],
            Width::Avx512 => &[Width::Plain, Width::Avx2, Width::Avx512],
        }
    }
}

/// Eight numbers in the vectors of one width.
pub trait Eight: Copy {
    /// Vectors of a row that a tile of eight rows may hold without running out of registers.
    const COLUMNS: usize;
    /// # Safety
    /// `p` points to eight readable numbers; the machine has this width.
    unsafe fn load(p: *const f64) -> Self;
    /// # Safety
    /// `p` points to eight writable numbers; the machine has this width.
    unsafe fn store(self, p: *mut f64);
    /// Stores the first `n` numbers.
    /// # Safety
    /// As `store`, of `n` numbers; `n` is at most eight.
    #[inline(always)]
    unsafe fn store_first(self, p: *mut f64, n: usize) {
        let mut all = [0.0; 8];
        // SAFETY: the caller's promises.
        unsafe {
            self.store(all.as_mut_ptr());
            std::ptr::copy_nonoverlapping(all.as_ptr(), p, n);
        }
    }
    /// Loads the first `n` numbers; the others are zero.
    /// # Safety
    /// As `load`, of `n` numbers; `n` is at most eight.
    #[inline(always)]
    unsafe fn load_first(p: *const f64, n: usize) -> Self {
        let mut all = [0.0; 8];
        // SAFETY: the caller's promises.
        unsafe {
            std::ptr::copy_nonoverlapping(p, all.as_mut_ptr(), n);
            Self::load(all.as_ptr())
        }
    }
    /// # Safety
    /// The machine has this width.
    unsafe fn splat(x: f64) -> Self;
    /// `self * b + c`, rounded once.
    /// # Safety
    /// The machine has this width.
    unsafe fn fma(self, b: Self, c: Self) -> Self;
    /// # Safety
    /// The machine has this width.
    unsafe fn add(self, b: Self) -> Self;
    /// # Safety
    /// The machine has this width.
    unsafe fn mul(self, b: Self) -> Self;
}

/// Eight numbers without any promise about the machine.
#[derive(Clone, Copy)]
pub struct Plain([f64; 8]);

impl Eight for Plain {
    const COLUMNS: usize = 1;
    #[inline(always)]
    unsafe fn load(p: *const f64) -> Self {
        // SAFETY: the caller's promise; reading does not need alignment.
        Plain(unsafe { (p as *const [f64; 8]).read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store(self, p: *mut f64) {
        // SAFETY: the caller's promise.
        unsafe { (p as *mut [f64; 8]).write_unaligned(self.0) }
    }
    #[inline(always)]
    unsafe fn splat(x: f64) -> Self {
        Plain([x; 8])
    }
    #[inline(always)]
    unsafe fn fma(self, b: Self, c: Self) -> Self {
        Plain(std::array::from_fn(|l| self.0[l].mul_add(b.0[l], c.0[l])))
    }
    #[inline(always)]
    unsafe fn add(self, b: Self) -> Self {
        Plain(std::array::from_fn(|l| self.0[l] + b.0[l]))
    }
    #[inline(always)]
    unsafe fn mul(self, b: Self) -> Self {
        Plain(std::array::from_fn(|l| self.0[l] * b.0[l]))
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::Eight;
    use std::arch::x86_64::*;

    #[derive(Clone, Copy)]
    pub struct Avx2(__m256d, __m256d);

    // SAFETY of all bodies: the callers promise the machine's width and valid pointers.
    impl Eight for Avx2 {
        const COLUMNS: usize = 1;
        #[inline(always)]
        unsafe fn load_first(p: *const f64, n: usize) -> Self {
            unsafe {
                let n = _mm256_set1_epi64x(n as i64);
                let (low, high) = (_mm256_setr_epi64x(0, 1, 2, 3), _mm256_setr_epi64x(4, 5, 6, 7));
                let [low, high] = [low, high].map(|place| _mm256_cmpgt_epi64(n, place));
                Avx2(_mm256_maskload_pd(p, low), _mm256_maskload_pd(p.wrapping_add(4), high))
            }
        }
        #[inline(always)]
        unsafe fn load(p: *const f64) -> Self {
            unsafe { Avx2(_mm256_loadu_pd(p), _mm256_loadu_pd(p.add(4))) }
        }
        #[inline(always)]
        unsafe fn store(self, p: *mut f64) {
            unsafe {
                _mm256_storeu_pd(p, self.0);
                _mm256_storeu_pd(p.add(4), self.1);
            }
        }
        #[inline(always)]
        unsafe fn splat(x: f64) -> Self {
            unsafe { Avx2(_mm256_set1_pd(x), _mm256_set1_pd(x)) }
        }
        #[inline(always)]
        unsafe fn fma(self, b: Self, c: Self) -> Self {
            unsafe { Avx2(_mm256_fmadd_pd(self.0, b.0, c.0), _mm256_fmadd_pd(self.1, b.1, c.1)) }
        }
        #[inline(always)]
        unsafe fn add(self, b: Self) -> Self {
            unsafe { Avx2(_mm256_add_pd(self.0, b.0), _mm256_add_pd(self.1, b.1)) }
        }
        #[inline(always)]
        unsafe fn mul(self, b: Self) -> Self {
            unsafe { Avx2(_mm256_mul_pd(self.0, b.0), _mm256_mul_pd(self.1, b.1)) }
        }
    }

    #[derive(Clone, Copy)]
    pub struct Avx512(__m512d);

    impl Eight for Avx512 {
        const COLUMNS: usize = 2;
        #[inline(always)]
        unsafe fn load_first(p: *const f64, n: usize) -> Self {
            unsafe { Avx512(_mm512_maskz_loadu_pd((1u16 << n).wrapping_sub(1) as u8, p)) }
        }
        #[inline(always)]
        unsafe fn load(p: *const f64) -> Self {
            unsafe { Avx512(_mm512_loadu_pd(p)) }
        }
        #[inline(always)]
        unsafe fn store(self, p: *mut f64) {
            unsafe { _mm512_storeu_pd(p, self.0) }
        }
        #[inline(always)]
        unsafe fn store_first(self, p: *mut f64, n: usize) {
            unsafe { _mm512_mask_storeu_pd(p, (1u16 << n).wrapping_sub(1) as u8, self.0) }
        }
        #[inline(always)]
        unsafe fn splat(x: f64) -> Self {
            unsafe { Avx512(_mm512_set1_pd(x)) }
        }
        #[inline(always)]
        unsafe fn fma(self, b: Self, c: Self) -> Self {
            unsafe { Avx512(_mm512_fmadd_pd(self.0, b.0, c.0)) }
        }
        #[inline(always)]
        unsafe fn add(self, b: Self) -> Self {
            unsafe { Avx512(_mm512_add_pd(self.0, b.0)) }
        }
        #[inline(always)]
        unsafe fn mul(self, b: Self) -> Self {
            unsafe { Avx512(_mm512_mul_pd(self.0, b.0)) }
        }
    }
}

/// Compiles the `#[inline(always)]` generic function `body::<V, ...>` for every width and makes
/// `name(width, arguments...)` choose.
///
/// The function made is unsafe: the caller promises what `body` asks for, and that the machine has
/// `width` (which `Width::detect` and `Width::available` know).
#[macro_export]
macro_rules! by_width {
    ($(#[$meta:meta])* $vis:vis fn $name:ident $(<const $($g:ident),+>)? ($($a:ident: $t:ty),* $(,)?) = $body:ident) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)]
        $vis unsafe fn $name $(<$(const $g: usize),+>)? (width: $crate::math::simd::Width, $($a: $t),*) {
            use $crate::math::simd::{Plain, Width};
            #[cfg(target_arch = "x86_64")]
            use $crate::math::simd::{Avx2, Avx512};
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma,bmi2")]
            #[allow(clippy::too_many_arguments)]
            unsafe fn avx2 $(<$(const $g: usize),+>)? ($($a: $t),*) {
                // SAFETY: handed on.
                unsafe { $body::<Avx2 $($(, $g)+)?>($($a),*) }
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma,bmi2")]
            #[allow(clippy::too_many_arguments)]
            unsafe fn avx512 $(<$(const $g: usize),+>)? ($($a: $t),*) {
                // SAFETY: handed on.
                unsafe { $body::<Avx512 $($(, $g)+)?>($($a),*) }
            }
            // SAFETY: the caller's promises.
            unsafe {
                match width {
                    #[cfg(target_arch = "x86_64")]
                    Width::Avx512 => avx512 $(::<$($g),+>)? ($($a),*),
                    #[cfg(target_arch = "x86_64")]
                    Width::Avx2 => avx2 $(::<$($g),+>)? ($($a),*),
                    _ => $body::<Plain $($(, $g)+)?>($($a),*),
                }
            }
        }
    };
}

pub use by_width;

/// Numbers on addresses that are multiples of 64 bytes: a vector never straddles two cache lines.
#[derive(Debug, Clone, Default)]
pub struct Aligned {
    lines: Vec<Line>,
    len: usize,
}

#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
struct Line([f64; 8]);

impl Aligned {
    /// Makes it `len` zeros, reusing its memory.
    pub fn zeros(&mut self, len: usize) {
        self.lines.clear();
        self.resize(len);
    }

    /// At least `len` numbers; new ones are zero, old ones stay.
    pub fn resize(&mut self, len: usize) {
        if len.div_ceil(8) > self.lines.len() {
            self.lines.resize(len.div_ceil(8), Line::default());
        }
        self.len = len;
    }

    /// So many zeros.
    pub fn of_zeros(len: usize) -> Aligned {
        let mut out = Aligned::default();
        out.zeros(len);
        out
    }

    /// The numbers as rows of `W`.
    pub fn rows_of<const W: usize>(&self) -> &[[f64; W]] {
        self.as_chunks::<W>().0
    }

    /// The same, to be written.
    pub fn rows<const W: usize>(&mut self) -> &mut [[f64; W]] {
        self.as_chunks_mut::<W>().0
    }
}

impl std::ops::Deref for Aligned {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        // SAFETY: `lines` holds at least `len` numbers in a row (`Line` is `repr(C)` without
        // padding).
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.len) }
    }
}

impl std::ops::DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f64] {
        // SAFETY: as above, and `self` is borrowed mutably.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.len) }
    }
}
