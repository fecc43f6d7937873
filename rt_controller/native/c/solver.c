/* Dual active-set method for the QP, with a warm start.
 *
 * With H = L L' and the rows M = sign L^-1 c of the active constraints c' v = bound, the multipliers
 * solve M M' lambda = -M L^-1 f - sign bound. Constraints that are violated are added, those whose
 * multiplier would become negative are removed (Goldfarb and Idnani, 1983; the factor L D L' of M M'
 * and the treatment of dependent constraints as in Arnstroem, Bemporad and Axehill, 2022). The dual
 * cost rises in every iteration, so the method ends; an iterate that was stopped early is not
 * feasible. */

#include "mdk_internal.h"

#if MDK_FLOAT
static const mdk_real VIOLATION = R(5e-5), LARGEST_ERROR = R(5e-4);
static const mdk_real DEPENDENT = R(1e-5), WRONG_SIGN = R(1e-4);
#else
static const mdk_real VIOLATION = R(1e-9), LARGEST_ERROR = R(1e-7);
static const mdk_real DEPENDENT = R(1e-14), WRONG_SIGN = R(1e-9);
#endif
enum { MOST_CORRECTIONS = 4 };
/* VIOLATION of a bound, in units of an input's range, and what rounding may leave of an active one;
 * of the size of a row of M, squared; of the largest multiplier */

/* L_inverse of H = L L'. False if H is not positive definite, or not finite. */
bool mdk_factorise(mdk_qp *qp) {
    const int nv = qp->size;
    mdk_real *L = qp->H, *inverse = qp->L_inverse;
    qp->is_convex = false;
    for (int j = 0; j < nv; j++) {
        for (int i = j; i < nv; i++) {
            L[i * nv + j] -= dot(j, L + i * nv, L + j * nv);
            if (i == j) {
                if (!(L[j * nv + j] > R(0)) || !isfinite(L[j * nv + j])) {
                    return false;
                }
                L[j * nv + j] = sqrt(L[j * nv + j]);
            } else {
                L[i * nv + j] /= L[j * nv + j];
            }
        }
    }
    set_zero(nv * nv, inverse);
    for (int i = 0; i < nv; i++) {
        mdk_real *row = inverse + i * nv;
        for (int j = 0; j < i; j++) {
            add_scaled(j + 1, -L[i * nv + j], inverse + j * nv, row);
        }
        row[i] = R(1);
        for (int j = 0; j <= i; j++) {
            row[j] /= L[i * nv + i];
        }
    }
    qp->is_convex = true;
    return true;
}

/* Value of constraint `number` at v, and its bounds. */
static mdk_real value_of(const mdk_qp *qp, int number, mdk_real *low, mdk_real *high) {
    const int nv = qp->size, i = number % nv;
    if (number < nv) {
        *low = qp->lower[i];
        *high = qp->upper[i];
        return qp->v[i];
    }
    *low = qp->row_lower[i];
    *high = qp->row_upper[i];
    return i < MDK_INPUTS ? qp->v[i] : qp->v[i] - qp->v[i - MDK_INPUTS];
}

/* First column of a row of M that is not zero: L^-1 is a lower triangle. */
static int begin_of(const mdk_qp *qp, int row) {
    const int number = (int)qp->active[row], i = number % qp->size;
    return number >= qp->size && i >= MDK_INPUTS ? i - MDK_INPUTS : i;
}

/* L D L' of the first `row` + 1 rows of M, if those before are factorised. False if the new row
 * depends on them. */
static bool factorise_row(mdk_qp *qp, int row) {
    const int nv = qp->size, begin = begin_of(qp, row);
    const mdk_real *new = qp->M + row * nv;
    mdk_real *l = qp->D + row * (nv + 1);
    const mdk_real size = dot(nv - begin, new + begin, new + begin);
    mdk_real d = size;
    for (int j = 0; j < row; j++) {
        const int other = begin_of(qp, j), first = other > begin ? other : begin;
        const mdk_real product = dot(nv - first, qp->M + j * nv + first, new + first);
        l[j] = product - dot(j, qp->D + j * (nv + 1), l);
    }
    for (int j = 0; j < row; j++) {
        const mdk_real scaled = l[j] / qp->D[j * (nv + 1) + j];
        d -= l[j] * scaled;
        l[j] = scaled;
    }
    const bool is_independent = d > DEPENDENT * size;
    l[row] = is_independent ? d : R(0);
    return is_independent;
}

