/* Filtered state and constant disturbance, from predictions of the model and of kinematics. */

#include "mdk_internal.h"

/* Change of e_psi and e_y between two states, from speeds and yaw rates. */
static mdk_real heading_change_rad(const mdk_real before[MDK_STATES], const mdk_real now[MDK_STATES],
                                   mdk_real kappa, mdk_real period_s) {
    const mdk_real yaw_rate = R(0.5) * (before[MDK_YAW_RATE] + now[MDK_YAW_RATE]);
    return period_s * yaw_rate - kappa * now[MDK_DS];
}

static mdk_real lateral_change_m(const mdk_real before[MDK_STATES], const mdk_real now[MDK_STATES],
                                 mdk_real mean_rad, mdk_real period_s) {
    const mdk_real vx_mps = R(0.5) * (before[MDK_VX] + now[MDK_VX]);
    const mdk_real vy_mps = R(0.5) * (before[MDK_VY] + now[MDK_VY]);
    return period_s * (vx_mps * sin(mean_rad) + vy_mps * cos(mean_rad));
}

/* Replace measured states by their estimates, columns first to last - 1. */
static void correct(mdk_controller *c, const mdk_real predicted[MDK_STATES], int first, int last,
                    mdk_real found[MDK_STATES]) {
    const mdk_estimation *shares = &c->model->estimation;
    mdk_real *offset = c->estimator.offset;
    for (int i = first; i < last; i++) {
        const mdk_real expected = predicted[i] + offset[i];
        const mdk_real error = found[i] - expected;
        found[i] = expected + shares->gain[i] * error;
        offset[i] += shares->offset_gain[i] * error;
    }
}

/* x_0: the measured state, with the noise that the prediction does not have averaged. */
void mdk_estimate(mdk_controller *c, const mdk_real measured[MDK_STATES],
                  mdk_real x_0[MDK_STATES]) {
    const mdk_dynamics *model = &c->model->dynamics;
    mdk_estimator *e = &c->estimator;
    copy(MDK_STATES, measured, x_0);
    if (!e->is_advanced) {
        e->begun = 0;
        set_zero(MDK_STATES, e->offset);
        copy(MDK_STATES, measured, e->before);
        return;
    }
    e->is_advanced = false;
    mdk_real predicted[MDK_STATES];
    for (int i = 0; i < MDK_STATES; i++) {
        predicted[i] = e->psi[e->newest * model->n + model->place[i]] + e->disturbance[i];
    }
    correct(c, predicted, 0, MDK_EY, x_0);
    const mdk_real period_s = c->model->period_s;
    const mdk_real turned_rad = heading_change_rad(e->before, x_0, c->kappa, period_s);
    const mdk_real mean_rad = e->before[MDK_EPSI] + R(0.5) * turned_rad;
    predicted[MDK_EY] = e->before[MDK_EY] + lateral_change_m(e->before, x_0, mean_rad, period_s);
    predicted[MDK_EPSI] = e->before[MDK_EPSI] + turned_rad;
    correct(c, predicted, MDK_EY, MDK_STATES, x_0);
    copy(MDK_STATES, x_0, e->before);
}

/* Deviation of the states that is left after some periods of a constant disturbance, and sums of the
 * kept shares: those of v_y and yaw rate fade; the yaw rate turns the car, heading and v_y move it
 * sideways. */
void mdk_respond(const mdk_model *model, int periods, mdk_response *r) {
    for (; r->periods < periods; r->periods++) {
        for (int i = 0; i < MDK_STATES; i++) {
            r->third[i] += model->period_s * r->second[i];
            r->second[i] += model->period_s * r->first[i];
            /* 1 + kept + kept^2 + ... */
            r->first[i] = R(1) + model->estimation.kept[i] * r->first[i];
        }
    }
}

void mdk_deviation(const mdk_response *r, const mdk_real d[MDK_STATES], mdk_real vx_mps,
                   mdk_real found[MDK_STATES]) {
    for (int i = 0; i < MDK_STATES; i++) {
        found[i] = r->first[i] * d[i];
    }
    found[MDK_EPSI] += r->second[MDK_YAW_RATE] * d[MDK_YAW_RATE];
    const mdk_real turned =
        r->third[MDK_YAW_RATE] * d[MDK_YAW_RATE] + r->second[MDK_EPSI] * d[MDK_EPSI];
    found[MDK_EY] += r->second[MDK_VY] * d[MDK_VY] + vx_mps * turned;
}

/* The disturbance of which a deviation is left after ten periods. */
static void cause(const mdk_model *model, const mdk_real deviation[MDK_STATES], mdk_real vx_mps,
                  mdk_real found[MDK_STATES]) {
    mdk_response r = NO_RESPONSE;
    mdk_respond(model, MDK_BEGUN, &r);
    for (int i = 0; i < MDK_STATES; i++) {
        found[i] = deviation[i] / larger(r.first[i], R(1));
    }
    found[MDK_EPSI] = found[MDK_EY] = R(0);
    static const int places[2] = {MDK_EPSI, MDK_EY};
    for (int i = 0; i < 2; i++) {
        mdk_real explained[MDK_STATES];
        mdk_deviation(&r, found, vx_mps, explained);
        const int place = places[i];
        found[place] = (deviation[place] - explained[place]) / r.first[place];
    }
}

/* Take as disturbance what keeps the motion of a car that `applied` turns steadily: a driver hands
 * over. The speed may change, and a heading error moves the car off its place: no disturbance. */
