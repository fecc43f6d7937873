/* mdk_step with plain arrays. */

#include "mdk_arrays.h"

#include "mdk_internal.h"
#include "mdk_model.h"

typedef struct {
    mdk_controller controller;
    mdk_real memory[MDK_MEMORY];
} law_state;

static void take(int n, const double *from, mdk_real *to) {
    for (int i = 0; i < n; i++) {
        to[i] = R(from[i]);
    }
}

size_t mdk_arrays_size(void) { return sizeof(law_state); }

void mdk_arrays_start(void *state) {
    law_state *s = state;
    mdk_init(&s->controller, &MDK_MODEL, s->memory);
}

int mdk_arrays_step(void *state, const double *in, double *out) {
    law_state *s = state;
    mdk_situation now;
    take(MDK_STATES, in + MDK_IN_VX, now.state);
    take(1, in + MDK_IN_CURVATURE, &now.curvature_per_m);
    take(MDK_PATH, in + MDK_IN_PATH_C0, now.path);
    take(MDK_PREVIEW, in + MDK_IN_SPACING, now.preview);
    now.has_preview = !(in[MDK_IN_SPACING] <= 0.0); /* NaN gives no plan */
    take(MDK_INPUTS, in + MDK_IN_APPLIED_THROTTLE, now.applied);
    take(MDK_INPUTS, in + MDK_IN_PREVIOUS_THROTTLE, now.previous);
    now.n_under_way = 0;
    while (now.n_under_way < MDK_MOST_UNDER_WAY && now.n_under_way < in[MDK_IN_N_UNDER_WAY]) {
        const int i = now.n_under_way++;
        take(MDK_INPUTS, in + MDK_IN_UNDER_WAY + MDK_INPUTS * i, now.under_way[i]);
    }
    if (in[MDK_IN_RESTART] > 0.0) {
        mdk_reset(&s->controller, now.previous);
    }
    mdk_real command[MDK_INPUTS];
    const mdk_status status = mdk_step(&s->controller, &now, command);
    for (int i = 0; i < MDK_INPUTS; i++) {
        out[i] = (double)command[i];
    }
    out[MDK_OUT_ITERATIONS] = mdk_iterations(&s->controller);
    return (int)status;
}
