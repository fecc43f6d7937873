/* Eq. (14) as a condensed QP over the inputs at the knots, in the letters of rt_controller/control/
 * eq14.py.
 *
 * The model is linearised along the nominal inputs: J_k = [A + N W_k S | B + N t_k], by psi_k and by
 * [u_k; kappa]; the derivatives of the path are those of its kinematics. */

#include "mdk_internal.h"

/* The input of a stage: a straight line between two knots. Sets the knot before it and the share of
 * the next one. */
int mdk_knot_of(const mdk_problem *p, int stage, mdk_real *share) {
    int j = p->knots - 1;
    while (p->stages[j] > stage) {
        j--;
    }
    *share = R(0);
    if (j + 1 < p->knots) {
        *share = R(stage - p->stages[j]) / R(p->stages[j + 1] - p->stages[j]);
    }
    return j;
}

/* The last plan, shifted by one period; without one the last input, held. */
static void choose_nominal_inputs(mdk_controller *c) {
    const mdk_problem *p = &c->model->problem;
    mdk_eq14 *e = &c->eq14;
    for (int j = 0; j < p->knots; j++) {
        const int stage = p->stages[j] + 1 < p->horizon ? p->stages[j] + 1 : p->horizon - 1;
        mdk_real *u = e->u_nominal + j * MDK_INPUTS;
        if (c->has_plan) {
            mdk_of_model(c, e->inputs + stage * MDK_INPUTS, u);
        } else {
            copy(MDK_INPUTS, e->u_prev, u);
        }
        u[MDK_THROTTLE] = smaller(u[MDK_THROTTLE], p->most_nominal_throttle);
    }
}

/* The tracked states of psi at a knot, and the length of the interval that ends there. */
static void note_states(mdk_controller *c, int knot, int stage, const mdk_real *psi) {
    const mdk_problem *p = &c->model->problem;
    for (int a = 0; a < p->tracked; a++) {
        const int column = c->model->dynamics.place[p->columns[a]];
        c->eq14.x[knot * p->tracked + a] = psi[column];
    }
    if (knot > 0) {
        const mdk_real interval_s = R(stage - p->stages[knot - 1]) * c->model->period_s;
        c->eq14.length_m[knot] = larger(psi[MDK_VX], p->slowest_mps) * interval_s;
    }
}

/* Predict from psi_0 along the nominal inputs: the states at the knots, W, t, and the derivatives of
 * the path. */
static void linearise(mdk_controller *c) {
    const mdk_dynamics *model = &c->model->dynamics;
    const mdk_problem *p = &c->model->problem;
    mdk_eq14 *e = &c->eq14;
    const int q = model->gains;
    mdk_real *psi = e->psi_nominal, *following = c->estimator.following;
    copy(model->n, e->psi_0, psi);
    for (int k = 0, knot = 0; k <= p->horizon; k++) {
        if (k == (knot < p->knots ? p->stages[knot] : p->horizon)) {
            note_states(c, knot++, k, psi);
        }
        if (k == p->horizon) {
            break;
        }
        mdk_real share, inputs[MDK_SIGNALS];
        const mdk_real *u = e->u_nominal + mdk_knot_of(p, k, &share) * MDK_INPUTS;
        for (int i = 0; i < MDK_INPUTS; i++) {
            inputs[i] = share > R(0) ? u[i] + share * (u[i + MDK_INPUTS] - u[i]) : u[i];
        }
        inputs[MDK_INPUTS] = e->kappa;
        mdk_one_step(model, c->gains, psi, inputs, following);
        for (int r = 0; r < q; r++) {
            const mdk_real t = c->gains[r];
            const mdk_real slope = model->is_linear[r] ? R(1) : R(1) - t * t;
            e->t[k * q + r] = t;
            e->W[k * q + r] = factor_of(model, r, inputs) * slope;
        }
        if (model->has_path) {
            mdk_real found[2][6];
            mdk_path_derivatives(c->gains + q, psi + model->m, following + model->m, e->kappa, found);
            copy(12, found[0], e->path + k * 12);
        }
        copy(model->n, following, psi);
    }
}