/* Make a constraint active at one of its bounds, with multiplier 0. False if it depends on others. */
static bool add(mdk_qp *qp, int number, mdk_real sign) {
    const int nv = qp->size, row = qp->count++, i = number % nv;
    const bool is_difference = number >= nv && i >= MDK_INPUTS;
    mdk_real *M = qp->M + row * nv;
    for (int k = 0; k < nv; k++) { /* columns of L^-1 */
        const mdk_real *inverse = qp->L_inverse + k * nv;
        M[k] = sign * (inverse[i] - (is_difference ? inverse[i - MDK_INPUTS] : R(0)));
    }
    qp->active[row] = R(number);
    qp->sign[row] = sign;
    qp->multiplier[row] = R(0);
    qp->level[row] = -dot(nv, M, qp->work);
    return factorise_row(qp, row);
}

/* Remove an active constraint. False if the last of the rest depends on the others. */
static bool remove_row(mdk_qp *qp, int row) {
    const int nv = qp->size;
    bool is_independent = true;
    qp->count--;
    for (int i = row; i < qp->count; i++) {
        qp->active[i] = qp->active[i + 1];
        qp->sign[i] = qp->sign[i + 1];
        qp->multiplier[i] = qp->multiplier[i + 1];
        qp->level[i] = qp->level[i + 1];
        copy(nv, qp->M + (i + 1) * nv, qp->M + i * nv);
        is_independent = factorise_row(qp, i);
    }
    return is_independent;
}

/* The multipliers `wanted` with which all active constraints hold with equality; `is_correction`: from
 * how far v is from their bounds. */
static void solve_equations(mdk_qp *qp, bool is_correction) {
    const int nv = qp->size, count = qp->count;
    for (int i = 0; i < count; i++) {
        mdk_real low, high;
        const mdk_real value = value_of(qp, (int)qp->active[i], &low, &high);
        const mdk_real bound = qp->sign[i] > R(0) ? high : low;
        qp->wanted[i] = is_correction ? qp->sign[i] * (value - bound)
                                      : qp->level[i] - qp->sign[i] * bound;
        qp->wanted[i] -= dot(i, qp->D + i * (nv + 1), qp->wanted);
    }
    for (int i = 0; i < count; i++) {
        qp->wanted[i] /= qp->D[i * (nv + 1) + i];
    }
    for (int i = count - 1; i >= 0; i--) {
        for (int j = i + 1; j < count; j++) {
            qp->wanted[i] -= qp->D[j * (nv + 1) + i] * qp->wanted[j];
        }
    }
    if (is_correction) {
        add_scaled(count, R(1), qp->multiplier, qp->wanted);
    }
}

/* The direction of the multipliers in which M' lambda does not change: the last row depends on the
 * others. */
static void find_null_direction(mdk_qp *qp) {
    const int nv = qp->size, last = qp->count - 1;
    for (int i = last - 1; i >= 0; i--) {
        qp->wanted[i] = -qp->D[last * (nv + 1) + i];
        for (int j = i + 1; j < last; j++) {
            qp->wanted[i] -= qp->D[j * (nv + 1) + i] * qp->wanted[j];
        }
    }
    qp->wanted[last] = R(1);
}

/* v = -L^-T (L^-1 f + M' lambda). False if it is not finite. */
static bool find_inputs(mdk_qp *qp) {
    const int nv = qp->size;
    mdk_real *z = qp->wanted, sum = R(0);
    copy(nv, qp->work, z);
    add_rows(nv, qp->count, qp->multiplier, qp->M, nv, z);
    set_zero(nv, qp->v);
    for (int i = 0; i < nv; i += 4) { /* rows of L^-1 end on its diagonal */
        const int rows = i + 4 < nv ? 4 : nv - i;
        add_rows(i + rows, rows, z + i, qp->L_inverse + i * nv, nv, qp->v);
    }
    for (int i = 0; i < nv; i++) {
        qp->v[i] = -qp->v[i];
        sum += qp->v[i];
    }
    return isfinite(sum);
}

static bool is_active(const mdk_qp *qp, int number) {
    int i = 0;
    while (i < qp->count && (int)qp->active[i] != number) {
        i++;
    }
    return i < qp->count;
}

/* How far v is from a bound on which it should be: rounding. */
static mdk_real largest_error(const mdk_qp *qp) {
    mdk_real largest = R(0);
    for (int i = 0; i < qp->count; i++) {
        mdk_real low, high;
        const mdk_real value = value_of(qp, (int)qp->active[i], &low, &high);
        largest = larger(largest, fabs(value - (qp->sign[i] > R(0) ? high : low)));
    }
    return largest;
}

/* Number of the constraint that v violates most, beyond the tolerance; -1: none. An active one is
 * violated by rounding only: if its bounds are equal, adding the other one would make it dependent. */
