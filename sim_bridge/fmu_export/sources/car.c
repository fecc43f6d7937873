#include "car.h"

#include <stdio.h>
#include <string.h>

/* Relative to the internal step; differences of times as large as a day are that exact. */
#define STEP_TOLERANCE 1e-6
#define LONGEST_STEP_S 86400.0
#define IS_OVER "expected an instance that is initialised and has neither failed nor ended."

static bool refuse(char *message, const char *name, const char *text) {
    snprintf(message, CAR_MESSAGE_SIZE, "%s: %s", name, text);
    return false;
}

void car_reset(Car *car) {
    memset(car, 0, sizeof *car);
    snprintf(car->token, sizeof car->token, "%s", CAR_TOKEN);
    car->parameters = CAR_PARAMETERS;
    car->start = CAR_START;
    car->phase = CAR_INSTANTIATED;
}

static bool are_finite(const double *values, int size) {
    for (int i = 0; i < size; ++i) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

static double *place_of(Car *car, const CarVariable *variable) {
    return (double *)((char *)car + variable->offset);
}

/* Names the number that was found, or the table without its numbers. */
static bool refuse_contradiction(Car *car, const CarContradiction *it, char *message) {
    char found[32] = "others";
    for (uint32_t i = 0; i < CAR_N_VARIABLES; ++i) {
        if (strcmp(CAR_VARIABLES[i].name, it->name) == 0) {
            snprintf(found, sizeof found, "%g", *place_of(car, &CAR_VARIABLES[i]));
        }
    }
    snprintf(message, CAR_MESSAGE_SIZE, "%s: expected %s, found %s. Change the parameters that "
             "belong to it too.", it->name, it->expected, found);
    return false;
}

static bool settle(Car *car, char *message) {
    if (car->is_settled) {
        return true;
    }
    const int64_t contradiction = exported_car_contradiction(&car->parameters);
    if (contradiction >= 0) {
        return refuse_contradiction(car, &CAR_CONTRADICTIONS[contradiction], message);
    }
    exported_car_start(&car->start, &car->parameters, car->state, car->pose);
    if (!are_finite(car->state, N_STATES)) {
        return refuse(message, "parameters", "expected a car that can start, found states that "
                      "are no numbers. Reset the changed parameters.");
    }
    car->is_settled = true;
    car->has_outputs = false;
    return true;
}

bool car_enter_initialisation(Car *car, double start_time_s, char *message) {
    if (car->phase != CAR_INSTANTIATED) {
        return refuse(message, "initialisation", "expected a new or reset instance.");
    }
    if (!isfinite(start_time_s)) {
        return refuse(message, "start time", "expected a finite number.");
    }
    car->time_s = start_time_s;
    car->phase = CAR_INITIALISING;
    return true;
}

bool car_exit_initialisation(Car *car, char *message) {
    if (car->phase != CAR_INITIALISING) {
        return refuse(message, "initialisation", "expected an instance that is initialising.");
    }
    if (!settle(car, message)) {
        return false;
    }
    car->phase = CAR_STEPPING;
    return true;
}

bool car_get(Car *car, uint32_t reference, double *value, char *message) {
    if (reference >= CAR_N_VARIABLES) {
        return refuse(message, "value reference", "expected one of the model description.");
    }
    const CarVariable *variable = &CAR_VARIABLES[reference];
    if (variable->kind == CAR_OUTPUT) {
        if (!settle(car, message)) {
            return false;
        }
        if (!car->has_outputs) {
            exported_car_write_exported(&car->inputs, &car->parameters, car->state, car->pose,
                                       car->outputs);
            car->has_outputs = true;
        }
    }
    *value = *place_of(car, variable);
    return true;
}

bool car_set(Car *car, uint32_t reference, double value, char *message) {
    if (reference >= CAR_N_VARIABLES) {
        return refuse(message, "value reference", "expected one of the model description.");
    }
    const CarVariable *variable = &CAR_VARIABLES[reference];
    const bool is_parameter = variable->kind == CAR_FIXED || variable->kind == CAR_TUNABLE;
    const bool is_before_start = car->phase == CAR_INSTANTIATED || car->phase == CAR_INITIALISING;
    if (!is_parameter && variable->kind != CAR_INPUT) {
        return refuse(message, variable->name, "expected an input or a parameter.");
    }
    if (!is_before_start && car->phase != CAR_STEPPING) {
        return refuse(message, variable->name, IS_OVER);
    }
    if (variable->kind == CAR_FIXED && !is_before_start) {
        return refuse(message, variable->name, "expected a value before the end of the "
                      "initialisation: the parameter is fixed.");
    }
    if (!isfinite(value)) {
        return refuse(message, variable->name, "expected a finite number.");
    }
    if (is_parameter &&
        (value < variable->lower || value > variable->upper ||
         (variable->excludes_lower && value <= variable->lower))) {
        snprintf(message, CAR_MESSAGE_SIZE, "%s: expected a number %s %g and at most %g, found %g.",
                 variable->name, variable->excludes_lower ? "above" : "of at least",
                 variable->lower, variable->upper, value);
        return false;
    }
    *place_of(car, variable) = value;
    car->has_outputs = false;
    if (variable->kind != CAR_INPUT && is_before_start) {
        car->is_settled = false;
    }
    return true;
}

bool car_step(Car *car, double time_s, double step_s, char *message) {
    if (car->phase != CAR_STEPPING) {
        return refuse(message, "step", IS_OVER);
    }
    if (!(step_s > 0.0 && step_s <= LONGEST_STEP_S)) {
        return refuse(message, "step", "expected a communication step above 0 and of at most a "
                      "day.");
    }
    if (!(fabs(time_s - car->time_s) <= 0.5 * CAR_STEP_S)) {
        snprintf(message, CAR_MESSAGE_SIZE, "step: expected the time %.9g s at which the last step "
                 "ended, found %.9g s.", car->time_s, time_s);
        return false;
    }
    /* Whole internal steps where they fit, otherwise equal ones that are a little shorter. */
    const double ratio = step_s / CAR_STEP_S;
    const double whole = fmax(1.0, ceil(ratio - STEP_TOLERANCE));
    const double inner_s = fabs(ratio - whole) <= STEP_TOLERANCE ? CAR_STEP_S : step_s / whole;
    exported_car_step(&car->inputs, &car->parameters, (int64_t)whole, inner_s, car->state,
                      car->pose);
    car->time_s += step_s;
    car->has_outputs = false;
    if (!are_finite(car->state, N_STATES) || !are_finite(car->pose, N_POSE)) {
        car->phase = CAR_FAILED;
        return refuse(message, "step", "the motion of the car is no longer a number.");
    }
    return true;
}

bool car_terminate(Car *car, char *message) {
    if (car->phase != CAR_STEPPING) {
        return refuse(message, "termination", IS_OVER);
    }
    car->phase = CAR_TERMINATED;
    return true;
}
