/* SPDX-License-Identifier: MIT */
/* What the shim knows of an FMU: the plan that the loader made, the functions of its library, what it says.
 *
 * Part of shim.c, which alone includes it. The few types and functions needed are declared here from the text of the
 * standard (FMI 2.0.4, sections 2.1 and 4.2; FMI 3.0.1, sections 2.2 and 4.2).
 */

#include <dlfcn.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "own_functions.h"

enum { INPUT, OUTPUT, PARAMETER, STATE, KINDS };
enum { SECTIONS = 5 };
enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL };
enum { TERMINATED = 3, CO_SIMULATION = 1 };

/* What the loader found out; the same fields in the same order as Plan in node/native/fmu/load.py, which keeps them alive. */
typedef struct {
    int32_t count;
    const uint32_t *references;
    double *starts;       /* start values, in the description's order */
    uint8_t *written;     /* the start value was given by the user, not by the FMU */
    const uint8_t *live;  /* a write takes effect while the model runs */
} Group;

typedef struct {
    const char *library;
    const char *prefix;         /* before the functions' names where the FMU was built with one */
    const char *name;
    const char *token;
    const char *resources;      /* NULL where there are none */
    const char *restart_symbols[SECTIONS]; /* all NULL where the model need not, or cannot, start again from new values */
    const char *starting_symbol; /* the model's flag that it is starting; NULL where it has none */
    const char *static_symbol;  /* NULL where static equations cannot be run again */
    const char *stop_symbol;    /* NULL where the model has no flag of its own that stops it */
    double step;               /* s */
    double stop;               /* s; not finite where no end is to be given */
    int32_t version;           /* 2 or 3 */
    int32_t keeps_state;       /* it gives and takes its state (canGetAndSetFMUstate) */
    Group groups[KINDS];
    const int32_t *followers; /* for each parameter the state that starts from it, or -1 where the FMU sees to it */
} Plan;

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);

typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, int);
    void *environment;
} Callbacks;

typedef struct {
    void *(*instantiate2)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    int (*setup2)(void *, int, double, double, int, double);
    int (*enter2)(void *);
    int (*step2)(void *, double, double, int);
    int (*set2)(void *, const uint32_t *, size_t, const double *);
    int (*get2)(void *, const uint32_t *, size_t, double *);
    int (*boolean_status2)(void *, int, int *); /* NULL where the FMU lacks it */
    void *(*instantiate3)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t, void *,
                          void (*)(void *, int, const char *, const char *), void *);
    int (*enter3)(void *, bool, double, double, bool, double);
    int (*step3)(void *, double, double, bool, bool *, bool *, bool *, double *);
    int (*set3)(void *, const uint32_t *, size_t, const double *, size_t);
    int (*get3)(void *, const uint32_t *, size_t, double *, size_t);
    int (*exit_initialization)(void *);
    int (*terminate)(void *);
    void (*release)(void *);
    int (*get_state)(void *, void **); /* these three NULL where the FMU does not keep its state */
    int (*set_state)(void *, void *);
    int (*free_state)(void *, void **);
    void (*restart[SECTIONS])(void *);
    char *starting;
    void (*run_static)(void *);
    const char *stop; /* the model's own flag */
    double *time;     /* s; of repeatable.c: the FMU's own where it was compiled from its sources, else the shim's */
} Functions;


static const Plan *plan;
static void *handle;
static void *instance;
static Functions fmu;
static char said[512];   /* the FMU's last message worth keeping */
static char failure[1024];

/* Messages. */

static void tidy(char *text) {
    for (; *text != '\0'; text++) {
        if ((unsigned char)*text < ' ') {
            *text = ' ';
        }
    }
}

static int fail(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(failure, sizeof failure, format, arguments);
    va_end(arguments);
    return -1;
}

static int fail_saying(const char *what) {
    return said[0] != '\0' ? fail("%s: %s", what, said) : fail("%s, and the FMU does not say why", what);
}

static bool writes_memory(const char *format) {
    /* %n, with whatever flags and lengths, stores through a pointer: no message needs that. */
    for (const char *at = strchr(format, '%'); at != NULL; at = strchr(at, '%')) {
        at += 1 + strspn(at + 1, "0123456789.*+- #'hljztLq");
        if (*at == 'n') {
            return true;
        }
        at += *at != '\0';
    }
    return false;
}

