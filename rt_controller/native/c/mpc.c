/* One period of the control law, and the memory of a controller. */

#include "mdk_internal.h"

/* The next `count` numbers of the memory; `used` counts them. Without memory only the count. */
static mdk_real *take(mdk_real *memory, int *used, int count) {
    mdk_real *found = memory == NULL ? NULL : memory + *used;
    *used += count;
    return found;
}

static int share_memory(mdk_controller *c, const mdk_model *model, mdk_real *memory) {
    const mdk_encoder *net = &model->encoder;
    const mdk_dynamics *d = &model->dynamics;
    const mdk_problem *p = &model->problem;
    const int n = d->n, m = d->m, K = p->knots, N = p->horizon, s = p->tracked;
    const int nv = MDK_INPUTS * K, rows = K * (s + (p->has_course ? 1 : 0));
    int used = 0, widest = 0;
    for (int i = 0; i < net->layers; i++) {
        widest = widest > net->layer[i].outputs ? widest : net->layer[i].outputs;
    }
    c->history = take(memory, &used, net->history * MDK_HISTORY);
    c->signals = take(memory, &used, net->present + net->history * MDK_HISTORY);
    c->layer[0] = take(memory, &used, widest);
    c->layer[1] = take(memory, &used, widest);
    c->psi = take(memory, &used, n);
    c->gains = take(memory, &used, d->gains + 3);
    c->estimator.psi = take(memory, &used, MDK_BEGUN * n);
    c->estimator.following = take(memory, &used, n + d->gains);
    mdk_eq14 *e = &c->eq14;
    e->psi_0 = take(memory, &used, n);
    e->psi_nominal = take(memory, &used, n);
    e->u_nominal = take(memory, &used, nv);
    e->x_r = take(memory, &used, (K + 1) * s);
    e->x = take(memory, &used, (K + 1) * s);
    e->length_m = take(memory, &used, K + 1);
    e->W = take(memory, &used, N * d->gains);
    e->t = take(memory, &used, N * d->gains);
    e->path = take(memory, &used, d->has_path ? N * 12 : 0);
    e->J = take(memory, &used, m * (m + MDK_SIGNALS + 1));
    e->Y = take(memory, &used, (K + 1) * s * (n + MDK_SIGNALS));
    e->y = take(memory, &used, 2 * (m + MDK_SIGNALS));
    e->by_input = take(memory, &used, (K + 1) * s * nv);
    e->by_kappa = take(memory, &used, (K + 1) * s);
    e->Gamma = take(memory, &used, rows * nv);
    e->Phi = take(memory, &used, rows * n);
    e->g = take(memory, &used, rows);
    e->constant = take(memory, &used, rows);
    e->d = take(memory, &used, rows);
    e->inputs = take(memory, &used, N * MDK_INPUTS);
    mdk_qp *qp = &c->qp;
    qp->size = nv;
    mdk_real **const matrices[] = {&qp->H, &qp->L_inverse, &qp->M, &qp->D};
    mdk_real **const vectors[] = {
        &qp->f,         &qp->v,      &qp->lower, &qp->upper,      &qp->row_lower,
        &qp->row_upper, &qp->active, &qp->sign,  &qp->multiplier, &qp->wanted,
        &qp->work,      &qp->level,
    };
    for (size_t i = 0; i < sizeof matrices / sizeof matrices[0]; i++) {
        *matrices[i] = take(memory, &used, (nv + 1) * (nv + 1));
    }
    for (size_t i = 0; i < sizeof vectors / sizeof vectors[0]; i++) {
        *vectors[i] = take(memory, &used, nv + 1);
    }
    return used;
}

int mdk_memory(const mdk_model *model) {
    mdk_controller unused;
    return share_memory(&unused, model, NULL);
}

void mdk_init(mdk_controller *c, const mdk_model *model, mdk_real *memory) {
    static const mdk_real released[MDK_INPUTS] = {R(0), R(0), R(0)};
    const mdk_problem *p = &model->problem;
    memset(c, 0, sizeof *c);
    set_zero(mdk_memory(model), memory);
    share_memory(c, model, memory);
    c->model = model;
    copy(MDK_INPUTS, p->slew, c->eq14.slew);
    for (int j = 0; j < p->knots; j++) {
        const int periods = j == 0 ? 1 : p->stages[j] - p->stages[j - 1];
        for (int i = 0; i < MDK_INPUTS; i++) {
            const int row = j * MDK_INPUTS + i;
            c->qp.lower[row] = p->lower[i];
            c->qp.upper[row] = p->upper[i];
            c->qp.row_upper[row] = R(periods) * p->slew[i];
            c->qp.row_lower[row] = -c->qp.row_upper[row];
        }
    }
    mdk_reset(c, released);
}

void mdk_forget(mdk_controller *c) {
    c->has_plan = c->is_prepared = c->has_present = false;
    c->estimator.is_advanced = false;
    c->estimator.begun = 0;
}

void mdk_discard_estimates(mdk_controller *c) {
    c->estimator.is_advanced = false;
    c->estimator.begun = 0;
    set_zero(MDK_STATES, c->estimator.disturbance);
    c->estimator.pedals = R(0);
    c->steering = (mdk_steering){R(1), R(0), R(0), R(1), R(0), 0};
}

void mdk_reset(mdk_controller *c, const mdk_real previous[MDK_INPUTS]) {
    mdk_forget(c);
    mdk_discard_estimates(c);
    mdk_resume(c, previous);
    c->periods_held = c->model->hold_periods;
}

