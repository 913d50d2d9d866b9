/* SPDX-License-Identifier: MIT */
/* Preloaded: waits until a time of the wall clock last as if that was set back by an hour when they began. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <time.h>

typedef int clock_wait(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock,
                           const struct timespec *until) {
    struct timespec later = *until;
    if (clock == CLOCK_REALTIME)
        later.tv_sec += 3600;
    return ((clock_wait *)dlsym(RTLD_NEXT, "pthread_cond_clockwait"))(condition, mutex, clock, &later);
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until) {
    return pthread_cond_clockwait(condition, mutex, CLOCK_REALTIME, until);
}