/* J [m][m + 5] of stage k: by the observables that follow from A, then by [u; kappa; 1]. */
static void jacobian(mdk_controller *c, int k) {
    const mdk_dynamics *model = &c->model->dynamics;
    mdk_eq14 *e = &c->eq14;
    const int m = model->m, even = model->even, q = model->gains, columns = m + MDK_SIGNALS + 1;
    mdk_real *N_W = c->gains;
    for (int i = 0; i < m; i++) {
        mdk_real *row = e->J + i * columns;
        copy(m, model->A + i * m, row);
        copy(MDK_SIGNALS, model->B + i * MDK_SIGNALS, row + m);
        row[columns - 1] = R(0);
        const mdk_real *N = model->N + i * q, *W = e->W + k * q, *t = e->t + k * q;
        const int *part = model->parts + (i >= model->even ? 2 : 0);
        for (int r = part[0]; r < part[2]; r++) {
            N_W[r] = N[r] * W[r];
            row[m + model->factor[r]] += N[r] * t[r];
        }
        for (int is_odd = 0; is_odd < 2; is_odd++) {
            const int r = part[is_odd], first = is_odd ? even : 0, last = is_odd ? m : even;
            add_rows(last - first, part[is_odd + 1] - r, N_W + r, model->S + r * m + first, m,
                     row + first);
        }
    }
}

/* The same through the path, and y from what was found for it (m + 4). */
static void finish_row(const mdk_controller *c, int k, mdk_real *y, mdk_real *found) {
    const mdk_dynamics *model = &c->model->dynamics;
    const int m = model->m;
    if (model->has_path) {
        const mdk_real *to_ey = c->eq14.path + k * 12, *to_epsi = to_ey + 6;
        const mdk_real ey = y[m + 1], epsi = y[m + 2];
        mdk_real by[6];
        for (int i = 0; i < 6; i++) {
            by[i] = ey * to_ey[i] + epsi * to_epsi[i];
        }
        add_rows(m, 3, by, model->S + model->gains * m, m, found);
        y[m] = R(0);
        y[m + 1] = by[3];
        y[m + 2] = by[4];
        found[m + MDK_INPUTS] += by[5];
    }
    copy(m, found, y);
    copy(MDK_SIGNALS, found + m, y + model->n);
}

/* y <- y J_k of one or two rows y (n), and the derivatives (4) by [u; kappa] behind each. */
static void times_jacobian(mdk_controller *c, int k, int rows, mdk_real *y) {
    const mdk_dynamics *model = &c->model->dynamics;
    const int m = model->m, columns = m + MDK_SIGNALS, row = model->n + MDK_SIGNALS;
    mdk_real *found = c->eq14.y;
    set_zero(2 * columns, found);
    if (rows == 2) {
        add_rows_twice(columns, m, y, y + row, c->eq14.J, columns + 1, found, found + columns);
    } else {
        add_rows(columns, m, y, c->eq14.J, columns + 1, found);
    }
    for (int i = 0; i < rows; i++) {
        finish_row(c, k, y + i * row, found + i * columns);
    }
}

/* Derivatives of the tracked states at the knots, by the adjoint equation y' <- y' J_k. */
static void propagate(mdk_controller *c) {
    const mdk_dynamics *model = &c->model->dynamics;
    const mdk_problem *p = &c->model->problem;
    mdk_eq14 *e = &c->eq14;
    const int K = p->knots, s = p->tracked, n = model->n, row = n + MDK_SIGNALS;
    set_zero((K + 1) * s * K * MDK_INPUTS, e->by_input);
    set_zero((K + 1) * s, e->by_kappa);
    set_zero((K + 1) * s * row, e->Y);
    for (int i = 0; i <= K; i++) {
        for (int a = 0; a < s; a++) {
            e->Y[(i * s + a) * row + model->place[p->columns[a]]] = R(1);
        }
    }
    int first = K + 1; /* of the knots behind stage k */
    for (int k = p->horizon - 1; k >= 0; k--) {
        if (k + 1 == (first - 1 < K ? p->stages[first - 1] : p->horizon)) {
            first--;
        }
        mdk_real share;
        const int j = mdk_knot_of(p, k, &share);
        jacobian(c, k);
        for (int i = first * s; i < (K + 1) * s; i += 2) {
            times_jacobian(c, k, i + 1 < (K + 1) * s ? 2 : 1, e->Y + i * row);
        }
        for (int i = first * s; i < (K + 1) * s; i++) {
            const mdk_real *by_u = e->Y + i * row + n;
            mdk_real *by = e->by_input + (i * K + j) * MDK_INPUTS;
            add_scaled(MDK_INPUTS, R(1) - share, by_u, by);
            if (share > R(0)) {
                add_scaled(MDK_INPUTS, share, by_u, by + MDK_INPUTS);
            }
            e->by_kappa[i] += by_u[MDK_INPUTS];
        }
    }
}

