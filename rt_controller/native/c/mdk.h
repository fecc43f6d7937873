/* A learned control law for an embedded computer: state and path in, pedals and wheel out.
 *
 * psi = [x; latents; 1] is lifted by a neural network, psi+ = A psi + B [u; kappa] + gains, and a QP
 * over a horizon finds the inputs. All constants are in one `mdk_model`; all that changes is in one
 * `mdk_controller`, which the caller allocates. No heap, no files, no global variables: several
 * controllers can run side by side. SI units; the steering angle is that of the wheel, positive to
 * the left.
 *
 * C99. All numbers are float if MDK_FLOAT is 1, otherwise double: the same in all files. */

#ifndef MDK_H
#define MDK_H

#include <stdbool.h>
#include <stddef.h>

#ifndef MDK_FLOAT
#define MDK_FLOAT 0
#endif
#if MDK_FLOAT
typedef float mdk_real;
#else
typedef double mdk_real;
#endif

enum { MDK_VX, MDK_VY, MDK_YAW_RATE, MDK_DS, MDK_EY, MDK_EPSI, MDK_STATES };
/* v_x, v_y in m/s, yaw rate in rad/s, progress in the last period in m, lateral error in m, heading
 * error in rad; axes of the car: x forward, y left */
enum { MDK_THROTTLE, MDK_BRAKE, MDK_STEER, MDK_INPUTS };
/* 0 to 1; force on the pedal in N; angle of the steering wheel in rad */
enum { MDK_PATH = 6 };
/* lateral position c0 + c1 s + c2 s^2 + c3 s^3 of the path s metres ahead, its speed in m/s and
 * acceleration in m/s^2 */
enum { MDK_SPACING, MDK_K0, MDK_K4 = 5, MDK_PREVIEW };
/* curvature of the road in 1/m, at the car and 1, 2, 3, 4 spacings ahead; the spacing in m > 0 */
enum { MDK_BEGUN = 10 };
/* periods of a prediction whose error is the disturbance */
enum { MDK_MOST_UNDER_WAY = 16 };
/* inputs that were sent and do not act yet */

typedef enum {
    MDK_SOLVED,
    MDK_ITERATION_LIMIT, /* the QP needs more iterations than `max_iterations` */
    MDK_INFEASIBLE,
    MDK_NUMERICS /* a number is not finite, or the Hessian is not positive definite */
} mdk_status;

typedef enum { MDK_SILU, MDK_RELU } mdk_activation;

typedef struct {
    int inputs, outputs;
    const float *weights; /* [outputs][inputs] */
    const float *biases;  /* [outputs] */
} mdk_layer;

/* The network: latents = layers(s) + products of the present signals, with s = [x; kappa; history],
 * of which it may read some. If `signs` is set, each latent is even or odd when left and right are
 * exchanged: (f(s) +- f(s mirrored)) / 2. */
typedef struct {
    int layers;
    const mdk_layer *layer;
    mdk_activation activation;
    int latents, present, history; /* sizes; `history`: periods */
    const int *columns;            /* [present] of [x; kappa] */
    const float *products;         /* [latents][present (present + 1) / 2]; NULL: none */
    const float *centre, *spread;  /* [present] of the factors of the products */
    const float *signs;            /* [present + 6 history]; NULL: not symmetric */
    const float *latent_signs;     /* [latents] */
} mdk_encoder;

/* psi+ = A psi + B [u; kappa] + c + N (t f), t = tanh(S psi + s0), or S psi + s0 if it is linear. The
 * factor f of a gain is an input, kappa or 1.
 *
 * psi has `n` observables, the first `m` of which follow from A. If `has_path`, the path states are the
 * last three, and follow by kinematics from the movement of the car, which is S psi + s0 too (metres
 * ahead and to the left, radians turned).
 *
 * In a symmetric model the first `even` observables are even when left and right are exchanged, the
 * others odd. A has two blocks, and a row of S has the even or the odd columns. Any other model has
 * even observables only. */
typedef struct {
    int n, m, even;
    int gains;
    int parts[5]; /* gains that act on even observables: from parts[0] with an even function, from
                   * parts[1] with an odd one; from parts[2] and parts[3] those that act on odd ones */
    const int *place;       /* [n], in psi, of x and of the latents; v_x has the first one */
    const mdk_real *A;      /* [m][m] */
    const mdk_real *B;      /* [m][4] */
    const mdk_real *c;      /* [m] */
    const mdk_real *N;      /* [m][gains] */
    const mdk_real *S;      /* [gains + 3][m]; the movement last, if has_path */
    const mdk_real *s0;     /* [gains + 3] */
    const bool *is_odd;     /* [gains + 3], of the rows of S */
    const bool *is_linear;  /* [gains] */
    const int *factor;      /* [gains], 0..4 of [u; kappa; 1] */
    bool has_path;
} mdk_dynamics;

/* Eq. (14): cost, horizon and bounds. Inputs are scaled: u = range v. */
typedef struct {
    int horizon, knots;
    const int *stages; /* [knots], stage of each knot */
    int tracked;       /* states that the cost or the course needs */
    const int *columns; /* [tracked] */
    int ey, vx;         /* index of them in `columns`; vx: -1 if it has no weight */
    bool has_course;    /* the direction of motion is the last output */
    const mdk_real *Q;  /* [knots][tracked + has_course] */
    const mdk_real *R, *R_next; /* [3 knots], [3 (knots - 1)]: diagonal, and coupling of two knots */
    mdk_real from_previous[MDK_INPUTS];
    mdk_real lower[MDK_INPUTS], upper[MDK_INPUTS], slew[MDK_INPUTS]; /* of v; slew: a period */
    mdk_real range[MDK_INPUTS];
    int pedal_change; /* periods from one pedal to the other */
    mdk_real change_mps2, released, most_nominal_throttle, slowest_mps;
    int max_iterations;
} mdk_problem;

