/* Forces of a tyre from the coefficients of a `.tir` file: Magic Formula 5.2 and 6.x.
 *
 * Without inflation pressure and turn slip. Axes as in these files (ISO): side force positive to
 * the left, slip angle positive if the wheel moves to its left, camber positive if it leans to the
 * right. Pacejka, Tyre and Vehicle Dynamics, 2012, sec. 4.3.2. */

#include <math.h>

#include "car.h"

static const double LEAST_LOAD_SHARE = 0.02;
static const double LEAST = 1e-6;

/* Force of pure slip, with what other formulas need from it. */
typedef struct {
    double force_n;
    double stiffness_n;
    double peak_n; /* with the sign of PDX1 or PDY1 */
    double shift;
    double offset_n;
    double steepness;
} PureSlip;

static double sine_n(double slip, double stiffness_n, double peak_n, double shape, double bend) {
    const double scaled = stiffness_n / (shape * peak_n) * slip;
    return peak_n * sin(shape * atan(scaled - bend * (scaled - atan(scaled))));
}

static double cosine(double slip, double steepness, double shape, double bend) {
    const double scaled = steepness * slip;
    return cos(shape * atan(scaled - bend * (scaled - atan(scaled))));
}

static PureSlip longitudinal(double slip, double camber, double load_n, double road,
                             const TyreFileParameters *t) {
    const double nominal_n = t->fnomin * t->lfzo;
    const double excess = load_n / nominal_n - 1.0;
    const double shift = (t->phx1 + t->phx2 * excess) * t->lhx;
    const double offset_n = load_n * (t->pvx1 + t->pvx2 * excess) * t->lvx * t->lmux * road;
    const double friction =
        (t->pdx1 + t->pdx2 * excess) * (1.0 - t->pdx3 * camber * camber) * t->lmux * road;
    const double peak_n = larger(LEAST, friction) * load_n;
    const double stiffness_n =
        load_n * (t->pkx1 + t->pkx2 * excess) * exp(t->pkx3 * excess) * t->lkx;
    const double shifted = slip + shift;
    const double sign = shifted >= 0.0 ? 1.0 : -1.0;
    const double bend = (t->pex1 + t->pex2 * excess + t->pex3 * excess * excess) *
                        (1.0 - t->pex4 * sign) * t->lex;
    const double shape = t->pcx1 * t->lcx;
    const double force_n =
        sine_n(shifted, stiffness_n, peak_n, shape, smaller(1.0, bend)) + offset_n;
    const double slope = stiffness_n / (shape * peak_n);
    return (PureSlip){force_n, stiffness_n, peak_n, shift, offset_n, slope};
}

static PureSlip lateral(double slip_angle, double camber, double load_n, double road,
                        const TyreFileParameters *t) {
    const double nominal_n = t->fnomin * t->lfzo;
    const double excess = load_n / nominal_n - 1.0;
    const double share = load_n / ((t->pky2 + t->pky5 * camber * camber) * nominal_n);
    const double stiffness_n = t->pky1 * nominal_n * (1.0 - t->pky3 * fabs(camber)) *
                               sin(t->pky4 * atan(share)) * t->lky;
    const double camber_offset_n =
        load_n * (t->pvy3 + t->pvy4 * excess) * camber * t->lmuy * road;
    const double offset_n =
        load_n * (t->pvy1 + t->pvy2 * excess) * t->lvy * t->lmuy * road + camber_offset_n;
    double shift = (t->phy1 + t->phy2 * excess) * t->lhy + t->phy3 * camber;
    if (t->pky6 != 0.0 || t->pky7 != 0.0) {
        /* Since version 6 the shift by camber follows from the camber stiffness. */
        const double camber_n = load_n * (t->pky6 + t->pky7 * excess) * camber;
        shift += (camber_n - camber_offset_n) / smaller(-LEAST, stiffness_n);
    }
    const double friction =
        (t->pdy1 + t->pdy2 * excess) * (1.0 - t->pdy3 * camber * camber) * t->lmuy * road;
    /* With a negative PDY1 the steepness is positive; the force is the same. */
    const double peak_n =
        t->pdy1 > 0.0 ? larger(LEAST, friction) * load_n : smaller(-LEAST, friction) * load_n;
    const double shifted = slip_angle + shift;
    const double sign = shifted >= 0.0 ? 1.0 : -1.0;
    double bend = (t->pey1 + t->pey2 * excess) * t->ley;
    bend *= 1.0 + t->pey5 * camber * camber - (t->pey3 + t->pey4 * camber) * sign;
    const double shape = t->pcy1 * t->lcy;
    const double force_n =
        sine_n(shifted, stiffness_n, peak_n, shape, smaller(1.0, bend)) + offset_n;
    const double slope = stiffness_n / (shape * peak_n);
    return (PureSlip){force_n, stiffness_n, peak_n, shift, offset_n, slope};
}

/* Slip angle that stands for both slips. */
static double equivalent(double angle, double ratio) {
    const double size = atan(length(angle, ratio));
    return angle >= 0.0 ? size : -size;
}

