/* test.c on a Cortex-M7 in QEMU, with the number of instructions of each step of the law.
 *
 * With `-icount shift=0` an instruction takes 1 ns, so the system timer, of 25 MHz, counts 40 of
 * them. */

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "mdk_arrays.h"

enum { INSTRUCTIONS = 40, MOST_STEPS = 4096, LARGEST = 0xFFFFFF };

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define TIMER_CONTROL REGISTER(0xE000E010)
#define TIMER_RELOAD REGISTER(0xE000E014)
#define TIMER REGISTER(0xE000E018)
#define COPROCESSORS REGISTER(0xE000ED88)

void initialise_monitor_handles(void);
void start(void);
extern char top_of_stack[];

static void fail(void) { _exit(2); }

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    top_of_stack, (void *)start, /* and of all faults */
    (void *)fail, (void *)fail, (void *)fail, (void *)fail, (void *)fail,
};

static uint32_t counts[MOST_STEPS], first_worst;
static int steps;

static int counted_step(void *state, const double *in, double *out) {
    const uint32_t begin = TIMER;
    const int status = mdk_arrays_step(state, in, out);
    const uint32_t count = ((begin - TIMER) & LARGEST) * INSTRUCTIONS;
    if (in[MDK_IN_RESTART] == 0.0) {
        counts[steps++ % MOST_STEPS] = count;
    } else if (count > first_worst) { /* no plan was prepared: the matrices are made twice */
        first_worst = count;
    }
    return status;
}

#define mdk_arrays_step counted_step
#include "test.c"

static int compare_counts(const void *a, const void *b) {
    const uint32_t one = *(const uint32_t *)a, other = *(const uint32_t *)b;
    return (one > other) - (one < other);
}

void start(void) {
    COPROCESSORS |= 0xFU << 20; /* the floating-point unit is on */
    TIMER_RELOAD = LARGEST;
    TIMER = 0;
    TIMER_CONTROL = 5; /* on, with the clock of the processor */
    initialise_monitor_handles();
    const int status = main();
    qsort(counts, (size_t)steps, sizeof counts[0], compare_counts);
    printf("instructions_first_worst %lu\n", (unsigned long)first_worst);
    printf("instructions_worst %lu\n", (unsigned long)counts[steps - 1]);
    printf("instructions_median %lu\n", (unsigned long)counts[steps / 2]);
    fflush(stdout);
    _exit(status);
}
