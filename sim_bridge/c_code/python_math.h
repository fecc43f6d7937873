/* Arithmetic of Python where C's differs: minimum, maximum, remainder, powers, positions. */

#ifndef PYTHON_MATH_H
#define PYTHON_MATH_H

#ifdef __FAST_MATH__
#error "compile without -ffast-math: the code needs the arithmetic of IEEE 754"
#endif

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* A two-dimensional array; its memory belongs to somebody else. */
typedef struct {
    double *data;
    int64_t rows;
    int64_t columns;
} Matrix;

/* The first of two that is not less; `fmin` of C would drop a NaN. */
static inline double py_min(double one, double other) { return other < one ? other : one; }

static inline double py_max(double one, double other) { return other > one ? other : one; }

static inline int64_t py_min_int(int64_t one, int64_t other) { return other < one ? other : one; }

static inline int64_t py_max_int(int64_t one, int64_t other) { return other > one ? other : one; }

/* The whole part; 0 for what is no whole number that a double holds exactly, such as NaN. */
static inline int64_t py_int(double number) {
    return number > -9007199254740992.0 && number < 9007199254740992.0 ? (int64_t)number : 0;
}

static inline int64_t py_abs_int(int64_t number) { return number < 0 ? -number : number; }

/* Remainder with the sign of the divisor. */
static inline double py_mod(double dividend, double divisor) {
    const double rest = fmod(dividend, divisor);
    if (rest == 0.0) {
        return copysign(0.0, divisor);
    }
    return (divisor < 0.0) != (rest < 0.0) ? rest + divisor : rest;
}

static inline int64_t py_mod_int(int64_t dividend, int64_t divisor) {
    const int64_t rest = dividend % divisor;
    return rest != 0 && (rest < 0) != (divisor < 0) ? rest + divisor : rest;
}

/* Quotient rounded down. */
static inline int64_t py_floor_div(int64_t dividend, int64_t divisor) {
    return (dividend - py_mod_int(dividend, divisor)) / divisor;
}

/* A power with a whole exponent, by repeated squaring. */
static inline double py_power(double base, int64_t exponent) {
    double result = 1.0;
    for (int64_t left = exponent < 0 ? -exponent : exponent; left > 0; left /= 2) {
        if (left % 2 == 1) {
            result *= base;
        }
        base *= base;
    }
    return exponent < 0 ? 1.0 / result : result;
}

static inline double py_radians(double degrees) { return degrees * (3.141592653589793 / 180.0); }

static inline double py_degrees(double radians) { return radians * (180.0 / 3.141592653589793); }

/* Linear interpolation between points with increasing x; constant outside, as numpy.interp. */
static inline double py_interp(double x, const double *xs, const double *ys, int64_t size) {
    if (isnan(x) || x <= xs[0]) {
        return isnan(x) ? x : ys[0];
    }
    if (x >= xs[size - 1]) {
        return ys[size - 1];
    }
    int64_t left = 0;
    int64_t right = size - 1;
    while (right - left > 1) {
        const int64_t middle = (left + right) / 2;
        if (x >= xs[middle]) {
            left = middle;
        } else {
            right = middle;
        }
    }
    const double slope = (ys[right] - ys[left]) / (xs[right] - xs[left]);
    return slope * (x - xs[left]) + ys[left];
}

/* A position in a tuple: negative ones count from the end, none leaves the tuple. */
static inline int64_t py_position(int64_t index, int64_t size) {
    const int64_t position = index < 0 ? index + size : index;
    return position < 0 ? 0 : position < size ? position : size - 1;
}

#endif