/* Filter and disturbance: shares that are taken over in one period. Bounds of the steering factor, and
 * how fast it is learned. */
typedef struct {
    mdk_real gain[MDK_STATES], offset_gain[MDK_STATES];
    mdk_real kept[MDK_STATES], low_pass[MDK_STATES], largest[MDK_STATES];
    mdk_real moved_pedal, brake_n, fast_mps;
    mdk_real smallest_factor, largest_factor, information, least_radps, averaged, at_rate_rad;
} mdk_estimation;

/* The last check of a command, and the bound of the wheel by the speed: `least_rad`, or more at low
 * speed, as far as a steady turn stays within `plan_mps2`; at any angle within `accepted_mps2`. */
typedef struct {
    mdk_real lower[MDK_INPUTS], upper[MDK_INPUTS], change[MDK_INPUTS]; /* change: a period */
    mdk_real released[MDK_STEER];
    mdk_real steering_ratio, wheelbase_m, understeer; /* understeer: rad per m/s^2 */
    mdk_real plan_mps2, accepted_mps2;
    mdk_real least_rad, lock_rad, trained_rad;
} mdk_envelope;

typedef struct {
    mdk_real period_s;
    mdk_encoder encoder;
    mdk_dynamics dynamics;
    mdk_problem problem;
    mdk_estimation estimation;
    mdk_envelope envelope;
    int hold_periods; /* in which the last plan may replace a missing one */
} mdk_model;

/* What the caller knows in a period. */
typedef struct {
    mdk_real state[MDK_STATES];
    mdk_real curvature_per_m;       /* of the road at the car */
    mdk_real path[MDK_PATH];
    mdk_real preview[MDK_PREVIEW];
    bool has_preview;               /* false: the curvature is constant */
    mdk_real applied[MDK_INPUTS];   /* that acted until now */
    mdk_real previous[MDK_INPUTS];  /* that was sent last: slew rates begin there */
    int n_under_way;                /* 0 to MDK_MOST_UNDER_WAY */
    mdk_real under_way[MDK_MOST_UNDER_WAY][MDK_INPUTS]; /* sent, not acting yet; oldest first */
} mdk_situation;

#include "mdk_controller.h"

/* Number of mdk_real that a controller with this model needs beside its struct. */
int mdk_memory(const mdk_model *model);

/* `memory` has mdk_memory() numbers and belongs to the controller from now on. */
void mdk_init(mdk_controller *c, const mdk_model *model, mdk_real *memory);

/* One period: filter, plan, envelope, and the preparation of the next plan.
 *
 * MDK_SOLVED: `command` is the first input of a new plan. Otherwise it is the next input of the last
 * one, for `hold_periods` periods, and then the input that was sent last: the caller stops the car.
 * The command is always finite, and within bounds and rates if `previous` is within its bounds. */
mdk_status mdk_step(mdk_controller *c, const mdk_situation *now, mdk_real command[MDK_INPUTS]);

/* The parts of mdk_step, for a caller that sends before it prepares. */
void mdk_observe(mdk_controller *c, const mdk_real measured[MDK_STATES],
                 const mdk_real applied[MDK_INPUTS], mdk_real x_0[MDK_STATES]);
mdk_status mdk_plan(mdk_controller *c, const mdk_real x_0[MDK_STATES], const mdk_situation *now);
void mdk_prepare(mdk_controller *c);
void mdk_limit(const mdk_model *model, mdk_real most_steer_rad, const mdk_real wanted[MDK_INPUTS],
               const mdk_real previous[MDK_INPUTS], mdk_real command[MDK_INPUTS]);

/* Bound of the wheel angle at a speed. */
mdk_real mdk_largest_wheel_rad(const mdk_model *model, mdk_real vx_mps);

/* The last plan that was solved, [horizon][3]. */
const mdk_real *mdk_inputs(const mdk_controller *c);

/* The state that was lifted last, [n] in the order of `mdk_dynamics`. */
const mdk_real *mdk_lifted(const mdk_controller *c);

/* The gain from the wheel to the yaw rate, relative to that of the model. */
mdk_real mdk_steering_factor(const mdk_controller *c);

/* Of the last QP: iterations, and all of it, its Hessian as the factor L in the lower half of H. */
int mdk_iterations(const mdk_controller *c);
const mdk_qp *mdk_last_qp(const mdk_controller *c);

/* Bytes of the struct, for a caller that is not written in C. */
size_t mdk_size(void);

/* A driver hands over a car that `applied` turns steadily. */
void mdk_assume_steady(mdk_controller *c, const mdk_real state[MDK_STATES], mdk_real curvature_per_m,
                       const mdk_real applied[MDK_INPUTS]);

/* A period or more is missing before the next one. */
void mdk_forget(mdk_controller *c);

/* The next state is an estimate, since a signal is faulty: discard what was learned from it. */
void mdk_discard_estimates(mdk_controller *c);

/* Another drive begins; `previous`: the input that acts now. */
void mdk_reset(mdk_controller *c, const mdk_real previous[MDK_INPUTS]);

/* Another law made the last inputs, the newest of them `previous`. */
void mdk_resume(mdk_controller *c, const mdk_real previous[MDK_INPUTS]);

/* From now on the wheel turns at most so far, and at most at this rate. */
void mdk_limit_steering(mdk_controller *c, mdk_real most_rad, mdk_real rate_radps);

#endif
