# SPDX-License-Identifier: MIT
"""A model compiled for arm64 is bit-identical to x86-64, run by QEMU's user mode: it emulates the processor exactly."""

import struct
import subprocess
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native import compile as native_compile
from segway_ecc.node.native.compile import compile_c
from segway_ecc.node.native.load import load_native
from tests.fixtures.twenty_sim import models
from tests.fixtures.twenty_sim.maker import Maker

pytestmark = pytest.mark.arm64
STEPS = 10_000
STATE = r"PID1\uD_previous"
DRIVER = """
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
int main(int count, char **arguments) {
    void *model = dlopen(arguments[1], RTLD_NOW);
    int (*initialize)(double *, double *) = model ? dlsym(model, "ecc_initialize") : NULL;
    int (*step)(double *, double *) = model ? dlsym(model, "ecc_step") : NULL;
    double (*read)(int32_t, int32_t) = model ? dlsym(model, "ecc_read") : NULL;
    if (!read)
        return fprintf(stderr, "%s\\n", dlerror()), 1;
    for (int k = 0; k <= STEPS; k++) {
        double u[] = {k % 100 / 256.0, k % 77 / 512.0}, values[2];
        k ? step(u, values) : initialize(u, values);
        values[1] = read(3, 0);
        fwrite(values, sizeof values, 1, stdout);
    }
}
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache that only this test uses."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "segway-ecc" / "models"


def emulated(program: Path, *arguments: str) -> "subprocess.CompletedProcess[bytes]":
    words = ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu", str(program), *arguments]
    return subprocess.run(words, capture_output=True, check=False)


def compile_for_arm64(monkeypatch: pytest.MonkeyPatch, target: Path, source: str) -> Path:
    monkeypatch.setenv("CC", "aarch64-linux-gnu-gcc")
    words = ["-O2", f"-DSTEPS={STEPS}", "-x", "c", "-", "-o", str(target), "-ldl"]
    compile_c(words, target.name, source.encode())
    return target


def differences(make: Maker, cache: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """How many of the output and a state of a PID controller differ between the processors, to the last bit."""
    path = make.submodel(models.PID).path
    model = load_native(path)
    here = list[float]()
    for k in range(STEPS + 1):
        u = [k % 100 / 256.0, k % 77 / 512.0]
        (out,) = model.step(u) if k else model.initialize(u)
        here += [out, model.read(STATE)]
    model.library_path.unlink()
    driver = compile_for_arm64(monkeypatch, cache / "driver", DRIVER)
    with pytest.raises(ModelError, match="cannot load the compiled model"):
        load_native(path)  # compiled with the compiler for arm64
    (library,) = cache.glob("*/model.so")
    done = emulated(driver, str(library))
    assert done.returncode == 0, done.stderr
    there = struct.iter_unpack("8s", done.stdout)
    return sum(struct.pack("<d", one) != two for one, (two,) in zip(here, there, strict=True))


def test_a_controller_is_bit_identical(make: Maker, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert differences(make, cache, monkeypatch) == 0


def test_without_our_flags_a_controller_differs(make: Maker, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_compile, "SAME_BITS", ())
    # By gcc 12.2, 4,141 of 20,002.
    assert differences(make, cache, monkeypatch) > STEPS / 100


@pytest.mark.parametrize(("flags", "exit_code"), [(native_compile.SAME_BITS, 0), ((), 1)], ids=["ours", "none"])
def test_a_plain_char_has_a_sign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: tuple[str, ...], exit_code: int
) -> None:
    monkeypatch.setattr(native_compile, "SAME_BITS", flags)
    source = "int main(void) { volatile char boolean = -1; return boolean != -1; }"
    assert emulated(compile_for_arm64(monkeypatch, tmp_path / "sign", source)).returncode == exit_code


DRAWING = """
#include <stdlib.h>
#include <time.h>
double draw(void) {
    static int (*volatile drawn)(void) = rand;
    double sum = drawn(); /* one after the other: within an expression any order is allowed */
    sum = 0.7 * sum + rand();
    sum = 0.7 * sum + random();
    return sum + drand48() + time(NULL);
}
"""
BINDING = f"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "{Path(native_compile.__file__).with_name("fmu")}/own_functions.h"
int main(int count, char **arguments) {{
    void *library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
    double (*draw)(void) = library ? dlsym(library, "draw") : NULL;
    if (!draw || use_own_functions(library) != 0)
        return 1;
    ecc_time = 3.0;
    printf("%a\\n", draw());
}}
"""


@pytest.mark.compiler
@pytest.mark.parametrize("flags", [("-Wl,-z,now", "-Wl,-z,relro"), ("-Wl,-z,lazy",), ("-fno-plt",)])
def test_a_library_draws_the_shims_numbers_on_both_processors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: tuple[str, ...]
) -> None:
    found = []
    for compiler, before in ((None, ()), ("aarch64-linux-gnu-gcc", ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"))):
        if compiler:
            monkeypatch.setenv("CC", compiler)
        library, program = tmp_path / f"{compiler}.so", tmp_path / f"{compiler}"
        compile_c(["-shared", "-fPIC", *flags, "-x", "c", "-", "-o", str(library)], "a library", DRAWING.encode())
        compile_c(["-w", "-x", "c", "-", "-o", str(program), "-ldl"], "a program", BINDING.encode())
        found += [subprocess.run([*before, program, library], check=True, capture_output=True, text=True).stdout]
    assert found[0] == found[1] != ""
