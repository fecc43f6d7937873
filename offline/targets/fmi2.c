/* The control law as an FMU: the functions of FMI 2.0 for co-simulation.
 *
 * Model and settings are compiled in (mdk_model.c). The FMU remembers what it has sent: from that it
 * knows which input acts. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mdk.h"

#if defined __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter" /* FMI prescribes the arguments */
#endif
#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define IS_OVER "expected an instance that is initialised and has not ended."
#define NOT_LISTED "expected a variable of this type and causality in the model description."

extern const mdk_model MDK_MODEL;
extern const char FMU_GUID[];

enum { NEWEST = MDK_MOST_UNDER_WAY }; /* place of the last input in `sent` */
/* Value references: places in the model description. */
enum {
    FIRST_START = offsetof(mdk_situation, has_preview) / sizeof(mdk_real),
    FIRST_COMMAND = FIRST_START + MDK_INPUTS,
    DELAY = FIRST_COMMAND + MDK_INPUTS,
    STATUS,
    ITERATIONS,
    N_VARIABLES
};
static const double STEP_TOLERANCE = 1e-6; /* of a period */

typedef enum { OK, WARNING, DISCARD, ERROR } Status;
typedef enum { INSTANTIATED, INITIALISING, STEPPING, ENDED } Phase;

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
    Phase phase;
    mdk_real reals[DELAY]; /* inputs as `mdk_situation` begins with them, start values, command */
    int integers[N_VARIABLES - DELAY];
    mdk_situation now;
    mdk_real sent[NEWEST + 1][MDK_INPUTS]; /* oldest first */
    mdk_controller law;
    Logger logger;
    void *environment;
    char name[256];
    mdk_real memory[]; /* of `law` */
} Instance;

/* Log the reason of a refused call. */
static Status refuse(const Instance *instance, const char *call, const char *reason) {
    if (instance->logger != NULL) {
        instance->logger(instance->environment, instance->name, ERROR, "logStatusError", "%s: %s",
                         call, reason);
    }
    return ERROR;
}

static void one_period(Instance *instance) {
    mdk_situation *now = &instance->now;
    const int n = instance->integers[0];
    memcpy(now, instance->reals, FIRST_START * sizeof(mdk_real));
    now->has_preview = !(now->preview[MDK_SPACING] <= 0);
    now->n_under_way = n;
    memcpy(now->applied, instance->sent[NEWEST - n], sizeof now->applied);
    memcpy(now->previous, instance->sent[NEWEST], sizeof now->previous);
    memcpy(now->under_way, instance->sent + NEWEST + 1 - n, (size_t)n * sizeof instance->sent[0]);
    memmove(instance->sent, instance->sent + 1, sizeof instance->sent - sizeof instance->sent[0]);
    instance->integers[STATUS - DELAY] = mdk_step(&instance->law, now, instance->sent[NEWEST]);
    instance->integers[ITERATIONS - DELAY] = mdk_iterations(&instance->law);
    memcpy(instance->reals + FIRST_COMMAND, instance->sent[NEWEST], sizeof instance->sent[0]);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT Status fmi2SetDebugLogging(void *component, int is_on, size_t n, const char *const *names) {
    return OK; /* errors are always logged, nothing else is */
}

EXPORT void fmi2FreeInstance(void *component) { free(component); }

EXPORT Status fmi2Reset(void *component) {
    Instance *instance = component;
    instance->phase = INSTANTIATED;
    memset(instance->reals, 0, sizeof instance->reals);
    memset(instance->integers, 0, sizeof instance->integers);
    mdk_init(&instance->law, &MDK_MODEL, instance->memory);
    return OK;
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const Callbacks *callbacks, int is_visible, int is_logging) {
    const int co_simulation = 1;
    const size_t memory = (size_t)mdk_memory(&MDK_MODEL) * sizeof(mdk_real);
    Instance *instance = calloc(1, sizeof *instance + memory);
    if (instance == NULL) {
        return NULL;
    }
    instance->logger = callbacks == NULL ? NULL : callbacks->logger;
    instance->environment = callbacks == NULL ? NULL : callbacks->environment;
    snprintf(instance->name, sizeof instance->name, "%s", name == NULL ? "" : name);
    if (type != co_simulation || guid == NULL || strcmp(guid, FMU_GUID) != 0) {
        refuse(instance, "instance", "expected co-simulation, and the guid of the model description.");
        fmi2FreeInstance(instance);
        return NULL;
    }
    fmi2Reset(instance);
    return instance;
}

EXPORT Status fmi2SetupExperiment(void *component, int has_tolerance, double tolerance,
                                  double start_s, int has_stop, double stop_s) {
    return OK; /* nothing depends on the time */
}

/* Go from one phase to another. */
static Status change_phase(Instance *instance, Phase from, Phase to, const char *expected) {
    if (instance->phase != from) {
        return refuse(instance, "phase", expected);
    }
    instance->phase = to;
    return OK;
}

EXPORT Status fmi2EnterInitializationMode(void *component) {
    return change_phase(component, INSTANTIATED, INITIALISING, "expected a new or reset instance.");
}

EXPORT Status fmi2ExitInitializationMode(void *component) {
    Instance *instance = component;
    const Status status =
        change_phase(instance, INITIALISING, STEPPING, "expected one that is initialising.");
    if (status != OK) {
        return status;
    }
    const mdk_real *start = instance->reals + FIRST_START;
    mdk_reset(&instance->law, start);
    for (int i = 0; i <= NEWEST; i++) {
        memcpy(instance->sent[i], start, sizeof instance->sent[i]);
    }
    return OK;
}

EXPORT Status fmi2Terminate(void *component) {
    return change_phase(component, STEPPING, ENDED, IS_OVER);
}

EXPORT Status fmi2GetReal(void *component, const unsigned *references, size_t n, double *values) {
    const Instance *instance = component;
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= DELAY) {
            return refuse(instance, "fmi2GetReal", NOT_LISTED);
        }
        values[i] = (double)instance->reals[references[i]];
    }
    return OK;
}

