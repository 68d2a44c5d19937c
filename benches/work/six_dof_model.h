// The equations of `six_dof.model.toml`: rates of the states, accelerations, and the Jacobian of the rates.

// Numbers of one instant, for so many segments or samples.
typedef struct { vd V, iV, D2, al, be, ph, qh, rh, qS, Tc, sphi, cphi, sth, cth, spsi, cpsi, CX, CZ, Cm, CY, Cl,
  Cn; } air;

static INLINE air air_of(const vd *x, const vd *in, const double *p) {
  air a;
  vd u = x[xu], v = x[xv], w = x[xw];
  a.D2 = u * u + w * w;
  a.V = root(a.D2 + v * v);                             // V = sqrt(u^2 + v^2 + w^2)
  a.iV = 1 / a.V;
  a.al = arctan(w / u);                                 // alpha = atan2(w, u), in forward flight
  a.be = arcsin(v * a.iV);                              // beta = asin(v/V)
  a.qS = RHO / 2 * AREA * (a.V * a.V);                  // qS = rho*V^2/2*S
  a.ph = x[xp] * (SPAN / 2 * a.iV);                     // ph = p*b/(2*V), rh = r*b/(2*V)
  a.rh = x[xr] * (SPAN / 2 * a.iV);
  a.qh = x[xq] * (CHORD * a.iV);                        // qh = q*c/V
  a.Tc = in[thrust] * (2 / (RHO * AREA)) * (a.iV * a.iV); // Tc = thrust/qS
  sincos_of(x[xphi], &a.sphi, &a.cphi);
  sincos_of(x[xth], &a.sth, &a.cth);
  sincos_of(x[xpsi], &a.spsi, &a.cpsi);
  vd al2 = a.al * a.al, be2 = a.be * a.be, ba = a.be * a.al;
  // CX = CX0 + CXa*alpha + CXa2*alpha^2 + CXq*qh + CXde*de + CXb2*beta^2, and CXt*thrust/qS;
  // CZ the same without thrust; Cm the same with Cmt*Tc.
#define LONGITUDINAL(c) c[0] + c[1] * a.al + c[2] * al2 + c[3] * a.qh + c[4] * in[de] + c[5] * be2
  const double *c = p + CX0; a.CX = LONGITUDINAL(c) + c[6] * a.Tc;
  c = p + CZ0; a.CZ = LONGITUDINAL(c);
  c = p + Cm0; a.Cm = LONGITUDINAL(c) + c[6] * a.Tc;
  // CY = CY0 + CYb*beta + CYp*ph + CYr*rh + CYda*da + CYdr*dr + CYba*beta*alpha;
  // Cl the same with Clra*rh*alpha, Cn with Cnpa*ph*alpha.
#define LATERAL(c) c[0] + c[1] * a.be + c[2] * a.ph + c[3] * a.rh + c[4] * in[da] + c[5] * in[dr] + c[6] * ba
  c = p + CY0; a.CY = LATERAL(c);
  c = p + Cl0; a.Cl = LATERAL(c) + c[7] * a.rh * a.al;
  c = p + Cn0; a.Cn = LATERAL(c) + c[7] * a.ph * a.al;
  return a;
}

