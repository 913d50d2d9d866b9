/* SPDX-License-Identifier: MIT */
/* The seat of an FMU: the interface of node/native/library.py over the functions of the FMI standard.
 *
 * Compiled once; each instance loads its own copy, so the state below and in calls.h belongs to one FMU.
 */

#define _GNU_SOURCE
#include <math.h>

#include "calls.h"

enum { NOT_STARTED, RUNNING, ENDED, FAILED, FATAL };

static int phase = NOT_STARTED;
static double now; /* s */

/* Turns a status into our return; a warning is not a failure. */
static int settle(int status, const char *what) {
    if (status == STATUS_OK || status == STATUS_WARNING) {
        return 0;
    }
    phase = status == STATUS_FATAL ? FATAL : FAILED;
    return fail_saying(what);
}

/* The life of an instance. */

/* What a write that fails, or is tried, goes back to; of a few the oldest gives way. They live as long as the instance. */
enum { KEPT = 4 };
static struct {
    void *state;
    double now;
    int phase;
} kept[KEPT];
static int newest;

static void release(void) {
    for (int i = 0; i < KEPT; i++) {
        if (kept[i].state != NULL && instance != NULL && phase != FATAL) {
            fmu.free_state(instance, &kept[i].state);
        }
        kept[i].state = NULL;
    }
    if (instance != NULL && phase != FATAL) {
        if (phase == RUNNING) {
            fmu.terminate(instance);
        }
        fmu.release(instance);
    }
    instance = NULL;
    if (handle != NULL && phase != FATAL) {
        dlclose(handle);
    }
    handle = NULL;
}

static int instantiate(void) {
    if (plan->version == 2) {
        instance = fmu.instantiate2(plan->name, CO_SIMULATION, plan->token, plan->resources, &callbacks, 0, 0);
    } else {
        instance = fmu.instantiate3(plan->name, plan->token, plan->resources, false, false, false, false, NULL, 0, NULL,
                                    take_message3, NULL);
    }
    return instance != NULL ? 0 : fail_saying("it refuses to be instantiated");
}

static int enter(void) {
    int ends = isfinite(plan->stop);
    double stop = ends ? plan->stop : 0.0;
    if (plan->version == 3) {
        return settle(fmu.enter3(instance, false, 0.0, 0.0, ends != 0, stop), "it does not enter initialization");
    }
    if (settle(fmu.setup2(instance, 0, 0.0, 0.0, ends, stop), "it refuses the experiment") < 0) {
        return -1;
    }
    return settle(fmu.enter2(instance), "it does not enter initialization");
}

static int set_start(const Group *group, int32_t place, double value) {
    return settle(set_values(&group->references[place], 1, &value), "it refuses a start value");
}

/* Sets what the user has written; returns how many there were, or -1. */
static int set_written(void) {
    const Group *parameters = &plan->groups[PARAMETER], *states = &plan->groups[STATE];
    int count = 0;
    for (int32_t i = 0; i < parameters->count; i++) {
        if (!parameters->written[i]) {
            continue;
        }
        count++;
        int32_t follower = plan->followers[i];
        if (set_start(parameters, i, parameters->starts[i]) < 0
            || (follower >= 0 && set_start(states, follower, parameters->starts[i]) < 0)) {
            return -1;
        }
    }
    for (int32_t i = 0; i < states->count; i++) {
        if (states->written[i]) {
            count++;
            if (set_start(states, i, states->starts[i]) < 0) {
                return -1;
            }
        }
    }
    return count;
}

/* Runs the equations that a model in globals ran before it took its start values, once more and in the same order. */
static void start_again(void) {
    if (fmu.restart[0] == NULL) {
        if (fmu.run_static != NULL) {
            fmu.run_static(instance);
        }
        return;
    }
    if (fmu.starting != NULL) {
        *fmu.starting = 1;
    }
    for (int i = 0; i < SECTIONS; i++) {
        fmu.restart[i](instance);
    }
    if (fmu.starting != NULL) {
        *fmu.starting = 0;
    }
}

/* Start values go in here and no earlier: some FMUs forget what was set before. */
static int set_starts(const double *u) {
    const Group *inputs = &plan->groups[INPUT];
    int count = set_written();
    if (count < 0) {
        return -1;
    }
    if (count > 0) {
        start_again();
    }
    return settle(set_values(inputs->references, (size_t)inputs->count, u), "it refuses its inputs");
}

static int get_outputs(double *y) {
    const Group *outputs = &plan->groups[OUTPUT];
    return settle(get_values(outputs->references, (size_t)outputs->count, y), "its outputs cannot be read");
}

static int start(const double *u, double *y) {
    if (open_library() < 0 || instantiate() < 0 || enter() < 0 || set_starts(u) < 0) {
        return -1;
    }
    if (settle(fmu.exit_initialization(instance), "its initialization fails") < 0) {
        return -1;
    }
    return get_outputs(y);
}

/* The calls. */

static int open_fmu(void) {
    /* Instantiated once and given back, so that an FMU that refuses does so when it is loaded. */
    int status = open_library() < 0 || instantiate() < 0 ? -1 : 0;
    release();
    return status;
}

static int close_fmu(void) {
    if (plan != NULL) {
        release();
        phase = NOT_STARTED;
    }
    return 0;
}

static int initialize(const double *u, double *y) {
    if (phase == FATAL) {
        return fail("the FMU failed for good earlier: load it again");
    }
    /* The library is loaded anew, so that even an FMU that keeps its state in globals starts as new. */
    release();
    phase = NOT_STARTED;
    said[0] = '\0';
    now = 0.0;
    if (start(u, y) < 0) {
        if (phase == NOT_STARTED) {
            phase = FAILED;
        }
        return -1;
    }
    phase = RUNNING;
    return 0;
}