void mdk_resume(mdk_controller *c, const mdk_real previous[MDK_INPUTS]) {
    c->eq14.pedal = previous[MDK_BRAKE] > R(0) ? MDK_BRAKE : MDK_THROTTLE;
    c->eq14.periods_until_pressed = 0;
}

const mdk_real *mdk_inputs(const mdk_controller *c) { return c->eq14.inputs; }

const mdk_real *mdk_lifted(const mdk_controller *c) { return c->psi; }

mdk_real mdk_steering_factor(const mdk_controller *c) { return c->steering.factor; }

int mdk_iterations(const mdk_controller *c) { return c->qp.iterations; }

const mdk_qp *mdk_last_qp(const mdk_controller *c) { return &c->qp; }

size_t mdk_size(void) { return sizeof(mdk_controller); }

void mdk_observe(mdk_controller *c, const mdk_real measured[MDK_STATES],
                 const mdk_real applied[MDK_INPUTS], mdk_real x_0[MDK_STATES]) {
    mdk_estimate(c, measured, x_0);
    mdk_remember(c, x_0, applied);
}

/* psi_0 after one more input. */
void mdk_step_ahead(mdk_controller *c, const mdk_real input[MDK_INPUTS]) {
    mdk_real inputs[MDK_SIGNALS] = {R(0), R(0), R(0), c->kappa};
    mdk_of_model(c, input, inputs);
    mdk_real *following = c->estimator.following;
    mdk_one_step(&c->model->dynamics, c->gains, c->eq14.psi_0, inputs, following);
    copy(c->model->dynamics.n, following, c->eq14.psi_0);
}

/* The inputs of all stages, from those at the knots. */
static void take_plan(mdk_controller *c) {
    const mdk_problem *p = &c->model->problem;
    for (int k = 0; k < p->horizon; k++) {
        mdk_real share;
        const mdk_real *v = c->qp.v + mdk_knot_of(p, k, &share) * MDK_INPUTS;
        for (int i = 0; i < MDK_INPUTS; i++) {
            const mdk_real rise = share > R(0) ? share * (v[i + MDK_INPUTS] - v[i]) : R(0);
            c->eq14.inputs[k * MDK_INPUTS + i] = p->range[i] * (v[i] + rise);
        }
        c->eq14.inputs[k * MDK_INPUTS + MDK_STEER] /= c->steering.factor;
    }
}

mdk_status mdk_plan(mdk_controller *c, const mdk_real x_0[MDK_STATES], const mdk_situation *now) {
    mdk_eq14 *e = &c->eq14;
    if (now->n_under_way < 0 || now->n_under_way > MDK_MOST_UNDER_WAY) {
        c->has_plan = c->is_prepared = false;
        return MDK_NUMERICS;
    }
    mdk_lift(c, x_0, now->curvature_per_m);
    copy(c->model->dynamics.n, c->psi, e->psi_0);
    for (int i = 0; i < now->n_under_way; i++) {
        mdk_step_ahead(c, now->under_way[i]);
    }
    e->kappa = now->curvature_per_m;
    mdk_of_model(c, now->previous, e->u_prev);
    mdk_expand(c, now, x_0, e->x_r);
    if (!c->is_prepared) {
        mdk_update_matrices(c);
    }
    mdk_update_vectors(c);
    mdk_choose_pedal(c, mdk_needed_mps2(c));
    mdk_update_bounds(c);
    const mdk_status status = mdk_solve(&c->qp, c->model->problem.max_iterations);
    c->is_prepared = false;
    c->has_plan = status == MDK_SOLVED;
    if (c->has_plan) {
        take_plan(c);
        copy(MDK_INPUTS, now->n_under_way > 0 ? now->under_way[0] : e->inputs, c->acting);
    }
    return status;
}

/* The matrices of the next plan, around its predicted state: then the time of a plan is short. */
void mdk_prepare(mdk_controller *c) {
    c->is_prepared = false;
    if (!c->has_plan) {
        return;
    }
    mdk_advance(c, c->acting);
    mdk_step_ahead(c, c->eq14.inputs);
    mdk_of_model(c, c->eq14.inputs, c->eq14.u_prev);
    c->is_prepared = mdk_update_matrices(c);
    c->has_plan = false; /* a plan is the nominal trajectory of one period only */
}

mdk_status mdk_step(mdk_controller *c, const mdk_situation *now, mdk_real command[MDK_INPUTS]) {
    mdk_real x_0[MDK_STATES];
    mdk_observe(c, now->state, now->applied, x_0);
    /* A wheel that is turned further returns with its rate. */
    const mdk_real turned_rad = fabs(now->previous[MDK_STEER]);
    const mdk_real most_rad = larger(turned_rad, mdk_largest_wheel_rad(c->model, x_0[MDK_VX]));
    mdk_limit_steering(c, most_rad, INFINITY);
    const mdk_status status = mdk_plan(c, x_0, now);
    if (status == MDK_SOLVED) {
        c->periods_held = 0;
    } else {
        mdk_forget(c); /* what gave no plan must not stay in the history */
        c->periods_held++;
    }
    const bool is_held = c->periods_held <= c->model->hold_periods;
    const mdk_real *wanted = now->previous;
    if (is_held && c->periods_held < c->model->problem.horizon) {
        wanted = c->eq14.inputs + c->periods_held * MDK_INPUTS;
    }
    mdk_limit(c->model, most_rad, wanted, now->previous, command);
    mdk_prepare(c);
    return status;
}
