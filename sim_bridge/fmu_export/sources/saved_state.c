/* Copies of a run: a state in memory of its own, and its bytes. */

#include "car.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool refuse(char *message, const char *text) {
    snprintf(message, CAR_MESSAGE_SIZE, "state: %s", text);
    return false;
}

static bool is_of_this_car(const void *state) {
    return state != NULL && strncmp(state, CAR_TOKEN, CAR_TOKEN_SIZE) == 0;
}

static bool copy(const void *from, void **state, char *message) {
    if (state == NULL) {
        return refuse(message, "expected a place for it, found NULL.");
    }
    if (*state == NULL) {
        *state = malloc(sizeof(Car));
    }
    if (*state == NULL) {
        return refuse(message, "there is no memory left.");
    }
    memcpy(*state, from, sizeof(Car));
    return true;
}

bool car_save(const Car *car, void **state, char *message) { return copy(car, state, message); }

bool car_restore(Car *car, const void *state, char *message) {
    if (!is_of_this_car(state)) {
        return refuse(message, "expected one of this FMU, found another or NULL.");
    }
    memcpy(car, state, sizeof *car);
    return true;
}

bool car_to_bytes(const void *state, void *bytes, size_t size, char *message) {
    if (!is_of_this_car(state) || bytes == NULL) {
        return refuse(message, "expected one of this FMU and a place for its bytes, found another "
                      "or NULL.");
    }
    if (size < sizeof(Car)) {
        return refuse(message, "expected room for all its bytes, found less.");
    }
    memcpy(bytes, state, sizeof(Car));
    return true;
}

bool car_from_bytes(const void *bytes, size_t size, void **state, char *message) {
    if (size != sizeof(Car) || !is_of_this_car(bytes)) {
        return refuse(message, "expected bytes of a state of this FMU, found others.");
    }
    return copy(bytes, state, message);
}

void car_release(void **state) {
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
}
