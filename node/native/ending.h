/* SPDX-License-Identifier: MIT */
/* What would end the process ends the call into the model instead, which then fails: exit and its kin, also by the
   number of the system call, abort, and an assertion that does not hold.

   Part of a shim, for one instance of a model, whose calls these functions take in place of the C library's; a function
   of the model's own under one of these names is the one that it calls. Outside a call of ours, as in a thread that the
   model has started, they are the C library's.

   In thread-local memory: what lies in the rest of the model's is its state. */

#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <dlfcn.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/syscall.h>

static __thread jmp_buf *ecc_way_out; /* of the call into the model that this thread is in */
static __thread char ecc_ended_by[240];

#define ECC_STAND_IN extern __attribute__((weak, noreturn))
#ifdef __cplusplus
extern "C" {
#endif

static void ecc_leave(void)
{
    jmp_buf *way = ecc_way_out;
    ecc_way_out = NULL;
    if (way)
        longjmp(*way, 1);
}

static void ecc_leave_by(const char *name, int status)
{
    snprintf(ecc_ended_by, sizeof ecc_ended_by, "it called %s(%d), which would end the process", name, status);
    ecc_leave();
}

#define ECC_EXIT(name)                                                    \
    ECC_STAND_IN void name(int status)                                    \
    {                                                                     \
        void (*other)(int);                                               \
        ecc_leave_by(#name, status);                                      \
        *(void **) &other = dlsym(RTLD_NEXT, #name);                      \
        other(status);                                                    \
        __builtin_trap();                                                 \
    }
ECC_EXIT(exit)
ECC_EXIT(_exit)
ECC_EXIT(_Exit)
ECC_EXIT(quick_exit)

ECC_STAND_IN void abort(void)
{
    void (*other)(void);
    snprintf(ecc_ended_by, sizeof ecc_ended_by, "it called abort(), which would end the process");
    ecc_leave();
    *(void **) &other = dlsym(RTLD_NEXT, "abort");
    other();
    __builtin_trap();
}

#ifdef ECC_SYSCALL
/* In place of ECC_REAL_SYSCALL, for who ends the process, or the loop's thread, by the number of the system call. */
long ECC_REAL_SYSCALL(long number, ...);
long ECC_SYSCALL(long number, ...);
long ECC_SYSCALL(long number, ...)
{
    long a[6];
    va_list given;
    va_start(given, number);
    for (int i = 0; i < 6; i++) /* as many as there can be: the C library's function passes all on as well */
        a[i] = va_arg(given, long);
    va_end(given);
    if (number == SYS_exit_group || number == SYS_exit)
        ecc_leave_by(number == SYS_exit ? "the system call exit" : "the system call exit_group", (int) a[0]);
    return ECC_REAL_SYSCALL(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}
#endif

/* What the macro assert calls, of the C library's ABI. */
ECC_STAND_IN void __assert_fail(const char *text, const char *file, unsigned int line, const char *function)
{
    void (*other)(const char *, const char *, unsigned int, const char *);
    snprintf(ecc_ended_by, sizeof ecc_ended_by, "its assertion '%s' does not hold (%s:%u)", text, file, line);
    ecc_leave();
    *(void **) &other = dlsym(RTLD_NEXT, "__assert_fail");
    other(text, file, line, function);
    __builtin_trap();
}

#ifdef __cplusplus
}
#endif
