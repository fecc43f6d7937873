/* The wheels on the road: velocity, slips, force and spin; and the steering, which turns them.
 *
 * The angle of the steering wheel is given. A spring behind the ratio carries the moment of the
 * front tyres around the kingpins, so side force turns the road wheels back. Dry friction in rack
 * and joints holds them against small moments. */

#include <math.h>

#include "car.h"

static const double LARGEST_DAMPING_OF_A_STEP = 1.8;
/* rate times step; at 2 the midpoint rule becomes unstable */

/* Share of the longitudinal damping of the tyres with which an integration step is stable.
 *
 * It is 1 for the shipped cars. Light wheels and stiff tyres, as in some `.tir` files, would
 * oscillate at rest with the whole damping. */
static double longitudinal_damping_share(const Parameters *p) {
    const TyreParameters *tyre = &p->tyre;
    double stiffness = tyre->slip_stiffness;
    if (p->tyre_file.fnomin > 0.0) {
        stiffness = p->tyre_file.pkx1 * p->tyre_file.lkx;
    }
    const double stiffness_npm =
        stiffness * tyre->relaxation_load_n / tyre->longitudinal_relaxation_m;
    const double wheel_kg =
        tyre->spin_inertia_kgm2 / (tyre->rolling_radius_m * tyre->rolling_radius_m);
    const double damping = tyre->longitudinal_damping_s * stiffness_npm / wheel_kg * STEP_S;
    return LARGEST_DAMPING_OF_A_STEP / larger(LARGEST_DAMPING_OF_A_STEP, damping);
}

/* Force of the road on one wheel in body axes; its slips and spin go into `out`. `angle_rad` is
 * that of the wheel against the body, positive to the left. */
WheelForce wheel_force(const State *x, int wheel, const Axle *axle, double angle_rad,
                       double drive_nm, const Parameters *p, Derivative *out) {
    const double side = side_of(wheel);
    const double load_n = tyre_load_n(x, wheel, axle, &p->tyre);
    const double road_friction = road_friction_at(wheel, &p->road);
    const double c = cos(angle_rad);
    const double s = sin(angle_rad);

    /* Velocity of the contact. The frame of the wheels moves against the centre of gravity of the
     * whole car while the sprung mass rolls and pitches. */
    const double sprung_share = p->body.sprung_mass_kg / p->body.mass_kg;
    const double frame_forward_mps =
        x->vx_mps - sprung_share * pitch_arm_m(p) * x->pitch_rate_radps;
    const double frame_left_mps = x->vy_mps + sprung_share * roll_arm_m(p) * x->roll_rate_radps;
    const double contact_forward_mps =
        frame_forward_mps - side * axle->half_track_m * x->yaw_rate_radps;
    const double contact_left_mps = frame_left_mps + axle->ahead_m * x->yaw_rate_radps;
    const double forward_mps = c * contact_forward_mps + s * contact_left_mps;
    const double left_mps = c * contact_left_mps - s * contact_forward_mps;

    /* The wheels follow the roll of the body only in part; travel compensates the rest. */
    const double lean_per_m = side * 2.0 * (1.0 - axle->camber_gain) / axle->track_m;
    const double lean_rad = x->roll_rad + lean_per_m * travel_m(x, wheel, axle);
    const double spin_radps = x->spin_radps[wheel];
    const double radius_m = p->tyre.rolling_radius_m;
    const SlipRates across =
        lateral_relaxation(x->lateral_slip[wheel], forward_mps, left_mps, load_n, &p->tyre);
    const SlipRates along = longitudinal_relaxation(
        x->longitudinal_slip[wheel], forward_mps, spin_radps * radius_m, load_n, &p->tyre);
    const double sideways = x->lateral_slip[wheel] + across.damping;
    const double forward_slip =
        x->longitudinal_slip[wheel] + along.damping * longitudinal_damping_share(p);
    const TyreForce road =
        tyre_force(sideways, forward_slip, lean_rad, load_n, road_friction, side, p);
    out->rate.lateral_slip[wheel] = across.rate;
    out->decay.lateral_slip[wheel] = across.decay;
    out->rate.longitudinal_slip[wheel] = along.rate;
    out->decay.longitudinal_slip[wheel] = along.decay;
    out->rate.spin_radps[wheel] =
        (drive_nm - radius_m * road.forward_n) / p->tyre.spin_inertia_kgm2;

    double release = x->brake_release[wheel];
    if (wheel >= N_FRONT) {
        /* The rear wheels get the pressure of the more slippery side, so that the axle guides. */
        release = larger(x->brake_release[2], x->brake_release[3]);
    }
    out->rate.brake_release[wheel] = brake_release_per_s(x, wheel, forward_mps, p);
    out->friction.spin_radps[wheel] =
        (axle->brake_nm_per_mpa * larger(0.0, x->brake_mpa[wheel]) * (1.0 - release) +
         rolling_resistance_nm(spin_radps, load_n, &p->tyre)) /
        p->tyre.spin_inertia_kgm2;
    return (WheelForce){
        .forward_n = c * road.forward_n - s * road.left_n,
        .left_n = s * road.forward_n + c * road.left_n,
        .aligning_nm = road.aligning_nm,
        /* The side force acts behind the kingpin by the caster trail. */
        .kingpin_nm = road.aligning_nm - p->steering.caster_trail_m * road.left_n,
        .side_n = road.left_n,
        .forward_mps = forward_mps,
    };
}

