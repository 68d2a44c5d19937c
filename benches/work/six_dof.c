// One Gauss-Newton iteration for `six_dof.model.toml`, written by hand for this one model: the least
// time that we know how to reach. Data in (a file named on the command line); least milliseconds of
// an iteration, costs before and after it, and the new parameters out.
//
// In turn: the motion of all segments, which are the lanes; R; then segment by segment, with
// samples for lanes, the Jacobians of the four stages and the transition of the whole step,
//   S' = Phi S + sum_s G_s f_s,   the exact derivative of the Runge-Kutta step,
// where f_s are the terms of the aerodynamic coefficients and G_s what a unit of each does to the
// end of the step; then S, with directions for lanes; sums of products; solution.
//
// Directions: 43 parameters move the states. The other 17 stand in outputs alone and need no S. An
// initial psi, north, east or h moves next to nothing, and stands where a coefficient has no term.
#include "six_dof.h"
#include "six_dof_model.h"
#include "six_dof_sums.h"

// All segments from their starts: states of every stage and residuals.
static APART void motion(const double *p) {
  vd x[12 * MOST];
  for (int i = 0; i < 12; i++) for (int s = 0; s < groups * W; s++)
    ((double *)x)[i * groups * W + s] = start[s < segments ? s : 0][i];
  memset(square, 0, sizeof square);
  for (int t = 0; t < blocks * W; t++) for (int k = 0; k < groups; k++) {
    vd now[12], at[12], f[12], sum[12], acc[3], in[4], *kept = stages + (size_t)(t % W) * 4 * KEPT * groups + k;
    for (int i = 0; i < 12; i++) at[i] = now[i] = x[i * groups + k];
    const vd *left = inputs + (size_t)t * 4 * groups + k, *right = left + 4 * groups;
    for (int n = 0; n < 4; n++) {
      for (int i = 0; i < 4; i++) {
        vd a = left[i * groups], b = right[i * groups];
        in[i] = n == 0 ? a : n == 3 ? b : a + .5 * (b - a);
      }
      for (int i = 0; i < KEPT; i++) kept[(n * KEPT + i) * groups] = at[i];
      air a = air_of(at, in, p);
      rates(at, &a, f, acc);
      if (n == 0) {
        // V_m = V + z_V, alpha_m = k_a*(alpha - x_a*q/V) + z_a, beta_m = k_b*(beta + x_b*r/V) + z_b,
        // p..psi + z, h_m = k_h*h, ax..az + z, north, east
        vd y[15] = {a.V, p[k_a] * (a.al - p[x_a] * at[xq] * a.iV), p[k_b] * (a.be + p[x_b] * at[xr] * a.iV),
          at[xp], at[xq], at[xr], at[xphi], at[xth], at[xpsi], p[k_h] * at[xh], acc[0], acc[1], acc[2], at[xn],
            at[xe]};
        const vd *z = measured + (size_t)t * 15 * groups + k, there = scored[t * groups + k];
        vd *e = residuals + (size_t)t * 15 * groups + k;
        height[t * groups + k] = at[xh];
        for (int j = 0; j < 15; j++) {
          vd d = (z[j * groups] - y[j] - (j < 13 && j != 9 ? p[z_V + j] : 0)) * there;
          e[j * groups] = d;
          square[j] += d * d;
        }
      }
      // the classical Runge-Kutta scheme
      static const double ahead[3] = {.5, .5, 1};
      for (int i = 0; i < 12; i++) {
        sum[i] = n == 0 ? f[i] : n == 3 ? sum[i] + f[i] : sum[i] + 2 * f[i];
        at[i] = n < 3 ? now[i] + ahead[n] * dt * f[i] : now[i] + dt / 6 * sum[i];
      }
    }
    for (int i = 0; i < 12; i++) x[i * groups + k] = at[i];
    for (int i = 0; i < 4 * KEPT && t % W == W - 1; i++) {
      vd steps[W];
      for (int l = 0; l < W; l++) steps[l] = stages[(l * 4 * KEPT + i) * groups + k];
      turn(steps, states + (((size_t)k * W * blocks + t / W) * 4 * KEPT + i) * W, blocks * 4 * KEPT * W);
    }
  }
}

