/* The car inside an FMU: parameters, state and variables; without global memory. */

#ifndef CAR_H
#define CAR_H

#include "plant.h"

#include <stddef.h>

enum { CAR_MESSAGE_SIZE = 256, CAR_TOKEN_SIZE = 40 };

typedef enum { CAR_INSTANTIATED, CAR_INITIALISING, CAR_STEPPING, CAR_TERMINATED, CAR_FAILED } CarPhase;

/* All that a run depends on, without pointers: a copy of it is a copy of the run. */
typedef struct {
    char token[CAR_TOKEN_SIZE]; /* of the FMU that the copy belongs to; comes first */
    double time_s;
    Parameters parameters;
    ExportedStart start;
    ExportedInput inputs;
    double state[N_STATES];
    double pose[N_POSE];
    double outputs[N_EXPORTED];
    int32_t phase;
    int32_t is_settled;
    int32_t has_outputs;
    int32_t unused;
} Car;

/* FIXED: until the end of the initialisation; TUNABLE: at any time. */
typedef enum { CAR_TIME, CAR_INPUT, CAR_FIXED, CAR_TUNABLE, CAR_OUTPUT } CarVariableKind;

typedef struct {
    const char *name;
    size_t offset;
    CarVariableKind kind;
    double lower;
    double upper;
    bool excludes_lower;
} CarVariable;

/* A parameter that does not fit the others, and what would. */
typedef struct {
    const char *name;
    const char *expected;
} CarContradiction;

/* Generated from the car file: `variables.c`. Value references are positions in the table. */
extern const CarVariable CAR_VARIABLES[];
extern const uint32_t CAR_N_VARIABLES;
extern const Parameters CAR_PARAMETERS;
extern const ExportedStart CAR_START;
extern const CarContradiction CAR_CONTRADICTIONS[];
extern const double CAR_STEP_S;
extern const char CAR_TOKEN[];

/* Each returns false and writes a message of at most CAR_MESSAGE_SIZE if it fails. */
void car_reset(Car *car);
bool car_enter_initialisation(Car *car, double start_time_s, char *message);
bool car_exit_initialisation(Car *car, char *message);
bool car_get(Car *car, uint32_t reference, double *value, char *message);
bool car_set(Car *car, uint32_t reference, double value, char *message);
bool car_step(Car *car, double time_s, double step_s, char *message);
bool car_terminate(Car *car, char *message);

/* Copies of a run, in memory that `car_save` allocates if `*state` is NULL, and as bytes. */
bool car_save(const Car *car, void **state, char *message);
bool car_restore(Car *car, const void *state, char *message);
bool car_to_bytes(const void *state, void *bytes, size_t size, char *message);
bool car_from_bytes(const void *bytes, size_t size, void **state, char *message);
void car_release(void **state);

#endif