static int not_running(void) {
    switch (phase) {
    case NOT_STARTED:
        return fail("it is not initialized yet");
    case ENDED:
        return fail("it is terminated: initialize it again");
    default:
        return fail("it failed earlier: initialize it again");
    }
}

static int ended2(int status) {
    int over = 0;
    if (status == STATUS_DISCARD && fmu.boolean_status2 != NULL) {
        fmu.boolean_status2(instance, TERMINATED, &over);
    }
    return over;
}

static int advance(bool *over) {
    int status;
    if (plan->version == 2) {
        status = fmu.step2(instance, now, plan->step, 1);
        *over = ended2(status);
    } else {
        bool event = false, early = false;
        double reached = 0.0;
        status = fmu.step3(instance, now, plan->step, true, &event, over, &early, &reached);
    }
    if (*over && status == STATUS_DISCARD) {
        return 0;
    }
    return settle(status, "its step fails");
}

static int step(const double *u, double *y) {
    if (phase != RUNNING) {
        return not_running();
    }
    const Group *inputs = &plan->groups[INPUT];
    bool over = false;
    if (settle(set_values(inputs->references, (size_t)inputs->count, u), "it refuses its inputs") < 0
        || advance(&over) < 0) {
        return -1;
    }
    /* Added up, as the FMU does it: a product differs in the last bit now and then, and costs a whole step too many. */
    now += plan->step;
    *fmu.time = now;
    if (get_outputs(y) < 0) {
        return -1;
    }
    return over || (fmu.stop != NULL && *fmu.stop != 0);
}

static int terminate(void) {
    if (phase != RUNNING) {
        return 0;
    }
    phase = ENDED;
    return settle(fmu.terminate(instance), "its final equations fail");
}

static int run_static(void) {
    if (phase == RUNNING && fmu.run_static != NULL) {
        fmu.run_static(instance);
    }
    return 0;
}

static int read_value(int32_t kind, int32_t index, double *value) {
    const Group *group = &plan->groups[kind];
    if (phase != RUNNING && phase != ENDED) {
        *value = group->starts[index];
        return 0;
    }
    return get_values(&group->references[index], 1, value);
}

static int write_value(int32_t kind, int32_t index, double value) {
    const Group *group = &plan->groups[kind];
    /* A parameter keeps its value when the model starts anew; of the states only those written for that. */
    if (kind == PARAMETER || !group->live[index]) {
        group->starts[index] = value;
        group->written[index] = 1;
    }
    if (phase != RUNNING || !group->live[index]) {
        return 0;
    }
    return settle(set_values(&group->references[index], 1, &value), "it refuses the value");
}

static int keep(void) {
    if (!plan->keeps_state) {
        return fail("this FMU neither gives nor takes its state (canGetAndSetFMUstate)");
    }
    newest = (newest + 1) % KEPT;
    kept[newest].now = now;
    kept[newest].phase = phase;
    if (phase == RUNNING) {
        int status = fmu.get_state(instance, &kept[newest].state);
        if (status != STATUS_OK && status != STATUS_WARNING) {
            return fail_saying("it does not give its state");
        }
    }
    return newest;
}

/* Also from an error, which the standard allows with a state of before it (FMI 2.0.4, 2.1.3, fmi2Error). */
static int put_back(int32_t place) {
    if (phase == FATAL) {
        return fail("the FMU failed for good");
    }
    if (kept[place].phase == RUNNING) {
        if (kept[place].state == NULL) {
            return fail("it was initialized since");
        }
        if (settle(fmu.set_state(instance, kept[place].state), "it does not take its state back") < 0) {
            return -1;
        }
        *fmu.time = kept[place].now;
    }
    now = kept[place].now;
    phase = kept[place].phase;
    said[0] = '\0';
    return 0;
}

/* The interface: a call in which the FMU would end the process fails, and so do all later ones. */

#define CALL(expression)                                \
    jmp_buf way;                                        \
    int status;                                         \
    if (setjmp(way) != 0) {                             \
        phase = FATAL;                                  \
        return fail("%s", ecc_ended_by);                \
    }                                                   \
    ecc_way_out = &way;                                 \
    status = (expression);                              \
    ecc_way_out = NULL;                                 \
    return status

int32_t ecc_fmu_open(const Plan *given) {
    plan = given;
    CALL(open_fmu());
}

int32_t ecc_fmu_close(void) {
    CALL(close_fmu());
}

int32_t ecc_initialize(const double *u, double *y) {
    CALL(initialize(u, y));
}

int32_t ecc_step(const double *u, double *y) {
    CALL(step(u, y));
}

int32_t ecc_terminate(void) {
    CALL(terminate());
}

int32_t ecc_static(void) {
    CALL(run_static());
}

static int read_protected(int32_t kind, int32_t index, double *value) {
    CALL(read_value(kind, index, value));
}

double ecc_read(int32_t kind, int32_t index) {
    double value = NAN;
    read_protected(kind, index, &value);
    return value;
}

int32_t ecc_write(int32_t kind, int32_t index, double value) {
    CALL(write_value(kind, index, value));
}

int32_t ecc_keep(void) {
    CALL(keep());
}

int32_t ecc_put_back(int32_t place) {
    CALL(put_back(place));
}

const char *ecc_error(void) {
    return failure;
}
