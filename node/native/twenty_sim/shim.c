/* SPDX-License-Identifier: MIT */
/* The interface of node/native/library.py over code that 20-sim generated.

   Compiled with the model, as C or as C++, together with an ecc_model.h that is written for it (node/native/twenty_sim/shim.py). */

#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <dlfcn.h>
#include <errno.h>
#include <link.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <unistd.h>

#ifdef __cplusplus
#include <exception>
#include <new>
#endif

#include "ecc_model.h"
#include "ending.h"

#define ECC_RANGES 8
typedef struct {
    char *place;
    void *content;
    size_t size;
} ecc_range;

/* A word of the model's memory that is not what it was when the model was loaded. */
typedef struct {
    uint64_t place; /* which word it is; with ECC_ADDRESS, the value is an offset into this shared object */
    uint64_t value;
} ecc_word;
#define ECC_ADDRESS (UINT64_C(1) << 63)

/* What outlives a restart: it lies on the heap, out of reach of the restoring below. What comes before `error` is part of
   the model's state. */
typedef struct {
    int begun;   /* the model has been initialized at least once */
    int running; /* initialized and not terminated */
    int stale;   /* something was written since the rates were computed */
    double parameters[ECC_PARAMETERS + 1];
    char written[ECC_PARAMETERS + 1];
    ecc_real u[ECC_INPUTS + 1];
    ecc_real y[ECC_OUTPUTS + 1];
    const char *error;
    int ranges;
    ecc_range range[ECC_RANGES + 1]; /* the last one is the beginning of this */
    uint64_t image, image_end;
    void (**constructors)(void);
    size_t constructor_count;
} ecc_kept_state;

static ecc_kept_state *ecc_kept;

#ifdef __cplusplus
extern "C" {
#endif
extern double ecc_time; /* s; repeatable.c gives it to the model */
extern void *__dso_handle __attribute__((visibility("hidden")));
void __cxa_finalize(void *object);
#ifdef __cplusplus
}
#endif

#ifdef __cplusplus
/* What the model makes with `new` lies in its own memory as far as there is room: elsewhere it would be lost to its
   state. A restart makes it empty again. */
#define ECC_ROOM 65536
alignas(16) static char ecc_room[ECC_ROOM];
static size_t ecc_used;

void *operator new(size_t size)
{
    void *place;
    if (size > ECC_ROOM - ecc_used) {
        place = malloc(size);
        if (!place)
            throw std::bad_alloc();
        return place;
    }
    place = ecc_room + ecc_used;
    ecc_used += (size + 15) & ~(size_t) 15; /* ECC_ROOM at most, which is a multiple too */
    return place;
}
void operator delete(void *place) noexcept
{
    if ((char *) place < ecc_room || (char *) place >= ecc_room + ECC_ROOM)
        free(place);
}
void *operator new[](size_t size) { return operator new(size); }
void operator delete[](void *place) noexcept { operator delete(place); }
void operator delete(void *place, size_t) noexcept { operator delete(place); }
void operator delete[](void *place, size_t) noexcept { operator delete(place); }
#endif

/* Finds what runs when this shared object is loaded. */
static void ecc_find_constructors(const struct dl_phdr_info *info, const ElfW(Dyn) *entry)
{
    for (; entry->d_tag != DT_NULL; entry++) {
        if (entry->d_tag == DT_INIT_ARRAY)
            ecc_kept->constructors = (void (**)(void)) (info->dlpi_addr + entry->d_un.d_ptr);
        if (entry->d_tag == DT_INIT_ARRAYSZ)
            ecc_kept->constructor_count = entry->d_un.d_val / sizeof(void *);
    }
}

