/* The whole car: x' = f(x, u, p), its integration with a fixed step, settling, and outputs.
 *
 * Midpoint rule; first-order lags are solved exactly over each half and whole step (exponential
 * midpoint), dry friction by projection; gears change between steps. The curvature of the road is
 * not part of this file: on a flat road it acts on the position only. */

#include <math.h>
#include <stddef.h>

#include "car.h"

static const double LARGEST_TILT_RAD = 0.5 * PI;
static const double LEAST_SIDESLIP_SPEED_MPS = 0.5; /* at rest the sideslip is not defined */

static const int SETTLING_STEPS = 2000;
static const int STANDING_STEPS = 6000;
/* at rest longer, until the pitch by the torque of the idling engine has settled */
static const double FIRST_THROTTLE = 0.12;
static const double THROTTLE_PER_MPS = 1.2;
static const double HOLDING_BRAKE_N = 60.0;

/* Lag of the four brake pressures behind the pedal. */
static void brake_rates(double brake_n, const Parameters *p, Derivative *out) {
    const FrontRear steady_mpa = steady_pressures_mpa(brake_n, &p->brakes);
    for (int wheel = 0; wheel < N_WHEELS; wheel++) {
        const double wanted_mpa = wheel < N_FRONT ? steady_mpa.front : steady_mpa.rear;
        out->rate.brake_mpa[wheel] = wanted_mpa / p->brakes.lag_s;
        out->decay.brake_mpa[wheel] = 1.0 / p->brakes.lag_s;
    }
}

/* Wheel angles that the bushings give under side force and aligning moment, with a lag.
 *
 * The lag stands for the mass of the wheels on their bushings, and keeps the force of a step from
 * depending on an angle that depends on the force. */
static void compliance_rates(const WheelForce wheels[N_WHEELS], const Axle *front,
                             const Axle *rear, const Parameters *p, Derivative *out) {
    double front_rad = front->lateral_steer_radpn * (wheels[0].side_n + wheels[1].side_n);
    front_rad += front->aligning_steer_radpnm * (wheels[0].aligning_nm + wheels[1].aligning_nm);
    double rear_rad = rear->lateral_steer_radpn * (wheels[2].side_n + wheels[3].side_n);
    rear_rad += rear->aligning_steer_radpnm * (wheels[2].aligning_nm + wheels[3].aligning_nm);
    const double lag_s = p->suspension.compliance_lag_s;
    out->rate.front_compliance_rad = front_rad / lag_s;
    out->decay.front_compliance_rad = 1.0 / lag_s;
    out->rate.rear_compliance_rad = rear_rad / lag_s;
    out->decay.rear_compliance_rad = 1.0 / lag_s;
}

/* Write the derivative of the state under constant inputs; entries of `out` that no part of the car
 * writes must be zero before. */
