/* What the parts of the control law share. */

#ifndef MDK_INTERNAL_H
#define MDK_INTERNAL_H

#ifdef __FAST_MATH__
#error "compile without -ffast-math: the code tests for NaN, and is compared with the Python controller"
#endif

#include <math.h>
#include <string.h>

#include "mdk.h"

#if MDK_FLOAT /* as <tgmath.h>, which needs complex numbers that some libraries do not have */
#define atan(x) atanf(x)
#define atan2(y, x) atan2f(y, x)
#define ceil(x) ceilf(x)
#define cos(x) cosf(x)
#define exp(x) expf(x)
#define fabs(x) fabsf(x)
#define sin(x) sinf(x)
#define sqrt(x) sqrtf(x)
#define tanh(x) tanhf(x)
#endif

#define R(number) ((mdk_real)(number))

static inline mdk_real smaller(mdk_real a, mdk_real b) { return a < b ? a : b; }
static inline mdk_real larger(mdk_real a, mdk_real b) { return a > b ? a : b; }
static inline mdk_real limited(mdk_real x, mdk_real low, mdk_real high) {
    return smaller(larger(x, low), high);
}

static inline void copy(int n, const mdk_real *from, mdk_real *to) {
    memcpy(to, from, (size_t)n * sizeof(mdk_real));
}

static inline void set_zero(int n, mdk_real *x) { memset(x, 0, (size_t)n * sizeof(mdk_real)); }

/* y += a x */
static inline void add_scaled(int n, mdk_real a, const mdk_real *x, mdk_real *y) {
    for (int i = 0; i < n; i++) {
        y[i] += a * x[i];
    }
}

/* y += sum over r of a_r x_r, of rows x_r that are `stride` apart. Four rows at once: then y is read and
 * written once for them. Missing rows have the coefficient 0. */
static inline void add_rows(int n, int count, const mdk_real *a, const mdk_real *x, int stride,
                            mdk_real *y) {
    for (int r = 0; r < count; r += 4, x += 4 * stride) {
        const int left = count - r;
        if (left == 1) {
            add_scaled(n, a[r], x, y);
            return;
        }
        const mdk_real a0 = a[r], a1 = a[r + 1];
        const mdk_real a2 = left > 2 ? a[r + 2] : R(0), a3 = left > 3 ? a[r + 3] : R(0);
        const mdk_real *x1 = x + stride, *x2 = left > 2 ? x1 + stride : x;
        const mdk_real *x3 = left > 3 ? x2 + stride : x;
        for (int i = 0; i < n; i++) {
            y[i] += (a0 * x[i] + a1 * x1[i]) + (a2 * x2[i] + a3 * x3[i]);
        }
    }
}

/* The same of two sums y, z with coefficients a, b: the rows are read once for both. */
static inline void add_rows_twice(int n, int count, const mdk_real *a, const mdk_real *b,
                                  const mdk_real *x, int stride, mdk_real *y, mdk_real *z) {
    int r = 0;
    for (; r + 4 <= count; r += 4, x += 4 * stride) {
        const mdk_real a0 = a[r], a1 = a[r + 1], a2 = a[r + 2], a3 = a[r + 3];
        const mdk_real b0 = b[r], b1 = b[r + 1], b2 = b[r + 2], b3 = b[r + 3];
        const mdk_real *x1 = x + stride, *x2 = x1 + stride, *x3 = x2 + stride;
        for (int i = 0; i < n; i++) {
            const mdk_real c0 = x[i], c1 = x1[i], c2 = x2[i], c3 = x3[i];
            y[i] += (a0 * c0 + a1 * c1) + (a2 * c2 + a3 * c3);
            z[i] += (b0 * c0 + b1 * c1) + (b2 * c2 + b3 * c3);
        }
    }
    add_rows(n, count - r, a + r, x, stride, y);
    add_rows(n, count - r, b + r, x, stride, z);
}

/* Four sums, so that additions do not wait for each other. */
static inline mdk_real dot(int n, const mdk_real *x, const mdk_real *y) {
    mdk_real a = R(0), b = R(0), c = R(0), d = R(0);
    int i = 0;
    for (; i + 4 <= n; i += 4) {
        a += x[i] * y[i];
        b += x[i + 1] * y[i + 1];
        c += x[i + 2] * y[i + 2];
        d += x[i + 3] * y[i + 3];
    }
    for (; i < n; i++) {
        a += x[i] * y[i];
    }
    return (a + b) + (c + d);
}

/* Columns of A that a row has, or of S, or of N: those of its kind. */
typedef struct {
    int first, count;
} block;

static inline block block_of(bool is_odd, int even, int all) {
    return is_odd ? (block){even, all - even} : (block){0, even};
}

/* What a gain is multiplied by. */
static inline mdk_real factor_of(const mdk_dynamics *model, int gain,
                                 const mdk_real inputs[MDK_SIGNALS]) {
    return model->factor[gain] < MDK_SIGNALS ? inputs[model->factor[gain]] : R(1);
}

/* The input with which the car of the model moves as this one does. */
static inline void mdk_of_model(const mdk_controller *c, const mdk_real input[MDK_INPUTS],
                                mdk_real found[MDK_INPUTS]) {
    copy(MDK_INPUTS, input, found);
    found[MDK_STEER] *= c->steering.factor;
}

/* lift.c */
void mdk_lift(mdk_controller *c, const mdk_real x_0[MDK_STATES], mdk_real kappa);
void mdk_remember(mdk_controller *c, const mdk_real x_0[MDK_STATES],
                  const mdk_real held[MDK_INPUTS]);

/* dynamics.c */
void mdk_one_step(const mdk_dynamics *model, mdk_real *gains, const mdk_real *psi,
                  const mdk_real inputs[MDK_SIGNALS], mdk_real *following);
void mdk_path_derivatives(const mdk_real moved[3], const mdk_real before[3],
                          const mdk_real after[3], mdk_real kappa, mdk_real found[2][6]);

/* estimator.c */
void mdk_estimate(mdk_controller *c, const mdk_real measured[MDK_STATES],
                  mdk_real x_0[MDK_STATES]);
void mdk_advance(mdk_controller *c, const mdk_real acting[MDK_INPUTS]);
typedef struct {
    int periods;
    mdk_real first[MDK_STATES], second[MDK_STATES], third[MDK_STATES];
} mdk_response;
#define NO_RESPONSE {0, {R(0)}, {R(0)}, {R(0)}}
void mdk_respond(const mdk_model *model, int periods, mdk_response *r);
void mdk_deviation(const mdk_response *r, const mdk_real d[MDK_STATES], mdk_real vx_mps,
                   mdk_real found[MDK_STATES]);

/* mpc.c */
void mdk_step_ahead(mdk_controller *c, const mdk_real input[MDK_INPUTS]);

/* reference.c */
void mdk_expand(const mdk_controller *c, const mdk_situation *now, const mdk_real x_0[MDK_STATES],
                mdk_real *x_r);

/* eq14.c */
int mdk_knot_of(const mdk_problem *p, int stage, mdk_real *share);
bool mdk_update_matrices(mdk_controller *c);
void mdk_update_vectors(mdk_controller *c);

/* bounds.c */
mdk_real mdk_needed_mps2(const mdk_controller *c);
void mdk_choose_pedal(mdk_controller *c, mdk_real needed_mps2);
void mdk_update_bounds(mdk_controller *c);

/* solver.c */
bool mdk_factorise(mdk_qp *qp);
mdk_status mdk_solve(mdk_qp *qp, int max_iterations);

#endif
