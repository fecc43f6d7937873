/* Random periods at and beyond the ranges of all numbers: the promises of mdk.h hold in each.
 *
 * Arguments: number of periods, seed. Prints figures, one a line. Exit status 1: a promise is
 * broken. */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "mdk_arrays.h"
#include "mdk_model.h"
#include "recorded_drives.h"

enum { MOST_CHANGED = 4, SPECIAL = 12 };

static const double special[SPECIAL] = {
    NAN, INFINITY, -INFINITY, 1e30, -1e30, 1e-310, 0.0, -1.0, 1e-9, 17.0, 1e6, -40.0,
};

static struct {
    mdk_controller controller;
    mdk_real memory[MDK_MEMORY];
} law; /* as mdk_arrays_size(), so that its plan can be read */

static uint64_t state_of_rng;

static int below(int n) {
    state_of_rng = state_of_rng * 6364136223846793005u + 1442695040888963407u;
    return (int)((state_of_rng >> 33) % (uint64_t)n);
}

static double share(void) { return below(1 << 20) / (double)(1 << 20); }

/* Some numbers of a recorded situation are scaled, or replaced. */
static void change(double *in) {
    for (int n = below(MOST_CHANGED); n > 0; n--) {
        double *number = in + below(MDK_IN_SIZE);
        *number = below(3) == 0 ? special[below(SPECIAL)] : *number * 6.0 * (share() - 0.3);
    }
    if (below(4) == 0) { /* speeds around 0 */
        in[MDK_IN_VX] = 4.0 * (share() - 0.5);
    }
}

static uint64_t add_to_hash(uint64_t hash, const double *out) {
    const unsigned char *bytes = (const unsigned char *)out;
    for (size_t i = 0; i < MDK_INPUTS * sizeof *out; i++) {
        hash = (hash ^ bytes[i]) * 1099511628211u;
    }
    return hash;
}

static int is_as_promised(int status, int held, const double *in, const double *out) {
    const mdk_envelope *limits = &MDK_MODEL.envelope;
    mdk_real previous[MDK_INPUTS], expected[MDK_INPUTS];
    int is_kept = out[MDK_OUT_ITERATIONS] <= MDK_MODEL.problem.max_iterations;
    for (int i = 0; i < MDK_INPUTS; i++) {
        const double before = in[MDK_IN_PREVIOUS_THROTTLE + i], found = out[i];
        const double wide = i == MDK_STEER ? limits->trained_rad : (double)limits->upper[i];
        const double rate = (double)limits->change[i] * (1.0 + 1e-5);
        const int is_pedal = i < MDK_STEER;
        previous[i] = (mdk_real)before;
        is_kept &= isfinite(found) && (!is_pedal || found >= 0.0);
        if (isfinite(previous[i]) && fabs(before) <= wide && (!is_pedal || before >= 0.0)) {
            is_kept &= fabs(found) <= wide * (1.0 + 1e-6);
            is_kept &= fabs(found - before) <= rate || (is_pedal && found <= 0.0);
        }
    }
    for (int i = MDK_IN_VX; i <= MDK_IN_SPACING; i++) {
        /* After inputs under way the progress until now has no effect. */
        is_kept &= !isnan(in[i]) || i == MDK_IN_DS || status != MDK_SOLVED;
    }
    if (status != MDK_SOLVED) {
        const int is_held = held <= MDK_MODEL.hold_periods && held < MDK_MODEL.problem.horizon;
        const mdk_real *next = mdk_inputs(&law.controller) + MDK_INPUTS * held;
        mdk_real most = mdk_largest_wheel_rad(&MDK_MODEL, law.controller.present[MDK_VX]);
        const mdk_real turned = (mdk_real)fabs(in[MDK_IN_PREVIOUS_STEER]);
        most = turned > most && isfinite(turned) ? turned : most;
        mdk_limit(&MDK_MODEL, most, is_held ? next : previous, previous, expected);
        for (int i = 0; i < MDK_INPUTS; i++) {
            is_kept &= out[i] == (double)expected[i];
        }
    }
    return is_kept;
}

int main(int count, char **arguments) {
    const int periods = count > 1 ? atoi(arguments[1]) : 1000;
    state_of_rng = count > 2 ? (uint64_t)atoi(arguments[2]) : 0;
    double in[MDK_IN_SIZE], out[MDK_OUT_SIZE] = {0.0};
    int broken = 0, solved = 0, worst = 0, held = MDK_MODEL.hold_periods;
    uint64_t hash = 14695981039346656037u;
    mdk_arrays_start(&law);
    for (int t = 0, row = 0; t < periods; t++, row = (row + 1) % RECORDED_PERIODS) {
        row = below(50) == 0 ? below(RECORDED_PERIODS) : row;
        for (int i = 0; i < MDK_IN_SIZE; i++) {
            in[i] = RECORDED_IN[row][i];
        }
        for (int i = 0; i < MDK_INPUTS && below(4) > 0; i++) {
            in[MDK_IN_PREVIOUS_THROTTLE + i] = out[i];
        }
        if (below(2) == 0) {
            change(in);
        }
        held = in[MDK_IN_RESTART] > 0.0 ? MDK_MODEL.hold_periods : held;
        const int status = mdk_arrays_step(&law, in, out);
        hash = add_to_hash(hash, out);
        held = status == MDK_SOLVED ? 0 : held + 1;
        solved += status == MDK_SOLVED;
        worst = out[MDK_OUT_ITERATIONS] > worst ? (int)out[MDK_OUT_ITERATIONS] : worst;
        if (!is_as_promised(status, held, in, out) && broken++ < 5) {
            fprintf(stderr, "period %d: status %d, %d held, command %g %g %g after %g %g %g\n", t,
                    status, held, out[0], out[1], out[2], in[MDK_IN_PREVIOUS_THROTTLE],
                    in[MDK_IN_PREVIOUS_BRAKE], in[MDK_IN_PREVIOUS_STEER]);
        }
    }
    printf("periods %d\nsolved %d\nbroken %d\n", periods, solved, broken);
    printf("iterations_worst %d\nhash_of_commands %llx\n", worst, (unsigned long long)hash);
    return broken > 0;
}
