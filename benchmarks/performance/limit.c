// SPDX-License-Identifier: Apache-2.0
/* The limit: the base model by hand, with the method of core/integrator.py and nothing else (no effects, no pulses).
 *
 * `run` is one run, plain C for the compiler's optimiser. `ensemble` takes runs eight at a time, lane by lane, as far as
 * they fly (its inner loops are the vectoriser's), and finishes each that touches the track with `run`'s loop.
 * Compiled by limit.py: one with -O3, ensemble with -O3 -march=native -ffast-math.
 */
#include <math.h>
#include <string.h>

#define S 0.70710678118654752440
#define W 8                                     /* lanes */
static const double TOL[8] = {1e-8, 1e-8, 1e-8, 1e-7, 1e-5, 1e-5, 1e-5, 1e-4};

/* Order of core/parameters.py. */
enum { ETA, GAMMA, B0, LAMBDA, IND, RES, MASS, TAU, CURRENT, NC, WT, WS, GRAV, GAP, KC, BC, IZ, HT, OX, OH, NP = 22 };

/* The model once, for one run and for lanes: p(NAME) is a parameter, x(i) a state; the rest are locals of who uses it. */
#define MODEL(p, x, SIN, COS, touching) \
    double k = 2.0 * M_PI / p(LAMBDA), speed = x(4) > 0.0 ? x(4) : 0.0, w = k * speed, s = SIN, c = COS; \
    double tx = -s * p(HT), ty = c * p(HT); \
    double rx = -c * p(OX) - s * p(OH), ry = -s * p(OX) + c * p(OH); \
    double lx = c * p(OX) - s * p(OH), ly = s * p(OX) + c * p(OH); \
    double gt = p(GAP) + x(2) + ty - p(HT); \
    double gr = p(GAP) - S * (x(1) + rx + p(OX) + x(2) + ry - p(OH)); \
    double gl = p(GAP) + S * (x(1) + lx - p(OX) - x(2) - ly + p(OH)); \
    double vt = x(6) + x(7) * tx; \
    double vr = -S * (x(5) - x(7) * ry + x(6) + x(7) * rx); \
    double vl = S * (x(5) - x(7) * ly - x(6) - x(7) * lx); \
    double ot = p(WT) * exp(-k * gt), or = p(WS) * exp(-k * gr), ol = p(WS) * exp(-k * gl), o = ot + or + ol; \
    double reactance = w * p(IND), flux = p(ETA) * p(B0) / k * o, base = flux * w / (p(RES) * p(RES) + reactance * reactance); \
    double f = p(NC) * p(B0), lift = f * base * reactance; \
    double thrust = p(GAMMA) * o * p(B0) * (4.0 * speed / p(LAMBDA) * p(TAU) / M_PI * p(CURRENT)); \
    double drag = o * f * base * p(RES); \
    double ft = ot * lift - (touching(0) ? p(KC) * gt + p(BC) * vt : 0.0); \
    double fr = or * lift - (touching(1) ? p(KC) * gr + p(BC) * vr : 0.0); \
    double fl = ol * lift - (touching(2) ? p(KC) * gl + p(BC) * vl : 0.0); \
    double surge = (thrust - drag) / p(MASS), sway = S * (fl - fr) / p(MASS), heave = (ft - S * (fr + fl)) / p(MASS) - p(GRAV); \
    double roll = (tx * ft + S * fr * (ry - rx) - S * fl * (lx + ly)) / p(IZ);

#ifdef COUNT
long evaluations;
#define COUNT_ONE evaluations++;
#else
#define COUNT_ONE
#endif

typedef struct { double a[4], g[3], v[3]; } Slope;

static void slope(const double *p, const double *x, const int *touching, Slope *d)
{
#define ONE(i) p[i]
#define STATE(i) x[i]
#define TOUCHING(i) touching[i]
    MODEL(ONE, STATE, sin(x[3]), cos(x[3]), TOUCHING)
    COUNT_ONE
    *d = (Slope){{surge, sway, heave, roll}, {gt, gr, gl}, {vt, vr, vl}};
}

