/* The functions of FMI 2.0 for co-simulation. */

#include "car.h"

#include <stdlib.h>
#include <string.h>

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* In a static library the names need a prefix. */
#ifdef FMI2_FUNCTION_PREFIX
#define JOIN_(prefix, name) prefix##name
#define JOIN(prefix, name) JOIN_(prefix, name)
#define FMI(name) JOIN(FMI2_FUNCTION_PREFIX, fmi2##name)
#else
#define FMI(name) fmi2##name
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
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
    char name[CAR_MESSAGE_SIZE];
    char message[CAR_MESSAGE_SIZE];
} Instance;

static Status result(Instance *instance, bool is_ok) {
    if (!is_ok && instance->logger != NULL) {
        instance->logger(instance->environment, instance->name, ERROR, "logStatusError", "%s",
                         instance->message);
    }
    return is_ok ? OK : ERROR;
}

static Status refuse(Instance *instance, const char *message) {
    strncpy(instance->message, message, CAR_MESSAGE_SIZE - 1);
    return result(instance, false);
}

EXPORT const char *FMI(GetTypesPlatform)(void) { return "default"; }

EXPORT const char *FMI(GetVersion)(void) { return "2.0"; }

EXPORT Status FMI(SetDebugLogging)(void *component, int is_on, size_t n, const char *const *names) {
    (void)component, (void)is_on, (void)n, (void)names;
    return OK; /* errors are always logged, nothing else is */
}

EXPORT void *FMI(Instantiate)(const char *name, int type, const char *token, const char *resources,
                              const Callbacks *callbacks, int is_visible, int is_logging) {
    (void)resources, (void)is_visible, (void)is_logging;
    const int co_simulation = 1;
    const char *problem = NULL;
    if (type != co_simulation) {
        problem = "expected co-simulation, found another type of simulation.";
    } else if (token == NULL || strcmp(token, CAR_TOKEN) != 0) {
        problem = "expected the guid of this FMU's modelDescription.xml, found another.";
    }
    Instance *instance = problem == NULL ? calloc(1, sizeof *instance) : NULL;
    if (instance == NULL) {
        if (callbacks != NULL && callbacks->logger != NULL) {
            callbacks->logger(callbacks->environment, name, ERROR, "logStatusError", "%s",
                              problem == NULL ? "there is no memory left." : problem);
        }
        return NULL;
    }
    if (callbacks != NULL) {
        instance->logger = callbacks->logger;
        instance->environment = callbacks->environment;
    }
    strncpy(instance->name, name == NULL ? "" : name, CAR_MESSAGE_SIZE - 1);
    car_reset(&instance->car);
    return instance;
}

EXPORT void FMI(FreeInstance)(void *component) { free(component); }

EXPORT Status FMI(SetupExperiment)(void *component, int has_tolerance, double tolerance,
                                   double start_time, int has_stop_time, double stop_time) {
    (void)has_tolerance, (void)tolerance, (void)has_stop_time, (void)stop_time;
    Instance *instance = component;
    if (instance->car.phase != CAR_INSTANTIATED) {
        return refuse(instance, "expected a new or reset instance.");
    }
    instance->car.time_s = start_time;
    return OK;
}

EXPORT Status FMI(EnterInitializationMode)(void *component) {
    Instance *instance = component;
    return result(instance, car_enter_initialisation(&instance->car, instance->car.time_s,
                                                     instance->message));
}

EXPORT Status FMI(ExitInitializationMode)(void *component) {
    Instance *instance = component;
    return result(instance, car_exit_initialisation(&instance->car, instance->message));
}

EXPORT Status FMI(Terminate)(void *component) {
    Instance *instance = component;
    return result(instance, car_terminate(&instance->car, instance->message));
}

EXPORT Status FMI(Reset)(void *component) {
    car_reset(&((Instance *)component)->car);
    return OK;
}

EXPORT Status FMI(GetReal)(void *component, const unsigned int *references, size_t n,
                           double *values) {
    Instance *instance = component;
    for (size_t i = 0; i < n; ++i) {
        if (!car_get(&instance->car, references[i], &values[i], instance->message)) {
            return result(instance, false);
        }
    }
    return OK;
}

