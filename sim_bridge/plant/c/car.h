/* A simulated car: states, inputs, outputs and the functions of its parts.
 *
 * Axes as ISO 8855: x forward, y left, z up; angles positive by the right-hand rule, so positive
 * roll lowers the right side, positive pitch the nose, positive steering turns to the left. Wheels
 * are ordered front left, front right, rear left, rear right. SI units; names end in the unit.
 *
 * Compile with IEEE 754 arithmetic (-ffp-contract=off, no -ffast-math): results are then the same
 * to the last bit on all machines whose C libraries agree. */

#ifndef CAR_H
#define CAR_H

#ifdef __FAST_MATH__
#error "compile without -ffast-math: the code needs the arithmetic of IEEE 754"
#endif

#include <math.h>

#include "records.h"

#define N_FRONT 2 /* front wheels; they come first */

#define GRAVITY_MPS2 9.80665
#define PI 3.141592653589793
#define RPM_OF_RADPS (30.0 / PI)
#define STEP_S 0.001 /* of the integration; 25 steps in a control period */

/* `State` and `Outputs` are made from `StateIndex` and `PlantOutputs` in Python; their memory is a
 * flat array of doubles. The position on the road is not part of the state. */
#define N_STATES (sizeof(State) / sizeof(double))

/* x' = rate - decay x, and dry friction of size `friction` against x. Lags are given as rate and
 * decay, so that a step solves them exactly; friction apart, so that it can stop a motion but not
 * reverse it. */
typedef struct {
    State rate;
    State decay;
    State friction;
} Derivative;

typedef struct {
    double throttle; /* accelerator pedal, 0..1 */
    double brake_n;  /* force on the brake pedal */
    double steer_rad; /* steering wheel, positive to the left */
} Input;

/* Motion of the centre of gravity, body axes. */
typedef struct {
    double vx_mps;
    double vy_mps;
    double yaw_rate_radps;
} Motion;

/* Place of the centre of gravity on the road, and the heading against it. */
typedef struct {
    double s_m;
    double ey_m;
    double epsi_rad;
} Pose;

/* Curvature over arc length, as polynomials of third order: for each piece its start and four
 * coefficients, in ascending powers of the distance from it. */
typedef struct {
    int n_pieces;
    const double *starts_m;
    const double *coefficients;
} Curvature;

/* One axle, so that both use the same equations. */
typedef struct {
    double ahead_m;        /* of the whole car's centre of gravity; rear axle: negative */
    double sprung_ahead_m; /* of that of the sprung mass */
    double half_track_m;
    double track_m;
    double wheel_kg;
    double rest_load_n; /* of one tyre of the car at rest */
    double spring_npm;
    double bar_nmprad;
    double jounce_nspm;
    double rebound_nspm;
    double jounce_fast_nspm;
    double rebound_fast_nspm;
    double damper_knee_mps;
    double stop_gap_m;
    double stop_npm2;
    double roll_centre_m;
    double arm_slope;    /* upward force of the arms on the body per forward force at the road */
    double centre_slope; /* the same per forward force at the wheel centre */
    double roll_steer;
    double lateral_steer_radpn;
    double aligning_steer_radpnm;
    double camber_gain;
    double brake_nm_per_mpa;
} Axle;

/* Force of the road on one tyre in the axes of the wheel, and the moment around its vertical. */
typedef struct {
    double forward_n;
    double left_n;
    double aligning_nm;
} TyreForce;

/* Linear lag of one slip: its rate is `rate - decay * slip`. */
typedef struct {
    double rate;
    double decay;
    double damping; /* added to the slip for the force: material damping of the tyre */
} SlipRates;

/* Force of the road on one wheel in body axes, its moments around the vertical, its speed. */
typedef struct {
    double forward_n;
    double left_n;
    double aligning_nm;
    double kingpin_nm;
    double side_n;      /* to the left in the axes of the wheel */
    double forward_mps; /* speed of the wheel's centre along the wheel */
} WheelForce;

/* Gravity in the axes of the road. */
typedef struct {
    double forward_mps2;
    double left_mps2;
    double lighter_mps2; /* by which gravity against the road is smaller than on a flat road */
} RoadGravity;

/* Force of the air on the body in its axes, and its moment around the vertical. */
typedef struct {
    double forward_n;
    double left_n;
    double up_n;
    double yaw_nm;
} AirForce;

typedef struct {
    double front;
    double rear;
} FrontRear;

/* The second one only if it is smaller or larger. A NaN that comes first stays; `limited` turns one
 * into `low`. */
static inline double smaller(double one, double other) { return other < one ? other : one; }
static inline double larger(double one, double other) { return other > one ? other : one; }
static inline double limited(double value, double low, double high) {
    return smaller(high, larger(low, value));
}

/* Of a vector; `hypot` guards against overflow and takes four times as long. */
static inline double length(double one, double other) { return sqrt(one * one + other * other); }