/* Output b of interval i, whose end is knot i, of values [K + 1][s][width] at the knots: a tracked
 * state, or the course, which is the change of e_y over the distance travelled. */
static void output(const mdk_controller *c, int i, int b, const mdk_real *values, int width,
                   int count, mdk_real *found) {
    const mdk_problem *p = &c->model->problem;
    const int s = p->tracked;
    if (b < s) {
        copy(count, values + (i * s + b) * width, found);
        return;
    }
    const mdk_real *end = values + (i * s + p->ey) * width, *begin = end - s * width;
    for (int j = 0; j < count; j++) {
        found[j] = (end[j] - begin[j]) / c->eq14.length_m[i];
    }
}

/* H, and the maps of f, along the nominal inputs, around which the outputs are
 * constant + Gamma v + Phi psi_0 + g kappa. False if H is not positive definite. */
bool mdk_update_matrices(mdk_controller *c) {
    const mdk_problem *p = &c->model->problem;
    mdk_eq14 *e = &c->eq14;
    mdk_qp *qp = &c->qp;
    const int n = c->model->dynamics.n, K = p->knots, nv = qp->size;
    const int outputs = p->tracked + (p->has_course ? 1 : 0);
    choose_nominal_inputs(c);
    linearise(c);
    propagate(c);
    set_zero(nv * nv, qp->H);
    for (int i = 0; i < nv; i++) {
        qp->H[i * nv + i] = p->R[i];
        if (i >= MDK_INPUTS) {
            qp->H[i * nv + i - MDK_INPUTS] = p->R_next[i - MDK_INPUTS];
        }
    }
    for (int i = 1; i <= K; i++) {
        /* The inputs at knot i act in interval i already: they are the ends of straight lines. */
        const int acting = MDK_INPUTS * (i < K ? i + 1 : K);
        for (int b = 0; b < outputs; b++) {
            const int row = (i - 1) * outputs + b;
            mdk_real *Gamma = e->Gamma + row * nv, *Phi = e->Phi + row * n;
            output(c, i, b, e->by_input, nv, nv, Gamma);
            output(c, i, b, e->Y, n + MDK_SIGNALS, n, Phi);
            output(c, i, b, e->by_kappa, 1, 1, e->g + row);
            output(c, i, b, e->x, 1, 1, e->constant + row);
            e->constant[row] -= dot(nv, Gamma, e->u_nominal) + dot(n, Phi, e->psi_0) +
                                e->g[row] * e->kappa;
            for (int j = 0, input = 0; j < nv; j++, input = input < MDK_STEER ? input + 1 : 0) {
                Gamma[j] *= p->range[input];
            }
        }
        const mdk_real *Gamma = e->Gamma + (i - 1) * outputs * nv, *Q = p->Q + (i - 1) * outputs;
        for (int j = 0; j < acting; j++) {
            mdk_real Q_Gamma[MDK_STATES];
            for (int b = 0; b < outputs; b++) {
                Q_Gamma[b] = Q[b] * Gamma[b * nv + j];
            }
            add_rows(j + 1, outputs, Q_Gamma, Gamma, nv, qp->H + j * nv);
        }
    }
    return mdk_factorise(qp);
}

/* f, with the maps of the last matrices, for the present psi_0, kappa and reference. */
void mdk_update_vectors(mdk_controller *c) {
    const mdk_problem *p = &c->model->problem;
    mdk_eq14 *e = &c->eq14;
    mdk_qp *qp = &c->qp;
    const int n = c->model->dynamics.n, nv = qp->size;
    const int outputs = p->tracked + (p->has_course ? 1 : 0);
    set_zero(nv, qp->f);
    for (int i = 0; i < MDK_INPUTS; i++) {
        qp->f[i] = p->from_previous[i] * e->u_prev[i];
    }
    for (int i = 1; i <= p->knots; i++) {
        for (int b = 0; b < outputs; b++) {
            const int row = (i - 1) * outputs + b;
            mdk_real x_r;
            output(c, i, b, e->x_r, 1, 1, &x_r);
            e->d[row] = dot(n, e->Phi + row * n, e->psi_0) + e->g[row] * e->kappa +
                        e->constant[row] - x_r;
            add_scaled(nv, p->Q[row] * e->d[row], e->Gamma + row * nv, qp->f);
        }
    }
}
