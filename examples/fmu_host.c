/* Drive the exported car from C: no Python, no FMI library, only dlopen.

     sim-bridge export-fmu car.fmu && unzip -o car.fmu -d car
     cc -std=c99 -o fmu_host examples/fmu_host.c -ldl && ./fmu_host car

   Prints time, speed, lateral acceleration and roll every 0.1 s of a steering step at 25 m/s. */

#include <dlfcn.h>
#include <err.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char description[1 << 20]; /* modelDescription.xml */

static const char *text_after(const char *start) {
    const char *place = strstr(description, start);
    if (place == NULL) errx(1, "modelDescription.xml: no %s", start);
    return place + strlen(start);
}

static unsigned reference(const char *name) {
    char start[128];
    snprintf(start, sizeof start, "name=\"%s\" valueReference=\"", name);
    return (unsigned)strtoul(text_after(start), NULL, 10);
}

int main(int argc, char **argv) {
    if (argc != 2 || chdir(argv[1])) errx(1, "expected the folder of the FMU as argument");
    FILE *file = fopen("modelDescription.xml", "r");
    if (!file || !fread(description, 1, sizeof description - 1, file)) err(1, "no description");
    void *library = dlopen("./binaries/linux64/rt_controller_car.so", RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) errx(1, "%s", dlerror());
    void *(*instantiate)(const char *, int, const char *, const char *, const void *, int, int);
    int (*set_up)(void *, int, double, double, int, double), (*enter)(void *), (*leave)(void *);
    void (*release)(void *);
    int (*step)(void *, double, double, int);
    int (*set)(void *, const unsigned *, size_t, const double *);
    int (*get)(void *, const unsigned *, size_t, double *);
    *(void **)&instantiate = dlsym(library, "fmi2Instantiate");
    *(void **)&set_up = dlsym(library, "fmi2SetupExperiment");
    *(void **)&enter = dlsym(library, "fmi2EnterInitializationMode");
    *(void **)&leave = dlsym(library, "fmi2ExitInitializationMode");
    *(void **)&release = dlsym(library, "fmi2FreeInstance");
    *(void **)&step = dlsym(library, "fmi2DoStep");
    *(void **)&set = dlsym(library, "fmi2SetReal");
    *(void **)&get = dlsym(library, "fmi2GetReal");
    char guid[64];
    sscanf(text_after("guid=\""), "%63[^\"]", guid);
    void *car = instantiate("car", 1, guid, "", NULL, 0, 0);
    unsigned speed = reference("v0_mps"), u[] = {reference("throttle"), reference("steer_rad")};
    unsigned y[] = {reference("vx_mps"), reference("out_ay_mps2"), reference("out_roll_rad")};
    if (!car || set(car, &speed, 1, (double[]){25.0}) || set_up(car, 0, 0.0, 0.0, 0, 0.0) ||
        enter(car) || leave(car)) errx(1, "the car does not start");
    for (int i = 0; i < 80; ++i) {
        double x[3];
        if (set(car, u, 2, (double[]){0.1, i < 20 ? 0.0 : 0.5})) errx(1, "fmi2SetReal failed");
        if (step(car, 0.025 * i, 0.025, 1) || get(car, y, 3, x)) errx(1, "fmi2DoStep failed");
        if (i % 4 == 3) printf("%.3f %.17g %.17g %.17g\n", 0.025 * (i + 1), x[0], x[1], x[2]);
    }
    release(car);
}
