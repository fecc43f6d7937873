/* psi_0: the state, and the latents that the network computes from it and from the past. */

#include "mdk_internal.h"

/* One more row of the history: the state at the begin of the period, and the input held in it. */
void mdk_remember(mdk_controller *c, const mdk_real x_0[MDK_STATES],
                  const mdk_real held[MDK_INPUTS]) {
    const int rows = c->model->encoder.history;
    if (rows > 0) {
        mdk_real row[MDK_HISTORY];
        copy(MDK_DS, c->has_present ? c->present : x_0, row);
        mdk_of_model(c, held, row + MDK_DS);
        mdk_real *last = c->history + (rows - 1) * MDK_HISTORY;
        if (c->has_present) {
            memmove(c->history, c->history + MDK_HISTORY,
                    (size_t)((rows - 1) * MDK_HISTORY) * sizeof(mdk_real));
            copy(MDK_HISTORY, row, last);
        } else {
            /* Before the first state the car is assumed to have been in it all the time. */
            for (mdk_real *each = c->history; each <= last; each += MDK_HISTORY) {
                copy(MDK_HISTORY, row, each);
            }
        }
    }
    copy(MDK_STATES, x_0, c->present);
    c->has_present = true;
}

static mdk_real activated(mdk_activation activation, mdk_real a) {
    if (activation == MDK_RELU) {
        return larger(a, R(0));
    }
    return a / (R(1) + exp(-a)); /* SiLU */
}

/* Add `share` (and the sign of each latent) times f(signals) to the latents. */
static void add_function(mdk_controller *c, mdk_real share, const float *latent_signs) {
    const mdk_encoder *net = &c->model->encoder;
    const mdk_real *from = c->signals;
    for (int k = 0; k < net->layers; k++) {
        const mdk_layer *layer = &net->layer[k];
        mdk_real *to = c->layer[k % 2];
        for (int i = 0; i < layer->outputs; i++) {
            const float *weights = layer->weights + i * layer->inputs;
            mdk_real a = layer->biases[i], b = R(0);
            int j = 0;
            for (; j + 2 <= layer->inputs; j += 2) {
                a += weights[j] * from[j];
                b += weights[j + 1] * from[j + 1];
            }
            if (j < layer->inputs) {
                a += weights[j] * from[j];
            }
            to[i] = k + 1 < net->layers ? activated(net->activation, a + b) : a + b;
        }
        from = to;
    }
    for (int i = 0; i < net->latents; i++) {
        mdk_real latent = from[i];
        if (net->products != NULL) {
            const float *weights = net->products + i * net->present * (net->present + 1) / 2;
            for (int j = 0; j < net->present; j++) {
                const mdk_real first = (c->signals[j] - net->centre[j]) / net->spread[j];
                for (int k = j; k < net->present; k++) {
                    const mdk_real second = (c->signals[k] - net->centre[k]) / net->spread[k];
                    latent += *weights++ * first * second;
                }
            }
        }
        mdk_real *found = c->psi + c->model->dynamics.place[MDK_STATES + i];
        *found += (latent_signs != NULL ? latent_signs[i] : R(1)) * share * latent;
    }
}

/* Eq. (7), into c->psi. */
void mdk_lift(mdk_controller *c, const mdk_real x_0[MDK_STATES], mdk_real kappa) {
    const mdk_encoder *net = &c->model->encoder;
    const mdk_dynamics *model = &c->model->dynamics;
    c->kappa = kappa;
    for (int i = 0; i < MDK_STATES; i++) {
        c->psi[model->place[i]] = x_0[i];
    }
    if (net->latents == 0) {
        return;
    }
    for (int i = 0; i < net->present; i++) {
        c->signals[i] = (float)(net->columns[i] < MDK_STATES ? x_0[net->columns[i]] : kappa);
    }
    const int size = net->present + net->history * MDK_HISTORY;
    for (int i = net->present; i < size; i++) { /* float, as the network in Python has them */
        c->signals[i] = (float)c->history[i - net->present];
    }
    for (int i = 0; i < net->latents; i++) {
        c->psi[model->place[MDK_STATES + i]] = R(0);
    }
    if (net->signs == NULL) {
        add_function(c, R(1), NULL);
        return;
    }
    add_function(c, R(0.5), NULL);
    for (int i = 0; i < size; i++) {
        c->signals[i] *= net->signs[i];
    }
    add_function(c, R(0.5), net->latent_signs);
}