/* Aligning moment: pneumatic trail, residual moment and arm of the longitudinal force. */
static double aligning_nm(double angle, double along, double camber, double load_n, double road,
                          double forward_n, double left_n, const PureSlip *x, const PureSlip *y,
                          const TyreFileParameters *t) {
    const double nominal_n = t->fnomin * t->lfzo;
    const double excess = load_n / nominal_n - 1.0;
    const double friction = t->lmuy * road;
    const double stiffness_n = smaller(-LEAST, y->stiffness_n);
    const double ratio = x->stiffness_n / stiffness_n * along;
    const double direction = 1.0 / sqrt(1.0 + angle * angle);

    const double shift = t->qhz1 + t->qhz2 * excess + (t->qhz3 + t->qhz4 * excess) * camber;
    const double trailing = equivalent(angle + shift, ratio);
    double steepness = t->qbz1 + t->qbz2 * excess + t->qbz3 * excess * excess;
    steepness *= (1.0 + t->qbz4 * camber + t->qbz5 * fabs(camber)) * t->lky / friction;
    double peak_m =
        load_n * t->unloaded_radius / nominal_n * (t->qdz1 + t->qdz2 * excess) * t->ltr;
    peak_m *= 1.0 + t->qdz3 * camber + t->qdz4 * camber * camber;
    double bend = t->qez1 + t->qez2 * excess + t->qez3 * excess * excess;
    bend *= 1.0 +
            (t->qez4 + t->qez5 * camber) * 2.0 / PI * atan(steepness * t->qcz1 * trailing);
    const double trail_m =
        peak_m * cosine(trailing, steepness, t->qcz1, smaller(1.0, bend)) * direction;

    const double rest = equivalent(angle + y->shift + y->offset_n / stiffness_n, ratio);
    const double rest_steepness =
        t->qbz9 * t->lky / friction + t->qbz10 * y->steepness * t->pcy1 * t->lcy;
    double rest_nm = (t->qdz6 + t->qdz7 * excess) * t->lres;
    rest_nm += (t->qdz8 + t->qdz9 * excess) * camber;
    rest_nm += (t->qdz10 + t->qdz11 * excess) * camber * fabs(camber);
    rest_nm *=
        load_n * t->unloaded_radius * friction * cos(atan(rest_steepness * rest)) * direction;

    double arm_m =
        t->ssz1 + t->ssz2 * left_n / nominal_n + (t->ssz3 + t->ssz4 * excess) * camber;
    arm_m *= t->unloaded_radius * t->ls;
    return -trail_m * left_n + rest_nm + arm_m * forward_n;
}

/* Force and aligning moment of one tyre, with the arguments of `tyre_force`. `mirror` is -1 if the
 * file is of a tyre of the other side of the car, else 1. */
TyreForce tyre_file_force(double lateral_slip, double longitudinal_slip, double lean_rad,
                          double load_n, double road_friction, double mirror,
                          const TyreFileParameters *t) {
    if (load_n <= LEAST_LOAD_SHARE * t->fnomin) {
        return (TyreForce){0.0, 0.0, 0.0};
    }
    const double angle = -mirror * lateral_slip;
    const double camber = mirror * lean_rad;
    const double along = longitudinal_slip;
    const double excess = load_n / (t->fnomin * t->lfzo) - 1.0;
    const PureSlip x = longitudinal(along, t->lgax * camber, load_n, road_friction, t);
    const PureSlip y = lateral(angle, t->lgay * camber, load_n, road_friction, t);

    double steepness =
        (t->rbx1 + t->rbx3 * camber * camber) * cos(atan(t->rbx2 * along)) * t->lxal;
    double bend = smaller(1.0, t->rex1 + t->rex2 * excess);
    double centre = cosine(t->rhx1, steepness, t->rcx1, bend);
    double forward_n =
        x.force_n * larger(0.0, cosine(angle + t->rhx1, steepness, t->rcx1, bend) / centre);

    steepness = (t->rby1 + t->rby4 * camber * camber) * cos(atan(t->rby2 * (angle - t->rby3)));
    bend = smaller(1.0, t->rey1 + t->rey2 * excess);
    const double shift = t->rhy1 + t->rhy2 * excess;
    centre = cosine(shift, steepness * t->lyka, t->rcy1, bend);
    double left_n =
        y.force_n *
        larger(0.0, cosine(along + shift, steepness * t->lyka, t->rcy1, bend) / centre);
    double drag_n = y.peak_n * (t->rvy1 + t->rvy2 * excess + t->rvy3 * camber) *
                    cos(atan(t->rvy4 * angle));
    drag_n *= sin(t->rvy5 * atan(t->rvy6 * along)) * t->lvyka;
    const double turning_nm = aligning_nm(angle, along, t->lgaz * camber, load_n, road_friction,
                                          forward_n, left_n, &x, &y, t);
    left_n += drag_n;

    /* Offsets and weights may leave the friction ellipse: bring the force back to it. */
    const double share = length(forward_n / (x.peak_n + fabs(x.offset_n)),
                               left_n / (fabs(y.peak_n) + fabs(y.offset_n)));
    if (share > 1.0) {
        forward_n = forward_n / share;
        left_n = left_n / share;
    }
    return (TyreForce){forward_n, mirror * left_n, mirror * turning_nm};
}
