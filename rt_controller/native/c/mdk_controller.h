/* The memory of a controller: what changes from period to period. Only the law uses its fields. */

#ifndef MDK_CONTROLLER_H
#define MDK_CONTROLLER_H

enum { MDK_SIGNALS = MDK_INPUTS + 1 }; /* [u; kappa] */
enum { MDK_HISTORY = 6 };              /* v_x, v_y, yaw rate, and the input held after them */

/* The condensed QP: minimise 1/2 v' H v + f' v, lower <= v <= upper, row_lower <= v_i - v_(i-3) <=
 * row_upper. v has 3 inputs at each of K knots. */
typedef struct {
    int size; /* nv = 3 K */
    mdk_real *H;         /* [nv][nv], the lower half */
    mdk_real *L_inverse; /* [nv][nv], of the Cholesky factor of H */
    mdk_real *f, *v;     /* [nv] */
    mdk_real *lower, *upper, *row_lower, *row_upper; /* [nv] */
    bool is_convex;
    int iterations;
    /* Working set: `active` < nv a bound, otherwise the row active - nv. One more than nv for a moment,
     * when a constraint is added that depends on the others. */
    int count;
    mdk_real *active;       /* [nv + 1] numbers of constraints */
    mdk_real *sign;         /* [nv + 1] +1 at the upper bound, -1 at the lower one */
    mdk_real *multiplier;   /* [nv + 1] */
    mdk_real *M;            /* [nv + 1][nv], rows sign L^-1 c of the active constraints c */
    mdk_real *D;            /* [nv + 1][nv + 1], factor L D L' of M M': L below, D on the diagonal */
    mdk_real *wanted, *work; /* [nv + 1] */
    mdk_real *level;         /* [nv + 1], -M L^-1 f */
} mdk_qp;

/* The model along the nominal inputs, and what eq. (14) is made of. s: tracked states, p: outputs. */
typedef struct {
    mdk_real kappa;
    mdk_real u_prev[MDK_INPUTS];
    mdk_real *psi_0, *psi_nominal;   /* [n] */
    mdk_real *u_nominal;             /* [K][3] */
    mdk_real *x_r, *x;               /* [K + 1][s], wanted and predicted at the knots */
    mdk_real *length_m;              /* [K + 1], of the interval that ends at each knot */
    mdk_real *W, *t;                 /* [N][gains], slopes and values of the gains */
    mdk_real *path;                  /* [N][2][6], derivatives of e_y and e_psi */
    mdk_real *J;                     /* [m][m + 5] of one stage */
    mdk_real *Y;                     /* [K + 1][s][n + 4], derivatives of the states at the knots */
    mdk_real *y;                     /* [2][m + 4] */
    mdk_real *by_input;              /* [K + 1][s][K][3] by the inputs at the knots */
    mdk_real *by_kappa;              /* [K + 1][s] */
    mdk_real *Gamma;                 /* [K p][nv] */
    mdk_real *Phi;                   /* [K p][n] */
    mdk_real *g, *constant, *d;      /* [K p] */
    mdk_real slew[MDK_INPUTS];       /* largest change of v from the last period to the first knot */
    mdk_real *inputs;                /* [N][3], the last plan that was solved */
    int pedal, periods_until_pressed; /* the pedal in use; the other one is released */
} mdk_eq14;

/* The gain from the wheel to the yaw rate, relative to that of the model, and averages of the yaw rate
 * that was predicted with a factor of 1, and of the measured one, with the share of the next one; periods
 * until the wheel was not at its rate in a prediction. */
typedef struct {
    mdk_real factor, predicted, measured, share, wheel_rad;
    int periods_left;
} mdk_steering;

typedef struct {
    mdk_real before[MDK_STATES], offset[MDK_STATES], disturbance[MDK_STATES];
    mdk_real pedals; /* throttle less brake, averaged */
    bool is_advanced;
    int newest, begun;
    mdk_real *psi;       /* [MDK_BEGUN][n], predictions that began in the last periods */
    mdk_real *following; /* [n + gains] */
} mdk_estimator;

typedef struct {
    const mdk_model *model;
    mdk_real *history; /* [H][6], oldest first */
    mdk_real present[MDK_STATES];
    bool has_present;
    mdk_real *signals, *layer[2]; /* work space of the network */
    mdk_real *psi;                          /* [n], the state that was lifted last */
    mdk_real *gains;                        /* [gains + 3] */
    mdk_real kappa;                         /* of the road in the last period */
    mdk_estimator estimator;
    mdk_steering steering;
    mdk_eq14 eq14;
    mdk_qp qp;
    mdk_real acting[MDK_INPUTS]; /* the input that acts after the state of the last plan */
    bool has_plan, is_prepared;
    int periods_held;
} mdk_controller;

#endif
