// Rows in; sums of their products, normal equations with every segment's own unknowns eliminated first,
// and the step of all unknowns out.

// Sums of products of some samples' rows: W directions by `NJ` vectors of them, from direction W*i and vector j on.
#define GRAM(NJ) static APART void gram##NJ(int samples, int i, int j) { \
  vd sum[W][NJ]; \
  for (int a = 0; a < W; a++) for (int b = 0; b < NJ; b++) sum[a][b] = Q[i * W + a][j + b]; \
  for (int k = 0; k < samples; k++) for (int n = xp; n < ROWS; n++) { \
    const vd *row = rows[k][n]; \
    vd y[NJ]; for (int b = 0; b < NJ; b++) y[b] = row[j + b]; \
    const double *x = (const double *)(row + i); \
    for (int a = 0; a < W; a++) for (int b = 0; b < NJ; b++) sum[a][b] += x[a] * y[b]; } \
  for (int a = 0; a < W; a++) for (int b = 0; b < NJ; b++) Q[i * W + a][j + b] = sum[a][b]; }
GRAM(1) GRAM(2) GRAM(3)

static APART void products(int samples) {
  for (int i = 0; i < NV; i++) for (int j = i; j < NV;) {
    int left = NV - j;
    if (left == 1) { gram1(samples, i, j); j++; }
    else if (left == 2 || left == 4) { gram2(samples, i, j); j += 2; }
    else { gram3(samples, i, j); j += 3; }
  }
  // parameters of the outputs: shifts and the scale of h, then scales and places of vanes
  for (int v = 0; v < NV; v++) {
    vd sum[17];
    ALL for (int j = 0; j < 17; j++) sum[j] = T[j][v];
    for (int k = 0; k < samples; k++) {
      vd (*row)[NV] = rows[k];
      ALL for (int j = 0; j < 13; j++) sum[j] += j == 9 ? direct[k][0] * row[xh][v] : row[row_of(j)][v];
      ALL for (int i = 0; i < 4; i++) sum[13 + i] += direct[k][1 + i] * row[row_V + 1 + i % 2][v];
    }
    ALL for (int j = 0; j < 17; j++) T[j][v] = sum[j];
  }
}

// Normal equations: unknowns of a segment first, then the common ones, then the right-hand side.
#define LINE 80
static double own_rows[MOST * W][12][LINE], common[PARAMETERS + 1][LINE];
static vd all_Q[56][NV], all_T[17][NV];
static double all_small[11];

static double product_of(vd (*q)[NV], int a,
  int b) { return a / W <= b / W ? q[a][b / W][b % W] : q[b][a / W][a % W]; }
static double direct_of(vd (*t)[NV], const double *sw, int p, int b) {
  int j = p - z_V;
  return t[j][b / W][b % W] * (j < 13 && j != 9 ? sw[j] : 1);
}

// A segment's sums to those of all, its own unknowns eliminated.
static APART void eliminate(int segment, const double *sw) {
  double (*u)[LINE] = own_rows[segment];
  for (int i = 0; i < 56; i++) for (int v = i / W; v < NV; v++) all_Q[i][v] += Q[i][v];
  for (int i = 0; i < 17; i++) for (int v = 0; v < NV; v++) all_T[i][v] += T[i][v];
  for (int i = 0; i < 11; i++) all_small[i] += small[i];
  for (int i = 0; i < 12; i++) {
    for (int j = i; j < 12; j++) u[i][j] = product_of(Q, SLOT_START[i], SLOT_START[j]);
    for (int p = 0; p <= PARAMETERS; p++)
      u[i][12 + p] = p < z_V || p == PARAMETERS ? product_of(Q, slot[p], SLOT_START[i])
        : direct_of(T, sw, p, SLOT_START[i]);
  }
  for (int k = 0; k < 12; k++) {
    double scale = 1 / sqrt(u[k][k]);
    for (int j = k; j < 13 + PARAMETERS; j++) u[k][j] *= scale;
    for (int i = k
      + 1; i < 12; i++) { double x = u[k][i]; for (int j = i; j < 13 + PARAMETERS; j++) u[i][j] -= x * u[k][j]; }
  }
  for (int p = 0; p < PARAMETERS; p++) for (int k = 0; k < 12; k++) {
    double x = u[k][12 + p];
    for (int j = p; j <= PARAMETERS; j++) common[p][j] -= x * u[k][12 + j];
  }
}

// The step of all unknowns.
static APART void solve(const double *sw, double *step, double (*steps)[12]) {
  for (int p = 0; p < PARAMETERS; p++) for (int j = p; j <= PARAMETERS; j++) {
    if (p < z_V) common[p][j] += j < z_V || j == PARAMETERS ? product_of(all_Q, slot[p], slot[j])
      : direct_of(all_T, sw, j, slot[p]);
    else if (j == PARAMETERS) common[p][j] += direct_of(all_T, sw, p, SLOT_E);
  }
  for (int j = 0; j < 13; j++) common[z_V + j][z_V + j] += j == 9 ? all_small[0] : samples_in_all * sw[j] * sw[j];
  for (int i = 0; i < 2; i++) {
    double *s = all_small + 1 + 5 * i;
    common[z_V + 1 + i][k_a + i] += sw[1 + i] * s[0];
    common[z_V + 1 + i][x_a + i] += sw[1 + i] * s[1];
    common[k_a + i][k_a + i] += s[2];
    common[k_a + i][x_a + i] += s[3];
    common[x_a + i][x_a + i] += s[4];
  }
  for (int k = 0; k < PARAMETERS; k++) {
    double scale = 1 / sqrt(common[k][k]);
    for (int j = k; j <= PARAMETERS; j++) common[k][j] *= scale;
    for (int i = k + 1; i < PARAMETERS; i++) {
      double x = common[k][i];
      for (int j = i; j <= PARAMETERS; j++) common[i][j] -= x * common[k][j];
    }
  }
  for (int k = PARAMETERS - 1; k >= 0; k--) {
    double sum = common[k][PARAMETERS];
    for (int j = k + 1; j < PARAMETERS; j++) sum -= common[k][j] * step[j];
    step[k] = sum / common[k][k];
  }
  for (int s = 0; s < segments; s++) for (int k = 11; k >= 0; k--) {
    double (*u)[LINE] = own_rows[s], sum = u[k][12 + PARAMETERS];
    for (int j = 0; j < PARAMETERS; j++) sum -= u[k][12 + j] * step[j];
    for (int j = k + 1; j < 12; j++) sum -= u[k][j] * steps[s][j];
    steps[s][k] = sum / u[k][k];
  }
}
