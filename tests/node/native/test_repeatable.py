# SPDX-License-Identifier: MIT
"""A second instance, a second start and another process compute the same, random numbers included."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from segway_ecc.node.native.load import load_native
from tests.fixtures.noisy import DRAWS, noisy, packed_binary
from tests.fixtures.twenty_sim.maker import Maker

SHAPES = pytest.mark.parametrize("shape", ["submodel", "cpp_class", "partial", "fmu"])
RUNS = """
import ctypes, sys
from pathlib import Path
from segway_ecc.node.native.load import load_native
libc = ctypes.CDLL(None)
libc.srand(int(sys.argv[2])), libc.srand48(int(sys.argv[2]))
one, two = (load_native(Path(sys.argv[1])) for _ in range(2))
def run(model):
    return [model.initialize([0.0])[0].hex(), *(model.step([0.0])[0].hex() for _ in range(8))]
first = run(one)
libc.rand(), libc.lrand48()
others = run(two), run(one), run(two)
assert others == (first, first, first), (first, others)
print(*first)
"""


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "compiled"))


def outputs(path: Path, seed: int = 1) -> list[str]:
    """The first output at nine moments, from a process of its own, once all its instances and starts agree."""
    words = [sys.executable, "-P", "-c", RUNS, str(path), str(seed)]
    return subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout.split()


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class", "partial", "fmu", "binary"])
def test_every_instance_start_and_process_draws_the_same(make: Maker, tmp_path: Path, shape: str) -> None:
    path = noisy(make, tmp_path, shape, DRAWS)
    found = outputs(path)
    assert len(set(found)) > 5
    assert outputs(path, seed=2) == found
    assert "it calls" not in str(load_native(path).description.warnings)


@pytest.mark.variants(1)
@SHAPES
def test_time_counts_the_models_own_seconds(make: Maker, tmp_path: Path, shape: str) -> None:
    model = load_native(noisy(make, tmp_path, shape, "return (double) time(NULL);"))
    found = [model.initialize([0.0])[0], *(model.step([0.0])[0] for _ in range(250))]
    if shape == "fmu":
        truth = load_native(noisy(make, tmp_path / "truth", shape, "return floor(t);"))
        assert found == [truth.initialize([0.0])[0], *(truth.step([0.0])[0] for _ in range(250))]
        assert found[-1] > 0.5
    else:
        assert found == [0.0, *(step // 4 for step in range(250))]


def test_a_function_of_the_models_own_is_the_one_it_calls(make: Maker, tmp_path: Path) -> None:
    path = noisy(make, tmp_path, "submodel", "return rand();")
    with (path / "noise.c").open("a", encoding="utf-8") as file:
        file.write("int rand(void) { return 7; }\n")
    assert load_native(path).initialize([0.0]) == [7.0]


def test_a_random_of_the_models_own_leaves_rand_as_it_is(make: Maker, tmp_path: Path) -> None:
    draws = "static int is_seeded; if (!is_seeded) srand(5); is_seeded = 1; return rand();"
    plain, own = (noisy(make, tmp_path / name, "submodel", draws) for name in ("plain", "own"))
    with (own / "noise.c").open("a", encoding="utf-8") as file:
        file.write("long random(void) { return 7; }\nvoid srandom(unsigned seed) { (void) seed; }\n")
    assert load_native(own).initialize([0.0]) == load_native(plain).initialize([0.0]) != [7.0]


OWNING = """#include <vector>
static std::vector<double> everywhere(10, 2.0);
double noise(double t);
double noise(double t)
{
    static std::vector<double> here(100, t);
    everywhere.resize(everywhere.size() + 1000, 3.0);
    here.resize(here.size() + 1000, t);
    return here.size() + everywhere[10] + everywhere.size() / 1e6;
}
"""


def test_objects_that_own_memory_are_made_anew_at_each_start(make: Maker, tmp_path: Path) -> None:
    """Their destructors run first: with their bytes put back as they were, they freed twice and ended the process."""
    path = noisy(make, tmp_path, "cpp_class", "return 0.0;")
    (path / "noise.cpp").write_text(OWNING, encoding="utf-8")
    first = 1100 + 3.0 + 1010 / 1e6
    assert outputs(path)[:2] == [first.hex(), (2100 + 3.0 + 2010 / 1e6).hex()]


OUTSIDE = """
    unsigned seed = (unsigned) getpid();
    return rand_r(&seed) + (getenv("HOME") != NULL) + syscall(1000);
"""
CLOCK = "struct timespec now; clock_gettime(CLOCK_REALTIME, &now); return clock() + now.tv_nsec;"
DEVICE = "return std::chrono::system_clock::now().time_since_epoch().count() + std::random_device()();"
REST = (
    "which nothing here seeds or repeats: "
    "its outputs may differ from run to run, from instance to instance and in a replay"
)


@pytest.mark.variants(1)
@pytest.mark.parametrize(
    ("shape", "body", "names"),
    [
        ("submodel", CLOCK, "clock, clock_gettime"),
        ("submodel", OUTSIDE, "getenv, getpid, rand_r, syscall"),
        ("cpp_class", DEVICE, "chrono, random_device"),
    ],
)
def test_what_cannot_be_repeated_is_warned_of(make: Maker, tmp_path: Path, shape: str, body: str, names: str) -> None:
    path = noisy(make, tmp_path, shape, body)
    for file in path.glob("noise.cpp"):
        file.write_text(f"#include <chrono>\n#include <random>\n{file.read_text()}", encoding="utf-8")
    assert load_native(path).description.warnings == (f"it calls {names}, {REST}",)


LINKED = {
    "lazily": ["-Wl,-z,lazy", "-Wl,-z,norelro"],
    "read-only": ["-Wl,-z,now", "-Wl,-z,relro"],
    "without a procedure linkage table": ["-fno-plt"],
}


@pytest.mark.variants(1)
@pytest.mark.parametrize("flags", LINKED.values(), ids=LINKED)
def test_a_binary_fmu_draws_its_own_numbers_however_it_is_linked(
    make: Maker, tmp_path: Path, flags: Sequence[str]
) -> None:
    body = "static int (*volatile drawn)(void) = rand; int one = drawn(); return one + rand() / 4e9 + time(NULL);"
    (tmp_path / "sources").mkdir()
    expected = outputs(noisy(make, tmp_path / "sources", "fmu", body))
    assert outputs(packed_binary(tmp_path, body, *flags), seed=5) == expected


def test_what_a_binary_fmu_cannot_repeat_is_warned_of(tmp_path: Path) -> None:
    body = "unsigned char bytes[1]; getentropy(bytes, 1); return rand() + time(NULL) + bytes[0] + clock();"
    path = packed_binary(tmp_path, body, "-D_DEFAULT_SOURCE", "-include", "unistd.h")
    assert load_native(path).description.warnings == (f"it calls clock, getentropy, {REST}",)
