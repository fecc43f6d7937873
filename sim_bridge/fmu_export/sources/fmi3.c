/* The functions of FMI 3.0 for co-simulation. */

#include "car.h"

#include <stdlib.h>
#include <string.h>

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* In a static library the names need a prefix. */
#ifdef FMI3_FUNCTION_PREFIX
#define JOIN_(prefix, name) prefix##name
#define JOIN(prefix, name) JOIN_(prefix, name)
#define FMI(name) JOIN(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define FMI(name) fmi3##name
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef uint32_t Reference;
typedef void (*Logger)(void *environment, Status status, const char *category, const char *message);

typedef struct {
    Car car;
    Logger logger;
    void *environment;
    char message[CAR_MESSAGE_SIZE];
} Instance;

static Status result(Instance *instance, bool is_ok) {
    if (!is_ok && instance->logger != NULL) {
        instance->logger(instance->environment, ERROR, "logStatusError", instance->message);
    }
    return is_ok ? OK : ERROR;
}

static Status refuse(Instance *instance, const char *message) {
    strncpy(instance->message, message, CAR_MESSAGE_SIZE - 1);
    return result(instance, false);
}

EXPORT const char *FMI(GetVersion)(void) { return "3.0"; }

EXPORT Status FMI(SetDebugLogging)(void *instance, bool is_on, size_t n, const char *const *names) {
    (void)instance, (void)is_on, (void)n, (void)names;
    return OK; /* errors are always logged, nothing else is */
}

EXPORT void *FMI(InstantiateCoSimulation)(const char *name, const char *token,
                                          const char *resources, bool is_visible, bool is_logging,
                                          bool uses_events, bool may_return_early,
                                          const Reference *intermediate, size_t n_intermediate,
                                          void *environment, Logger logger, void *update) {
    (void)name, (void)resources, (void)is_visible, (void)is_logging;
    (void)may_return_early, (void)intermediate, (void)n_intermediate, (void)update;
    const char *problem = NULL;
    if (token == NULL || strcmp(token, CAR_TOKEN) != 0) {
        problem = "expected the instantiationToken of this FMU's modelDescription.xml.";
    } else if (uses_events) {
        problem = "expected no event mode: hasEventMode is false.";
    }
    Instance *instance = problem == NULL ? calloc(1, sizeof *instance) : NULL;
    if (instance == NULL) {
        if (logger != NULL) {
            logger(environment, ERROR, "logStatusError",
                   problem == NULL ? "there is no memory left." : problem);
        }
        return NULL;
    }
    instance->logger = logger;
    instance->environment = environment;
    car_reset(&instance->car);
    return instance;
}

EXPORT void *FMI(InstantiateModelExchange)(const char *name, const char *token,
                                           const char *resources, bool is_visible, bool is_logging,
                                           void *environment, Logger logger) {
    (void)name, (void)token, (void)resources, (void)is_visible, (void)is_logging;
    if (logger != NULL) {
        logger(environment, ERROR, "logStatusError", "expected co-simulation.");
    }
    return NULL;
}

EXPORT void *FMI(InstantiateScheduledExecution)(const char *name, const char *token,
                                                const char *resources, bool is_visible,
                                                bool is_logging, void *environment, Logger logger,
                                                void *clock_update, void *lock, void *unlock) {
    (void)name, (void)token, (void)resources, (void)is_visible, (void)is_logging;
    (void)clock_update, (void)lock, (void)unlock;
    if (logger != NULL) {
        logger(environment, ERROR, "logStatusError", "expected co-simulation.");
    }
    return NULL;
}

EXPORT void FMI(FreeInstance)(void *instance) { free(instance); }

EXPORT Status FMI(EnterInitializationMode)(void *pointer, bool has_tolerance, double tolerance,
                                           double start_time, bool has_stop_time,
                                           double stop_time) {
    (void)has_tolerance, (void)tolerance, (void)has_stop_time, (void)stop_time;
    Instance *instance = pointer;
    return result(instance,
                  car_enter_initialisation(&instance->car, start_time, instance->message));
}

EXPORT Status FMI(ExitInitializationMode)(void *pointer) {
    Instance *instance = pointer;
    return result(instance, car_exit_initialisation(&instance->car, instance->message));
}

