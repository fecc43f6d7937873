/* Tyres: lagged slip (relaxation length), and the friction force from the lagged slip.
 *
 * Each direction has its Magic Formula of pure slip; under combined slip each force is weighted by
 * the slip in the other direction. The aligning moment is side force times a trail that becomes
 * zero where the contact slides.
 * Pacejka, Tyre and Vehicle Dynamics, 2012: ch. 4 (formula, weights, similarity), ch. 7
 * (relaxation). */

#include <math.h>

#include "car.h"

static const double LEAST_LATERAL_RELAXATION = 0.2;
static const double LEAST_LONGITUDINAL_RELAXATION = 0.2;
static const double LARGEST_SLIP = 3.0;
static const double LEAST_LOAD_FACTOR = 0.3; /* of the influence of the load on friction */
static const double LEAST_RELAXATION_LOAD_N = 500.0;

/* Lag of a slip over a length of which the share `left` remains.
 *
 * Written with the sliding velocity instead of the slip: there is no division by the speed. The
 * material damping decreases with the rolling speed. */
static SlipRates relaxation(double slip, double forward_mps, double sliding_mps, double length_m,
                            double left, double damping_s, const TyreParameters *tyre) {
    const double speed_mps = fabs(forward_mps);
    const double change = sliding_mps - speed_mps * slip;
    const double end_mps = tyre->damping_end_mps;
    return (SlipRates){
        .rate = sliding_mps / (length_m * left),
        .decay = speed_mps / (length_m * left),
        .damping = damping_s * end_mps / (end_mps + speed_mps) * change / length_m,
    };
}

/* Lag of the tangent of the slip angle; its length decreases as the tyre starts to slide. */
SlipRates lateral_relaxation(double slip, double forward_mps, double left_mps, double load_n,
                             const TyreParameters *tyre) {
    const double length_m = tyre->lateral_relaxation_m * larger(load_n, LEAST_RELAXATION_LOAD_N) /
                            tyre->relaxation_load_n;
    const double start = tyre->lateral_relaxation_start_slip;
    const double end = tyre->lateral_relaxation_end_slip;
    const double left = limited((end - fabs(slip)) / (end - start), LEAST_LATERAL_RELAXATION, 1.0);
    return relaxation(slip, forward_mps, -left_mps, length_m, left, tyre->lateral_damping_s, tyre);
}

/* Lag of the slip ratio; `rim_mps` is spin times rolling radius. */
SlipRates longitudinal_relaxation(double slip, double forward_mps, double rim_mps, double load_n,
                                  const TyreParameters *tyre) {
    const double length_m = tyre->longitudinal_relaxation_m *
                            larger(load_n, LEAST_RELAXATION_LOAD_N) / tyre->relaxation_load_n;
    const double left = larger(LEAST_LONGITUDINAL_RELAXATION,
                               1.0 - fabs(slip) / tyre->longitudinal_relaxation_end_slip);
    return relaxation(slip, forward_mps, rim_mps - forward_mps, length_m, left,
                      tyre->longitudinal_damping_s, tyre);
}

/* Lateral force per radian of small slip angle: degressive in the load. */
static double cornering_stiffness_npr(double load_n, const TyreParameters *tyre) {
    const double relative = load_n / tyre->cornering_stiffness_load_n;
    return tyre->cornering_stiffness_npr * 2.0 * relative / (1.0 + relative * relative);
}

/* Largest force on the reference road. */
static double limit_n(double load_n, double friction, double friction_per_load,
                      const TyreParameters *tyre) {
    const double excess = load_n / tyre->reference_load_n - 1.0;
    return friction * larger(LEAST_LOAD_FACTOR, 1.0 + friction_per_load * excess) * load_n;
}

/* Force of pure slip: D sin(C atan(B x - E (B x - atan(B x)))) with B C D the stiffness. */
static double magic_formula_n(double slip, double stiffness_n, double peak_n, double shape,
                              double curvature) {
    const double scaled = stiffness_n / (shape * peak_n) * slip;
    return peak_n * sin(shape * atan(scaled - curvature * (scaled - atan(scaled))));
}

