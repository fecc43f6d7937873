/* Brakes, engine or motor, torque converter, gearbox, shafts that twist, differentials.
 *
 * The centre differential is viscous, both axle differentials are open. An electric motor takes the
 * place of engine, converter and gearbox. */

#include <math.h>
#include <stdbool.h>

#include "car.h"

static const double LIMITER_BAND_RPM = 200.0;
static const double LEAST_CONTROL_SPEED_MPS = 3.0;
/* below it the slip of the traction control is computed with this speed */
static const double LONGEST_SHIFT_TIMER_S = 10.0;
static const double FREE_REAR_SLIP = 0.008;
/* rear wheels with less braking slip are not released: gentle braking uses all four brakes */

static bool is_electric(const Parameters *p) { return p->motor.inertia_kgm2 > 0.0; }

/* Steady pressures of front and rear circuit; above the knee the rear one rises less. */
FrontRear steady_pressures_mpa(double pedal_n, const BrakeParameters *brakes) {
    const double front_mpa = brakes->pedal_mpa_per_n * larger(0.0, pedal_n);
    const double above_mpa = larger(0.0, front_mpa - brakes->knee_mpa);
    return (FrontRear){front_mpa, front_mpa - (1.0 - brakes->slope_above_knee) * above_mpa};
}

/* Largest braking slip that the anti-lock system allows a wheel.
 *
 * The rear wheels may use a share of the slip of the front wheels only (electronic brake-force
 * distribution), so that the rear axle keeps the larger reserve for the side force in a turn. */
static double allowed_slip(const State *x, int wheel, const AntiLockParameters *anti_lock) {
    if (wheel < N_FRONT) {
        return anti_lock->slip;
    }
    const double front_slip = -0.5 * (x->longitudinal_slip[0] + x->longitudinal_slip[1]);
    return limited(anti_lock->rear_share * front_slip, FREE_REAR_SLIP, anti_lock->slip);
}

/* Rate of the released share of a wheel's pressure: it controls the slip of the wheel. */
double brake_release_per_s(const State *x, int wheel, double forward_mps, const Parameters *p) {
    const AntiLockParameters *anti_lock = &p->anti_lock;
    const double release = x->brake_release[wheel];
    if (anti_lock->slip == 0.0) {
        return 0.0;
    }
    const double speed_mps = fabs(forward_mps);
    if (speed_mps < anti_lock->least_speed_mps) {
        return release > 0.0 ? -anti_lock->apply_per_s : 0.0;
    }
    const double rim_mps = fabs(x->spin_radps[wheel]) * p->tyre.rolling_radius_m;
    const double excess = 1.0 - rim_mps / speed_mps - allowed_slip(x, wheel, anti_lock);
    const double wanted = limited(excess / anti_lock->slip_band, -1.0, 1.0);
    if (wanted > 0.0) {
        return release < 1.0 ? wanted * anti_lock->release_per_s : 0.0;
    }
    return release > 0.0 ? wanted * anti_lock->apply_per_s : 0.0;
}

/* Column left of a speed and the share of the way to the next; the map ends constant. */
static int map_column(double speed_rpm, const double speeds_rpm[N_MAP], double *way) {
    int column = 0;
    while (column < N_MAP - 2 && speed_rpm >= speeds_rpm[column + 1]) {
        column += 1;
    }
    *way = limited((speed_rpm - speeds_rpm[column]) / (speeds_rpm[column + 1] - speeds_rpm[column]),
                   0.0, 1.0);
    return column;
}

/* Torque between four points of a map, linear in speed and pedal. */
static double map_torque_nm(int column, double way, double pedal, const double pedals[N_MAP],
                            const double torques_nm[N_MAP][N_MAP]) {
    int row = 0;
    while (row < N_MAP - 2 && pedal >= pedals[row + 1]) {
        row += 1;
    }
    const double up = limited((pedal - pedals[row]) / (pedals[row + 1] - pedals[row]), 0.0, 1.0);
    const double *lower = torques_nm[row];
    const double *upper = torques_nm[row + 1];
    const double lower_nm = lower[column] + way * (lower[column + 1] - lower[column]);
    const double upper_nm = upper[column] + way * (upper[column + 1] - upper[column]);
    return lower_nm + up * (upper_nm - lower_nm);
}

