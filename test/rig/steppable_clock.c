// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * Preloaded into a process: its wall clock and its boot-time clock are off by what a file says.
 *
 * The file holds two 64-bit numbers of nanoseconds, which a test rewrites while the process runs.
 * What waits for a time of the wall clock waits by the stepped one, as it would if an
 * administrator had set the clock: a step forward ends the wait, a step back makes it longer. The
 * monotonic clock is nobody's to set, and is left alone.
 *
 * It waits in slices. A signal that comes when a slice is over, but its mutex is not yet free for
 * the one who waits, wakes nobody: it is counted, and ends the wait.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define NS 1000000000LL
#define SLICE (5 * NS / 1000) /* how soon a wait notices that the clock was set */
#define CONDITION_IS_MONOTONIC 2 /* in __wrefs, see glibc's nptl */

static volatile int64_t *offsets; /* the wall clock's, the boot-time clock's; NULL: none */

static int (*real_gettime)(clockid_t, struct timespec *);
static int (*real_wait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
static int (*real_signal)(pthread_cond_t *);
static int (*real_broadcast)(pthread_cond_t *);
static int (*real_semwait)(sem_t *, const struct timespec *);
static int (*real_lock)(pthread_mutex_t *, const struct timespec *);

static void *find(const char *name)
{
    /* Without its version, dlsym may find the pthread_cond_timedwait of long ago. */
    void *found = dlvsym(RTLD_NEXT, name, "GLIBC_2.3.2");
    return found ? found : dlsym(RTLD_NEXT, name);
}

__attribute__((constructor)) static void begin(void)
{
    if (real_gettime)
        return;
    real_wait = find("pthread_cond_timedwait");
    real_signal = find("pthread_cond_signal");
    real_broadcast = find("pthread_cond_broadcast");
    real_semwait = find("sem_timedwait");
    real_lock = find("pthread_mutex_timedlock");
    const char *path = getenv("EVGP_TEST_CLOCK");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file >= 0) {
        void *mapped = mmap(NULL, 2 * sizeof(int64_t), PROT_READ, MAP_SHARED, file, 0);
        offsets = mapped == MAP_FAILED ? NULL : mapped;
        close(file);
    }
    real_gettime = find("clock_gettime");
}

static int64_t ns_of(const struct timespec *time)
{
    return time->tv_sec * NS + time->tv_nsec;
}

static struct timespec timespec_of(int64_t ns)
{
    struct timespec time = {ns / NS, ns % NS};
    return time;
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    begin();
    int failed = real_gettime(clock, time);
    if (failed || !offsets)
        return failed;
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)
        *time = timespec_of(ns_of(time) + offsets[0]);
    else if (clock == CLOCK_BOOTTIME)
        *time = timespec_of(ns_of(time) + offsets[1]);
    return 0;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec time;
    (void)zone;
    if (clock_gettime(CLOCK_REALTIME, &time))
        return -1;
    now->tv_sec = time.tv_sec;
    now->tv_usec = time.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *where)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (where)
        *where = now.tv_sec;
    return now.tv_sec;
}

/* The next real time to look at the clock again, or that the deadline has passed. */
static int slice(const struct timespec *deadline, struct timespec *until)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    int64_t left = ns_of(deadline) - ns_of(&now);
    if (left <= 0)
        return 0;
    real_gettime(CLOCK_REALTIME, &now);
    *until = timespec_of(ns_of(&now) + (left < SLICE ? left : SLICE));
    return 1;
}

/* Two conditions may share a number: then one of them wakes for nothing, as conditions may. */
static atomic_uint *signals_of(pthread_cond_t *condition)
{
    static atomic_uint signals[1021];
    return &signals[(uintptr_t)condition / sizeof *condition % 1021];
}

#define WAIT(call, woken)                       \
    do {                                        \
        struct timespec until;                  \
        while (slice(deadline, &until)) {       \
            int result = (call);                \
            if (result != ETIMEDOUT)            \
                return result;                  \
            if (woken)                          \
                return 0;                       \
        }                                       \
        return ETIMEDOUT;                       \
    } while (0)

int pthread_cond_signal(pthread_cond_t *condition)
{
    begin();
    ++*signals_of(condition);
    return real_signal(condition);
}

int pthread_cond_broadcast(pthread_cond_t *condition)
{
    begin();
    ++*signals_of(condition);
    return real_broadcast(condition);
}

int pthread_cond_timedwait(
    pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *deadline)
{
    begin();
    if (!offsets || condition->__data.__wrefs & CONDITION_IS_MONOTONIC)
        return real_wait(condition, mutex, deadline);
    unsigned before = *signals_of(condition);
    WAIT(real_wait(condition, mutex, &until), *signals_of(condition) != before);
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *deadline)
{
    begin();
    if (!offsets)
        return real_lock(mutex, deadline);
    if (!pthread_mutex_trylock(mutex))
        return 0;
    WAIT(real_lock(mutex, &until), 0);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *deadline)
{
    begin();
    if (!offsets)
        return real_semwait(semaphore, deadline);
    if (!sem_trywait(semaphore))
        return 0;
    struct timespec until;
    while (slice(deadline, &until)) {
        if (!real_semwait(semaphore, &until))
            return 0;
        if (errno != ETIMEDOUT)
            return -1;
    }
    errno = ETIMEDOUT;
    return -1;
}