void evaluate(const State *x, const Input *u, const Parameters *p, Derivative *out) {
    const Axle front = front_axle(p);
    const Axle rear = rear_axle(p);
    const double front_roll_rad = axle_roll_rad(x, 0, &front);
    const double rear_roll_rad = axle_roll_rad(x, N_FRONT, &rear);
    brake_rates(u->brake_n, p, out);
    const FrontRear torque_nm = wheel_torque_nm(x, u->throttle, p, out);

    double front_left_rad;
    double front_right_rad;
    front_wheels_rad(x, front_roll_rad, &front, p, &front_left_rad, &front_right_rad);
    const double rear_rad = rear.roll_steer * rear_roll_rad + x->rear_compliance_rad;
    const WheelForce wheels[N_WHEELS] = {
        wheel_force(x, 0, &front, front_left_rad, torque_nm.front, p, out),
        wheel_force(x, 1, &front, front_right_rad, torque_nm.front, p, out),
        wheel_force(x, 2, &rear, rear_rad, torque_nm.rear, p, out),
        wheel_force(x, 3, &rear, rear_rad, torque_nm.rear, p, out),
    };
    const WheelForce *fl = &wheels[0];
    const WheelForce *fr = &wheels[1];
    const WheelForce *rl = &wheels[2];
    const WheelForce *rr = &wheels[3];
    const double forward_mps[N_WHEELS] = {fl->forward_mps, fr->forward_mps, rl->forward_mps,
                                          rr->forward_mps};
    out->rate.torque_cut = torque_cut_per_s(x, forward_mps, p);

    const double left_n = fl->left_n + fr->left_n + rl->left_n + rr->left_n;
    const double forward_n = fl->forward_n + fr->forward_n + rl->forward_n + rr->forward_n;
    const AirForce air = air_force(x, p);
    /* Forces per mass, as an accelerometer in the road plane reads them: without gravity. */
    const double ax_mps2 = (forward_n + air.forward_n) / p->body.mass_kg;
    const double ay_mps2 = (left_n + air.left_n) / p->body.mass_kg;
    const RoadGravity gravity = gravity_in_road_axes(&p->road);
    const double yaw_nm = p->body.front_axle_m * (fl->left_n + fr->left_n) -
                          p->body.rear_axle_m * (rl->left_n + rr->left_n) +
                          front.half_track_m * (fr->forward_n - fl->forward_n) +
                          rear.half_track_m * (rr->forward_n - rl->forward_n) + fl->aligning_nm +
                          fr->aligning_nm + rl->aligning_nm + rr->aligning_nm + air.yaw_nm;
    out->rate.vx_mps = ax_mps2 + gravity.forward_mps2 + x->yaw_rate_radps * x->vy_mps;
    out->rate.vy_mps = ay_mps2 + gravity.left_mps2 - x->yaw_rate_radps * x->vx_mps;
    out->rate.yaw_rate_radps = yaw_nm / p->body.yaw_inertia_kgm2;

    const double front_drive_n = torque_nm.front / p->tyre.rolling_radius_m;
    const double rear_drive_n = torque_nm.rear / p->tyre.rolling_radius_m;
    double corners_n[N_WHEELS]; /* upward forces on the body */
    for (int wheel = 0; wheel < N_WHEELS; wheel++) {
        const Axle *axle = wheel < N_FRONT ? &front : &rear;
        const double roll_rad = wheel < N_FRONT ? front_roll_rad : rear_roll_rad;
        const double drive_n = wheel < N_FRONT ? front_drive_n : rear_drive_n;
        corners_n[wheel] =
            spring_force_n(x, wheel, roll_rad, axle) +
            arm_force_n(wheel, &wheels[wheel], drive_n, ax_mps2, ay_mps2, axle, &p->body);
        const double load_n = tyre_load_n(x, wheel, axle, &p->tyre);
        out->rate.rise_m[wheel] = x->rise_rate_mps[wheel];
        out->rate.rise_rate_mps[wheel] =
            (load_n - axle->rest_load_n - corners_n[wheel]) / axle->wheel_kg +
            gravity.lighter_mps2;
    }
    const double lift_n = air.up_n + p->body.sprung_mass_kg * gravity.lighter_mps2;
    sprung_acceleration(x, forward_n, left_n, ax_mps2, ay_mps2, lift_n, corners_n, p, &out->rate);
    compliance_rates(wheels, &front, &rear, p, out);
    steering_rates(x, u->steer_rad, fl->kingpin_nm + fr->kingpin_nm, &front, p, out);
}

static void stop_at_largest_tilt(double *angle_rad, double *rate_radps) {
    if (fabs(*angle_rad) > LARGEST_TILT_RAD) {
        *angle_rad = limited(*angle_rad, -LARGEST_TILT_RAD, LARGEST_TILT_RAD);
        *rate_radps = 0.0;
    }
}

/* Limit slips, valves and tilt angles: the slip of a standing wheel would grow without limit; a car
 * that has rolled over stays on its side. */
static void bound(State *x, const Parameters *p) {
    double car_mps = length(x->vx_mps, x->vy_mps);
    car_mps += fabs(x->yaw_rate_radps) * p->body.rear_axle_m;
    for (int wheel = 0; wheel < N_WHEELS; wheel++) {
        const double rim_mps = fabs(x->spin_radps[wheel]) * p->tyre.rolling_radius_m;
        const double largest = largest_slip(larger(car_mps, rim_mps),
                                            road_friction_at(wheel, &p->road), &p->tyre);
        x->lateral_slip[wheel] = limited(x->lateral_slip[wheel], -largest, largest);
        x->longitudinal_slip[wheel] = limited(x->longitudinal_slip[wheel], -largest, largest);
        x->brake_release[wheel] = limited(x->brake_release[wheel], 0.0, 1.0);
    }
    x->torque_cut = limited(x->torque_cut, 0.0, 1.0);
    stop_at_largest_tilt(&x->roll_rad, &x->roll_rate_radps);
    stop_at_largest_tilt(&x->pitch_rad, &x->pitch_rate_radps);
}

/* The speed after dry friction: smaller by at most `largest_change`, never reversed.
 *
 * A stopped wheel stays stopped while the other torques are weaker than the friction, for any step
 * size: a locked wheel needs neither a regularised sign function nor a small step. */
static double after_friction(double speed, double largest_change) {
    if (speed > largest_change) {
        return speed - largest_change;
    }
    if (speed < -largest_change) {
        return speed + largest_change;
    }
    return 0.0;
}