EXPORT Status FMI(Terminate)(void *pointer) {
    Instance *instance = pointer;
    return result(instance, car_terminate(&instance->car, instance->message));
}

EXPORT Status FMI(Reset)(void *instance) {
    car_reset(&((Instance *)instance)->car);
    return OK;
}

EXPORT Status FMI(GetFloat64)(void *pointer, const Reference *references, size_t n,
                              double *values, size_t n_values) {
    Instance *instance = pointer;
    if (n != n_values) {
        return refuse(instance, "expected one value for each variable.");
    }
    for (size_t i = 0; i < n; ++i) {
        if (!car_get(&instance->car, references[i], &values[i], instance->message)) {
            return result(instance, false);
        }
    }
    return OK;
}

EXPORT Status FMI(SetFloat64)(void *pointer, const Reference *references, size_t n,
                              const double *values, size_t n_values) {
    Instance *instance = pointer;
    if (n != n_values) {
        return refuse(instance, "expected one value for each variable.");
    }
    for (size_t i = 0; i < n; ++i) {
        if (!car_set(&instance->car, references[i], values[i], instance->message)) {
            return result(instance, false);
        }
    }
    return OK;
}

EXPORT Status FMI(DoStep)(void *pointer, double time_s, double step_s, bool is_final,
                          bool *needs_events, bool *is_over, bool *is_early, double *last_time) {
    (void)is_final;
    Instance *instance = pointer;
    const bool is_ok = car_step(&instance->car, time_s, step_s, instance->message);
    *needs_events = false;
    *is_over = false;
    *is_early = false;
    *last_time = instance->car.time_s;
    return result(instance, is_ok);
}

EXPORT Status FMI(EnterStepMode)(void *instance) {
    return refuse(instance, "expected no event mode: the FMU has none.");
}

/* All variables are of type Float64. */
#define NO_VARIABLES(kind, type)                                                                   \
    EXPORT Status FMI(Get##kind)(void *instance, const Reference *references, size_t n,            \
                                 type *values, size_t n_values) {                                  \
        (void)references, (void)values, (void)n_values;                                            \
        return n == 0 ? OK : refuse(instance, "expected variables of type Float64.");              \
    }                                                                                              \
    EXPORT Status FMI(Set##kind)(void *instance, const Reference *references, size_t n,            \
                                 const type *values, size_t n_values) {                            \
        (void)references, (void)values, (void)n_values;                                            \
        return n == 0 ? OK : refuse(instance, "expected variables of type Float64.");              \
    }
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, char *)

EXPORT Status FMI(GetBinary)(void *instance, const Reference *references, size_t n, size_t *sizes,
                             const uint8_t **values, size_t n_values) {
    (void)references, (void)sizes, (void)values, (void)n_values;
    return n == 0 ? OK : refuse(instance, "expected variables of type Float64.");
}

EXPORT Status FMI(SetBinary)(void *instance, const Reference *references, size_t n,
                             const size_t *sizes, const uint8_t *const *values, size_t n_values) {
    (void)references, (void)sizes, (void)values, (void)n_values;
    return n == 0 ? OK : refuse(instance, "expected variables of type Float64.");
}

EXPORT Status FMI(GetFMUState)(void *pointer, void **state) {
    Instance *instance = pointer;
    return result(instance, car_save(&instance->car, state, instance->message));
}

EXPORT Status FMI(SetFMUState)(void *pointer, void *state) {
    Instance *instance = pointer;
    return result(instance, car_restore(&instance->car, state, instance->message));
}

EXPORT Status FMI(FreeFMUState)(void *pointer, void **state) {
    (void)pointer;
    car_release(state);
    return OK;
}

EXPORT Status FMI(SerializedFMUStateSize)(void *pointer, void *state, size_t *size) {
    (void)pointer, (void)state;
    *size = sizeof(Car);
    return OK;
}

EXPORT Status FMI(SerializeFMUState)(void *pointer, void *state, uint8_t bytes[], size_t size) {
    Instance *instance = pointer;
    return result(instance, car_to_bytes(state, bytes, size, instance->message));
}

EXPORT Status FMI(DeserializeFMUState)(void *pointer, const uint8_t bytes[], size_t size,
                                       void **state) {
    Instance *instance = pointer;
    return result(instance, car_from_bytes(bytes, size, state, instance->message));
}