/* Torque at the crankshaft; below idle speed the governor adds torque. `kept` is the share of the
 * combustion torque that shift and traction control leave. */
static double engine_torque_nm(double speed_radps, double throttle, double kept,
                               const EngineParameters *engine) {
    const double speed_rpm = speed_radps * RPM_OF_RADPS;
    const double above_rpm = speed_rpm - engine->idle_speed_rpm;
    double way;
    const int column = map_column(speed_rpm, engine->map_speeds_rpm, &way);
    const double drag_nm = map_torque_nm(column, way, 0.0, engine->map_throttles, engine->map_nm);
    const double total_nm =
        map_torque_nm(column, way, throttle, engine->map_throttles, engine->map_nm);
    const double fuel =
        limited((engine->speed_limit_rpm - speed_rpm) / LIMITER_BAND_RPM, 0.0, 1.0);
    const double governor_nm = limited(-engine->idle_gain_nm_per_rpm * above_rpm - drag_nm, 0.0,
                                       engine->idle_torque_limit_nm);
    /* With the throttle open the governor only fills what is missing to its own torque. */
    return drag_nm + larger(governor_nm, kept * fuel * (total_nm - drag_nm));
}

/* Torque at the shaft of the motor; the traction control reduces drive and regeneration alike. */
static double motor_torque_nm(double speed_radps, double pedal, double kept,
                              const MotorParameters *motor) {
    double way;
    const int column = map_column(speed_radps * RPM_OF_RADPS, motor->map_speeds_rpm, &way);
    return kept * map_torque_nm(column, way, pedal, motor->map_throttles, motor->map_nm);
}

/* Torque of the converter at equal capacity; `ratio` is the slower speed over the faster one. */
static double capacity_nm(double faster_rpm, double ratio, const ConverterParameters *converter) {
    const double full_nm = converter->capacity_nm_per_rpm2 * faster_rpm * faster_rpm;
    return full_nm * (1.0 - pow(ratio, converter->capacity_fade));
}

/* Torque taken from the engine and torque delivered to the gearbox.
 *
 * A turbine faster than the engine drives the engine. The capacity is largest at stall and
 * decreases with a power of the speed ratio. Both branches meet at equal speeds with the same
 * slope. */
static void converter_torque_nm(double engine_radps, double turbine_radps,
                                const ConverterParameters *converter, double *impeller_nm,
                                double *turbine_nm) {
    const double engine_rpm = larger(1.0, engine_radps * RPM_OF_RADPS);
    const double turbine_rpm = turbine_radps * RPM_OF_RADPS;
    if (turbine_rpm > engine_rpm) {
        const double overrun_nm = capacity_nm(turbine_rpm, engine_rpm / turbine_rpm, converter);
        *impeller_nm = -overrun_nm;
        *turbine_nm = -overrun_nm;
        return;
    }
    const double ratio = larger(0.0, turbine_rpm / engine_rpm);
    const double gain =
        converter->stall_torque_ratio -
        (converter->stall_torque_ratio - 1.0) * ratio / converter->coupling_speed_ratio;
    *impeller_nm = capacity_nm(engine_rpm, ratio, converter);
    *turbine_nm = *impeller_nm * larger(1.0, gain);
}

/* Position of a gear in the tables of the gearbox. */
static int gear_index(double gear) {
    return gear >= 1.0 && gear <= (double)N_GEARS ? (int)gear - 1 : 0;
}

double ratio_of_gear(double gear, const GearboxParameters *gearbox) {
    return gearbox->ratios[gear_index(gear)];
}

/* Speed ratio; during a shift a smooth transition from the old to the new gear. */
static double gearbox_ratio(const State *x, const GearboxParameters *gearbox) {
    const double after = ratio_of_gear(x->gear, gearbox);
    if (x->since_shift_s >= gearbox->shift_time_s) {
        return after;
    }
    const double before = ratio_of_gear(x->gear_before, gearbox);
    const double done = x->since_shift_s / gearbox->shift_time_s;
    return before + (after - before) * done * done * (3.0 - 2.0 * done);
}

