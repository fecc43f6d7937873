/* The car as an FMU: the functions of FMI 2.0 for co-simulation.
 *
 * Its numbers are compiled in (`car_numbers.h`); the road, the inputs and the start can be set.
 * The pose is that of road.c: on a road without curvature it is the position x, y and the heading. */

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "car.h"
#include "car_numbers.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* FMI prescribes the arguments */

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define N_PARAMETERS (sizeof(Parameters) / sizeof(double))
#define MESSAGE_SIZE 256
#define IS_OVER "expected an instance that is initialised and has neither failed nor ended."

static const double CAR_NUMBERS[N_PARAMETERS] = {CAR_NUMBER_LIST};
static const double FIRST_SPEED_MPS = 20.0;
static const double FASTEST_START_MPS = 70.0;
static const double STEEPEST_RAD = 0.7; /* the equations hold for small angles against the road */
static const double LONGEST_STEP_S = 86400.0;
/* Relative to the internal step; differences of times as large as a day are that exact. */
static const double STEP_TOLERANCE = 1e-6;

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef enum { INSTANTIATED, INITIALISING, STEPPING, ENDED, FAILED } Phase;

/* What an FMU state is: value references are places in `values`, in the order of the model
 * description. */
typedef struct {
    double time_s;
    double throttle;
    double brake_n;
    double steer_rad;
    double curvature_per_m;
    double v0_mps;
    double ey0_m;
    double epsi0_rad;
    RoadParameters road;
    Motion motion;
    Pose pose;
    Outputs outputs;
} Values;

enum {
    FIRST_INPUT = offsetof(Values, throttle) / sizeof(double),
    FIRST_START = offsetof(Values, v0_mps) / sizeof(double),
    FIRST_ROAD = offsetof(Values, road) / sizeof(double),
    FIRST_OUTPUT = offsetof(Values, motion) / sizeof(double),
    N_VALUES = sizeof(Values) / sizeof(double),
};

typedef struct {
    Phase phase;
    bool is_settled;
    bool has_outputs;
    Values values;
    State state;
} Car;

typedef void (*Logger)(void *environment, const char *instance, Status status,
                       const char *category, const char *message, ...);

typedef struct {
    Logger logger;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*step_finished)(void *environment, Status status);
    void *environment;
} Callbacks;

typedef struct {
    Car car;
    Logger logger;
    void *environment;
    char name[MESSAGE_SIZE];
} Instance;

/* Log the reason of a refused call. */
static Status refuse(Instance *instance, const char *name, const char *reason) {
    if (instance->logger != NULL) {
        instance->logger(instance->environment, instance->name, ERROR, "logStatusError", "%s: %s",
                         name, reason);
    }
    return ERROR;
}

static Parameters parameters_of(const Car *car) {
    Parameters p = *(const Parameters *)CAR_NUMBERS;
    p.road = car->values.road;
    return p;
}

/* The inputs of the car, with the pedals inside their range. */
static Input input_of(const Values *v) {
    return (Input){limited(v->throttle, 0.0, 1.0), larger(0.0, v->brake_n), v->steer_rad};
}

static void reset(Car *car) {
    memset(car, 0, sizeof *car);
    car->values.road = ((const Parameters *)CAR_NUMBERS)->road;
    car->values.v0_mps = FIRST_SPEED_MPS;
}

static void settle(Car *car) {
    if (!car->is_settled) {
        const Parameters p = parameters_of(car);
        car_settle(car->values.v0_mps, &p, &car->state);
        car->values.pose = (Pose){0.0, car->values.ey0_m, car->values.epsi0_rad};
        car->is_settled = true;
        car->has_outputs = false;
    }
}

static void write_outputs(Car *car) {
    settle(car);
    if (!car->has_outputs) {
        const State *x = &car->state;
        const Parameters p = parameters_of(car);
        const Input u = input_of(&car->values);
        car->values.motion = (Motion){x->vx_mps, x->vy_mps, x->yaw_rate_radps};
        car_outputs(x, &u, &p, &car->values.outputs);
        car->has_outputs = true;
    }
}

/* What the value would have to be; NULL if it is allowed. */
static const char *expected_instead(unsigned reference, double value) {
    const unsigned road = reference - FIRST_ROAD;
    if (!isfinite(value)) {
        return "expected a finite number.";
    }
    if (reference == FIRST_START && !(value >= 0.0 && value <= FASTEST_START_MPS)) {
        return "expected a speed of 0 to 70 m/s.";
    }
    if (reference >= FIRST_ROAD && road < 2 && value <= 0.0) {
        return "expected a friction above 0.";
    }
    if (reference >= FIRST_ROAD && (road == 2 || road == 3) && fabs(value) > STEEPEST_RAD) {
        return "expected a slope of at most 0.7 rad.";
    }
    return NULL;
}

