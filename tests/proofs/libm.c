/* SPDX-License-Identifier: MIT */
/* Prints the values of libm's functions at the same arguments on every processor, as raw doubles, a function after the other.
 *
 * The arguments come from integers and exact operations alone: a third from -1 to 1, a third from -20 to 20, a third of
 * either sign from 2^-40 to 2^40. */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

static const struct {
    const char *name;
    double (*of_one)(double);
    double (*of_two)(double, double);
} FUNCTIONS[] = {
#define ONE(name) {#name, name, NULL},
#define TWO(name) {#name, NULL, name},
    ONE(sqrt) ONE(fabs) ONE(floor) ONE(ceil) ONE(round) ONE(trunc) TWO(fmod) TWO(remainder) TWO(fmin) TWO(fmax)
    ONE(sin) ONE(cos) ONE(tan) ONE(asin) ONE(acos) ONE(atan) TWO(atan2) ONE(sinh) ONE(cosh) ONE(tanh) ONE(asinh) ONE(acosh)
    ONE(atanh) ONE(exp) ONE(exp2) ONE(exp10) ONE(expm1) ONE(log) ONE(log2) ONE(log10) ONE(log1p) TWO(pow) TWO(hypot)
    ONE(cbrt) ONE(erf) ONE(erfc) ONE(tgamma) ONE(lgamma) ONE(j0) ONE(j1) ONE(y0) ONE(y1)
};

static uint64_t state = 88172645463325252u;

/* From 0 to below 1, in steps of 2^-53 (xorshift64, Marsaglia 2003). */
static double uniform(void) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(state >> 11) * 0x1p-53;
}

static double argument(int kind) {
    double first = uniform(), second = uniform();
    switch (kind) {
    case 0:
        return 2.0 * first - 1.0;
    case 1:
        return 40.0 * first - 20.0;
    default:
        return ldexp(second < 0.5 ? second + 0.5 : -second, (int)(80.0 * first) - 40);
    }
}

int main(void) {
    for (size_t i = 0; i < sizeof FUNCTIONS / sizeof FUNCTIONS[0]; i++) {
        fprintf(stderr, "%s\n", FUNCTIONS[i].name);
        state = 88172645463325252u;
        for (int k = 0; k < 300000; k++) {
            double x = argument(k % 3), y = argument(k % 3);
            double value = FUNCTIONS[i].of_one != NULL ? FUNCTIONS[i].of_one(x) : FUNCTIONS[i].of_two(x, y);
            if (isnan(value)) {
                value = NAN; /* one bit pattern: its sign is the processor's own */
            }
            fwrite(&value, sizeof value, 1, stdout);
        }
    }
    return 0;
}