/* Finds the writable memory of this shared object, less what the loader has made read-only again. */
static int ecc_find(struct dl_phdr_info *info, size_t size, void *unused)
{
    ElfW(Addr) own = (ElfW(Addr)) &ecc_kept;
    ElfW(Addr) page = (ElfW(Addr)) sysconf(_SC_PAGESIZE), sealed = 0;
    int i, mine = 0;
    (void) size;
    (void) unused;
    for (i = 0; i < info->dlpi_phnum; i++) {
        const ElfW(Phdr) *part = &info->dlpi_phdr[i];
        ElfW(Addr) start = info->dlpi_addr + part->p_vaddr;
        if (part->p_type == PT_LOAD && own >= start && own < start + part->p_memsz) {
            mine = 1;
            ecc_kept->image = info->dlpi_addr;
            ecc_kept->image_end = start + part->p_memsz; /* what is written to comes last */
        }
        if (part->p_type == PT_GNU_RELRO)
            sealed = (start + part->p_memsz) / page * page;
    }
    for (i = 0; mine && i < info->dlpi_phnum && ecc_kept->ranges < ECC_RANGES; i++) {
        const ElfW(Phdr) *part = &info->dlpi_phdr[i];
        ElfW(Addr) start = info->dlpi_addr + part->p_vaddr, end = start + part->p_memsz;
        if (part->p_type == PT_DYNAMIC)
            ecc_find_constructors(info, (const ElfW(Dyn) *) start);
        if (part->p_type != PT_LOAD || !(part->p_flags & PF_W))
            continue;
        if (sealed > start && sealed <= end)
            start = sealed;
        start &= ~(ElfW(Addr)) 7; /* whole words, which lie in the same pages */
        ecc_kept->range[ecc_kept->ranges].place = (char *) start;
        ecc_kept->range[ecc_kept->ranges].size = (size_t) ((end - start + 7) & ~(ElfW(Addr)) 7);
        ecc_kept->ranges++;
    }
    return mine;
}

static int ecc_remember(void)
{
    int i;
    if (ecc_kept)
        return 1;
    ecc_kept = (ecc_kept_state *) calloc(1, sizeof *ecc_kept);
    if (!ecc_kept)
        return 0;
    for (i = 0; i < ECC_PARAMETERS; i++)
        ecc_kept->parameters[i] = ecc_parameter_starts[i];
    dl_iterate_phdr(ecc_find, NULL);
    ecc_kept->range[ecc_kept->ranges].place = (char *) ecc_kept;
    ecc_kept->range[ecc_kept->ranges].size = offsetof(ecc_kept_state, error);
    for (i = 0; i <= ecc_kept->ranges; i++) {
        ecc_kept->range[i].content = malloc(ecc_kept->range[i].size);
        if (!ecc_kept->range[i].content) {
            free(ecc_kept);
            ecc_kept = NULL;
            return 0;
        }
    }
    for (i = 0; i <= ecc_kept->ranges; i++)
        memcpy(ecc_kept->range[i].content, ecc_kept->range[i].place, ecc_kept->range[i].size);
    return 1;
}

/* Keeps a copy of every global of the model as it was loaded, before any constructor ran. */
__attribute__((constructor(101))) static void ecc_remember_first(void)
{
    ecc_remember();
}

/* Makes the memory what it was when the model was loaded: objects are destroyed, and constructed again. */
static void ecc_restore(void)
{
    size_t i;
    __cxa_finalize(__dso_handle);
    for (i = 0; i < (size_t) ecc_kept->ranges; i++)
        memcpy(ecc_kept->range[i].place, ecc_kept->range[i].content, ecc_kept->range[i].size);
    for (i = 0; i < ecc_kept->constructor_count; i++)
        ecc_kept->constructors[i]();
}

static int32_t ecc_failed(const char *why)
{
    if (ecc_kept)
        ecc_kept->error = why;
    return -1;
}

static void ecc_take(const double *u)
{
    int i;
    for (i = 0; i < ECC_INPUTS; i++)
        ecc_kept->u[i] = (ecc_real) u[i];
}

static void ecc_give(double *y)
{
    int i;
    for (i = 0; i < ECC_OUTPUTS; i++)
        y[i] = (double) ecc_kept->y[i];
}