static Status set_value(Instance *instance, unsigned reference, double value) {
    Car *car = &instance->car;
    const bool is_before_start = car->phase == INSTANTIATED || car->phase == INITIALISING;
    if (reference >= N_VALUES) {
        return refuse(instance, "value reference", "expected one of the model description.");
    }
    const char *name = VARIABLE_NAMES[reference];
    if (reference < FIRST_INPUT || reference >= FIRST_OUTPUT) {
        return refuse(instance, name, "expected an input or a parameter.");
    }
    if (!is_before_start && car->phase != STEPPING) {
        return refuse(instance, name, IS_OVER);
    }
    if (!is_before_start && reference >= FIRST_START && reference < FIRST_ROAD) {
        return refuse(instance, name, "expected a value before the end of the initialisation.");
    }
    const char *problem = expected_instead(reference, value);
    if (problem != NULL) {
        return refuse(instance, name, problem);
    }
    ((double *)&car->values)[reference] = value;
    car->has_outputs = false;
    if (is_before_start && reference >= FIRST_START) {
        car->is_settled = false;
    }
    return OK;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT Status fmi2SetDebugLogging(void *component, int is_on, size_t n, const char *const *names) {
    return OK; /* errors are always logged, nothing else is */
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *token, const char *resources,
                             const Callbacks *callbacks, int is_visible, int is_logging) {
    const int co_simulation = 1;
    const bool is_token = token != NULL && strcmp(token, CAR_TOKEN) == 0;
    Instance *instance = type == co_simulation && is_token ? calloc(1, sizeof *instance) : NULL;
    if (instance == NULL) {
        if (callbacks != NULL && callbacks->logger != NULL) {
            callbacks->logger(callbacks->environment, name, ERROR, "logStatusError", "%s",
                              "expected co-simulation, the guid of this FMU's "
                              "modelDescription.xml, and memory; one of them is missing.");
        }
        return NULL;
    }
    if (callbacks != NULL) {
        instance->logger = callbacks->logger;
        instance->environment = callbacks->environment;
    }
    snprintf(instance->name, sizeof instance->name, "%s", name == NULL ? "" : name);
    reset(&instance->car);
    return instance;
}

EXPORT void fmi2FreeInstance(void *component) { free(component); }

EXPORT Status fmi2SetupExperiment(void *component, int has_tolerance, double tolerance,
                                  double start_time, int has_stop_time, double stop_time) {
    Instance *instance = component;
    if (instance->car.phase != INSTANTIATED) {
        return refuse(instance, "experiment", "expected a new or reset instance.");
    }
    instance->car.values.time_s = start_time;
    return OK;
}

EXPORT Status fmi2EnterInitializationMode(void *component) {
    Instance *instance = component;
    if (instance->car.phase != INSTANTIATED || !isfinite(instance->car.values.time_s)) {
        return refuse(instance, "initialisation",
                      "expected a new or reset instance with a finite start time.");
    }
    instance->car.phase = INITIALISING;
    return OK;
}

EXPORT Status fmi2ExitInitializationMode(void *component) {
    Instance *instance = component;
    if (instance->car.phase != INITIALISING) {
        return refuse(instance, "initialisation", "expected an instance that is initialising.");
    }
    settle(&instance->car);
    instance->car.phase = STEPPING;
    return OK;
}

EXPORT Status fmi2Terminate(void *component) {
    Instance *instance = component;
    if (instance->car.phase != STEPPING) {
        return refuse(instance, "termination", IS_OVER);
    }
    instance->car.phase = ENDED;
    return OK;
}

EXPORT Status fmi2Reset(void *component) {
    reset(&((Instance *)component)->car);
    return OK;
}

EXPORT Status fmi2GetReal(void *component, const unsigned *references, size_t n, double *values) {
    Instance *instance = component;
    for (size_t i = 0; i < n; ++i) {
        if (references[i] >= N_VALUES) {
            return refuse(instance, "value reference", "expected one of the model description.");
        }
        if (references[i] >= FIRST_OUTPUT) {
            write_outputs(&instance->car);
        }
        values[i] = ((const double *)&instance->car.values)[references[i]];
    }
    return OK;
}

EXPORT Status fmi2SetReal(void *component, const unsigned *references, size_t n,
                          const double *values) {
    Status status = OK;
    for (size_t i = 0; i < n && status == OK; ++i) {
        status = set_value(component, references[i], values[i]);
    }
    return status;
}

EXPORT Status fmi2DoStep(void *component, double time_s, double step_s, int is_final) {
    Instance *instance = component;
    Car *car = &instance->car;
    Values *v = &car->values;
    if (car->phase != STEPPING) {
        return refuse(instance, "step", IS_OVER);
    }
    if (!(step_s > 0.0 && step_s <= LONGEST_STEP_S)) {
        return refuse(instance, "step", "expected a length above 0 and of at most a day.");
    }
    if (!(fabs(time_s - v->time_s) <= 0.5 * STEP_S)) {
        return refuse(instance, "step", "expected the time at which the last step ended.");
    }
    /* Whole internal steps where they fit, otherwise equal ones that are a little shorter. */
    const double ratio = step_s / STEP_S;
    const double whole = fmax(1.0, ceil(ratio - STEP_TOLERANCE));
    const double inner_s = fabs(ratio - whole) <= STEP_TOLERANCE ? STEP_S : step_s / whole;
    const Parameters p = parameters_of(car);
    const Input u = input_of(v);
    Motion before = {car->state.vx_mps, car->state.vy_mps, car->state.yaw_rate_radps};
    for (int i = 0; i < (int)whole; ++i) {
        Motion after;
        car_advance(&car->state, &u, &p, 1, inner_s, &after);
        road_step(&before, &after, v->curvature_per_m, inner_s, &v->pose);
        before = after;
    }
    v->time_s += step_s;
    car->has_outputs = false;
    const double sum = before.vx_mps + before.vy_mps + before.yaw_rate_radps;
    if (!isfinite(sum + v->pose.s_m + v->pose.ey_m + v->pose.epsi_rad)) {
        car->phase = FAILED;
        return refuse(instance, "step", "the motion of the car is no longer a number.");
    }
    return OK;
}

EXPORT Status fmi2CancelStep(void *component) {
    return refuse(component, "step", "every step ends before it returns.");
}

/* All variables are real numbers. */
#define NO_VARIABLES(function, type)                                                               \
    EXPORT Status function(void *component, const unsigned *references, size_t n, type *values) {  \
        return n == 0 ? OK : refuse(component, #function, "expected variables of type Real.");     \
    }
NO_VARIABLES(fmi2GetInteger, int)
NO_VARIABLES(fmi2SetInteger, const int)
NO_VARIABLES(fmi2GetBoolean, int)
NO_VARIABLES(fmi2SetBoolean, const int)
NO_VARIABLES(fmi2GetString, char *)
NO_VARIABLES(fmi2SetString, char *const)

EXPORT Status fmi2GetFMUstate(void *component, void **state) {
    *state = *state == NULL ? malloc(sizeof(Car)) : *state;
    if (*state == NULL) {
        return refuse(component, "state", "there is no memory left.");
    }
    memcpy(*state, &((Instance *)component)->car, sizeof(Car));
    return OK;
}

EXPORT Status fmi2SetFMUstate(void *component, void *state) {
    if (state == NULL) {
        return refuse(component, "state", "expected one of this FMU, found NULL.");
    }
    memcpy(&((Instance *)component)->car, state, sizeof(Car));
    return OK;
}

EXPORT Status fmi2FreeFMUstate(void *component, void **state) {
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return OK;
}

/* What the model description says that the FMU does not have. */
#define MISSING(function, ...)                                                                     \
    EXPORT Status function(void *component, __VA_ARGS__) {                                         \
        return refuse(component, #function, "expected no such call: the FMU does not offer it.");  \
    }
MISSING(fmi2SerializedFMUstateSize, void *state, size_t *size)
MISSING(fmi2SerializeFMUstate, void *state, char bytes[], size_t size)
MISSING(fmi2DeSerializeFMUstate, const char bytes[], size_t size, void **state)
MISSING(fmi2GetDirectionalDerivative, const unsigned *unknowns, size_t n_unknowns,
        const unsigned *knowns, size_t n_knowns, const double *seed, double *out)
MISSING(fmi2SetRealInputDerivatives, const unsigned *references, size_t n, const int *orders,
        const double *values)
MISSING(fmi2GetRealOutputDerivatives, const unsigned *references, size_t n, const int *orders,
        double *values)

/* Steps end before they return, so there is never a status to ask for but the last time. */
#define NO_STATUS(kind, type)                                                                      \
    EXPORT Status fmi2Get##kind(void *component, int what, type *value) { return DISCARD; }
NO_STATUS(Status, Status)
NO_STATUS(IntegerStatus, int)
NO_STATUS(StringStatus, const char *)

EXPORT Status fmi2GetBooleanStatus(void *component, int what, int *value) {
    const int terminated = 3;
    *value = 0; /* the car never asks for the end of the simulation */
    return what == terminated ? OK : DISCARD;
}

EXPORT Status fmi2GetRealStatus(void *component, int what, double *value) {
    const int last_successful_time = 2;
    *value = ((Instance *)component)->car.values.time_s;
    return what == last_successful_time ? OK : DISCARD;
}
