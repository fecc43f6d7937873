/* The road frame: place and heading of a moving body relative to a road of given curvature.
 *
 * s is the arc length along the reference line, e_y the distance to its left, e_psi the heading
 * relative to its tangent. The motion of the car does not depend on them; they are integrated from
 * the motion, which is linear between the points of the fine grid, with a Runge-Kutta step of
 * fourth order for each interval. Paper: eq. (2), "set of states and inputs". */

#include <math.h>

#include "car.h"

/* Lower limit of 1 - curvature * e_y; the frame is not defined beyond the centre of the bend. */
static const double LEAST_GAP = 0.05;

/* Curvature in 1/m at one arc length; constant outside of the pieces. */
static double curvature_at(double s_m, const Curvature *road) {
    int piece = 0;
    int after = road->n_pieces;
    while (after - piece > 1) {
        const int middle = (piece + after) / 2;
        if (road->starts_m[middle] <= s_m) {
            piece = middle;
        } else {
            after = middle;
        }
    }
    const double d = larger(0.0, s_m - road->starts_m[piece]);
    const double *c = &road->coefficients[4 * piece];
    return c[0] + d * (c[1] + d * (c[2] + d * c[3]));
}

static Pose rates(Motion motion, double curvature_per_m, double ey_m, double epsi_rad) {
    const double c = cos(epsi_rad);
    const double s = sin(epsi_rad);
    const double progress_mps =
        (motion.vx_mps * c - motion.vy_mps * s) / larger(LEAST_GAP, 1.0 - curvature_per_m * ey_m);
    return (Pose){progress_mps, motion.vx_mps * s + motion.vy_mps * c,
                  motion.yaw_rate_radps - curvature_per_m * progress_mps};
}

static double weighted(double first, double second, double third, double fourth) {
    return first + 2.0 * (second + third) + fourth;
}

/* Integrate the pose over one step of linear motion, in place. */
static void road_step(const Motion *before, const Motion *after, double curvature_per_m,
                      double step_s, Pose *pose) {
    const double half_s = 0.5 * step_s;
    const double sixth_s = step_s / 6.0;
    const Motion middle = {0.5 * (before->vx_mps + after->vx_mps),
                           0.5 * (before->vy_mps + after->vy_mps),
                           0.5 * (before->yaw_rate_radps + after->yaw_rate_radps)};
    const double ey_m = pose->ey_m;
    const double epsi_rad = pose->epsi_rad;
    const Pose k1 = rates(*before, curvature_per_m, ey_m, epsi_rad);
    const Pose k2 = rates(middle, curvature_per_m, ey_m + half_s * k1.ey_m,
                          epsi_rad + half_s * k1.epsi_rad);
    const Pose k3 = rates(middle, curvature_per_m, ey_m + half_s * k2.ey_m,
                          epsi_rad + half_s * k2.epsi_rad);
    const Pose k4 = rates(*after, curvature_per_m, ey_m + step_s * k3.ey_m,
                          epsi_rad + step_s * k3.epsi_rad);
    pose->s_m += sixth_s * weighted(k1.s_m, k2.s_m, k3.s_m, k4.s_m);
    pose->ey_m += sixth_s * weighted(k1.ey_m, k2.ey_m, k3.ey_m, k4.ey_m);
    pose->epsi_rad += sixth_s * weighted(k1.epsi_rad, k2.epsi_rad, k3.epsi_rad, k4.epsi_rad);
}

/* Integrate the pose over `n_steps` of motion from `before` on, in place.
 *
 * The curvature of each step is that at its middle, estimated from the progress at its start; an
 * end of a piece of the road is thus passed with an error of at most half a step of distance. */
void road_advance(const Motion *before, const Motion *motion, int n_steps, const Curvature *road,
                  double step_s, Pose *pose) {
    for (int i = 0; i < n_steps; i++) {
        const Motion *start = i == 0 ? before : &motion[i - 1];
        const double mean_mps = 0.5 * (start->vx_mps + motion[i].vx_mps);
        const double middle_m = pose->s_m + 0.5 * step_s * mean_mps * cos(pose->epsi_rad);
        road_step(start, &motion[i], curvature_at(middle_m, road), step_s, pose);
    }
}

/* Poses at the periods' ends of a whole motion; the first one, the start, is given. */
void road_poses(const Motion *motion, int n_periods, int steps_per_period, const Curvature *road,
                double step_s, Pose *poses) {
    for (int k = 0; k < n_periods; k++) {
        const Motion *start = &motion[k * steps_per_period];
        poses[k + 1] = poses[k];
        road_advance(start, start + 1, steps_per_period, road, step_s, &poses[k + 1]);
    }
}
