/* Bounds of the QP: throttle and brake are never pressed together, and the wheel has a largest angle.
 *
 * "Throttle times brake is zero" is not convex: one pedal is chosen before the QP is solved, and the
 * upper bound of the other one falls to zero at its slew rate. */

#include "mdk_internal.h"

/* Mean acceleration over the horizon that released pedals do not give; 0 if the plan presses the pedal
 * in use at its end. */
mdk_real mdk_needed_mps2(const mdk_controller *c) {
    const mdk_problem *p = &c->model->problem;
    const mdk_eq14 *e = &c->eq14;
    const int K = p->knots, nv = c->qp.size;
    const mdk_real last = e->u_nominal[(K - 1) * MDK_INPUTS + e->pedal];
    if (p->vx < 0 || last > p->released * p->range[e->pedal]) {
        return R(0);
    }
    const int row = (K - 1) * (p->tracked + (p->has_course ? 1 : 0)) + p->vx;
    mdk_real missing = e->d[row];
    for (int j = MDK_STEER; j < nv; j += MDK_INPUTS) {
        missing += e->Gamma[row * nv + j] * e->u_nominal[j] / p->range[MDK_STEER];
    }
    return -missing / (c->model->period_s * R(p->horizon));
}

void mdk_choose_pedal(mdk_controller *c, mdk_real needed_mps2) {
    const mdk_problem *p = &c->model->problem;
    mdk_eq14 *e = &c->eq14;
    if (e->periods_until_pressed > 0) {
        e->periods_until_pressed--;
    }
    const bool is_throttle = e->pedal == MDK_THROTTLE;
    if (is_throttle ? needed_mps2 < -p->change_mps2 : needed_mps2 > p->change_mps2) {
        e->pedal = is_throttle ? MDK_BRAKE : MDK_THROTTLE;
        e->periods_until_pressed = p->pedal_change;
    }
}

/* Those that depend on the last input. */
void mdk_update_bounds(mdk_controller *c) {
    const mdk_problem *p = &c->model->problem;
    const mdk_eq14 *e = &c->eq14;
    mdk_qp *qp = &c->qp;
    mdk_real v_prev[MDK_INPUTS];
    for (int i = 0; i < MDK_INPUTS; i++) {
        v_prev[i] = e->u_prev[i] / p->range[i];
        qp->row_lower[i] = v_prev[i] - e->slew[i];
        qp->row_upper[i] = v_prev[i] + e->slew[i];
    }
    const int pressed = e->pedal, released = pressed == MDK_THROTTLE ? MDK_BRAKE : MDK_THROTTLE;
    const mdk_real most = p->upper[pressed];
    mdk_real wait = R(e->periods_until_pressed);
    wait = larger(wait, ceil(v_prev[released] / p->slew[released] - R(1e-6)));
    for (int j = 0; j < p->knots; j++) {
        const mdk_real periods = R(p->stages[j] + 1);
        mdk_real *upper = qp->upper + j * MDK_INPUTS;
        /* A pedal beyond its bound is released at its rate. */
        upper[pressed] = larger(most, v_prev[pressed] - p->slew[pressed] * periods);
        upper[released] = larger(R(0), v_prev[released] - p->slew[released] * periods);
        if (v_prev[pressed] <= R(0) && periods <= wait) {
            upper[pressed] = R(0);
        }
    }
}

void mdk_limit_steering(mdk_controller *c, mdk_real most_rad, mdk_real rate_radps) {
    const mdk_problem *p = &c->model->problem;
    mdk_qp *qp = &c->qp;
    const mdk_real usual = p->slew[MDK_STEER] * p->range[MDK_STEER] / c->model->period_s;
    const mdk_real factor = c->steering.factor;
    const mdk_real share = factor * smaller(rate_radps / usual, R(1));
    for (int i = MDK_STEER; i < qp->size; i += MDK_INPUTS) {
        const int knot = i / MDK_INPUTS;
        const int periods = knot == 0 ? 1 : p->stages[knot] - p->stages[knot - 1];
        const mdk_real slew = share * p->slew[MDK_STEER] * R(periods);
        qp->upper[i] = factor * most_rad / p->range[MDK_STEER];
        qp->lower[i] = -qp->upper[i];
        qp->row_lower[i] = -slew;
        qp->row_upper[i] = slew;
        if (knot == 0) {
            c->eq14.slew[MDK_STEER] = slew;
        }
    }
}

mdk_real mdk_largest_wheel_rad(const mdk_model *model, mdk_real vx_mps) {
    const mdk_envelope *car = &model->envelope;
    const mdk_real squared = vx_mps * vx_mps;
    const mdk_real length_m = car->wheelbase_m + car->understeer * squared;
    const mdk_real per_rad_mps2 = larger(squared / (car->steering_ratio * length_m), R(1e-6));
    const mdk_real by_speed_rad = smaller(car->lock_rad, car->plan_mps2 / per_rad_mps2);
    const mdk_real most_rad = smaller(larger(by_speed_rad, car->least_rad), car->trained_rad);
    return smaller(most_rad, car->accepted_mps2 / per_rad_mps2);
}

/* The nearest command to `wanted` that may follow `previous`: finite, within bounds and rates, one
 * pedal. A wanted throttle of 0 closes the throttle at once; of two pedals the one that was not
 * pressed before waits. */
void mdk_limit(const mdk_model *model, mdk_real most_steer_rad, const mdk_real wanted[MDK_INPUTS],
               const mdk_real previous[MDK_INPUTS], mdk_real command[MDK_INPUTS]) {
    const mdk_envelope *limits = &model->envelope;
    mdk_real found[MDK_INPUTS];
    for (int i = 0; i < MDK_INPUTS; i++) {
        const mdk_real before = isfinite(previous[i]) ? previous[i] : R(0);
        const mdk_real finite = isfinite(wanted[i]) ? wanted[i] : before;
        const mdk_real low = i == MDK_STEER ? -most_steer_rad : limits->lower[i];
        const mdk_real high = i == MDK_STEER ? most_steer_rad : limits->upper[i];
        const mdk_real bounded = limited(finite, low, high);
        const mdk_real change = limits->change[i];
        found[i] = limited(bounded, before - change, before + change);
    }
    if (wanted[MDK_THROTTLE] <= limits->lower[MDK_THROTTLE]) {
        found[MDK_THROTTLE] = limits->lower[MDK_THROTTLE];
    }
    for (int i = 0; i < MDK_STEER; i++) {
        found[i] = found[i] < limits->released[i] ? R(0) : found[i];
    }
    if (found[MDK_THROTTLE] > R(0) && found[MDK_BRAKE] > R(0)) {
        found[previous[MDK_THROTTLE] > R(0) ? MDK_BRAKE : MDK_THROTTLE] = R(0);
    }
    copy(MDK_INPUTS, found, command);
}
