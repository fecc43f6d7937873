/* Reference states at the knots: path polynomial and road ahead. */

#include "mdk_internal.h"

enum { RAMPS = MDK_K4 };

/* Second derivative of the lateral position of the road ahead, against the circle of the curvature
 * at the car: a constant, and ramps c_j max(s - s_j, 0). */
typedef struct {
    mdk_real constant;
    mdk_real start_m[RAMPS], slope[RAMPS];
} turn;

static turn turn_of(const mdk_situation *now) {
    turn found = {R(0), {R(0)}, {R(0)}};
    if (!now->has_preview) {
        return found;
    }
    const mdk_real *k = now->preview + MDK_K0, spacing_m = now->preview[MDK_SPACING];
    found.constant = k[0] - now->curvature_per_m;
    mdk_real before = R(0);
    for (int j = 0; j < RAMPS; j++) {
        /* Behind the last value the curvature is constant. */
        const mdk_real slope = j + 1 < RAMPS ? (k[j + 1] - k[j]) / spacing_m : R(0);
        found.start_m[j] = R(j) * spacing_m;
        found.slope[j] = slope - before;
        before = slope;
    }
    return found;
}

/* x_r [K + 1][s], the tracked states at the knots and at the end of the horizon. */
void mdk_expand(const mdk_controller *c, const mdk_situation *now, const mdk_real x_0[MDK_STATES],
                mdk_real *x_r) {
    const mdk_problem *p = &c->model->problem;
    const turn road = turn_of(now);
    mdk_response response = NO_RESPONSE;
    const mdk_real *path = now->path, v_mps = path[4], a_mps2 = path[5];
    for (int i = 0; i <= p->knots; i++) {
        const int stage = i < p->knots ? p->stages[i] : p->horizon;
        const int periods = stage + now->n_under_way;
        const mdk_real elapsed_s = R(periods) * c->model->period_s;
        const mdk_real speed_mps = larger(R(0), v_mps + a_mps2 * elapsed_s); /* NaN stays NaN */
        /* Arc length at the mean of the present speed and the reference speed of the stage. */
        const mdk_real s = R(0.5) * (speed_mps + x_0[MDK_VX]) * elapsed_s;
        mdk_real ey_m = path[0] + s * (path[1] + s * (path[2] + R(0.5) * road.constant + s * path[3]));
        mdk_real slope = path[1] + s * (R(2) * path[2] + road.constant + s * R(3) * path[3]);
        mdk_real curvature =
            now->curvature_per_m + R(2) * path[2] + road.constant + R(6) * path[3] * s;
        for (int j = 0; j < RAMPS; j++) {
            const mdk_real ramp = larger(s - road.start_m[j], R(0));
            ey_m += road.slope[j] / R(6) * ramp * ramp * ramp;
            slope += road.slope[j] / R(2) * ramp * ramp;
            curvature += road.slope[j] * ramp;
        }
        mdk_real disturbed[MDK_STATES];
        mdk_respond(c->model, periods, &response);
        mdk_deviation(&response, c->estimator.disturbance, x_0[MDK_VX], disturbed);
        const mdk_real x[MDK_STATES] = {
            speed_mps, R(0), speed_mps * curvature, speed_mps * c->model->period_s,
            ey_m, atan(slope),
        };
        for (int a = 0; a < p->tracked; a++) {
            x_r[i * p->tracked + a] = x[p->columns[a]] - disturbed[p->columns[a]];
        }
    }
}
