/* SPDX-License-Identifier: MIT */
/* Functions for the library of one FMU in place of the C library's: random numbers and the time of repeatable.c, and of
 * ending.h what would end the process; all in this shim, of which each FMU has one.
 *
 * Part of shim.c, which alone includes it. The loader has bound what the library calls to the C library, which all of the
 * process share; its entries in the global offset table are bound anew here (System V ABI, chapter 5: relocation). That
 * is sound because each instance has a copy of the library to itself. What runs while the library loads, as constructors
 * of C++ do, still draws from the process, and may end it.
 */

#include <elf.h>
#include <link.h>
#include <sys/mman.h>
#include <unistd.h>

#define ECC_SYSCALL ecc_syscall
#define ECC_REAL_SYSCALL syscall
#include "../ending.h"

#if defined(__GLIBC__) && (defined(__x86_64__) || defined(__aarch64__))
#include "../repeatable.c"

#ifdef __x86_64__
enum { SLOT = R_X86_64_JUMP_SLOT, DATA = R_X86_64_GLOB_DAT, WORD = R_X86_64_64 };
#else
enum { SLOT = R_AARCH64_JUMP_SLOT, DATA = R_AARCH64_GLOB_DAT, WORD = R_AARCH64_ABS64 };
#endif

/* ISO C keeps pointers to functions apart from others; POSIX, which has dlsym, does not. */
#define OURS(name) {#name, (uintptr_t)&name}
static const struct {
    const char *name;
    uintptr_t address;
} own_functions[] = {OURS(rand),    OURS(srand),   OURS(random),  OURS(srandom), OURS(drand48),
                     OURS(lrand48), OURS(mrand48), OURS(srand48), OURS(time),
                     OURS(exit),    OURS(_exit),   OURS(_Exit),   OURS(quick_exit),
                     OURS(abort),   OURS(__assert_fail), {"syscall", (uintptr_t)&ecc_syscall}};

/* A table that the dynamic section names; the GNU C library has added the base address there, others have not. */
static uintptr_t placed(const struct link_map *map, ElfW(Addr) address) {
    return address < map->l_addr ? address + map->l_addr : address;
}

static int rebind(const struct link_map *map, const ElfW(Rela) *entry, const ElfW(Sym) *symbols, const char *names) {
    const ElfW(Sym) *symbol = &symbols[ELF64_R_SYM(entry->r_info)];
    uint32_t kind = (uint32_t)ELF64_R_TYPE(entry->r_info);
    if ((kind != SLOT && kind != DATA && kind != WORD) || symbol->st_shndx != SHN_UNDEF) {
        return 0;
    }
    for (size_t i = 0; i < sizeof own_functions / sizeof *own_functions; i++) {
        if (strcmp(&names[symbol->st_name], own_functions[i].name) == 0) {
            uintptr_t target = map->l_addr + entry->r_offset, inside = target % (uintptr_t)sysconf(_SC_PAGESIZE);
            uintptr_t address = own_functions[i].address + (kind == WORD ? (uintptr_t)entry->r_addend : 0);
            /* The loader may have made the table read-only (RELRO). */
            if (mprotect((void *)(target - inside), inside + sizeof address, PROT_READ | PROT_WRITE) != 0) {
                return -1;
            }
            memcpy((void *)target, &address, sizeof address);
        }
    }
    return 0;
}

/* Binds them, as in a fresh process; returns -1 where memory cannot be written. */
static int use_own_functions(void *library) {
    struct link_map *map;
    uintptr_t symbols = 0, names = 0, tables[2] = {0, 0};
    size_t sizes[2] = {0, 0};
    memset(&ecc_random, 0, sizeof ecc_random);
    memset(&ecc_random48, 0, sizeof ecc_random48);
    ecc_time = 0.0;
    if (dlinfo(library, RTLD_DI_LINKMAP, &map) != 0) {
        return -1;
    }
    for (const ElfW(Dyn) *each = map->l_ld; each->d_tag != DT_NULL; each++) {
        switch (each->d_tag) {
        case DT_SYMTAB: symbols = placed(map, each->d_un.d_ptr); break;
        case DT_STRTAB: names = placed(map, each->d_un.d_ptr); break;
        case DT_RELA: tables[0] = placed(map, each->d_un.d_ptr); break;
        case DT_RELASZ: sizes[0] = each->d_un.d_val; break;
        case DT_JMPREL: tables[1] = placed(map, each->d_un.d_ptr); break;
        case DT_PLTRELSZ: sizes[1] = each->d_un.d_val; break;
        default: break;
        }
    }
    for (int table = 0; table < 2; table++) {
        const ElfW(Rela) *entries = (const ElfW(Rela) *)tables[table];
        for (size_t i = 0; i < sizes[table] / sizeof *entries; i++) {
            if (rebind(map, &entries[i], (const ElfW(Sym) *)symbols, (const char *)names) < 0) {
                return -1;
            }
        }
    }
    return 0;
}
#else
static double ecc_time;
static int use_own_functions(void *library) {
    (void)library;
    return 0;
}
#endif