// What the step from a sample needs, for W samples at once.
static vd phi[12][9], g[4][12][6], p_alpha[4], entries[24], own[7];
static double f_of[4][W][2][8];

// One where row and column are one state; those among the states that move no other.
static const double unity[12][9] = {{1}, {0, 1}, {0, 0, 1}, {[xp] = 1}, {[xq] = 1}, {[xr] = 1}, {[xphi] = 1},
  {[xth] = 1}, {[xpsi] = 1}};
static const double own_of[12] = {[xn] = 1, [xe] = 1, [xh] = 1};

// Whether an entry of the Jacobian is ever anything but zero.
static INLINE int has(int row, int c) {
  static const int mask[12] = {0xb7, 0xef, 0xdf, 0x3f, 0x3f, 0x3f, 0xf8, 0x70, 0xf0, 0x1c7, 0x1c7, 0xc7};
  return mask[row] >> c & 1;
}

// Whether a coefficient at stage `n` moves a state by the end of the step.
static INLINE int is_there(int n, int i, int of) {
  int moment = of == 2 || of > 3;
  if (n == 3) return of == 0 ? i == xu : of == 1 ? i == xw : of == 2 ? i == xq : of == 3 ? i == xv
    : i == xp || i == xr;
  if (n == 2) return i == xv ? of != 2 : i >= xn ? !moment : i >= xphi ? moment : 1;
  return 1;
}

// Row `row` of the transition: M_4 = h/6, M_3 = h/6 (2 + h A_4), M_2 = h/6 2 + h/2 M_3 A_3,
// M_1 = h/6 + h/2 M_2 A_2; Phi = 1 + sum M_s A_s, G_s = M_s times the unit of each coefficient. States
// that are measured as they are count in their standard deviations: rows of S are rows of outputs then.
static INLINE void transition(int row, int late, vd (*a)[12][9], vd (*unit)[8]) {
  const double weight[4] = {dt / 6, dt / 3, dt / 3, dt / 6};
  double d = scale[row];
  vd m[9], sum[9];
  ALL for (int c = 0; c < 8 + late; c++) {
    sum[c] = d * weight[3] * a[3][row][c];
    m[c] = dt * sum[c] + d * weight[2] * unity[row][c];
    sum[c] += d * unity[row][c] * (1 - late);
  }
  ALL for (int n = 2; n >= 0; n--) {
    vd (*A)[9] = a[n], *G = g[n][row];
    G[0] = m[xu] * unit[n][0];
    G[1] = m[xw] * unit[n][1];
    G[2] = m[xq] * unit[n][2];
    G[3] = m[xv] * unit[n][3];
    G[4] = m[xp] * unit[n][4] + m[xr] * unit[n][5];
    G[5] = m[xp] * unit[n][6] + m[xr] * unit[n][7];
    vd at[9];
    ALL for (int c = 0; c < 8 + late; c++) {
      at[c] = late ? d * weight[n] * own_of[row] * A[row][c] : (vd){0};
      ALL for (int k = 0; k < 8 + late; k++) if (has(k, c)) at[c] += m[k] * A[k][c];
    }
    ALL for (int c = 0; c < 8 + late; c++) {
      sum[c] += at[c];
      if (n) m[c] = dt / 2 * at[c] + d * weight[n - 1] * unity[row][c];
    }
  }
  ALL for (int c = 0; c < 8 + late; c++) phi[row][c] = c < 3 ? sum[c] : sum[c] * (1 / scale[c]);
}