EXPORT Status FMI(SetReal)(void *component, const unsigned int *references, size_t n,
                           const double *values) {
    Instance *instance = component;
    for (size_t i = 0; i < n; ++i) {
        if (!car_set(&instance->car, references[i], values[i], instance->message)) {
            return result(instance, false);
        }
    }
    return OK;
}

EXPORT Status FMI(DoStep)(void *component, double time_s, double step_s, int is_final) {
    (void)is_final;
    Instance *instance = component;
    return result(instance, car_step(&instance->car, time_s, step_s, instance->message));
}

EXPORT Status FMI(CancelStep)(void *component) {
    return refuse(component, "expected no cancelled step: every step ends before it returns.");
}

/* All variables are real numbers. */
#define NO_VARIABLES(kind, type)                                                                   \
    EXPORT Status FMI(Get##kind)(void *component, const unsigned int *references, size_t n,        \
                                 type *values) {                                                   \
        (void)references, (void)values;                                                            \
        return n == 0 ? OK : refuse(component, "expected variables of type Real.");                \
    }                                                                                              \
    EXPORT Status FMI(Set##kind)(void *component, const unsigned int *references, size_t n,        \
                                 const type *values) {                                             \
        (void)references, (void)values;                                                            \
        return n == 0 ? OK : refuse(component, "expected variables of type Real.");                \
    }
NO_VARIABLES(Integer, int)
NO_VARIABLES(Boolean, int)
NO_VARIABLES(String, char *)

EXPORT Status FMI(GetFMUstate)(void *component, void **state) {
    Instance *instance = component;
    return result(instance, car_save(&instance->car, state, instance->message));
}

EXPORT Status FMI(SetFMUstate)(void *component, void *state) {
    Instance *instance = component;
    return result(instance, car_restore(&instance->car, state, instance->message));
}

EXPORT Status FMI(FreeFMUstate)(void *component, void **state) {
    (void)component;
    car_release(state);
    return OK;
}

EXPORT Status FMI(SerializedFMUstateSize)(void *component, void *state, size_t *size) {
    (void)component, (void)state;
    *size = sizeof(Car);
    return OK;
}

EXPORT Status FMI(SerializeFMUstate)(void *component, void *state, char bytes[], size_t size) {
    Instance *instance = component;
    return result(instance, car_to_bytes(state, bytes, size, instance->message));
}

EXPORT Status FMI(DeSerializeFMUstate)(void *component, const char bytes[], size_t size,
                                       void **state) {
    Instance *instance = component;
    return result(instance, car_from_bytes(bytes, size, state, instance->message));
}

EXPORT Status FMI(GetDirectionalDerivative)(void *component, const unsigned int *unknowns,
                                            size_t n_unknowns, const unsigned int *knowns,
                                            size_t n_knowns, const double *seed, double *out) {
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)out;
    return refuse(component, "expected no derivatives: the FMU does not provide them.");
}

EXPORT Status FMI(SetRealInputDerivatives)(void *component, const unsigned int *references,
                                           size_t n, const int *orders, const double *values) {
    (void)references, (void)n, (void)orders, (void)values;
    return refuse(component, "expected inputs that are held over a step.");
}

EXPORT Status FMI(GetRealOutputDerivatives)(void *component, const unsigned int *references,
                                            size_t n, const int *orders, double *values) {
    (void)references, (void)n, (void)orders, (void)values;
    return refuse(component, "expected no derivatives: the FMU does not provide them.");
}

/* Steps end before they return, so there is never a status to ask for but the last time. */
#define NO_STATUS(kind, type)                                                                      \
    EXPORT Status FMI(Get##kind)(void *component, int what, type *value) {                         \
        (void)component, (void)what, (void)value;                                                  \
        return DISCARD;                                                                            \
    }
NO_STATUS(Status, Status)
NO_STATUS(IntegerStatus, int)
NO_STATUS(StringStatus, const char *)

EXPORT Status FMI(GetBooleanStatus)(void *component, int what, int *value) {
    (void)component;
    const int terminated = 3;
    *value = 0; /* the car never asks for the end of the simulation */
    return what == terminated ? OK : DISCARD;
}

EXPORT Status FMI(GetRealStatus)(void *component, int what, double *value) {
    const int last_successful_time = 2;
    if (what != last_successful_time) {
        return DISCARD;
    }
    *value = ((Instance *)component)->car.time_s;
    return OK;
}