/* Angle of the left or right front wheel from the mean angle. With a share of 1 the axes of all
 * wheels meet in one point; with 0 both wheels are parallel. */
static double ackermann_rad(double road_wheel_rad, double side, const Axle *front,
                            const Parameters *p) {
    const double wheelbase_m = p->body.front_axle_m + p->body.rear_axle_m;
    const double t = tan(road_wheel_rad);
    return atan(t / (1.0 - p->steering.ackermann * side * front->half_track_m / wheelbase_m * t));
}

/* Angles of the front wheels against the body: steering, roll steer and compliance. */
void front_wheels_rad(const State *x, double roll_rad, const Axle *front, const Parameters *p,
                      double *left_rad, double *right_rad) {
    const double give_rad = front->roll_steer * roll_rad + x->front_compliance_rad;
    *left_rad = ackermann_rad(x->road_wheel_rad, side_of(0), front, p) + give_rad;
    *right_rad = ackermann_rad(x->road_wheel_rad, side_of(1), front, p) + give_rad;
}

/* Moment of one tyre against turning on the spot, from the twist of its contact patch.
 *
 * At full twist it grows with the friction, and with load to the power of 1.5, since the contact
 * grows with the load. */
static double parking_nm(const State *x, int wheel, const Axle *front, const Parameters *p) {
    const TyreParameters *tyre = &p->tyre;
    const double share = x->contact_twist_rad / tyre->parking_twist_rad;
    const double relative =
        larger(0.0, tyre_load_n(x, wheel, front, tyre)) / tyre->reference_load_n;
    return -road_friction_at(wheel, &p->road) * tyre->parking_torque_nm * share * relative *
           sqrt(relative);
}

/* Angle of the front wheels at the steering without a load; the wheel stops at its lock. */
static double unloaded_rad(double steer_rad, const SteeringParameters *steering) {
    return limited(steer_rad, -steering->lock_rad, steering->lock_rad) / steering->ratio;
}

/* Torque at the steering wheel without power assistance, positive to the left. */
double hand_torque_nm(double steer_rad, double road_wheel_rad, const SteeringParameters *steering) {
    const double wound_rad = unloaded_rad(steer_rad, steering) - road_wheel_rad;
    return steering->stiffness_nmprad * wound_rad / steering->ratio;
}

/* Rates of the steered wheels and of the twist of their contact patches; `kingpin_nm` is the moment
 * of both front tyres around their kingpins. */
void steering_rates(const State *x, double steer_rad, double kingpin_nm, const Axle *front,
                    const Parameters *p, Derivative *out) {
    const SteeringParameters *steering = &p->steering;
    const double turn_radps = x->road_wheel_rate_radps;
    out->rate.road_wheel_rad = turn_radps;
    /* A contact patch slides at full twist, and rolling renews it: with this decay and the turning
     * rate as input the twist never exceeds `parking_twist_rad`. */
    out->rate.contact_twist_rad = turn_radps;
    out->decay.contact_twist_rad = fabs(turn_radps) / p->tyre.parking_twist_rad +
                                   fabs(x->vx_mps) / p->tyre.parking_length_m;
    const double parked_nm = parking_nm(x, 0, front, p) + parking_nm(x, 1, front, p);
    const double wound_rad = unloaded_rad(steer_rad, steering) - x->road_wheel_rad;
    out->rate.road_wheel_rate_radps =
        (steering->stiffness_nmprad * wound_rad - steering->damping_nms * turn_radps +
         (kingpin_nm + parked_nm)) /
        steering->inertia_kgm2;
    out->friction.road_wheel_rate_radps = steering->friction_nm / steering->inertia_kgm2;
}