// Jacobians, transition, terms of the coefficients and rows of the outputs of W samples.
static APART void prepare(const double *p, const double *sw, int segment, int t) {
  static vd a[4][12][9], unit[4][8];
  const double *kept = states + ((size_t)segment * blocks + t / W) * 4 * KEPT * W,
    *in_of = input_of + (size_t)segment * 4 * pad + t;
  for (int n = 0; n < 4; n++) {
    vd in[4], x[KEPT];
    for (int i = 0; i < 4; i++) {
      vd l = load(in_of + i * pad), r = load(in_of + i * pad + 1);
      in[i] = n == 0 ? l : n == 3 ? r : l + .5 * (r - l);
    }
    for (int i = 0; i < KEPT; i++) x[i] = load(kept + (n * KEPT + i) * W);
    air b = air_of(x, in, p);
    jacobian(x, &b, p, a[n], unit[n]);
    vd one = (vd){0} + 1, lon[8] = {one, b.al, b.al * b.al, b.qh, in[de], b.be * b.be, b.Tc, {0}};
    vd lat[8] = {one, b.be, b.ph, b.rh, in[da], in[dr], b.be * b.al, b.rh * b.al};
    for (int i = 0; i < 8; i += W) {
      turn(lon + i, &f_of[n][0][0][i], 16);
      turn(lat + i, &f_of[n][0][1][i], 16);
    }
    p_alpha[n] = b.ph * b.al;
    if (n) continue;
    vd iV = b.iV, iD2 = 1 / b.D2, iD = root(b.D2) * iD2, V[3] = {x[xu] * iV, x[xv] * iV, x[xw] * iV}, *c = entries;
    vd qV = p[x_a] * x[xq] * iV * iV, rV = p[x_b] * x[xr] * iV * iV, bi = -x[xv] * iV * iV * iD;
    for (int i = 0; i < 3; i++) *c++ = sw[0] * V[i];
    double k = sw[1] * p[k_a];
    *c++ = k * (qV * V[0] - x[xw] * iD2); *c++ = k * (qV * V[1]); *c++ = k * (qV * V[2] + x[xu] * iD2);
    *c++ = -k * p[x_a] / scale[xq] * iV;
    k = sw[2] * p[k_b];
    *c++ = k * (x[xu] * bi - rV * V[0]); *c++ = k * (b.D2 * iD * iV * iV - rV * V[1]);
    *c++ = k * (x[xw] * bi - rV * V[2]); *c++ = k * p[x_b] / scale[xr] * iV;
    // accelerations: rates without rotation and gravity
    vd (*A)[9] = a[0], q = x[xq], r = x[xr], pp = x[xp];
    *c++ = sw[10] * A[xu][0]; *c++ = sw[10] * (A[xu][1] - r); *c++ = sw[10] * (A[xu][2] + q);
    *c++ = sw[10] / scale[xq] * (A[xu][4] + x[xw]);
    *c++ = sw[11] * (A[xv][0] + r); *c++ = sw[11] * A[xv][1]; *c++ = sw[11] * (A[xv][2] - pp);
    *c++ = sw[11] / scale[xp] * (A[xv][3] - x[xw]); *c++ = sw[11] / scale[xr] * (A[xv][5] + x[xu]);
    *c++ = sw[12] * (A[xw][0] - q); *c++ = sw[12] * (A[xw][1] + pp); *c++ = sw[12] * A[xw][2];
    *c++ = sw[12] / scale[xq] * (A[xw][4] - x[xu]);
    own[0] = sw[10] * unit[0][0]; own[1] = sw[11] * unit[0][3]; own[2] = sw[12] * unit[0][1];
    // of k_h; k_a, k_b; x_a, x_b
    own[3] = sw[1] * (b.al - p[x_a] * q * iV); own[4] = sw[2] * (b.be + p[x_b] * r * iV);
    own[5] = -sw[1] * p[k_a] * q * iV; own[6] = sw[2] * p[k_b] * r * iV;
  }
  for (int row = 0; row < 8; row++) transition(row, 0, a, unit);
  for (int row = 8; row < 12; row++) transition(row, 1, a, unit);
  // the last stage: a coefficient moves its own rates alone
  g[3][xu][0] = scale[xu] * dt / 6 * unit[3][0]; g[3][xw][1] = scale[xw] * dt / 6 * unit[3][1];
  g[3][xq][2] = scale[xq] * dt / 6 * unit[3][2]; g[3][xv][3] = scale[xv] * dt / 6 * unit[3][3];
  g[3][xp][4] = scale[xp] * dt / 6 * unit[3][4]; g[3][xr][4] = scale[xr] * dt / 6 * unit[3][5];
  g[3][xp][5] = scale[xp] * dt / 6 * unit[3][6]; g[3][xr][5] = scale[xr] * dt / 6 * unit[3][7];
}