static void take_message2(void *environment, const char *name, int status, const char *category, const char *message,
                          ...) {
    (void)environment, (void)name, (void)category;
    if (message == NULL || (status == STATUS_OK && said[0] != '\0')) {
        return;
    }
    if (strchr(message, '%') == NULL || writes_memory(message)) {
        snprintf(said, sizeof said, "%s", message);
    } else {
        va_list arguments;
        va_start(arguments, message);
        vsnprintf(said, sizeof said, message, arguments);
        va_end(arguments);
    }
    tidy(said);
}

static void take_message3(void *environment, int status, const char *category, const char *message) {
    take_message2(environment, NULL, status, category, "%s", message == NULL ? "" : message);
}

static void ignore_finished(void *environment, int status) {
    (void)environment, (void)status;
}

static const Callbacks callbacks = {take_message2, calloc, free, ignore_finished, NULL};

/* The FMU's functions. */

static void *find(const char *name) {
    char full[512];
    void *function = dlsym(handle, name);
    if (function == NULL) {
        snprintf(full, sizeof full, "%s%s", plan->prefix, name);
        function = dlsym(handle, full);
    }
    return function;
}

static const char *missing;

static void *need(const char *name) {
    void *function = find(name);
    if (function == NULL && missing == NULL) {
        missing = name;
    }
    return function;
}

/* ISO C keeps pointers to data and to functions apart; POSIX, which has dlsym, does not. */
#define TAKE(field, name) (*(void **)&fmu.field = need(name))

static void resolve2(void) {
    TAKE(instantiate2, "fmi2Instantiate");
    TAKE(setup2, "fmi2SetupExperiment");
    TAKE(enter2, "fmi2EnterInitializationMode");
    TAKE(exit_initialization, "fmi2ExitInitializationMode");
    TAKE(step2, "fmi2DoStep");
    TAKE(set2, "fmi2SetReal");
    TAKE(get2, "fmi2GetReal");
    TAKE(terminate, "fmi2Terminate");
    TAKE(release, "fmi2FreeInstance");
    *(void **)&fmu.boolean_status2 = find("fmi2GetBooleanStatus");
}

static void resolve3(void) {
    TAKE(instantiate3, "fmi3InstantiateCoSimulation");
    TAKE(enter3, "fmi3EnterInitializationMode");
    TAKE(exit_initialization, "fmi3ExitInitializationMode");
    TAKE(step3, "fmi3DoStep");
    TAKE(set3, "fmi3SetFloat64");
    TAKE(get3, "fmi3GetFloat64");
    TAKE(terminate, "fmi3Terminate");
    TAKE(release, "fmi3FreeInstance");
}

static void resolve_state(void) {
    int is2 = plan->version == 2;
    if (plan->keeps_state) {
        TAKE(get_state, is2 ? "fmi2GetFMUstate" : "fmi3GetFMUState");
        TAKE(set_state, is2 ? "fmi2SetFMUstate" : "fmi3SetFMUState");
        TAKE(free_state, is2 ? "fmi2FreeFMUstate" : "fmi3FreeFMUState");
    }
}

static void *own_symbol(const char *name) {
    return name != NULL ? dlsym(handle, name) : NULL;
}

static int open_library(void) {
    handle = dlopen(plan->library, RTLD_NOW | RTLD_LOCAL);
    if (handle == NULL) {
        const char *reason = dlerror();
        return fail("its library does not load: %s", reason != NULL ? reason : "no reason is given");
    }
    if (use_own_functions(handle) < 0) {
        return fail("its library cannot be given functions of its own");
    }
    memset(&fmu, 0, sizeof fmu);
    missing = NULL;
    if (plan->version == 2) {
        resolve2();
    } else {
        resolve3();
    }
    resolve_state();
    if (missing != NULL) {
        return fail("its library lacks the function %s", missing);
    }
    for (int i = 0; i < SECTIONS; i++) {
        *(void **)&fmu.restart[i] = own_symbol(plan->restart_symbols[i]);
    }
    fmu.starting = own_symbol(plan->starting_symbol);
    *(void **)&fmu.run_static = own_symbol(plan->static_symbol);
    fmu.stop = own_symbol(plan->stop_symbol);
    fmu.time = dlsym(handle, "ecc_time");
    fmu.time = fmu.time != NULL ? fmu.time : &ecc_time;
    return 0;
}

static int set_values(const uint32_t *references, size_t count, const double *values) {
    if (count == 0) {
        return STATUS_OK;
    }
    return plan->version == 2 ? fmu.set2(instance, references, count, values)
                              : fmu.set3(instance, references, count, values, count);
}

static int get_values(const uint32_t *references, size_t count, double *values) {
    if (count == 0) {
        return STATUS_OK;
    }
    return plan->version == 2 ? fmu.get2(instance, references, count, values)
                              : fmu.get3(instance, references, count, values, count);
}
