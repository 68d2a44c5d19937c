// What `six_dof.c` stands on: vectors and functions of them, constants and places of the model, data.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#ifdef __AVX__
#include <immintrin.h>
#endif

// Numbers in a vector: four where nothing wider than AVX2 is asked for.
#ifdef __AVX512F__
#define W 8
#else
#define W 4
#endif
#define INLINE inline __attribute__((always_inline))
// Numbers are read from memory again: broadcasts are kept in no register, and so not spilled.
#if W == 8
#define FORGET __asm__ volatile("" ::: "memory")
#else
#define FORGET
#endif
// A loop written out.
#define ALL _Pragma("GCC unroll 20")
#define APART __attribute__((noinline))
typedef double vd __attribute__((vector_size(8 * W)));
typedef long vl __attribute__((vector_size(8 * W)));

#define G0 9.80665
#define RHO 0.9
#define MASS 5200.0
#define AREA 30.0
#define CHORD 2.06
#define SPAN 15.9
#define IXX 12000.0
#define IYY 25000.0
#define IZZ 35000.0
#define IXZ 2000.0
#define DET (IXX * IZZ - IXZ * IXZ)

// States, inputs, and where parameters begin in the order of the model file.
enum { xu, xv, xw, xp, xq, xr, xphi, xth, xpsi, xn, xe, xh };
enum { de, da, dr, thrust };
enum { CX0 = 0, CZ0 = 7, Cm0 = 13, CY0 = 20, Cl0 = 27, Cn0 = 35, z_V = 43, k_h = 52, k_a = 56, k_b, x_a, x_b,
  PARAMETERS };

// Directions: a coefficient's terms in each eight, then initial u to theta; the residual and the other
// initial states where a coefficient has less than eight terms.
#define NV (56 / W)
#define SLOT_E 7
static const int SLOT_START[12] = {48, 49, 50, 51, 52, 53, 54, 55, 14, 15, 23, 31};
static const int FIRST[7] = {CX0, CZ0, Cm0, CY0, Cl0, Cn0, z_V};
// Samples whose rows are multiplied together: they stay in near memory.
#define CHUNK 8
// Rows of a sample: the states, those but u, v and w being outputs as well; then V, alpha and beta, then ax, ay and
// az.
enum { row_V = 12, row_ax = 15, ROWS = 18 };
static INLINE int row_of(int j) { return j < 3 ? row_V + j : j < 9 ? j : j == 9 ? xh : j < 13 ? row_ax + j - 10
  : xn + j - 13; }
// States that a Jacobian depends on.
#define KEPT 9
#define MOST 4

// Where each parameter, and the residual, stands among the directions.
static int slot[PARAMETERS + 1];
static double samples_in_all;
static int segments, groups, longest, blocks, pad, lengths[MOST * W];
static double dt, theta0[PARAMETERS], start0[MOST * W][12], start[MOST * W][12];
// Segments are lanes in these: [sample][input or output][group], the residuals and altitudes of a pass
// likewise, and the states of stages of W samples.
static vd *inputs, *measured, *scored, *residuals, *height, *stages, square[15];
// Samples are lanes in these: [segment][input][sample], [segment][block][stage][state].
static double *input_of, *states;
// Of some samples the sensitivities of states and outputs; a segment's sums: of products, and of rows times what is
// direct.
static vd rows[CHUNK + 1][ROWS][NV], Q[56][NV], T[17][NV];
static double direct[CHUNK][5], small[11], scale[12];

#if W == 8
#define BUT_ONE ((vl){-1, -1, -1, -1, -1, -1, -1, 0})
#define BUT_TWO ((vl){-1, -1, -1, -1, -1, -1, 0, 0})
#else
#define BUT_ONE ((vl){-1, -1, -1, 0})
#define BUT_TWO ((vl){-1, -1, 0, 0})
#endif

static INLINE vd load(const double *from) { vd x; memcpy(&x, from, sizeof x); return x; }
#if defined __AVX512F__
static INLINE vd root(vd x) { return _mm512_sqrt_pd(x); }
#elif defined __AVX__
static INLINE vd root(vd x) { return _mm256_sqrt_pd(x); }
#else
static INLINE vd root(vd x) { return (vd){sqrt(x[0]), sqrt(x[1]), sqrt(x[2]), sqrt(x[3])}; }
#endif