/* Share of the combustion torque that the engine keeps: reduced during an up-shift, not during a
 * down-shift, in which the engine has to accelerate. */
static double kept_torque(const State *x, const GearboxParameters *gearbox) {
    if (x->since_shift_s >= gearbox->shift_time_s || x->gear < x->gear_before) {
        return 1.0;
    }
    const double done = x->since_shift_s / gearbox->shift_time_s;
    const double half_way = done * (1.0 - done);
    return 1.0 - gearbox->shift_dip * 16.0 * (half_way * half_way);
}

/* Turbine speed above which the next higher gear is engaged. */
static double up_shift_rpm(double throttle, const GearboxParameters *gearbox) {
    const double opened = pow(throttle, gearbox->shift_shape);
    return gearbox->up_rpm + (gearbox->up_rpm_full - gearbox->up_rpm) * opened;
}

/* Turbine speed below which the next lower gear is engaged. */
static double down_shift_rpm(double throttle, const GearboxParameters *gearbox) {
    const double opened = pow(throttle, gearbox->shift_shape);
    return gearbox->down_rpm + (gearbox->down_rpm_full - gearbox->down_rpm) * opened;
}

/* The highest gear with a margin of 10 % above its down-shift speed. */
double highest_gear(double output_radps, double throttle, const GearboxParameters *gearbox) {
    for (int gear = N_GEARS; gear > 1; gear--) {
        const double turbine_rpm = output_radps * gearbox->ratios[gear - 1] * RPM_OF_RADPS;
        if (turbine_rpm > 1.1 * down_shift_rpm(throttle, gearbox)) {
            return (double)gear;
        }
    }
    return 1.0;
}

/* Start a shift if it is due, and advance the shift timer; writes only the gear states. Called
 * between steps: the gear is constant within a step. */
void choose_gear(State *x, double output_radps, const GearboxParameters *gearbox, double step_s) {
    double elapsed_s = x->since_shift_s + step_s;
    if (elapsed_s >= gearbox->dwell_s) {
        const double gear = x->gear;
        const double turbine_rpm = output_radps * ratio_of_gear(gear, gearbox) * RPM_OF_RADPS;
        const double throttle = limited(x->throttle, 0.0, 1.0);
        double change = 0.0;
        if (gear < (double)N_GEARS && turbine_rpm > up_shift_rpm(throttle, gearbox)) {
            change = 1.0;
        } else if (gear > 1.0 && turbine_rpm < down_shift_rpm(throttle, gearbox)) {
            change = -1.0;
        }
        if (change != 0.0) {
            x->gear_before = gear;
            x->gear = gear + change;
            elapsed_s = 0.0;
        }
    }
    x->since_shift_s = smaller(elapsed_s, LONGEST_SHIFT_TIMER_S);
}

/* Mean wheel speed of the front and of the rear axle. */
static FrontRear axle_speeds_radps(const State *x) {
    return (FrontRear){0.5 * (x->spin_radps[0] + x->spin_radps[1]),
                       0.5 * (x->spin_radps[2] + x->spin_radps[3])};
}

/* Speed at the input of the centre differential. */
static double driven_speed_radps(const State *x, const DrivelineParameters *driveline) {
    const FrontRear speeds = axle_speeds_radps(x);
    return driveline->front_share * speeds.front + (1.0 - driveline->front_share) * speeds.rear;
}

/* Speed of the gearbox's output shaft that follows from the wheel speeds, without its twist. */
double output_speed_radps(const State *x, const Parameters *p) {
    return p->driveline.final_ratio * driven_speed_radps(x, &p->driveline);
}

/* Torque of each wheel of an axle: the split of the centre differential, whose viscous coupling
 * drives the slower axle. */