/* 1 for a left wheel, -1 for a right one. */
static inline double side_of(int wheel) { return wheel % 2 == 0 ? 1.0 : -1.0; }

static inline double road_friction_at(int wheel, const RoadParameters *road) {
    return wheel % 2 == 0 ? road->friction_left : road->friction_right;
}

/* tyre.c and tyre_file.c */
SlipRates lateral_relaxation(double slip, double forward_mps, double left_mps, double load_n,
                             const TyreParameters *tyre);
SlipRates longitudinal_relaxation(double slip, double forward_mps, double rim_mps, double load_n,
                                  const TyreParameters *tyre);
TyreForce tyre_force(double lateral_slip, double longitudinal_slip, double lean_rad, double load_n,
                     double road_friction, double side, const Parameters *p);
TyreForce tyre_file_force(double lateral_slip, double longitudinal_slip, double lean_rad,
                          double load_n, double road_friction, double mirror,
                          const TyreFileParameters *t);
double largest_slip(double speed_mps, double road_friction, const TyreParameters *tyre);
double rolling_resistance_nm(double spin_radps, double load_n, const TyreParameters *tyre);

/* chassis.c */
Axle front_axle(const Parameters *p);
Axle rear_axle(const Parameters *p);
double roll_arm_m(const Parameters *p);
double pitch_arm_m(const Parameters *p);
RoadGravity gravity_in_road_axes(const RoadParameters *road);
AirForce air_force(const State *x, const Parameters *p);
double travel_m(const State *x, int wheel, const Axle *axle);
double axle_roll_rad(const State *x, int left_wheel, const Axle *axle);
double tyre_load_n(const State *x, int wheel, const Axle *axle, const TyreParameters *tyre);
double spring_force_n(const State *x, int wheel, double roll_rad, const Axle *axle);
double arm_force_n(int wheel, const WheelForce *road, double drive_n, double ax_mps2,
                   double ay_mps2, const Axle *axle, const BodyParameters *body);
void sprung_acceleration(const State *x, double forward_n, double left_n, double ax_mps2,
                         double ay_mps2, double lift_n, const double corners_n[N_WHEELS],
                         const Parameters *p, State *rate);

/* wheels.c */
WheelForce wheel_force(const State *x, int wheel, const Axle *axle, double angle_rad,
                       double drive_nm, const Parameters *p, Derivative *out);
void front_wheels_rad(const State *x, double roll_rad, const Axle *front, const Parameters *p,
                      double *left_rad, double *right_rad);
double hand_torque_nm(double steer_rad, double road_wheel_rad, const SteeringParameters *steering);
void steering_rates(const State *x, double steer_rad, double kingpin_nm, const Axle *front,
                    const Parameters *p, Derivative *out);

/* drive.c */
FrontRear steady_pressures_mpa(double pedal_n, const BrakeParameters *brakes);
double brake_release_per_s(const State *x, int wheel, double forward_mps, const Parameters *p);
double output_speed_radps(const State *x, const Parameters *p);
double highest_gear(double output_radps, double throttle, const GearboxParameters *gearbox);
double ratio_of_gear(double gear, const GearboxParameters *gearbox);
void choose_gear(State *x, double output_radps, const GearboxParameters *gearbox, double step_s);
double drive_nm(const State *x, const Parameters *p);
double torque_cut_per_s(const State *x, const double forward_mps[N_WHEELS], const Parameters *p);
FrontRear wheel_torque_nm(const State *x, double throttle, const Parameters *p, Derivative *out);

/* car.c */
void evaluate(const State *x, const Input *u, const Parameters *p, Derivative *out);

/* The functions of the library. */
#ifdef __GNUC__
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

EXPORTED void car_advance(State *x, const Input *u, const Parameters *p, int n_steps, double step_s,
                          Motion *motion);
EXPORTED void car_simulate(State *x, const Input *inputs, const RoadParameters *roads,
                           Parameters *p, int n_periods, int steps_per_period, double step_s,
                           Motion *motion, Outputs *outputs);
EXPORTED void car_settle(double v0_mps, const Parameters *p, State *x);
EXPORTED void car_outputs(const State *x, const Input *u, const Parameters *p, Outputs *outputs);
EXPORTED void car_sizes(int *n_states, int *n_parameters, int *n_outputs);
EXPORTED void car_tyre_force(double lateral_slip, double longitudinal_slip, double lean_rad,
                             double load_n, double road_friction, const Parameters *p,
                             TyreForce *force);
EXPORTED void car_steady_pressures(double pedal_n, const Parameters *p, FrontRear *mpa);
EXPORTED void road_advance(const Motion *before, const Motion *motion, int n_steps,
                           const Curvature *road, double step_s, Pose *pose);
EXPORTED void road_poses(const Motion *motion, int n_periods, int steps_per_period,
                         const Curvature *road, double step_s, Pose *poses);

#endif
