/* Loaded before the C library of user-mode Linux (LD_PRELOAD); replaces some of its calls.

   The guest has a time of its own, so that what runs in it does not depend on the load of this
   machine: the processor time of the guest, divided by PROCESSOR_SPEED, and the time in which it
   waits for a timer, which is skipped.

   clock_gettime tells that time. timer_settime asks for a signal after it; an early one does no
   harm, the guest asks again. sigsuspend is how the guest waits: it moves the time to the next timer.

   ptrace: tells which process of the guest runs. Linux expects as many bytes of registers as its
   processor has. User-mode Linux 6.1 passes 2696, which is less than on processors with tiles
   (AMX): the rest is added here as unused. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#define NS_PER_S 1000000000LL
#define MOST_REGISTER_BYTES 32768
#define STATE_BITS_AT 512
#define WITHOUT_TILES 0x3ffULL
#define MOST_PROCESSES 65536

static struct {
    long pid;
    long long used_ns;
} processes[MOST_PROCESSES];
static long running;
static long long used_by_processes_ns, skipped_ns, timer_at_ns;

static long long to_ns(struct timespec time) { return time.tv_sec * NS_PER_S + time.tv_nsec; }

static struct timespec from_ns(long long ns) {
    return (struct timespec){ns / NS_PER_S, ns % NS_PER_S};
}

static long long processor_speed(void) {
    static long long speed;
    if (speed == 0) {
        const char *text = getenv("PROCESSOR_SPEED");
        speed = text == NULL || atoll(text) < 1 ? 1 : atoll(text);
    }
    return speed;
}

/* Adds what the running process of the guest has used since it was asked last. */
static void account(void) {
    struct timespec used;
    const clockid_t clock = (clockid_t)((~(unsigned int)running << 3) | 2);
    if (running == 0 || syscall(SYS_clock_gettime, clock, &used) != 0) {
        return;
    }
    const int place = running % MOST_PROCESSES;
    if (processes[place].pid != running || processes[place].used_ns > to_ns(used)) {
        processes[place].pid = running;
        processes[place].used_ns = 0;
    }
    used_by_processes_ns += to_ns(used) - processes[place].used_ns;
    processes[place].used_ns = to_ns(used);
}

static long long now_ns(void) {
    struct timespec used;
    account();
    syscall(SYS_clock_gettime, CLOCK_PROCESS_CPUTIME_ID, &used);
    return (to_ns(used) + used_by_processes_ns) / processor_speed() + skipped_ns;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    if (clock != CLOCK_MONOTONIC) {
        return (int)syscall(SYS_clock_gettime, clock, now);
    }
    *now = from_ns(NS_PER_S + now_ns());
    return 0;
}

int timer_settime(timer_t timer, int flags, const struct itimerspec *new, struct itimerspec *old) {
    static int (*call)(timer_t, int, const struct itimerspec *, struct itimerspec *);
    if (call == NULL) {
        call = (int (*)(timer_t, int, const struct itimerspec *, struct itimerspec *))dlsym(
            RTLD_NEXT, "timer_settime");
    }
    const long long after_ns = to_ns(new->it_value), every_ns = to_ns(new->it_interval);
    const long long speed = processor_speed();
    const struct itimerspec here = {from_ns(every_ns * speed), from_ns(after_ns * speed)};
    timer_at_ns = after_ns == 0 ? 0 : now_ns() + after_ns;
    return call(timer, flags, &here, old);
}

int sigsuspend(const sigset_t *mask) {
    static int (*call)(const sigset_t *);
    if (call == NULL) {
        call = (int (*)(const sigset_t *))dlsym(RTLD_NEXT, "sigsuspend");
    }
    if (timer_at_ns != 0) {
        const long long rest_ns = timer_at_ns - now_ns();
        skipped_ns += rest_ns > 0 ? rest_ns : 0;
        kill(getpid(), SIGALRM);
    }
    return call(mask);
}

long ptrace(enum __ptrace_request request, ...) {
    static long (*call)(long, long, long, void *);
    static _Alignas(64) unsigned char registers[MOST_REGISTER_BYTES];
    va_list arguments;
    va_start(arguments, request);
    const long pid = va_arg(arguments, long);
    const long address = va_arg(arguments, long);
    void *data = va_arg(arguments, void *);
    va_end(arguments);
    if (call == NULL) {
        call = (long (*)(long, long, long, void *))dlsym(RTLD_NEXT, "ptrace");
    }
    if (pid != running) {
        account();
        running = pid;
    }
    if (request != PTRACE_SETREGSET || address != NT_X86_XSTATE) {
        return call(request, pid, address, data);
    }
    const struct iovec *few = data;
    struct iovec all = {registers, sizeof registers};
    memset(registers, 0, sizeof registers);
    memcpy(registers, few->iov_base, few->iov_len);
    *(uint64_t *)(registers + STATE_BITS_AT) &= WITHOUT_TILES;
    return call(request, pid, address, &all);
}