/* Write `x` after `step_s` under constant rate, decay and dry friction to `after`. */
static void step(const State *x, const Derivative *derivative, const Parameters *p, double step_s,
                 State *after) {
    const double *state = (const double *)x;
    const double *rate = (const double *)&derivative->rate;
    const double *decay = (const double *)&derivative->decay;
    double *next = (double *)after;
    for (size_t i = 0; i < N_STATES; i++) {
        const double exponent = decay[i] * step_s;
        if (exponent > 1e-9) {
            const double left = exp(-exponent);
            next[i] = state[i] * left + rate[i] * step_s * (1.0 - left) / exponent;
        } else {
            next[i] = state[i] + rate[i] * step_s;
        }
    }
    for (int wheel = 0; wheel < N_WHEELS; wheel++) {
        after->spin_radps[wheel] = after_friction(
            after->spin_radps[wheel], derivative->friction.spin_radps[wheel] * step_s);
    }
    after->road_wheel_rate_radps = after_friction(
        after->road_wheel_rate_radps, derivative->friction.road_wheel_rate_radps * step_s);
    bound(after, p);
}

/* Integrate over `n_steps` under constant inputs, in place; `motion` has the motion after each. */
void car_advance(State *x, const Input *u, const Parameters *p, int n_steps, double step_s,
                 Motion *motion) {
    State middle;
    Derivative derivative = {0};
    for (int i = 0; i < n_steps; i++) {
        choose_gear(x, output_speed_radps(x, p), &p->gearbox, step_s);
        evaluate(x, u, p, &derivative);
        step(x, &derivative, p, 0.5 * step_s, &middle);
        evaluate(&middle, u, p, &derivative);
        step(x, &derivative, p, step_s, x);
        motion[i] = (Motion){x->vx_mps, x->vy_mps, x->yaw_rate_radps};
    }
}

/* A whole episode from `x`, with inputs and road constant over each period.
 *
 * `motion` has n_periods * steps_per_period + 1 rows, `outputs` n_periods + 1, both with the start
 * first. */
void car_simulate(State *x, const Input *inputs, const RoadParameters *roads, Parameters *p,
                  int n_periods, int steps_per_period, double step_s, Motion *motion,
                  Outputs *outputs) {
    motion[0] = (Motion){x->vx_mps, x->vy_mps, x->yaw_rate_radps};
    for (int k = 0; k < n_periods; k++) {
        p->road = roads[k];
        if (k == 0) {
            car_outputs(x, &inputs[k], p, &outputs[0]);
        }
        car_advance(x, &inputs[k], p, steps_per_period, step_s, &motion[k * steps_per_period + 1]);
        car_outputs(x, &inputs[k], p, &outputs[k + 1]);
    }
}

/* The state of a car that drives straight ahead at `v0_mps`, all other states settled.
 *
 * Gear, engine, converter, slips, pitch and the throttle that keeps the speed result from 2 s of
 * simulation in which the speed is kept constant. At rest the brake is applied, because the
 * converter would move the car, and the simulation lasts 6 s. */
void car_settle(double v0_mps, const Parameters *p, State *x) {
    const int drives = v0_mps > 0.0;
    *x = (State){.vx_mps = v0_mps, .throttle = drives ? FIRST_THROTTLE : 0.0};
    const double brake_n = drives ? 0.0 : HOLDING_BRAKE_N;
    const FrontRear steady_mpa = steady_pressures_mpa(brake_n, &p->brakes);
    for (int wheel = 0; wheel < N_WHEELS; wheel++) {
        x->spin_radps[wheel] = v0_mps / p->tyre.rolling_radius_m;
        x->brake_mpa[wheel] = wheel < N_FRONT ? steady_mpa.front : steady_mpa.rear;
    }
    const double output_radps = output_speed_radps(x, p);
    x->gear = highest_gear(output_radps, x->throttle, &p->gearbox);
    x->gear_before = x->gear;
    x->since_shift_s = p->gearbox.dwell_s;
    x->turbine_radps = output_radps * ratio_of_gear(x->gear, &p->gearbox);
    x->engine_radps = x->turbine_radps;
    if (p->motor.inertia_kgm2 == 0.0) {
        x->engine_radps =
            larger(p->engine.idle_speed_rpm / RPM_OF_RADPS, 1.03 * x->turbine_radps);
    }
    Motion motion;
    Input u = {x->throttle, brake_n, 0.0};
    const int n_steps = drives ? SETTLING_STEPS : STANDING_STEPS;
    for (int i = 0; i < n_steps; i++) {
        car_advance(x, &u, p, 1, STEP_S, &motion);
        if (drives) {
            const double slower_mps = v0_mps - x->vx_mps;
            u.throttle = limited(u.throttle + THROTTLE_PER_MPS * slower_mps, 0.0, 1.0);
            x->vx_mps = v0_mps;
            x->throttle = u.throttle; /* without the lag of the actuator */
        }
    }
    if (drives) {
        /* A bank or a cross-wind has pushed the car aside; at rest its tyres carry that force. */
        for (int wheel = 0; wheel < N_WHEELS; wheel++) {
            x->lateral_slip[wheel] = 0.0;
        }
        x->vy_mps = 0.0;
        x->yaw_rate_radps = 0.0;
    }
}

