// What the printed programs are made of: vectors of W directions (V) and of LW lanes (T), and the
// operations of src/model/arithmetic.rs on numbers (suffix _s) and on lanes (suffix _l).
#define PLAIN
#pragma GCC push_options
// The sums of products are always those of the program by hand, whatever else is narrowed.
#pragma GCC optimize("O3,fp-contract=fast")
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw")
#include "hfb.h"
#pragma GCC pop_options
#include <immintrin.h>
#define INLINE static inline __attribute__((always_inline))

#if W == 8
typedef __m512d V;
#define FMA(a, b, c) _mm512_fmadd_pd(a, b, c)
#define ALL(x) _mm512_set1_pd(x)
#define PUT(d, lane, x) _mm512_mask_mov_pd(d, 1 << (lane), ALL(x))
#elif W == 4
typedef __m256d V;
#define FMA(a, b, c) _mm256_fmadd_pd(a, b, c)
#define ALL(x) _mm256_set1_pd(x)
#define PUT(d, lane, x) _mm256_blend_pd(d, ALL(x), 1 << (lane))
#else
typedef __m128d V;
#define FMA(a, b, c) _mm_fmadd_pd(a, b, c)
#define ALL(x) _mm_set1_pd(x)
#define PUT(d, lane, x) _mm_blend_pd(d, ALL(x), 1 << (lane))
#endif
#define NOTHING ((V){0})

#define SMALL 0.785
#define ROUND 6755399441055744.0
static const double SIN[6] = {-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
  2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10};
static const double COS[6] = {4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
  -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11};

#define fma_s(a, b, c) __builtin_fma(a, b, c)
#define sqrt_s(a) __builtin_sqrt(a)
#define POLYNOMIALS(r, tail, sin, cos, fma, all) { \
  const __auto_type z = (r) * (r); const __auto_type z2 = z * z; const __auto_type z4 = z2 * z2; \
  const __auto_type p = fma(fma(all(SIN[5]), z, all(SIN[4])), z4, fma(fma(all(SIN[3]), z, all(SIN[2])), z2, fma(all(SIN[1]), z, all(SIN[0])))); \
  const __auto_type q = fma(fma(all(COS[5]), z, all(COS[4])), z4, fma(fma(all(COS[3]), z, all(COS[2])), z2, fma(all(COS[1]), z, all(COS[0])))); \
  sin = fma((r) * z, p, tail); \
  cos = fma(z2, q, fma(all(-0.5), z, all(1.0))); }
#define one_s(x) (x)

INLINE void sin_cos_s(double x, double *sin, double *cos) {
  if (__builtin_expect(__builtin_fabs(x) <= SMALL, 1)) { POLYNOMIALS(x, x + 0.0, *sin, *cos, fma_s, one_s) return; }
  const double rounded = fma_s(x, 0.63661977236758134308, ROUND), k = rounded - ROUND;
  double r = fma_s(-k, 1.57079632679489661923, x), s, c;
  r = fma_s(-k, 6.123233995736766e-17, r);
  const double tail = fma_s(-k, -1.497384904859169e-33, r);
  POLYNOMIALS(r, tail, s, c, fma_s, one_s)
  long q; memcpy(&q, &rounded, 8);
  *sin = q & 2 ? -(q & 1 ? c : s) : (q & 1 ? c : s);
  *cos = (q + 1) & 2 ? -(q & 1 ? s : c) : (q & 1 ? s : c);
}

#if LW == 8
typedef __m512d T;
#define fma_l(a, b, c) _mm512_fmadd_pd(a, b, c)
#define one_l(x) _mm512_set1_pd(x)
#define IS_SMALL(x) (_mm512_cmp_pd_mask(_mm512_abs_pd(x), one_l(SMALL), _CMP_LE_OQ) == 255)
#elif LW == 4
typedef __m256d T;
#define fma_l(a, b, c) _mm256_fmadd_pd(a, b, c)
#define one_l(x) _mm256_set1_pd(x)
#define IS_SMALL(x) (_mm256_movemask_pd(_mm256_cmp_pd(_mm256_andnot_pd(one_l(-0.0), x), one_l(SMALL), _CMP_LE_OQ)) == 15)
#else
typedef __m128d T;
#define fma_l(a, b, c) _mm_fmadd_pd(a, b, c)
#define one_l(x) _mm_set1_pd(x)
#define IS_SMALL(x) (_mm_movemask_pd(_mm_cmple_pd(_mm_andnot_pd(one_l(-0.0), x), one_l(SMALL))) == 3)
#endif
INLINE void sin_cos_l(T x, T *sin, T *cos) {
  if (__builtin_expect(IS_SMALL(x), 1)) {
    POLYNOMIALS(x, x + one_l(0.0), *sin, *cos, fma_l, one_l) return; }
  for (int l = 0; l < LW; l++) { double s, c; sin_cos_s(x[l], &s, &c); (*sin)[l] = s; (*cos)[l] = c; }
}