static double step(const double *p, double h, const double *x, const Slope *k1, const int *touching, double *y, Slope *end)
{
    double dx[8], stage[8];
    Slope k;
    memcpy(dx, x + 4, 32), memcpy(dx + 4, k1->a, 32);
    for (int i = 0; i < 8; i++) y[i] = x[i] + h / 6.0 * dx[i], stage[i] = x[i] + 0.5 * h * dx[i];
    for (int s = 0; s < 3; s++) {
        slope(p, stage, touching, &k);
        memcpy(dx, stage + 4, 32), memcpy(dx + 4, k.a, 32);
        double weight = s == 2 ? h / 6.0 : h / 3.0, ahead = s == 1 ? h : 0.5 * h;
        for (int i = 0; i < 8; i++) y[i] += weight * dx[i], stage[i] = x[i] + ahead * dx[i];
    }
    slope(p, y, touching, end);
    double error = 0.0;
    for (int i = 0; i < 8; i++) error = fmax(error, h / 6.0 * fabs(dx[i] - (i < 4 ? y[4 + i] : end->a[i - 4])) / TOL[i]);
    return error;
}

static int touches(const double *p, const Slope *d, int i) { return p[KC] * d->g[i] + p[BC] * (d->v[i] > 0.0 ? d->v[i] : 0.0) < 0.0; }

static int switches(const double *p, const Slope *d, const int *touching)
{
    return touches(p, d, 0) != touching[0] || touches(p, d, 1) != touching[1] || touches(p, d, 2) != touching[2];
}

static void limits(const double *p, double *flight, double *contact)
{
    double arm = p[OX] * p[OX] + fmax(p[OH] * p[OH], p[HT] * p[HT]), inverse = 1.0 / p[MASS] + arm / p[IZ];
    *flight = FREE_STEP / sqrt(4.0 * M_PI / p[LAMBDA] * p[GRAV] * p[MASS] * inverse);
    *contact = fmin(*flight, CONTACT_STEP / (sqrt(p[KC] * inverse) + 0.5 * p[BC] * inverse));
}

static void record(double *out, const double *x, const Slope *d) { memcpy(out, x, 64), memcpy(out + 8, d->g, 24), memcpy(out + 11, d->a, 32); }

static void finish(const double *p, double *x, double t, const double *times, long n, long row, double *out)
{
    double flight, contact, refine = 1.0, y[8];
    Slope k1, end;
    int touching[3] = {0, 0, 0};
    limits(p, &flight, &contact);
    slope(p, x, touching, &k1);
    for (int i = 0; i < 3; i++) touching[i] = touches(p, &k1, i);
    slope(p, x, touching, &k1);
    for (; row < n; row++) {
        while (t < times[row]) {
            int in_contact = touching[0] | touching[1] | touching[2];
            double limit = in_contact ? contact : flight, left = times[row] - t;
            double h = left / fmax(ceil(left / fmin(limit * refine, flight) - 1e-9), 1.0);
            double error = step(p, h, x, &k1, touching, y, &end);
            if (error > (refine > 1.0 ? CONTACT_GROWN : 1.0) && refine > FINEST) { refine *= 0.5; continue; }
            if (error < (refine < 1.0 ? 0.03 : CONTACT_GROWS) && refine < (in_contact ? CONTACT_GROWTH : 1.0)) refine *= 2.0;
            if (switches(p, &end, touching)) {
                double low = 0.0, high = h;
                while (high - low > fmax(1e-9, 1e-6 * h)) {
                    double middle = 0.5 * (low + high);
                    step(p, middle, x, &k1, touching, y, &end);
                    if (switches(p, &end, touching)) high = middle; else low = middle;
                }
                h = high;
                step(p, h, x, &k1, touching, y, &end);
                for (int i = 0; i < 3; i++) touching[i] = touches(p, &end, i);
                slope(p, y, touching, &end);
                refine = fmin(refine, 1.0);
            }
            t = h == left ? times[row] : t + h;
            memcpy(x, y, 64), k1 = end;
        }
        record(out + 15 * row, x, &k1);
    }
}

/* One run from x (8) at times[0] through times (n) into out (n, 15). */
void run(const double *p, double *x, const double *times, long n, double *out) { finish(p, x, times[0], times, n, 0, out); }

/* -- lanes ------------------------------------------------------------------------------------------------------ */

typedef double Lanes[W];

