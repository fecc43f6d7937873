/* The control law with plain arrays, for an S-function, dSPACE, or a language that calls C.
 *
 * `state` is memory of the caller, of mdk_arrays_size() bytes, aligned as double. Several states can
 * run side by side. */

#ifndef MDK_ARRAYS_H
#define MDK_ARRAYS_H

#include <stddef.h>

enum { /* places of `in`, as `mdk_situation` of mdk.h */
    MDK_IN_RESTART,  /* 1: another law made the last inputs, or a period is missing; otherwise 0 */
    MDK_IN_VX,       /* m/s, measured now */
    MDK_IN_VY,       /* m/s, positive to the left */
    MDK_IN_YAW_RATE, /* rad/s, positive to the left */
    MDK_IN_DS,       /* m, along the road in the last period */
    MDK_IN_EY,       /* m, of the car from the road, positive to the left */
    MDK_IN_EPSI,     /* rad, of the car from the road, positive to the left */
    MDK_IN_CURVATURE, /* 1/m, of the road at the car */
    MDK_IN_PATH_C0,   /* m, lateral position c0 + c1 s + c2 s^2 + c3 s^3 of the path s metres ahead */
    MDK_IN_PATH_C1,   /* - */
    MDK_IN_PATH_C2,   /* 1/m */
    MDK_IN_PATH_C3,   /* 1/m^2 */
    MDK_IN_PATH_V,    /* m/s, wanted */
    MDK_IN_PATH_A,    /* m/s^2, wanted */
    MDK_IN_SPACING,   /* m, of the curvatures ahead; 0: the curvature is constant */
    MDK_IN_K0,        /* 1/m, at the car */
    MDK_IN_K1,        /* 1/m, one spacing ahead */
    MDK_IN_K2,
    MDK_IN_K3,
    MDK_IN_K4,
    MDK_IN_APPLIED_THROTTLE,  /* 0 to 1, that acted until now */
    MDK_IN_APPLIED_BRAKE,     /* N, on the pedal */
    MDK_IN_APPLIED_STEER,     /* rad, of the wheel, positive to the left */
    MDK_IN_PREVIOUS_THROTTLE, /* 0 to 1, sent in the last period */
    MDK_IN_PREVIOUS_BRAKE,    /* N */
    MDK_IN_PREVIOUS_STEER,    /* rad */
    MDK_IN_N_UNDER_WAY,       /* 0 to 16 inputs that were sent and do not act yet */
    MDK_IN_UNDER_WAY,         /* throttle, brake, steer of each, the oldest first */
    MDK_IN_SIZE = MDK_IN_UNDER_WAY + 3 * 16
};

enum { /* places of `out` */
    MDK_OUT_THROTTLE, /* 0 to 1 */
    MDK_OUT_BRAKE,    /* N, on the pedal */
    MDK_OUT_STEER,    /* rad, of the wheel, positive to the left */
    MDK_OUT_ITERATIONS,
    MDK_OUT_SIZE
};

/* Bytes of a state. */
size_t mdk_arrays_size(void);

/* A drive begins. */
void mdk_arrays_start(void *state);

/* One period of 25 ms. 0: a new plan; otherwise the `mdk_status` of mdk.h, and `out` is an input of
 * the last plan, or the previous one: the caller stops the car. */
int mdk_arrays_step(void *state, const double *in, double *out);

#endif
