/* One step of the model, and the derivatives of the path. */

#include "mdk_internal.h"

static const mdk_real SMALLEST_TURN = R(1e-6);
/* of the road in rad; below it arc and tangent have the same length */

/* Path states after a period in which the car moved ahead, left, and turned: the projection of its
 * place onto the circle of the road is exact. */
static void follow_path(const mdk_real moved[3], mdk_real kappa, const mdk_real before[3],
                        mdk_real after[3]) {
    const mdk_real middle = before[2] + R(0.5) * moved[2];
    const mdk_real cosine = cos(middle), sine = sin(middle);
    const mdk_real x_m = moved[0] * cosine - moved[1] * sine;
    const mdk_real y_m = before[1] + moved[0] * sine + moved[1] * cosine;
    const mdk_real ahead = kappa * x_m, sideways = R(1) - kappa * y_m;
    const mdk_real of_road = atan2(ahead, sideways);
    const mdk_real ratio = sqrt(ahead * ahead + sideways * sideways);
    after[0] = fabs(of_road) < SMALLEST_TURN ? x_m / sideways : of_road / kappa;
    after[1] = (R(2) * y_m - kappa * (x_m * x_m + y_m * y_m)) / (R(1) + ratio);
    after[2] = before[2] + moved[2] - of_road;
}

/* psi+ (n). `gains` [gains + 3]: gets t, the value of each gain, and the movement behind them.
 *
 * Paper: eq. (8), with gains. */
void mdk_one_step(const mdk_dynamics *model, mdk_real *gains, const mdk_real *psi,
                  const mdk_real inputs[MDK_SIGNALS], mdk_real *following) {
    const int m = model->m, q = model->gains;
    const int rows = model->has_path ? q + 3 : q;
    for (int r = 0; r < rows; r++) {
        const block b = block_of(model->is_odd[r], model->even, m);
        gains[r] = dot(b.count, model->S + r * m + b.first, psi + b.first) + model->s0[r];
    }
    for (int i = 0; i < m; i++) {
        const block b = block_of(i >= model->even, model->even, m);
        following[i] = dot(b.count, model->A + i * m + b.first, psi + b.first) + model->c[i] +
                       dot(MDK_SIGNALS, model->B + i * MDK_SIGNALS, inputs);
    }
    if (model->has_path) {
        follow_path(gains + q, inputs[MDK_INPUTS], psi + m, following + m);
    }
    mdk_real *term = following + model->n; /* one more number of work space for each gain */
    for (int r = 0; r < q; r++) {
        if (!model->is_linear[r]) {
            gains[r] = tanh(gains[r]);
        }
        term[r] = gains[r] * factor_of(model, r, inputs);
    }
    for (int i = 0; i < m; i++) {
        const block b = block_of(i >= model->even, model->parts[2], q);
        following[i] += dot(b.count, model->N + i * q + b.first, term + b.first);
    }
}

/* Of e_y and e_psi after a period, by the movement (3), e_y, e_psi, and the curvature. */
void mdk_path_derivatives(const mdk_real moved[3], const mdk_real before[3],
                          const mdk_real after[3], mdk_real kappa, mdk_real found[2][6]) {
    const mdk_real of_road = before[2] + moved[2] - after[2];
    const mdk_real heading = after[2] - R(0.5) * moved[2]; /* of the movement, at its end */
    const mdk_real c = cos(heading), s = sin(heading);
    const mdk_real cos_road = cos(of_road), sin_road = sin(of_road);
    const mdk_real along = moved[0] * c - moved[1] * s, across = moved[0] * s + moved[1] * c;
    const mdk_real radius_ratio = R(1) - kappa * after[1];
    const mdk_real to_ey[5] = {s, c, R(0.5) * along, cos_road, along};
    const mdk_real to_ds[5] = {c, -s, R(-0.5) * across, sin_road, -across};
    for (int i = 0; i < 5; i++) {
        found[0][i] = to_ey[i];
        found[1][i] = -kappa * to_ds[i] / radius_ratio; /* the turn of the road */
    }
    found[1][2] += R(1);
    found[1][4] += R(1);
    const mdk_real x_m = along * cos_road - across * sin_road;
    const mdk_real y_m = along * sin_road + across * cos_road + before[1];
    const mdk_real squared = x_m * x_m + y_m * y_m, one = R(1) + radius_ratio;
    const mdk_real by_ratio = (kappa * squared - y_m) / radius_ratio;
    found[0][5] = (-squared * one - (R(2) * y_m - kappa * squared) * by_ratio) / (one * one);
    found[1][5] = -x_m / (radius_ratio * radius_ratio);
}