static FrontRear split_nm(const State *x, double shafts_nm, const DrivelineParameters *driveline) {
    const FrontRear speeds = axle_speeds_radps(x);
    const double ratio = driveline->final_ratio;
    const double coupled_nm =
        driveline->viscous_nms * ratio * ratio * (speeds.rear - speeds.front);
    const double lossy_nm = shafts_nm < 0.0 ? shafts_nm / driveline->final_efficiency
                                            : shafts_nm * driveline->final_efficiency;
    return (FrontRear){
        0.5 * (driveline->front_share * lossy_nm + coupled_nm),
        0.5 * ((1.0 - driveline->front_share) * lossy_nm - coupled_nm),
    };
}

/* Rate of the share of torque that the traction control takes away.
 *
 * It acts on driven wheels that are too fast and, because a motor brakes too, on those too slow.
 * `forward_mps` is the speed of each wheel's centre along the wheel; in a turn they differ. */
double torque_cut_per_s(const State *x, const double forward_mps[N_WHEELS], const Parameters *p) {
    const TractionControlParameters *control = &p->traction_control;
    if (control->slip == 0.0) {
        return 0.0;
    }
    const int first = p->driveline.front_share > 0.0 ? 0 : N_FRONT;
    const int last = p->driveline.front_share < 1.0 ? N_WHEELS : N_FRONT;
    double slip = 0.0;
    for (int wheel = first; wheel < last; wheel++) {
        const double rim_mps = x->spin_radps[wheel] * p->tyre.rolling_radius_m;
        const double speed_mps = larger(fabs(forward_mps[wheel]), LEAST_CONTROL_SPEED_MPS);
        slip = larger(slip, fabs(rim_mps - forward_mps[wheel]) / speed_mps);
    }
    const double wanted = limited((slip - control->slip) / control->slip_band, -1.0, 1.0);
    if (wanted > 0.0) {
        return x->torque_cut < 1.0 ? wanted * control->cut_per_s : 0.0;
    }
    return x->torque_cut > 0.0 ? wanted * control->restore_per_s : 0.0;
}

/* Torque of the engine at its crankshaft, or of the motor at its shaft. */
double drive_nm(const State *x, const Parameters *p) {
    const double kept = 1.0 - x->torque_cut;
    if (is_electric(p)) {
        return motor_torque_nm(x->turbine_radps, x->throttle, kept, &p->motor);
    }
    return engine_torque_nm(x->engine_radps, x->throttle, kept * kept_torque(x, &p->gearbox),
                            &p->engine);
}

/* Torque of one front and one rear wheel; throttle, engine, turbine and wind-up go into `out`. */
FrontRear wheel_torque_nm(const State *x, double throttle, const Parameters *p, Derivative *out) {
    const double ratio = p->driveline.final_ratio * gearbox_ratio(x, &p->gearbox);
    const double wind_up_radps = x->turbine_radps / ratio - driven_speed_radps(x, &p->driveline);
    const double shafts_nm = p->driveline.shaft_stiffness_nmprad * x->wind_up_rad +
                             p->driveline.shaft_damping_nms * wind_up_radps;
    const double efficiency = p->gearbox.efficiencies[gear_index(x->gear)];
    const double load_nm = shafts_nm < 0.0 ? shafts_nm * efficiency : shafts_nm / efficiency;

    const double torque_nm = drive_nm(x, p);
    double lag_s = p->engine.throttle_lag_s;
    if (is_electric(p)) {
        lag_s = p->motor.lag_s;
        out->rate.turbine_radps = (torque_nm - load_nm / ratio) / p->motor.inertia_kgm2;
        out->rate.engine_radps = out->rate.turbine_radps;
    } else {
        double impeller_nm;
        double turbine_nm;
        converter_torque_nm(x->engine_radps, x->turbine_radps, &p->converter, &impeller_nm,
                            &turbine_nm);
        out->rate.engine_radps = (torque_nm - impeller_nm) / p->engine.inertia_kgm2;
        out->rate.turbine_radps =
            (turbine_nm - load_nm / ratio) / p->converter.turbine_inertia_kgm2;
    }
    out->rate.throttle = throttle / lag_s;
    out->decay.throttle = 1.0 / lag_s;
    out->rate.wind_up_rad = wind_up_radps;
    return split_nm(x, shafts_nm, &p->driveline);
}