/* An input may be NaN: the law then holds its plan, as it does after a signal is lost. */
EXPORT Status fmi2SetReal(void *component, const unsigned *references, size_t n,
                          const double *values) {
    Instance *instance = component;
    const mdk_envelope *bounds = &MDK_MODEL.envelope;
    for (size_t i = 0; i < n; i++) {
        const unsigned place = references[i];
        const mdk_real value = (mdk_real)values[i];
        if (place >= FIRST_COMMAND) {
            return refuse(instance, "fmi2SetReal", NOT_LISTED);
        }
        if (place >= FIRST_START) {
            const unsigned input = place - FIRST_START;
            if (instance->phase > INITIALISING ||
                !(value >= bounds->lower[input] && value <= bounds->upper[input])) {
                return refuse(instance, "start", "expected a value within the bounds of the input, "
                                                 "before the end of the initialisation.");
            }
            instance->reals[FIRST_COMMAND + input] = value;
        }
        instance->reals[place] = value;
    }
    return OK;
}

EXPORT Status fmi2GetInteger(void *component, const unsigned *references, size_t n, int *values) {
    const Instance *instance = component;
    for (size_t i = 0; i < n; i++) {
        if (references[i] < DELAY || references[i] >= N_VARIABLES) {
            return refuse(instance, "fmi2GetInteger", NOT_LISTED);
        }
        values[i] = instance->integers[references[i] - DELAY];
    }
    return OK;
}

EXPORT Status fmi2SetInteger(void *component, const unsigned *references, size_t n,
                             const int *values) {
    Instance *instance = component;
    for (size_t i = 0; i < n; i++) {
        if (references[i] != DELAY) {
            return refuse(instance, "fmi2SetInteger", NOT_LISTED);
        }
        if (instance->phase > INITIALISING || values[i] < 0 || values[i] > MDK_MOST_UNDER_WAY) {
            return refuse(instance, "delay_periods",
                          "expected 0 to 16, before the end of the initialisation.");
        }
        instance->integers[0] = values[i];
    }
    return OK;
}

EXPORT Status fmi2DoStep(void *component, double time_s, double step_s, int is_final) {
    Instance *instance = component;
    if (instance->phase != STEPPING) {
        return refuse(instance, "step", IS_OVER);
    }
    if (!(fabs(step_s / (double)MDK_MODEL.period_s - 1.0) <= STEP_TOLERANCE)) {
        return refuse(instance, "step", "expected a communication step of 0.025 s.");
    }
    one_period(instance);
    return OK;
}

/* What the model description says that the FMU does not have. */
#define MISSING(function, ...)                                                                     \
    EXPORT Status function(void *component, __VA_ARGS__) {                                         \
        return refuse(component, #function, "expected no such call: the FMU does not offer it.");  \
    }
MISSING(fmi2GetFMUstate, void **state)
MISSING(fmi2SetFMUstate, void *state)
MISSING(fmi2FreeFMUstate, void **state)
MISSING(fmi2SerializedFMUstateSize, void *state, size_t *size)
MISSING(fmi2SerializeFMUstate, void *state, char bytes[], size_t size)
MISSING(fmi2DeSerializeFMUstate, const char bytes[], size_t size, void **state)
MISSING(fmi2GetDirectionalDerivative, const unsigned *unknowns, size_t n_unknowns,
        const unsigned *knowns, size_t n_knowns, const double *seed, double *out)
MISSING(fmi2SetRealInputDerivatives, const unsigned *references, size_t n, const int *orders,
        const double *values)
MISSING(fmi2GetRealOutputDerivatives, const unsigned *references, size_t n, const int *orders,
        double *values)

/* No variable is of these types, and a tool may ask for none of them. */
#define NO_VARIABLES(function, type)                                                               \
    EXPORT Status function(void *component, const unsigned *references, size_t n, type *values) {  \
        return n == 0 ? OK : refuse(component, #function, NOT_LISTED);                             \
    }
NO_VARIABLES(fmi2GetBoolean, int)
NO_VARIABLES(fmi2SetBoolean, const int)
NO_VARIABLES(fmi2GetString, const char *)
NO_VARIABLES(fmi2SetString, const char *const)

/* Steps end before they return: there is none to cancel and no status to ask for. */
EXPORT Status fmi2CancelStep(void *component) {
    return refuse(component, "fmi2CancelStep", "every step ends before it returns.");
}
#define NO_STATUS(kind, type)                                                                      \
    EXPORT Status fmi2Get##kind(void *component, int what, type *value) { return DISCARD; }
NO_STATUS(Status, Status)
NO_STATUS(RealStatus, double)
NO_STATUS(IntegerStatus, int)
NO_STATUS(BooleanStatus, int)
NO_STATUS(StringStatus, const char *)
