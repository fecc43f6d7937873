/* Replays recorded drives, and compares commands and plans with those of the Python controller.
 *
 * Prints figures, one a line. Exit status 1: a difference is beyond the tolerance. */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "mdk_arrays.h"
#include "mdk_model.h"
#include "recorded_drives.h"

#if MDK_FLOAT
static const double TOLERANCE = 1e-3;
#else
static const double TOLERANCE = 1e-5;
#endif
/* of a difference, in units of an input's range */

enum { PAINTED = 1 << 16, GAP = 512, PATTERN = 0xA5 };

static struct {
    mdk_controller controller;
    mdk_real memory[MDK_MEMORY];
} law; /* as mdk_arrays_size(), so that its plan can be read */

/* Bytes below the caller that the last call wrote, or paint them for the next one. In a gap below
 * this function the processor may keep its own data. */
static size_t stack_below(int is_painting) {
    volatile char here;
    volatile unsigned char *lowest = (volatile unsigned char *)((uintptr_t)&here - PAINTED - GAP);
    size_t untouched = 0;
    if (is_painting) {
        for (size_t i = 0; i < PAINTED; i++) {
            lowest[i] = PATTERN;
        }
        return 0;
    }
    while (untouched < PAINTED && lowest[untouched] == PATTERN) {
        untouched++;
    }
    return untouched < PAINTED ? PAINTED + GAP - untouched : 0;
}

static double largest(double a, double b) { return b <= a ? a : b; /* NaN is the largest */ }

static double compare(const mdk_real *range, const double *found, const double *expected) {
    double worst = 0.0;
    for (int i = 0; i < MDK_INPUTS; i++) {
        worst = largest(worst, fabs(found[i] - expected[i]) / (double)range[i]);
    }
    return worst;
}

static int compare_ints(const void *a, const void *b) { return *(const int *)a - *(const int *)b; }

int main(void) {
    static int iterations[RECORDED_PERIODS];
    const mdk_problem *problem = &MDK_MODEL.problem;
    double worst_command = 0.0, worst_plan = 0.0;
    size_t stack = 0;
    int failed = 0;
    if (mdk_memory(&MDK_MODEL) != MDK_MEMORY || mdk_arrays_size() != sizeof law) {
        printf("mdk_model.h does not belong to these files\n");
        return 1;
    }
    for (int t = 0; t < RECORDED_PERIODS; t++) {
        double out[MDK_OUT_SIZE];
        if (RECORDED_IN[t][MDK_IN_RESTART] > 0.0) {
            mdk_arrays_start(&law);
        }
        stack_below(1);
        const int status = mdk_arrays_step(&law, RECORDED_IN[t], out);
        const size_t used = stack_below(0);
        stack = used > stack ? used : stack;
        failed += status != MDK_SOLVED;
        iterations[t] = (int)out[MDK_OUT_ITERATIONS];
        worst_command = largest(worst_command, compare(problem->range, out, RECORDED_COMMAND[t]));
        for (int j = 0; j < problem->knots; j++) {
            const mdk_real *u = mdk_inputs(&law.controller) + MDK_INPUTS * problem->stages[j];
            const double found[MDK_INPUTS] = {(double)u[0], (double)u[1], (double)u[2]};
            const double *expected = RECORDED_PLAN[t] + MDK_INPUTS * j;
            worst_plan = largest(worst_plan, compare(problem->range, found, expected));
        }
    }
    qsort(iterations, RECORDED_PERIODS, sizeof iterations[0], compare_ints);
    printf("periods %d\nfailed %d\n", RECORDED_PERIODS, failed);
    printf("command_difference %.2e\nplan_difference %.2e\n", worst_command, worst_plan);
    printf("tolerance %.0e\n", TOLERANCE);
    printf("iterations_worst %d\n", iterations[RECORDED_PERIODS - 1]);
    printf("iterations_median %d\n", iterations[RECORDED_PERIODS / 2]);
    printf("stack_bytes %d\n", (int)stack);
    return failed > 0 || !(largest(worst_command, worst_plan) <= TOLERANCE);
}
