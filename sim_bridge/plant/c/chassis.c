/* The chassis: body, air, gravity on slopes; springs, dampers, anti-roll bars and arms.
 *
 * The planar equations hold for the centre of gravity of the whole car, so that they contain no
 * roll or pitch accelerations. Forces and displacements of the suspension are counted from the car
 * at rest, where springs and tyres carry the weight. */

#include <math.h>

#include "car.h"

/* Weight of the sprung mass on the front axle, as a mass. */
static double sprung_front_kg(const BodyParameters *body) {
    const double wheelbase_m = body->sprung_front_axle_m + body->sprung_rear_axle_m;
    return body->sprung_mass_kg * body->sprung_rear_axle_m / wheelbase_m;
}

/* The axle at one end of the car, `front` or `rear`; `way` is 1 for the end ahead of the centre of
 * gravity, -1 for the one behind it. */
#define AXLE_OF(end, way, sprung_kg)                                                   \
    (Axle) {                                                                           \
        .ahead_m = (way) * body->end##_axle_m,                                         \
        .sprung_ahead_m = (way) * body->sprung_##end##_axle_m,                         \
        .half_track_m = 0.5 * body->track_##end##_m,                                   \
        .track_m = body->track_##end##_m,                                              \
        .wheel_kg = 0.5 * body->unsprung_##end##_kg,                                   \
        .rest_load_n = 0.5 * GRAVITY_MPS2 * ((sprung_kg) + body->unsprung_##end##_kg), \
        .spring_npm = suspension->spring_##end##_npm,                                  \
        .bar_nmprad = suspension->bar_##end##_nmprad,                                  \
        .jounce_nspm = suspension->jounce_##end##_nspm,                                \
        .rebound_nspm = suspension->rebound_##end##_nspm,                              \
        .jounce_fast_nspm = suspension->jounce_##end##_fast_nspm,                      \
        .rebound_fast_nspm = suspension->rebound_##end##_fast_nspm,                    \
        .damper_knee_mps = suspension->damper_knee_##end##_mps,                        \
        .stop_gap_m = suspension->stop_gap_##end##_m,                                  \
        .stop_npm2 = suspension->stop_##end##_npm2,                                    \
        .roll_centre_m = suspension->roll_centre_##end##_m,                            \
        .arm_slope = -(way) * suspension->arm_slope_##end,                             \
        .centre_slope = -(way) * suspension->centre_slope_##end,                       \
        .roll_steer = suspension->roll_steer_##end,                                    \
        .lateral_steer_radpn = suspension->lateral_steer_##end##_radpn,                \
        .aligning_steer_radpnm = suspension->aligning_steer_##end##_radpnm,            \
        .camber_gain = suspension->camber_gain_##end,                                  \
        .brake_nm_per_mpa = p->brakes.end##_nm_per_mpa,                                \
    }

Axle front_axle(const Parameters *p) {
    const BodyParameters *body = &p->body;
    const SuspensionParameters *suspension = &p->suspension;
    return AXLE_OF(front, 1.0, sprung_front_kg(body));
}

Axle rear_axle(const Parameters *p) {
    const BodyParameters *body = &p->body;
    const SuspensionParameters *suspension = &p->suspension;
    return AXLE_OF(rear, -1.0, body->sprung_mass_kg - sprung_front_kg(body));
}

/* Height of the sprung mass above its roll axis. */
double roll_arm_m(const Parameters *p) {
    const BodyParameters *body = &p->body;
    const double wheelbase_m = body->sprung_front_axle_m + body->sprung_rear_axle_m;
    const double axis_m = (p->suspension.roll_centre_front_m * body->sprung_rear_axle_m +
                           p->suspension.roll_centre_rear_m * body->sprung_front_axle_m) /
                          wheelbase_m;
    return body->sprung_height_m - axis_m;
}

/* Height of the sprung mass above its pitch axis, which is where the slopes of the arms of both
 * axles, seen from the side, meet. */
double pitch_arm_m(const Parameters *p) {
    const double front_m = p->body.sprung_front_axle_m;
    const double rear_m = p->body.sprung_rear_axle_m;
    const double slopes = p->suspension.arm_slope_front + p->suspension.arm_slope_rear;
    return p->body.sprung_height_m - slopes * front_m * rear_m / (front_m + rear_m);
}

/* Gravity along a car that follows the road. */
RoadGravity gravity_in_road_axes(const RoadParameters *road) {
    const double level = cos(road->grade_rad);
    return (RoadGravity){
        .forward_mps2 = -GRAVITY_MPS2 * sin(road->grade_rad),
        .left_mps2 = -GRAVITY_MPS2 * level * sin(road->bank_rad),
        .lighter_mps2 = GRAVITY_MPS2 * (1.0 - level * cos(road->bank_rad)),
    };
}

/* Forces from the velocity of the car against the air, which moves with the wind.
 *
 * Drag acts along the car, the side force in proportion to the direction of the flow: both grow
 * with the whole speed of the flow. */
AirForce air_force(const State *x, const Parameters *p) {
    const AeroParameters *aero = &p->aero;
    const double forward_mps = x->vx_mps - p->road.wind_forward_mps;
    const double left_mps = x->vy_mps - p->road.wind_left_mps;
    const double speed_mps = length(forward_mps, left_mps);
    const double per_mps2 = 0.5 * aero->air_density_kgpm3 * aero->area_m2;
    const double side_n = -per_mps2 * aero->side_force_slope * left_mps * speed_mps;
    return (AirForce){
        .forward_n = -per_mps2 * aero->drag * forward_mps * speed_mps,
        .left_n = side_n,
        .up_n = per_mps2 * aero->lift * forward_mps * forward_mps,
        .yaw_nm = side_n * aero->side_force_ahead_m,
    };
}

/* Displacement of a wheel upward against the body. */
double travel_m(const State *x, int wheel, const Axle *axle) {
    const double body_m = x->heave_m - axle->sprung_ahead_m * x->pitch_rad;
    const double lateral_m = side_of(wheel) * axle->half_track_m;
    return x->rise_m[wheel] - body_m - lateral_m * x->roll_rad;
}

/* Roll of the body against the line through the wheels of an axle. */
double axle_roll_rad(const State *x, int left_wheel, const Axle *axle) {
    const double left_m = travel_m(x, left_wheel, axle);
    return (travel_m(x, left_wheel + 1, axle) - left_m) / axle->track_m;
}

/* Vertical load of a tyre from its deflection; never negative: the tyre can leave the road. */
double tyre_load_n(const State *x, int wheel, const Axle *axle, const TyreParameters *tyre) {
    const double deflection_n = tyre->vertical_stiffness_npm * x->rise_m[wheel] +
                                tyre->vertical_damping_nspm * x->rise_rate_mps[wheel];
    return larger(0.0, axle->rest_load_n - deflection_n);
}

/* Force of bump stop or rebound stop on the body, square in the travel beyond the gap. */
static double stop_force_n(double risen_m, const Axle *axle) {
    const double beyond_m = fabs(risen_m) - axle->stop_gap_m;
    if (beyond_m <= 0.0) {
        return 0.0;
    }
    const double stop_n = axle->stop_npm2 * beyond_m * beyond_m;
    return risen_m > 0.0 ? stop_n : -stop_n;
}

/* Force of a damper on the body at the wheel; `rate_mps` is positive in jounce.
 *
 * Digressive: the slope falls from that of slow motion to that of fast motion around the knee, as
 * with valves that open. Equal slopes give a linear damper. */
static double damper_force_n(double rate_mps, const Axle *axle) {
    const double slow_nspm = rate_mps > 0.0 ? axle->jounce_nspm : axle->rebound_nspm;
    const double fast_nspm = rate_mps > 0.0 ? axle->jounce_fast_nspm : axle->rebound_fast_nspm;
    const double relative = rate_mps / axle->damper_knee_mps;
    const double opening_nspm = (slow_nspm - fast_nspm) / sqrt(1.0 + relative * relative);
    return (fast_nspm + opening_nspm) * rate_mps;
}

/* Upward force of spring, stops, damper and anti-roll bar on the body at one wheel; `roll_rad` is
 * that of the body against the axle. */
double spring_force_n(const State *x, int wheel, double roll_rad, const Axle *axle) {
    const double body_mps = x->heave_rate_mps - axle->sprung_ahead_m * x->pitch_rate_radps;
    const double lateral_m = side_of(wheel) * axle->half_track_m;
    const double rate_mps = x->rise_rate_mps[wheel] - body_mps - lateral_m * x->roll_rate_radps;
    const double bar_n = side_of(wheel) * axle->bar_nmprad * roll_rad / axle->track_m;
    const double risen_m = travel_m(x, wheel, axle);
    return axle->spring_npm * risen_m + stop_force_n(risen_m, axle) +
           damper_force_n(rate_mps, axle) - bar_n;
}

/* Upward force of the suspension arms on the body at one wheel.
 *
 * Inclined arms convert a part of a horizontal force into a vertical one. The force of the tyre
 * acts at the road, the inertia force of the wheel at the height of its centre; both are
 * transferred to the body in the roll centre, as with a rigid axle. In side view the arms carry the
 * torque of the brake, so that its force acts at the road; a drive shaft comes from the body, so
 * that its force acts at the wheel centre. `drive_n` is the torque of the shaft over the radius of
 * the wheel; `ax_mps2`, `ay_mps2` are without the part that gravity gives on a slope. */
double arm_force_n(int wheel, const WheelForce *road, double drive_n, double ax_mps2,
                   double ay_mps2, const Axle *axle, const BodyParameters *body) {
    const double lateral_nm =
        axle->roll_centre_m * road->left_n -
        axle->wheel_kg * ay_mps2 * (axle->roll_centre_m - body->unsprung_height_m);
    const double slope_per_m = side_of(wheel) * 2.0 / axle->track_m;
    return -slope_per_m * lateral_nm + axle->arm_slope * (road->forward_n - drive_n) +
           axle->centre_slope * (drive_n - axle->wheel_kg * ax_mps2);
}

/* Heave, roll and pitch acceleration of the sprung mass, written to `rate`.
 *
 * The wheels transfer the horizontal force of the road, less what accelerates the wheels
 * themselves: the first acts at the road, the second at the height of the wheel centres. Gravity
 * acts on the arms of roll and pitch. `corners_n` is the upward force of springs and arms on the
 * body at each wheel, beyond the weight. */
void sprung_acceleration(const State *x, double forward_n, double left_n, double ax_mps2,
                         double ay_mps2, double lift_n, const double corners_n[N_WHEELS],
                         const Parameters *p, State *rate) {
    const BodyParameters *body = &p->body;
    const double mass_kg = body->sprung_mass_kg;
    const double unsprung_kg = body->mass_kg - mass_kg;
    const double unsprung_share = unsprung_kg / body->mass_kg;
    const double roll_m = roll_arm_m(p);
    const double pitch_m = pitch_arm_m(p);
    const double below_m = body->sprung_height_m - body->unsprung_height_m;
    const double front_n = corners_n[0] + corners_n[1];
    const double rear_n = corners_n[2] + corners_n[3];
    const double roll_nm = body->sprung_height_m * left_n - unsprung_kg * ay_mps2 * below_m +
                           mass_kg * GRAVITY_MPS2 * roll_m * x->roll_rad +
                           0.5 * body->track_front_m * (corners_n[0] - corners_n[1]) +
                           0.5 * body->track_rear_m * (corners_n[2] - corners_n[3]);
    const double pitch_nm = -body->sprung_height_m * forward_n + unsprung_kg * ax_mps2 * below_m +
                            mass_kg * GRAVITY_MPS2 * pitch_m * x->pitch_rad -
                            body->sprung_front_axle_m * front_n +
                            body->sprung_rear_axle_m * rear_n;
    const double roll_kgm2 =
        body->sprung_roll_inertia_kgm2 + mass_kg * roll_m * roll_m * unsprung_share;
    const double pitch_kgm2 =
        body->sprung_pitch_inertia_kgm2 + mass_kg * pitch_m * pitch_m * unsprung_share;
    rate->heave_m = x->heave_rate_mps;
    rate->heave_rate_mps = (front_n + rear_n + lift_n) / mass_kg;
    rate->roll_rad = x->roll_rate_radps;
    rate->roll_rate_radps = roll_nm / roll_kgm2;
    rate->pitch_rad = x->pitch_rate_radps;
    rate->pitch_rate_radps = pitch_nm / pitch_kgm2;
}