#ifdef __cplusplus
extern "C" {
#endif

/* Called at the head of the initial equations: the code has just set the parameters to their defaults. */
void ecc_before_initial(void)
{
    int i;
    for (i = 0; ecc_kept && i < ECC_PARAMETERS; i++)
        if (ecc_kept->written[i])
            ecc_parameters()[i] = (ecc_real) ecc_kept->parameters[i];
}

static int32_t ecc_do_initialize(const double *u, double *y)
{
    if (!ecc_remember())
        return -1;
    ecc_drop();
    if (ecc_kept->begun)
        ecc_restore();
    ecc_kept->stale = 0;
    ecc_take(u);
    ecc_start(ecc_kept->u, ecc_kept->y);
    ecc_kept->begun = ecc_kept->running = 1;
    ecc_give(y);
    return 0;
}

static int32_t ecc_do_step(const double *u, double *y)
{
    if (!ecc_kept || !ecc_kept->running)
        return ecc_failed("it is not initialized");
    /* The code begins a step with the rates it computed at the end of the last one, before the write. */
    if (ecc_kept->stale)
        ecc_rates();
    ecc_kept->stale = 0;
    ecc_take(u);
    ecc_advance(ecc_kept->u, ecc_kept->y);
    ecc_time += ECC_STEP;
    ecc_give(y);
    return ecc_stopped() ? 1 : 0;
}

static int32_t ecc_do_terminate(const double *u, double *y)
{
    (void) u;
    (void) y;
    if (ecc_kept && ecc_kept->running)
        ecc_finish(ecc_kept->u, ecc_kept->y);
    if (ecc_kept)
        ecc_kept->running = 0;
    return 0;
}

static int32_t ecc_do_static(const double *u, double *y)
{
    (void) u;
    (void) y;
    if (ecc_kept && ecc_kept->running) {
        ecc_statics();
        ecc_kept->stale = 1;
    }
    return 0;
}

/* Calls the model's own code; a model that would end the process has failed, as has one that throws. */
static int32_t ecc_call(int32_t (*call)(const double *, double *), const double *u, double *y)
{
    jmp_buf way;
    int32_t status;
    if (setjmp(way))
        return ecc_failed(ecc_ended_by);
    ecc_way_out = &way;
#ifdef __cplusplus
    try {
        status = call(u, y);
    } catch (const std::exception &thrown) {
        snprintf(ecc_ended_by, sizeof ecc_ended_by, "it threw an exception: %s", thrown.what());
        status = ecc_failed(ecc_ended_by);
    } catch (...) {
        status = ecc_failed("it threw what is no std::exception");
    }
#else
    status = call(u, y);
#endif
    ecc_way_out = NULL;
    return status;
}

int32_t ecc_initialize(const double *u, double *y) { return ecc_call(ecc_do_initialize, u, y); }
int32_t ecc_step(const double *u, double *y) { return ecc_call(ecc_do_step, u, y); }
int32_t ecc_terminate(void) { return ecc_call(ecc_do_terminate, NULL, NULL); }
int32_t ecc_static(void) { return ecc_call(ecc_do_static, NULL, NULL); }

double ecc_read(int32_t kind, int32_t index)
{
    if (!ecc_remember())
        return 0.0;
    switch (kind) {
    case 0:
        return (double) ecc_kept->u[index];
    case 1:
        return (double) ecc_kept->y[index];
    case 2:
        return ecc_kept->begun ? (double) ecc_parameters()[index] : ecc_kept->parameters[index];
    default:
        return ecc_kept->begun ? (double) ecc_states()[index] : ecc_state_starts[index];
    }
}

int32_t ecc_write(int32_t kind, int32_t index, double value)
{
    if (!ecc_remember())
        return -1;
    if (kind == 2) {
        ecc_kept->parameters[index] = value;
        ecc_kept->written[index] = 1;
        if (ecc_kept->begun)
            ecc_parameters()[index] = (ecc_real) value;
    } else if (ecc_kept->running) {
        ecc_states()[index] = (ecc_real) value;
    } else {
        return ecc_failed("a state can be written once the model is initialized");
    }
    ecc_kept->stale = 1;
    return 0;
}

/* Whether anything but a number may have this value; what cannot be asked is taken for an address. */
static int ecc_is_address(uint64_t value)
{
    unsigned char resident;
    uint64_t page = (uint64_t) sysconf(_SC_PAGESIZE);
    if (value < 65536 || value >> 48)
        return 0;
    return mincore((void *) (uintptr_t) (value / page * page), 1, &resident) == 0 || errno != ENOMEM;
}

/* Gives the model's state: every word that is not what it was when the model was loaded. Returns how many. */
int32_t ecc_save(ecc_word *words, int32_t most)
{
    int32_t count = 0;
    uint64_t place = 0, was, now;
    size_t at;
    int i;
    if (sizeof(void *) != 8 || !ecc_remember())
        return ecc_failed("the machine's words are not of 64 bits");
    for (i = 0; i <= ecc_kept->ranges; i++) {
        const ecc_range *range = &ecc_kept->range[i];
        for (at = 0; at < range->size; at += 8, place++) {
            memcpy(&was, (const char *) range->content + at, 8);
            memcpy(&now, range->place + at, 8);
            if (now == was)
                continue;
            if (count == most)
                return ecc_failed("it is too large");
            words[count].place = place;
            words[count].value = now;
            if (now >= ecc_kept->image && now < ecc_kept->image_end) {
                words[count].place |= ECC_ADDRESS;
                words[count].value -= ecc_kept->image;
            } else if (ecc_is_address(now)) {
                return ecc_failed("it holds the address of memory that is not its own");
            }
            count++;
        }
    }
    return count;
}

/* Puts a state back that ecc_save of the same shared object gave. */
int32_t ecc_load(const ecc_word *words, int32_t count)
{
    uint64_t place = 0, total = 0, first;
    int32_t next;
    int i;
    if (sizeof(void *) != 8 || !ecc_remember())
        return -1;
    for (i = 0; i <= ecc_kept->ranges; i++)
        total += ecc_kept->range[i].size / 8;
    for (next = 0; next < count; next++) {
        uint64_t value = words[next].value;
        first = place;
        place = words[next].place & ~ECC_ADDRESS;
        if (place >= total || (next > 0 && place <= first))
            return ecc_failed("the places of the words are not those of this model");
        if (words[next].place & ECC_ADDRESS ? value >= ecc_kept->image_end - ecc_kept->image : ecc_is_address(value))
            return ecc_failed("it holds the address of memory that is not the model's");
    }
    for (first = 0, next = 0, i = 0; i <= ecc_kept->ranges; first += ecc_kept->range[i++].size / 8) {
        ecc_range *range = &ecc_kept->range[i];
        memcpy(range->place, range->content, range->size);
        for (; next < count && (words[next].place & ~ECC_ADDRESS) < first + range->size / 8; next++) {
            uint64_t value = words[next].value + (words[next].place & ECC_ADDRESS ? ecc_kept->image : 0);
            memcpy(range->place + 8 * ((words[next].place & ~ECC_ADDRESS) - first), &value, 8);
        }
    }
    return 0;
}

const char *ecc_error(void)
{
    return ecc_kept ? ecc_kept->error : "there is no memory left";
}

#ifdef ECC_FILES
/* The model's data files, wherever the code looks for them; any other file is opened as ever. */
FILE *fopen(const char *path, const char *mode)
{
    FILE *(*other)(const char *, const char *);
    const char *name = path, *at;
    int i;
    for (at = path; *at; at++)
        if (*at == '/' || *at == '\\')
            name = at + 1;
    for (i = 0; i < ECC_FILES && *mode == 'r'; i++)
        if (!strcasecmp(name, ecc_files[i].name))
            return fmemopen((void *) ecc_files[i].content, ecc_files[i].size, "r");
    *(void **) &other = dlsym(RTLD_NEXT, "fopen");
    return other(path, mode);
}
#endif

#ifdef __cplusplus
}
#endif