// Rates of the states; accelerations ax, ay, az = qS*(CX, CY, CZ)/m, thrust included.
static INLINE void rates(const vd *x, const air *a, vd *f, vd *acc) {
  vd u = x[xu], v = x[xv], w = x[xw], p = x[xp], q = x[xq], r = x[xr], qm = a->qS * (1 / MASS);
  acc[0] = qm * a->CX; acc[1] = qm * a->CY; acc[2] = qm * a->CZ;
  f[xu] = acc[0] - G0 * a->sth + r * v - q * w;         // u' = ax - g*sin(theta) + r*v - q*w
  f[xv] = acc[1] + G0 * a->cth * a->sphi + p * w - r * u; // v' = ay + g*cos(theta)*sin(phi) + p*w - r*u
  f[xw] = acc[2] + G0 * a->cth * a->cphi + q * u - p * v; // w' = az + g*cos(theta)*cos(phi) + q*u - p*v
  vd L = SPAN * a->qS * a->Cl + IXZ * p * q - (IZZ - IYY) * q * r; // L = qS*b*Cl + I_xz*p*q - (I_zz - I_yy)*q*r
  vd N = SPAN * a->qS * a->Cn - IXZ * q * r - (IYY - IXX) * p * q; // N = qS*b*Cn - I_xz*q*r - (I_yy - I_xx)*p*q
  f[xp] = IZZ / DET * L + IXZ / DET * N;                // p' = (I_zz*L + I_xz*N)/det
  f[xr] = IXZ / DET * L + IXX / DET * N;                // r' = (I_xz*L + I_xx*N)/det
  // q' = (qS*c*Cm - (I_xx - I_zz)*p*r - I_xz*(p^2 - r^2))/I_yy
  f[xq] = CHORD / IYY * a->qS * a->Cm - (IXX - IZZ) / IYY * p * r - IXZ / IYY * (p * p - r * r);
  vd turn = q * a->sphi + r * a->cphi, down = v * a->sphi + w * a->cphi;
  f[xpsi] = turn / a->cth;                              // psi' = (q*sin(phi) + r*cos(phi))/cos(theta)
  f[xphi] = p + f[xpsi] * a->sth;                       // phi' = p + psi'*sin(theta)
  f[xth] = q * a->cphi - r * a->sphi;                   // theta' = q*cos(phi) - r*sin(phi)
  vd up = u * a->cth + down * a->sth, across = v * a->cphi - w * a->sphi;
  f[xn] = up * a->cpsi - across * a->spsi;              // north' = up*cos(psi) - across*sin(psi)
  f[xe] = up * a->spsi + across * a->cpsi;              // east' = up*sin(psi) + across*cos(psi)
  f[xh] = u * a->sth - down * a->cth;                   // h' = u*sin(theta) - (v*sin(phi) + w*cos(phi))*cos(theta)
}

