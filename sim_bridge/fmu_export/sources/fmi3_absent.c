/* Functions of FMI 3.0 that a library must have but this FMU does not offer: they refuse. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#ifdef FMI3_FUNCTION_PREFIX
#define JOIN_(prefix, name) prefix##name
#define JOIN(prefix, name) JOIN_(prefix, name)
#define FMI(name) JOIN(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define FMI(name) fmi3##name
#endif

enum { ERROR = 3 };

typedef const uint32_t *References;

#define ABSENT(name, ...)                                                                          \
    EXPORT int FMI(name)(void *instance, __VA_ARGS__);                                             \
    EXPORT int FMI(name)(void *instance, __VA_ARGS__)
#define ABSENT_PLAIN(name)                                                                         \
    EXPORT int FMI(name)(void *instance);                                                          \
    EXPORT int FMI(name)(void *instance) {                                                         \
        (void)instance;                                                                            \
        return ERROR;                                                                              \
    }

/* Modes of model exchange, events and reconfiguration. */
ABSENT_PLAIN(EnterEventMode)
ABSENT_PLAIN(EnterConfigurationMode)
ABSENT_PLAIN(ExitConfigurationMode)
ABSENT_PLAIN(EnterContinuousTimeMode)
ABSENT_PLAIN(EvaluateDiscreteStates)

ABSENT(UpdateDiscreteStates, bool *a, bool *b, bool *c, bool *d, bool *e, double *f) {
    (void)instance, (void)a, (void)b, (void)c, (void)d, (void)e, (void)f;
    return ERROR;
}

ABSENT(CompletedIntegratorStep, bool a, bool *b, bool *c) {
    (void)instance, (void)a, (void)b, (void)c;
    return ERROR;
}

ABSENT(SetTime, double time) {
    (void)instance, (void)time;
    return ERROR;
}

ABSENT(SetContinuousStates, const double *values, size_t n) {
    (void)instance, (void)values, (void)n;
    return ERROR;
}

#define ABSENT_VALUES(name)                                                                        \
    ABSENT(name, double *values, size_t n) {                                                       \
        (void)instance, (void)values, (void)n;                                                     \
        return ERROR;                                                                              \
    }
ABSENT_VALUES(GetContinuousStateDerivatives)
ABSENT_VALUES(GetEventIndicators)
ABSENT_VALUES(GetContinuousStates)
ABSENT_VALUES(GetNominalsOfContinuousStates)

#define ABSENT_COUNT(name)                                                                         \
    ABSENT(name, size_t *n) {                                                                      \
        (void)instance, (void)n;                                                                   \
        return ERROR;                                                                              \
    }
ABSENT_COUNT(GetNumberOfEventIndicators)
ABSENT_COUNT(GetNumberOfContinuousStates)

/* Dependencies and derivatives. */
ABSENT(GetNumberOfVariableDependencies, uint32_t reference, size_t *n) {
    (void)instance, (void)reference, (void)n;
    return ERROR;
}

ABSENT(GetVariableDependencies, uint32_t reference, size_t *a, uint32_t *b, size_t *c, int *d,
       size_t n) {
    (void)instance, (void)reference, (void)a, (void)b, (void)c, (void)d, (void)n;
    return ERROR;
}

#define ABSENT_DERIVATIVE(name)                                                                    \
    ABSENT(name, References unknowns, size_t n_unknowns, References knowns, size_t n_knowns,       \
           const double *seed, size_t n_seed, double *out, size_t n_out) {                         \
        (void)instance, (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns;            \
        (void)seed, (void)n_seed, (void)out, (void)n_out;                                          \
        return ERROR;                                                                              \
    }
ABSENT_DERIVATIVE(GetDirectionalDerivative)
ABSENT_DERIVATIVE(GetAdjointDerivative)

ABSENT(GetOutputDerivatives, References references, size_t n, const int32_t *orders, double *out,
       size_t n_out) {
    (void)instance, (void)references, (void)n, (void)orders, (void)out, (void)n_out;
    return ERROR;
}

/* Clocks. */
ABSENT(GetClock, References references, size_t n, bool *values) {
    (void)instance, (void)references, (void)n, (void)values;
    return ERROR;
}

ABSENT(SetClock, References references, size_t n, const bool *values) {
    (void)instance, (void)references, (void)n, (void)values;
    return ERROR;
}

ABSENT(GetIntervalDecimal, References references, size_t n, double *values, int *qualifiers) {
    (void)instance, (void)references, (void)n, (void)values, (void)qualifiers;
    return ERROR;
}

ABSENT(GetIntervalFraction, References references, size_t n, uint64_t *counters,
       uint64_t *resolutions, int *qualifiers) {
    (void)instance, (void)references, (void)n, (void)counters, (void)resolutions, (void)qualifiers;
    return ERROR;
}

ABSENT(GetShiftDecimal, References references, size_t n, double *values) {
    (void)instance, (void)references, (void)n, (void)values;
    return ERROR;
}

ABSENT(GetShiftFraction, References references, size_t n, uint64_t *counters,
       uint64_t *resolutions) {
    (void)instance, (void)references, (void)n, (void)counters, (void)resolutions;
    return ERROR;
}

#define ABSENT_SHIFT(name)                                                                         \
    ABSENT(Set##name##Decimal, References references, size_t n, const double *values) {            \
        (void)instance, (void)references, (void)n, (void)values;                                   \
        return ERROR;                                                                              \
    }                                                                                              \
    ABSENT(Set##name##Fraction, References references, size_t n, const uint64_t *counters,         \
           const uint64_t *resolutions) {                                                          \
        (void)instance, (void)references, (void)n, (void)counters, (void)resolutions;              \
        return ERROR;                                                                              \
    }
ABSENT_SHIFT(Interval)
ABSENT_SHIFT(Shift)

ABSENT(ActivateModelPartition, uint32_t clock, double time) {
    (void)instance, (void)clock, (void)time;
    return ERROR;
}