// Tangent's and sine's inverses where the argument is below 7/16 and 1/2, as fdlibm has them.
static INLINE vd arctan(vd x) {
  vd z = x * x, w = z * z;
  vd odd = z * (3.33333333333329318027e-01 + w * (1.42857142725034663711e-01 + w * (9.09088713343650656196e-02
    + w * (6.66107313738753120669e-02 + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)))));
  vd even = w * (-1.99999999998764832476e-01 + w * (-1.11111104054623557880e-01 + w * (-7.69187620504482999495e-02
    + w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02))));
  return x - x * (odd + even);
}
static INLINE vd arcsin(vd x) {
  vd z = x * x;
  vd p = z * (1.66666666666666657415e-01 + z * (-3.25565818622400915405e-01 + z * (2.01212532134862925881e-01
    + z * (-4.00555345006794114027e-02 + z * (7.91534994289814532176e-04 + z * 3.47933107596021167570e-05)))));
  vd q = 1 + z * (-2.40339491173441421878e+00
    + z * (2.02094576023350569471e+00 + z * (-6.88283971605453293030e-01 + z * 7.70381505559019352791e-02)));
  return x + x * (p / q);
}
// A sum that no compiler may take apart (`-ffast-math`).
#ifdef __AVX__
#define KEPT_SO(x) __asm__("" : "+v"(x))
#else
#define KEPT_SO(x)
#endif
// Sine and cosine by the nearest quarter turn and the polynomials of fdlibm.
static INLINE void sincos_of(vd x, vd *s, vd *c) {
  const double shift = 0x1.8p52;
  vd turned = x * 6.36619772367581382433e-01 + shift;
  KEPT_SO(turned);
  vd k = turned - shift;
  vl quarter = (vl)turned;
  vd r = x - k * 1.57079632679489655800e+00 - k * 6.12323399573676603587e-17, z = r * r, w = z * z;
  vd a = r + r * z * (-1.66666666666666324348e-01 + z * 8.33333333332248946124e-03
    + w * ((-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
      + w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
  vd b = 1 - .5 * z + w * ((4.16666666666666019037e-02 + z * -1.38888888888741095749e-03)
    + w * ((2.48015872894767294178e-05 + z * -2.75573143513906633035e-07)
      + w * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)));
  vl odd = -(quarter & 1), swap = ((vl)a ^ (vl)b) & odd;
  *s = (vd)(((vl)a ^ swap) ^ ((quarter & 2) << 62));
  *c = (vd)(((vl)b ^ swap) ^ (((quarter + 1) & 2) << 62));
}

#define LEVEL(step, lo, hi) \
  ALL for (int i = 0; i < W; i++) if (!(i & step)) { \
    vd x = a[i], y = a[i + step]; \
    a[i] = __builtin_shuffle(x, y, (vl)lo); \
    a[i + step] = __builtin_shuffle(x, y, (vl)hi); }
#define L(...) {__VA_ARGS__}
// W vectors turned into columns of `to`, whose rows are `stride` apart.
static INLINE void turn(const vd *in, double *to, int stride) {
  vd a[W];
  ALL for (int i = 0; i < W; i++) a[i] = in[i];
#if W == 8
  LEVEL(1, L(0, 8, 2, 10, 4, 12, 6, 14), L(1, 9, 3, 11, 5, 13, 7, 15))
  LEVEL(2, L(0, 1, 8, 9, 4, 5, 12, 13), L(2, 3, 10, 11, 6, 7, 14, 15))
  LEVEL(4, L(0, 1, 2, 3, 8, 9, 10, 11), L(4, 5, 6, 7, 12, 13, 14, 15))
#else
  LEVEL(1, L(0, 4, 2, 6), L(1, 5, 3, 7))
  LEVEL(2, L(0, 1, 4, 5), L(2, 3, 6, 7))
#endif
  ALL for (int i = 0; i < W; i++) memcpy(to + i * stride, &a[i], sizeof(vd));
}

// Data: segments, dt, parameters, starts of the states; of each segment its samples, then inputs and outputs of each.
static double number(FILE *file) {
  double x;
  if (fscanf(file, "%lf", &x) != 1) { fprintf(stderr, "no number\n"); exit(1); }
  return x;
}
static void *zeros(size_t n) {
  size_t bytes = (n * sizeof(double) + 63) / 64 * 64;
  void *p = aligned_alloc(64, bytes);
  if (!p) { perror("memory"); exit(1); }
  memset(p, 0, bytes);
  return p;
}
static void read_data(const char *name) {
  FILE *file = fopen(name, "r");
  if (!file) { perror(name); exit(1); }
  segments = (int)number(file); longest = (int)number(file); dt = number(file);
  groups = (segments + W - 1) / W;
  if (groups > MOST) { fprintf(stderr, "too many segments\n"); exit(1); }
  blocks = (longest + W - 1) / W; pad = blocks * W + 8;
  size_t lanes = (size_t)groups * W, padded = blocks * W + 1;
  inputs = zeros(padded * 4 * lanes); measured = zeros(padded * 15 * lanes); scored = zeros(padded * lanes);
  residuals = zeros(padded * 15 * lanes); height = zeros(padded * lanes); stages = zeros(W * 4 * KEPT * lanes);
  input_of = zeros((size_t)segments * 4 * pad); states = zeros(lanes * blocks * 4 * KEPT * W);
  for (int i = 0; i < PARAMETERS; i++) theta0[i] = number(file);
  for (int i = 0; i < 12; i++) {
    start0[0][i] = number(file);
    for (int s = 1; s < groups * W; s++) start0[s][i] = start0[0][i];
  }
  for (int s = 0; s < segments; s++) {
    lengths[s] = (int)number(file); samples_in_all += lengths[s];
    for (int t = 0; t < lengths[s]; t++) {
      for (int i = 0; i < 4; i++) input_of[(s * 4 + i) * pad + t] = number(file);
      for (int j = 0; j < 15; j++) ((double *)measured)[(t * 15 + j) * lanes + s] = number(file);
      ((double *)scored)[t * lanes + s] = 1;
    }
  }
  // what runs on behind the end of a segment has its last inputs
  for (int s = 0; s < (int)lanes; s++) for (int i = 0; i < 4; i++) for (int t = 0; t < pad; t++) {
    int of = s < segments ? s : 0;
    if (t >= lengths[of]) input_of[(of * 4 + i) * pad + t] = input_of[(of * 4 + i) * pad + lengths[of] - 1];
    if (t < (int)padded) ((double *)inputs)[(t * 4 + i) * lanes + s] = input_of[(of * 4 + i) * pad + t];
  }
  fclose(file);
  for (int g = 0; g < 6; g++) for (int p = FIRST[g]; p < FIRST[g + 1]; p++) slot[p] = 8 * g + p - FIRST[g];
  slot[PARAMETERS] = SLOT_E;
}