// Jacobian of the rates at a stage: `a[row][column]`, columns u v w p q r phi theta psi, what is always
// zero untouched; `unit`: what a unit of each coefficient adds to u', w', q', v', p', r' (by Cl), p', r' (by Cn).
static INLINE void jacobian(const vd *x, const air *a, const double *p, vd (*m)[9], vd *unit) {
  vd u = x[xu], v = x[xv], w = x[xw], q = x[xq], r = x[xr], pp = x[xp], zero = {0};
  vd iD2 = 1 / a->D2, iD = root(a->D2) * iD2, iV = a->iV;
  vd V[3] = {u * iV, v * iV, w * iV}, al[3] = {-w * iD2, zero, u * iD2};
  vd bi = -v * iV * iV * iD, be[3] = {u * bi, a->D2 * iD * iV * iV, w * bi};
  unit[0] = unit[1] = unit[3] = a->qS * (1 / MASS);
  unit[2] = a->qS * (CHORD / IYY);
  unit[4] = a->qS * (SPAN * IZZ / DET);
  unit[5] = unit[6] = a->qS * (SPAN * IXZ / DET);
  unit[7] = a->qS * (SPAN * IXX / DET);
  // d(qS C)/dx = qS ((2 C - terms in rates)/V dV/dx + C_alpha dalpha/dx + C_beta dbeta/dx)
  const double *c;
  vd f[6][6] = {{zero}};                                // by u v w p q r, without qS
#define AERO(k, kV, ka, kb) do { \
    vd by_V = (kV) * iV, by_a = ka, by_b = kb; \
    ALL for (int i = 0; i < 3; i++) f[k][i] = by_V * V[i] + by_a * al[i] + by_b * be[i]; } while (0)
  c = p + CX0; AERO(0, 2 * (a->CX - c[6] * a->Tc) - c[3] * a->qh, c[1] + 2 * c[2] * a->al, 2 * c[5] * a->be);
  f[0][4] = c[3] * CHORD * iV;
  c = p + CZ0; AERO(1, 2 * a->CZ - c[3] * a->qh, c[1] + 2 * c[2] * a->al, 2 * c[5] * a->be);
  f[1][4] = c[3] * CHORD * iV;
  c = p + Cm0; AERO(2, 2 * (a->Cm - c[6] * a->Tc) - c[3] * a->qh, c[1] + 2 * c[2] * a->al, 2 * c[5] * a->be);
  f[2][4] = c[3] * CHORD * iV;
  vd half = SPAN / 2 * iV, r_al = a->rh * a->al, p_al = a->ph * a->al;
  c = p + CY0; AERO(3, 2 * a->CY - c[2] * a->ph - c[3] * a->rh, c[6] * a->be, c[1] + c[6] * a->al);
  f[3][3] = c[2] * half; f[3][5] = c[3] * half;
  c = p + Cl0;
  AERO(4, 2 * a->Cl - c[2] * a->ph - c[3] * a->rh - c[7] * r_al, c[6] * a->be + c[7] * a->rh, c[1] + c[6] * a->al);
  f[4][3] = c[2] * half; f[4][5] = (c[3] + c[7] * a->al) * half;
  c = p + Cn0;
  AERO(5, 2 * a->Cn - c[2] * a->ph - c[3] * a->rh - c[7] * p_al, c[6] * a->be + c[7] * a->ph, c[1] + c[6] * a->al);
  f[5][3] = (c[2] + c[7] * a->al) * half; f[5][5] = c[3] * half;
  ALL for (int i = 0; i < 6; i++) {
    m[xu][i] = unit[0] * f[0][i]; m[xw][i] = unit[1] * f[1][i]; m[xv][i] = unit[3] * f[3][i];
    m[xq][i] = unit[2] * f[2][i];
    m[xp][i] = unit[4] * f[4][i] + unit[6] * f[5][i];
    m[xr][i] = unit[5] * f[4][i] + unit[7] * f[5][i];
  }
  // what rotation and gravity add
  m[xu][1] += r; m[xu][2] -= q; m[xu][4] -= w; m[xu][5] = v; m[xu][7] = -G0 * a->cth;
  m[xv][0] -= r; m[xv][2] += pp; m[xv][3] += w; m[xv][5] -= u; m[xv][6] = G0 * a->cth * a->cphi;
  m[xv][7] = -G0 * a->sth * a->sphi;
  m[xw][0] += q; m[xw][1] -= pp; m[xw][3] = -v; m[xw][4] += u; m[xw][6] = -G0 * a->cth * a->sphi;
  m[xw][7] = -G0 * a->sth * a->cphi;
  // L: lp p q + lr q r, N: np p q + nr q r
  const double lp = IXZ, lr = -(IZZ - IYY), np = -(IYY - IXX), nr = -IXZ;
  const double pp_q = (IZZ * lp + IXZ * np) / DET, pr_q = (IZZ * lr + IXZ * nr) / DET,
    rp_q = (IXZ * lp + IXX * np) / DET, rr_q = (IXZ * lr + IXX * nr) / DET;
  m[xp][3] += pp_q * q; m[xp][4] = pp_q * pp + pr_q * r; m[xp][5] += pr_q * q;
  m[xr][3] += rp_q * q; m[xr][4] = rp_q * pp + rr_q * r; m[xr][5] += rr_q * q;
  m[xq][3] = -(IXX - IZZ) / IYY * r - 2 * IXZ / IYY * pp; m[xq][5] = -(IXX - IZZ) / IYY * pp + 2 * IXZ / IYY * r;
  vd turn = q * a->sphi + r * a->cphi, pitch = q * a->cphi - r * a->sphi, icth = 1 / a->cth, tth = a->sth * icth;
  m[xphi][3] = zero + 1; m[xphi][4] = a->sphi * tth; m[xphi][5] = a->cphi * tth; m[xphi][6] = pitch * tth;
  m[xphi][7] = turn * icth * icth;
  m[xth][4] = a->cphi; m[xth][5] = -a->sphi; m[xth][6] = -turn;
  m[xpsi][4] = a->sphi * icth; m[xpsi][5] = a->cphi * icth; m[xpsi][6] = pitch * icth; m[xpsi][7] = turn * icth * tth;
  vd down = v * a->sphi + w * a->cphi, across = v * a->cphi - w * a->sphi, up = u * a->cth + down * a->sth,
    up_th = down * a->cth - u * a->sth;
  vd up_v = a->sphi * a->sth, up_w = a->cphi * a->sth, up_phi = across * a->sth, s = a->spsi, co = a->cpsi;
  m[xn][0] = a->cth * co; m[xn][1] = up_v * co - a->cphi * s; m[xn][2] = up_w * co + a->sphi * s;
  m[xn][6] = up_phi * co + down * s; m[xn][7] = up_th * co; m[xn][8] = -(up * s + across * co);
  m[xe][0] = a->cth * s; m[xe][1] = up_v * s + a->cphi * co; m[xe][2] = up_w * s - a->sphi * co;
  m[xe][6] = up_phi * s - down * co; m[xe][7] = up_th * s; m[xe][8] = up * co - across * s;
  m[xh][0] = a->sth; m[xh][1] = -a->sphi * a->cth; m[xh][2] = -a->cphi * a->cth; m[xh][6] = -across * a->cth;
  m[xh][7] = up;
}
