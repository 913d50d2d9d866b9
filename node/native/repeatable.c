/* SPDX-License-Identifier: MIT */
/* The C library's random numbers for one instance of a model: those of a fresh process, whatever else draws any.

   Compiled into the shared object of a model (an instance has a copy of its own), where these hide the C library's. A
   model that starts again draws the same again: generated code has its memory restored, and an FMU is loaded anew.

   Weak: a function of the model's own under one of these names is the one that it calls.

   `time` gives the model's own time in whole seconds, so that a model seeded with it can be repeated too. */

#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <stdint.h>
#include <stdlib.h>
#include <time.h>

#define ECC_WEAK __attribute__((weak))
#ifdef __cplusplus
#define ECC_NO_THROW noexcept
extern "C" {
#else
#define ECC_NO_THROW
#endif

double ecc_time; /* s since the model was initialized; the shim counts it */

static struct random_data ecc_random;
static char ecc_random_state[128]; /* the C library's own size */
static struct drand48_data ecc_random48;

static struct random_data *ecc_generator(void)
{
    if (!ecc_random.state)
        initstate_r(1, ecc_random_state, sizeof ecc_random_state, &ecc_random);
    return &ecc_random;
}

static int32_t ecc_draw(void)
{
    int32_t value = 0;
    random_r(ecc_generator(), &value);
    return value;
}

/* rand() and random() draw from one generator, as in the C library; neither calls the other, which may be the model's. */
ECC_WEAK long random(void) ECC_NO_THROW
{
    return ecc_draw();
}

ECC_WEAK void srandom(unsigned int seed) ECC_NO_THROW
{
    srandom_r(seed, ecc_generator());
}

ECC_WEAK int rand(void) ECC_NO_THROW
{
    return ecc_draw();
}

ECC_WEAK void srand(unsigned int seed) ECC_NO_THROW
{
    srandom_r(seed, ecc_generator());
}

ECC_WEAK double drand48(void) ECC_NO_THROW
{
    double value = 0.0;
    drand48_r(&ecc_random48, &value);
    return value;
}

ECC_WEAK long lrand48(void) ECC_NO_THROW
{
    long value = 0;
    lrand48_r(&ecc_random48, &value);
    return value;
}

ECC_WEAK long mrand48(void) ECC_NO_THROW
{
    long value = 0;
    mrand48_r(&ecc_random48, &value);
    return value;
}

ECC_WEAK void srand48(long seed) ECC_NO_THROW
{
    srand48_r(seed, &ecc_random48);
}

ECC_WEAK time_t time(time_t *at) ECC_NO_THROW
{
    time_t now = (time_t) ecc_time;
    if (at)
        *at = now;
    return now;
}

#ifdef __cplusplus
}
#endif