/* Further quantities of the car under constant inputs. */
void car_outputs(const State *x, const Input *u, const Parameters *p, Outputs *outputs) {
    Derivative derivative = {0};
    evaluate(x, u, p, &derivative);
    const State *rate = &derivative.rate;
    const Axle front = front_axle(p);
    const Axle rear = rear_axle(p);
    const double ax_mps2 = rate->vx_mps - x->yaw_rate_radps * x->vy_mps;
    const double ay_mps2 = rate->vy_mps + x->yaw_rate_radps * x->vx_mps;
    const RoadGravity gravity = gravity_in_road_axes(&p->road);
    /* The sprung mass moves against the centre of gravity of the whole car as it rolls, pitches. */
    const double unsprung_share = 1.0 - p->body.sprung_mass_kg / p->body.mass_kg;
    const double left_arm_m = unsprung_share * roll_arm_m(p);
    const double forward_arm_m = unsprung_share * pitch_arm_m(p);
    double left_rad;
    double right_rad;
    front_wheels_rad(x, axle_roll_rad(x, 0, &front), &front, p, &left_rad, &right_rad);
    *outputs = (Outputs){
        .ax_mps2 = ax_mps2,
        .ay_mps2 = ay_mps2,
        .sideslip_rad = atan2(x->vy_mps, larger(x->vx_mps, LEAST_SIDESLIP_SPEED_MPS)),
        .roll_rad = x->roll_rad,
        .pitch_rad = x->pitch_rad,
        .gear = x->gear,
        .engine_rpm = x->engine_radps * RPM_OF_RADPS,
        .throttle = x->throttle,
        .brake_mpa = x->brake_mpa[0],
        .road_wheel_rad = 0.5 * (left_rad + right_rad),
        .turbine_rpm = x->turbine_radps * RPM_OF_RADPS,
        .wind_up_rad = x->wind_up_rad,
        .accelerometer_forward_mps2 = ax_mps2 - gravity.forward_mps2 +
                                      forward_arm_m * rate->pitch_rate_radps -
                                      GRAVITY_MPS2 * sin(x->pitch_rad),
        .accelerometer_left_mps2 = ay_mps2 - gravity.left_mps2 -
                                   left_arm_m * rate->roll_rate_radps +
                                   GRAVITY_MPS2 * sin(x->roll_rad),
        .steering_wheel_nm = hand_torque_nm(u->steer_rad, x->road_wheel_rad, &p->steering),
        .engine_nm = drive_nm(x, p),
    };
    for (int wheel = 0; wheel < N_WHEELS; wheel++) {
        const Axle *axle = wheel < N_FRONT ? &front : &rear;
        outputs->travel_m[wheel] = travel_m(x, wheel, axle);
        outputs->load_n[wheel] = tyre_load_n(x, wheel, axle, &p->tyre);
        outputs->spin_radps[wheel] = x->spin_radps[wheel];
    }
}

/* Force of the road on a left tyre, by its file if the car has one. */
void car_tyre_force(double lateral_slip, double longitudinal_slip, double lean_rad, double load_n,
                    double road_friction, const Parameters *p, TyreForce *force) {
    *force = tyre_force(lateral_slip, longitudinal_slip, lean_rad, load_n, road_friction,
                        side_of(0), p);
}

/* Brake pressures behind a pedal that is held. */
void car_steady_pressures(double pedal_n, const Parameters *p, FrontRear *mpa) {
    *mpa = steady_pressures_mpa(pedal_n, &p->brakes);
}

/* Numbers of doubles in the structs, with which a caller checks its own layout. */
void car_sizes(int *n_states, int *n_parameters, int *n_outputs) {
    *n_states = (int)N_STATES;
    *n_parameters = (int)(sizeof(Parameters) / sizeof(double));
    *n_outputs = (int)(sizeof(Outputs) / sizeof(double));
}