// Eight or four directions (`v`) of coefficient `of` at sample `l`: rows of the outputs, then the step.
static INLINE void advance(int v, int of, int l, vd (*row)[NV]) {
  vd s[12], f[4];
  ALL for (int i = 0; i < 12; i++) s[i] = row[i][v];
  int part = v * W % 8;
  ALL for (int n = 0; n < 4 && of < 6; n++) {
    f[n] = load(&f_of[n][l][of > 2][part]);
    if (part + W < 8) continue;
    if (of == 1) f[n] = (vd)((vl)f[n] & BUT_TWO);
    if (of == 3) f[n] = (vd)((vl)f[n] & BUT_ONE);
    if (of == 5) f[n] = (vd)(((vl)f[n] & BUT_ONE) | ((vl)((vd){0} + p_alpha[n][l]) & ~BUT_ONE));
  }
#define C(i) entries[i][l]
  row[row_V][v] = C(0) * s[xu] + C(1) * s[xv] + C(2) * s[xw];
  row[row_V + 1][v] = C(3) * s[xu] + C(4) * s[xv] + C(5) * s[xw] + C(6) * s[xq];
  row[row_V + 2][v] = C(7) * s[xu] + C(8) * s[xv] + C(9) * s[xw] + C(10) * s[xr];
  vd ax = C(11) * s[xu] + C(12) * s[xv] + C(13) * s[xw] + C(14) * s[xq];
  vd ay = C(15) * s[xu] + C(16) * s[xv] + C(17) * s[xw] + C(18) * s[xp] + C(19) * s[xr];
  vd az = C(20) * s[xu] + C(21) * s[xv] + C(22) * s[xw] + C(23) * s[xq];
  row[row_ax][v] = of == 0 ? ax + own[0][l] * f[0] : ax;
  row[row_ax + 1][v] = of == 3 ? ay + own[1][l] * f[0] : ay;
  row[row_ax + 2][v] = of == 1 ? az + own[2][l] * f[0] : az;
  // twelve sums side by side, none of which waits for itself
  vd sum[12];
  ALL for (int i = 0; i < 12; i++) sum[i] = i < 8 ? phi[i][0][l] * s[0] : s[i] + phi[i][0][l] * s[0];
  ALL for (int c = 1; c < 8; c++) ALL for (int i = 0; i < 12; i++) sum[i] += phi[i][c][l] * s[c];
  ALL for (int i = xn; i < xh; i++) sum[i] += phi[i][8][l] * s[8];
  ALL for (int n = 0; n < 4 && of < 6; n++) ALL for (int i = 0; i < 12; i++)
    if (is_there(n, i, of)) sum[i] += g[n][i][of][l] * f[n];
  ALL for (int i = 0; i < 12; i++) row[ROWS + i][v] = sum[i];
}