void mdk_assume_steady(mdk_controller *c, const mdk_real state[MDK_STATES], mdk_real kappa,
                       const mdk_real applied[MDK_INPUTS]) {
    const mdk_dynamics *model = &c->model->dynamics;
    mdk_estimator *e = &c->estimator;
    mdk_lift(c, state, kappa);
    copy(model->n, c->psi, c->eq14.psi_0);
    for (int k = 0; k < MDK_BEGUN; k++) {
        mdk_step_ahead(c, applied);
    }
    mdk_real error[MDK_STATES], found[MDK_STATES];
    for (int i = 0; i < MDK_STATES; i++) {
        error[i] = state[i] - c->eq14.psi_0[model->place[i]];
    }
    const mdk_real period_s = c->model->period_s;
    const mdk_real turned_rad = heading_change_rad(state, state, kappa, period_s);
    const mdk_real mean_rad = state[MDK_EPSI] + R(0.5) * R(MDK_BEGUN) * turned_rad;
    error[MDK_EPSI] += R(MDK_BEGUN) * turned_rad;
    error[MDK_EY] += R(MDK_BEGUN) * lateral_change_m(state, state, mean_rad, period_s);
    error[MDK_VX] = R(0);
    cause(c->model, error, state[MDK_VX], found);
    for (int i = 0; i < MDK_STATES; i++) {
        const mdk_real largest = c->model->estimation.largest[i];
        e->disturbance[i] = limited(found[i], -largest, largest);
    }
}

/* Learn how far the car turns, from the yaw rate of now and from that which was predicted for it. The
 * prediction is explained by the measurement: a wheel that only compensates a side wind teaches
 * nothing, and neither do noise of the sensor, and a wheel at its largest rate. */
static void learn_steering(mdk_controller *c, mdk_real predicted_radps, mdk_real measured_radps) {
    const mdk_estimation *shares = &c->model->estimation;
    mdk_steering *s = &c->steering;
    const mdk_real of_one_radps = predicted_radps / s->factor;
    if (!isfinite(of_one_radps + measured_radps)) {
        return;
    }
    s->predicted += s->share * (of_one_radps - s->predicted);
    s->measured += s->share * (measured_radps - s->measured);
    s->share = larger(s->share / (R(1) + s->share), shares->averaged);
    const mdk_real predicted = of_one_radps - s->predicted, measured = measured_radps - s->measured;
    if (fabs(measured) < shares->least_radps || s->periods_left > 0) {
        return;
    }
    mdk_real inverse = R(1) / s->factor;
    const mdk_real error = predicted - inverse * measured;
    inverse += measured * error / (shares->information + measured * measured);
    s->factor = R(1) / limited(inverse, R(1) / shares->largest_factor, R(1) / shares->smallest_factor);
}

/* The angle of the wheel in the next period. */
static void turn(mdk_controller *c, mdk_real wheel_rad) {
    mdk_steering *s = &c->steering;
    const bool is_at_rate = fabs(wheel_rad - s->wheel_rad) >= c->model->estimation.at_rate_rad;
    s->periods_left = is_at_rate ? MDK_BEGUN : s->periods_left > 0 ? s->periods_left - 1 : 0;
    s->wheel_rad = wheel_rad;
}

/* Begin a prediction at the lifted state; advance all by a period in which `acting` acts. The error
 * of the one that began ten periods ago changes steering factor and disturbance. */
void mdk_advance(mdk_controller *c, const mdk_real acting[MDK_INPUTS]) {
    const mdk_dynamics *model = &c->model->dynamics;
    const mdk_estimation *shares = &c->model->estimation;
    mdk_estimator *e = &c->estimator;
    const int n = model->n;
    const mdk_real pedals = acting[MDK_THROTTLE] - acting[MDK_BRAKE] / shares->brake_n;
    e->pedals += (pedals - e->pedals) / R(MDK_BEGUN);
    /* An error of v_x while a pedal moves is one of engine or brake. */
    const mdk_real moved = (pedals - e->pedals) / shares->moved_pedal;
    const mdk_real steady = R(1) / (R(1) + moved * moved);
    e->newest = (e->newest + 1) % MDK_BEGUN;
    if (e->begun >= MDK_BEGUN) {
        const mdk_real *oldest = e->psi + e->newest * n; /* its place is taken now */
        mdk_real error[MDK_STATES], found[MDK_STATES];
        for (int i = 0; i < MDK_STATES; i++) {
            const int column = model->place[i];
            error[i] = c->psi[column] - oldest[column];
        }
        const int yaw_rate = model->place[MDK_YAW_RATE];
        learn_steering(c, oldest[yaw_rate], c->psi[yaw_rate]);
        cause(c->model, error, c->psi[MDK_VX], found);
        const mdk_real fast = shares->fast_mps / larger(c->psi[MDK_VX], shares->fast_mps);
        const mdk_real third = fast * fast * fast;
        const mdk_real parts[MDK_STATES] = {steady, third * third, third * third, R(1), R(1), R(1)};
        for (int i = 0; i < MDK_STATES; i++) {
            const mdk_real share = shares->low_pass[i] * parts[i];
            const mdk_real changed = e->disturbance[i] + share * (found[i] - e->disturbance[i]);
            e->disturbance[i] = limited(changed, -shares->largest[i], shares->largest[i]);
        }
    }
    copy(n, c->psi, e->psi + e->newest * n);
    turn(c, acting[MDK_STEER]);
    e->begun = e->begun < MDK_BEGUN ? e->begun + 1 : MDK_BEGUN;
    mdk_real inputs[MDK_SIGNALS] = {R(0), R(0), R(0), c->kappa};
    mdk_of_model(c, acting, inputs);
    for (int i = 0; i < MDK_BEGUN; i++) {
        mdk_one_step(model, c->gains, e->psi + i * n, inputs, e->following);
        copy(n, e->following, e->psi + i * n);
    }
    e->is_advanced = true;
}
