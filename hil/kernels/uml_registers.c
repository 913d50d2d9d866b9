/* SPDX-License-Identifier: MIT */
/* Lets user-mode Linux 6.1 run on a processor whose register state is larger than it has room for (AMX: 11,008 bytes).
 *
 * It restores the first 2,696 bytes of a process' extended state. Since Linux 5.14 the host refuses to restore less
 * than all of it (arch/x86/kernel/fpu/regset.c, xstateregs_set), and the guest's first process ends in SIGSEGV. Here
 * the rest is filled in from the state that the process has. Loaded before the C library (LD_PRELOAD).
 */
#define _GNU_SOURCE
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#define LARGEST_STATE_BYTES 65536

long ptrace(enum __ptrace_request request, ...)
{
    static _Thread_local unsigned char state[LARGEST_STATE_BYTES];
    va_list arguments;
    va_start(arguments, request);
    long process = va_arg(arguments, long);
    long address = va_arg(arguments, long);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if ((int)request == PTRACE_SETREGSET && address == NT_X86_XSTATE) {
        const struct iovec *part = data;
        struct iovec whole = {state, sizeof state};
        if (syscall(SYS_ptrace, PTRACE_GETREGSET, process, address, &whole) < 0)
            return -1;
        if (part->iov_len < whole.iov_len) {
            memcpy(state, part->iov_base, part->iov_len);
            return syscall(SYS_ptrace, PTRACE_SETREGSET, process, address, &whole);
        }
    }
    if ((int)request >= PTRACE_PEEKTEXT && (int)request <= PTRACE_PEEKUSER) {
        /* The system call stores the word; the C library's function returns it. */
        long word = 0;
        long result = syscall(SYS_ptrace, request, process, address, &word);
        if (result < 0)
            return result;
        errno = 0;
        return word;
    }
    return syscall(SYS_ptrace, request, process, address, data);
}