// Sums of products of a segment.
static APART void sweep(int segment, const double *p, const double *sw) {
  int n = lengths[segment];
  memset(rows, 0, sizeof rows); memset(Q, 0, sizeof Q); memset(T, 0, sizeof T); memset(small, 0, sizeof small);
  for (int i = 0; i < 12; i++) ((double *)rows[0][i])[SLOT_START[i]] = scale[i];
  for (int t = 0; t < n; t++) {
    int l = t % W, near = t % CHUNK;
    if (l == 0) prepare(p, sw, segment, t);
    vd (*row)[NV] = rows[near];
#define OF(v) advance(v, (v) * W / 8, l, row); FORGET;
    OF(0) OF(1) OF(2) OF(3) OF(4) OF(5) OF(6)
#if W == 4
    OF(7) OF(8) OF(9) OF(10) OF(11) OF(12) OF(13)
#endif
    const double *e = (double *)(residuals + (size_t)t * 15 * groups) + segment;
    for (int j = 0; j < 15; j++) ((double *)row[row_of(j)])[SLOT_E] = sw[j] * e[j * groups * W];
    double *d = direct[near];
    d[0] = sw[9] * ((double *)height)[(size_t)t * groups * W + segment];
    for (int i = 0; i < 4; i++) d[1 + i] = own[3 + i][l];
    small[0] += d[0] * d[0];
    for (int i = 1; i < 3; i++) {
      double *s = small + 1 + 5 * (i - 1), a = d[i], b = d[i + 2];
      s[0] += a; s[1] += b; s[2] += a * a; s[3] += a * b; s[4] += b * b;
    }
    if (near < CHUNK - 1 && t < n - 1) continue;
    products(near + 1);
    memcpy(rows[0], rows[CHUNK], 12 * sizeof *rows[0]);
  }
}

static double now_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e3 * t.tv_sec + 1e-6 * t.tv_nsec;
}

// The iteration: cost `sum_j N/2 ln R_jj` here, and the step from here.
static double iterate(double *p, double *det) {
  double sw[15], step[PARAMETERS], steps[MOST * W][12], cost = 0;
  motion(p);
  *det = 1;
  for (int j = 0; j < 15; j++) {
    double sum = 0;
    for (int l = 0; l < W; l++) sum += square[j][l];
    double r = sum / samples_in_all;
    *det *= r; cost += samples_in_all / 2 * log(r); sw[j] = 1 / sqrt(r);
  }
  for (int i = 0; i < 12; i++) scale[i] = i < xp ? 1 : i < xn ? sw[i] : i < xh ? sw[13 + i - xn] : sw[9] * p[k_h];
  memset(common, 0, sizeof common); memset(all_Q, 0, sizeof all_Q); memset(all_T, 0, sizeof all_T);
  memset(all_small, 0, sizeof all_small);
  for (int s = 0; s < segments; s++) { sweep(s, p, sw); eliminate(s, sw); }
  solve(sw, step, steps);
  for (int i = 0; i < PARAMETERS; i++) p[i] += step[i];
  for (int s = 0; s < segments; s++) for (int i = 0; i < 12; i++) start[s][i] += steps[s][i];
  return cost;
}

int main(int n, char **names) {
  if (n < 2) return 1;
  read_data(names[1]);
  int runs = n > 2 ? atoi(names[2]) : 20;
  double p[PARAMETERS], det, cost = 0, least = 1e300;
  for (int k = -2; k < runs; k++) {
    memcpy(p, theta0, sizeof p); memcpy(start, start0, sizeof start);
    double from = now_ms();
    cost = iterate(p, &det);
    from = now_ms() - from;
    if (k >= 0 && from < least) least = from;
  }
  printf("ms %.6f\ncost %.17g %.17g", least, cost, det);
  double first[PARAMETERS], starts[MOST * W][12];
  memcpy(first, p, sizeof p); memcpy(starts, start, sizeof start);
  cost = iterate(p, &det);
  printf(" %.17g\nto", cost);
  for (int i = 0; i < PARAMETERS; i++) printf(" %.17g", first[i]);
  for (int s = 0; s < segments; s++) for (int i = 0; i < 12; i++) printf(" %.17g", starts[s][i]);
  printf("\n");
}
