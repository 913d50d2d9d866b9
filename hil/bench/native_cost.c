/* SPDX-License-Identifier: MIT */
/* Times a compiled model's step from C: the cost that no interface can be under. Prints the median, ns.
   Usage: native_cost LIBRARY INPUTS OUTPUTS STEPS */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

typedef int32_t (*calculate)(const double *u, double *y);

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t) now.tv_sec * 1000000000 + now.tv_nsec;
}

static int by_size(const void *a, const void *b)
{
    int64_t difference = *(const int64_t *) a - *(const int64_t *) b;
    return difference < 0 ? -1 : difference > 0;
}

int main(int argc, char **argv)
{
    if (argc != 5)
        return 2;
    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    long steps = atol(argv[4]);
    double *u = calloc((size_t) atol(argv[2]) + 1, sizeof *u), *y = calloc((size_t) atol(argv[3]) + 1, sizeof *y);
    int64_t *durations = calloc((size_t) steps, sizeof *durations);
    if (!library || !u || !y || !durations)
        return 1;
    calculate initialize = (calculate) dlsym(library, "ecc_initialize"), step = (calculate) dlsym(library, "ecc_step");
    if (!initialize || !step || initialize(u, y) < 0)
        return 1;
    for (long i = 0; i < steps; i++) {
        int64_t start = now_ns();
        if (step(u, y) < 0)
            return 1;
        durations[i] = now_ns() - start;
    }
    qsort(durations, (size_t) steps, sizeof *durations, by_size);
    printf("%lld\n", (long long) durations[steps / 2]);
    return 0;
}
