// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/* Signals a condition once, while the mutex of the one who waits has been kept from him for long. */
#include <pthread.h>
#include <time.h>

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t condition = PTHREAD_COND_INITIALIZER;
static int waits, said;

static void *wait_for_it(void *nothing)
{
    struct timespec deadline;
    clock_gettime(CLOCK_REALTIME, &deadline);
    deadline.tv_sec += 3600;
    pthread_mutex_lock(&mutex);
    waits = 1;
    while (!said)
        pthread_cond_timedwait(&condition, &mutex, &deadline);
    pthread_mutex_unlock(&mutex);
    return nothing;
}

int main(void)
{
    pthread_t thread;
    const struct timespec until_it_waits = {0, 1000000}, for_long = {0, 100000000};
    pthread_create(&thread, NULL, wait_for_it, NULL);
    pthread_mutex_lock(&mutex);
    while (!waits) {
        pthread_mutex_unlock(&mutex);
        nanosleep(&until_it_waits, NULL);
        pthread_mutex_lock(&mutex);
    }
    nanosleep(&for_long, NULL);
    said = 1;
    pthread_cond_signal(&condition);
    pthread_mutex_unlock(&mutex);
    return pthread_join(thread, NULL);
}