/* Share of a force that remains under slip across it: cos(atan(B s)).
 *
 * B itself decreases with the slip along the force, by cos(atan(B s')). With the same steepness in
 * both places the force of a sliding tyre is exactly opposite to its sliding velocity. */
static double weight(double slip, double other_slip, double steepness) {
    const double along = steepness * slip;
    const double across = steepness * other_slip;
    return sqrt((1.0 + along * along) / (1.0 + along * along + across * across));
}

/* Force of one tyre; `lean_rad` is the wheel's lean to the right against the ground.
 *
 * Friction by similarity: the force on a road of friction mu is mu f(slip / mu), so the stiffness
 * of the tyre does not change. Pacejka 2012, sec. 4.2. */
static TyreForce own_tyre_force(double lateral_slip, double longitudinal_slip, double lean_rad,
                                double load_n, double road_friction, const TyreParameters *tyre) {
    if (load_n <= 0.0) {
        return (TyreForce){0.0, 0.0, 0.0};
    }
    const double sideways = (lateral_slip - tyre->camber_slip * lean_rad) / road_friction;
    const double along = longitudinal_slip / road_friction;
    const double left_limit_n =
        limit_n(load_n, tyre->lateral_friction, tyre->lateral_friction_per_load, tyre);
    const double forward_limit_n =
        limit_n(load_n, tyre->longitudinal_friction, tyre->longitudinal_friction_per_load, tyre);
    double left_n = magic_formula_n(sideways, cornering_stiffness_npr(load_n, tyre), left_limit_n,
                                    tyre->lateral_shape, tyre->lateral_curvature);
    double forward_n = magic_formula_n(along, tyre->slip_stiffness * load_n, forward_limit_n,
                                       tyre->longitudinal_shape, tyre->longitudinal_curvature);
    left_n *= road_friction * weight(sideways, along, tyre->lateral_weight);
    forward_n *= road_friction * weight(along, sideways, tyre->longitudinal_weight);
    /* The weights alone let a diagonal force exceed the friction ellipse by a few percent. */
    const double share = length(forward_n / forward_limit_n, left_n / left_limit_n);
    if (share > road_friction) {
        forward_n *= road_friction / share;
        left_n *= road_friction / share;
    }
    /* The trail ends where the whole contact slides, so it depends on the combined slip. */
    const double trail_m =
        tyre->trail_m *
        cos(tyre->trail_shape * atan(tyre->trail_stiffness * length(sideways, along)));
    return (TyreForce){forward_n, left_n, -trail_m * left_n};
}

/* Force of the road on one tyre, by its file if the car has one; `side` is that of the wheel. */
TyreForce tyre_force(double lateral_slip, double longitudinal_slip, double lean_rad, double load_n,
                     double road_friction, double side, const Parameters *p) {
    if (p->tyre_file.fnomin == 0.0) {
        return own_tyre_force(lateral_slip, longitudinal_slip, lean_rad, load_n, road_friction,
                              &p->tyre);
    }
    /* A file is of a tyre of one side; the car has its mirror image on the other side. */
    const double mirror = p->tyre_file.is_right > 0.0 ? -side : side;
    return tyre_file_force(lateral_slip, longitudinal_slip, lean_rad, load_n, road_friction, mirror,
                           &p->tyre_file);
}

/* Limit of the lagged slips of a slow tyre.
 *
 * At rest a slip is the deflection of the carcass over the relaxation length. It ends where the
 * contact slides, and is not the slip -1 with which a locked wheel came to rest: that deflection
 * would push the car back. `speed_mps` is the larger one of wheel centre and rim. */
double largest_slip(double speed_mps, double road_friction, const TyreParameters *tyre) {
    const double sliding = road_friction * tyre->longitudinal_friction / tyre->slip_stiffness;
    return smaller(LARGEST_SLIP, sliding + speed_mps);
}

/* Torque against the rolling of a loaded tyre, applied as dry friction. */
double rolling_resistance_nm(double spin_radps, double load_n, const TyreParameters *tyre) {
    const double speed_mps = fabs(spin_radps) * tyre->rolling_radius_m;
    const double coefficient = tyre->rolling_resistance + tyre->rolling_resistance_spm * speed_mps;
    return coefficient * load_n * tyre->rolling_radius_m;
}