static int most_violated(const mdk_qp *qp, mdk_real *sign) {
    int found = -1;
    mdk_real most = VIOLATION;
    for (int number = 0; number < 2 * qp->size; number++) {
        mdk_real low, high;
        const mdk_real value = value_of(qp, number, &low, &high);
        const mdk_real violation = larger(value - high, low - value);
        if (violation > most && !(low <= high && is_active(qp, number))) {
            most = violation;
            *sign = value > high ? R(1) : R(-1);
            found = number;
        }
    }
    return found;
}

/* Move the multipliers towards `wanted` (or, `is_direction`, along it) until one would be negative.
 * Index of that one; -1: none. */
static int move_multipliers(mdk_qp *qp, bool is_direction) {
    int blocking = -1;
    mdk_real share = R(1), largest = R(0);
    for (int i = 0; i < qp->count; i++) {
        largest = larger(largest, fabs(qp->wanted[i]));
    }
    for (int i = 0; i < qp->count; i++) {
        if (qp->wanted[i] < -WRONG_SIGN * largest) {
            const mdk_real change = is_direction ? -qp->wanted[i] : qp->multiplier[i] - qp->wanted[i];
            const mdk_real until = qp->multiplier[i] / change;
            if (blocking < 0 || until < share) {
                share = until;
                blocking = i;
            }
        }
    }
    if (is_direction && blocking < 0) {
        return -1;
    }
    for (int i = 0; i < qp->count; i++) {
        const mdk_real change = is_direction ? qp->wanted[i] : qp->wanted[i] - qp->multiplier[i];
        qp->multiplier[i] = larger(qp->multiplier[i] + share * change, R(0));
    }
    return blocking;
}

/* The constraints of the last solution, of which those are taken that are independent. */
static void warm_start(mdk_qp *qp) {
    const int count = qp->count;
    qp->count = 0;
    for (int i = 0; i < count; i++) {
        if (!add(qp, (int)qp->active[i], qp->sign[i])) {
            qp->count--;
        }
    }
}

/* v, from the present working set. After a failure that is empty. */
static mdk_status iterate(mdk_qp *qp, int max_iterations) {
    bool is_independent = true;
    int corrections = 0; /* of the present constraints */
    while (qp->iterations < max_iterations) {
        qp->iterations++;
        if (is_independent) {
            solve_equations(qp, corrections > 0);
        } else {
            find_null_direction(qp);
        }
        const int blocking = move_multipliers(qp, !is_independent);
        if (blocking >= 0) {
            is_independent = remove_row(qp, blocking);
            corrections = 0;
            continue;
        }
        if (!is_independent) {
            qp->count = 0;
            return MDK_INFEASIBLE;
        }
        if (!find_inputs(qp)) {
            qp->count = 0;
            return MDK_NUMERICS;
        }
        mdk_real sign = R(1);
        const int violated = most_violated(qp, &sign);
        if (violated < 0) {
            const bool is_last = corrections++ == MOST_CORRECTIONS;
            const mdk_real error = largest_error(qp);
            if (error <= (is_last ? LARGEST_ERROR : VIOLATION)) {
                return MDK_SOLVED;
            }
            if (is_last) {
                qp->count = 0;
                return MDK_NUMERICS;
            }
            continue;
        }
        corrections = 0;
        if (qp->count > qp->size) { /* rounding hides that they depend on each other */
            qp->count = 0;
            return MDK_NUMERICS;
        }
        is_independent = add(qp, violated, sign);
    }
    qp->count = 0;
    return MDK_ITERATION_LIMIT;
}

/* v, from the constraints that were active in the last solution. If rounding spoils that, from none. */
mdk_status mdk_solve(mdk_qp *qp, int max_iterations) {
    const int nv = qp->size;
    mdk_real checked = R(0);
    for (int i = 0; i < nv; i++) {
        checked += qp->f[i] + qp->lower[i] + qp->upper[i] + qp->row_lower[i] + qp->row_upper[i];
    }
    qp->iterations = 0;
    if (!qp->is_convex || !isfinite(checked)) {
        qp->count = 0;
        return MDK_NUMERICS;
    }
    for (int i = 0; i < nv; i++) {
        qp->work[i] = dot(i + 1, qp->L_inverse + i * nv, qp->f); /* L^-1 f */
    }
    warm_start(qp);
    const bool is_warm = qp->count > 0;
    const mdk_status status = iterate(qp, max_iterations);
    return status == MDK_SOLVED || !is_warm ? status : iterate(qp, max_iterations);
}