static void slope_lanes(const Lanes *restrict p, const Lanes *restrict x, Lanes *restrict acc, Lanes *restrict gap, Lanes *restrict rate)
{
#define LANE(i) p[i][l]
#define STATES(i) x[i][l]
#define FLIGHT(i) 0
#pragma GCC ivdep
    for (int l = 0; l < W; l++) {       /* sin and cos together are a call that is not vectorised; a root is */
        double sine = sin(x[3][l]);
        MODEL(LANE, STATES, sine, sqrt(1.0 - sine * sine), FLIGHT)
        acc[0][l] = surge, acc[1][l] = sway, acc[2][l] = heave, acc[3][l] = roll;
        gap[0][l] = gt, gap[1][l] = gr, gap[2][l] = gl, rate[0][l] = vt, rate[1][l] = vr, rate[2][l] = vl;
    }
}

/* Runs of one model each, P (jobs, NP), x (jobs, 8), out (jobs, n, 15); jobs a multiple of W. */
void ensemble(long jobs, const double *P, double *X, const double *times, long n, double *out)
{
    for (long job = 0; job < jobs; job += W) {
        Lanes p[NP], x[8], y[8], stage[8], dx[8], k[4], a[4], g[3], v[3], gy[3], vy[3], ay[4];
        double shortest = 1.0, refine = 1.0, t = times[0];
        int gone[W] = {0}, flying = W;
        for (int l = 0; l < W; l++) {
            double flight, contact;
            for (int i = 0; i < NP; i++) p[i][l] = P[(job + l) * NP + i];
            for (int i = 0; i < 8; i++) x[i][l] = X[(job + l) * 8 + i];
            limits(P + (job + l) * NP, &flight, &contact);
            shortest = fmin(shortest, flight);
        }
        slope_lanes(p, x, a, g, v);
        for (long row = 0; row < n && flying; row++) {
            while (t < times[row] && flying) {
                double left = times[row] - t, h = left / fmax(ceil(left / (shortest * refine) - 1e-9), 1.0), worst = 0.0;
                memcpy(dx, x[4], sizeof(Lanes) * 4), memcpy(dx[4], a, sizeof a);
                for (int i = 0; i < 8; i++) for (int l = 0; l < W; l++) y[i][l] = x[i][l] + h / 6.0 * dx[i][l], stage[i][l] = x[i][l] + 0.5 * h * dx[i][l];
                for (int s = 0; s < 3; s++) {
                    double weight = s == 2 ? h / 6.0 : h / 3.0, ahead = s == 1 ? h : 0.5 * h;
                    slope_lanes(p, stage, k, gy, vy);
                    memcpy(dx, stage[4], sizeof(Lanes) * 4), memcpy(dx[4], k, sizeof k);
                    for (int i = 0; i < 8; i++) for (int l = 0; l < W; l++) y[i][l] += weight * dx[i][l], stage[i][l] = x[i][l] + ahead * dx[i][l];
                }
                slope_lanes(p, y, ay, gy, vy);
                for (int i = 0; i < 8; i++) for (int l = 0; l < W; l++) {
                    double error = gone[l] ? 0.0 : h / 6.0 * fabs(dx[i][l] - (i < 4 ? y[4 + i][l] : ay[i - 4][l])) / TOL[i];
                    worst = error > worst ? error : worst;
                }
                if (worst > 1.0 && refine > FINEST) { refine *= 0.5; continue; }
                if (worst < 0.03 && refine < 1.0) refine *= 2.0;
                for (int l = 0; l < W; l++)
                    if (!gone[l] && (gy[0][l] < 0.0 || gy[1][l] < 0.0 || gy[2][l] < 0.0)) {
                        double state[8];
                        for (int i = 0; i < 8; i++) state[i] = x[i][l];
                        finish(P + (job + l) * NP, state, t, times, n, row, out + (job + l) * n * 15);
                        gone[l] = 1, flying--;
                    }
                t = h == left ? times[row] : t + h;
                memcpy(x, y, sizeof x), memcpy(a, ay, sizeof a), memcpy(g, gy, sizeof g);
            }
            for (int l = 0; l < W; l++)
                if (!gone[l])
                    for (int i = 0; i < 15; i++) out[((job + l) * n + row) * 15 + i] = i < 8 ? x[i][l] : i < 11 ? g[i - 8][l] : a[i - 11][l];
        }
    }
}
