# SPDX-License-Identifier: MIT
"""A native model that would end the process has failed instead: with a reason, and as often as it is asked."""

import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.library import NativeModel
from segway_ecc.node.native.load import load_native
from tests.fixtures.noisy import noisy
from tests.fixtures.twenty_sim.maker import Maker

LATER = "static int calls; if (calls++ > 20) {{ {} }} return 1.0;"
"""So late that it is in a step, whatever the shape makes of a step."""
ENDINGS = {
    "exit(0);": "it called exit(0), which would end the process",
    "_exit(0);": "it called _exit(0), which would end the process",
    "syscall(SYS_exit_group, 0);": "it called the system call exit_group(0), which would end the process",
    "quick_exit(4);": "it called quick_exit(4), which would end the process",
    "abort();": "it called abort(), which would end the process",
    "assert(calls < 20);": "its assertion 'calls < 20' does not hold (",
}
CHOSEN = "ENDING"
"""The variable that chooses among them in a model that has them all, which is compiled once for each shape."""
CHOICE = " ".join(f"case {place}: {call} break;" for place, call in enumerate(ENDINGS))
THROWS = "#include <stdexcept>\ndouble noise(double t)\n{{ static int calls; if (calls++ > 20) throw {}; return t; }}\n"


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "compiled"))


def run(model: NativeModel) -> None:
    """Many steps."""
    model.initialize([0.0])
    for _ in range(100):
        model.step([0.0])


def failure(path: Path) -> str:
    """Why the model's steps end."""
    with pytest.raises(ModelError) as raised:
        run(load_native(path))
    return str(raised.value)


@pytest.fixture(scope="module", params=["submodel", "cpp_class", "partial", "fmu", "binary"])
def ending(make: Maker, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    choice = f'switch (atoi(getenv("{CHOSEN}"))) {{ {CHOICE} }}'
    return noisy(make, tmp_path_factory.mktemp("ending"), request.param, LATER.format(choice))


@pytest.mark.variants(6)
@pytest.mark.parametrize("call", ENDINGS)
def test_a_step_that_would_end_the_process_fails(ending: Path, call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CHOSEN, str(list(ENDINGS).index(call)))
    assert ENDINGS[call] in failure(ending)


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class", "binary"])
def test_other_system_calls_by_number_are_made_as_they_are(make: Maker, tmp_path: Path, shape: str) -> None:
    writes = "syscall(SYS_pipe2, ends, O_CLOEXEC); syscall(SYS_write, ends[1], &c, 1L); c = 0;"
    ends = "close(ends[0]); close(ends[1]); assert(syscall(1000) == -1); return c;"
    body = f"int ends[2]; char c = 7; {writes} assert(syscall(SYS_read, ends[0], &c, 1L) == 1 && c == 7); {ends}"
    run(load_native(noisy(make, tmp_path, shape, body)))


def test_initial_equations_that_would_end_the_process_fail(make: Maker, tmp_path: Path) -> None:
    path = noisy(make, tmp_path, "submodel", "exit(0);")
    with pytest.raises(ModelError, match=r"it called exit\(0\)"):
        load_native(path).initialize([0.0])


@pytest.mark.variants(1)
@pytest.mark.parametrize(
    ("thrown", "reason"),
    [('std::runtime_error("no root")', "it threw an exception: no root"), ("7", "it threw what is no std::exception")],
)
def test_an_exception_of_cpp_fails_the_step(make: Maker, tmp_path: Path, thrown: str, reason: str) -> None:
    path = noisy(make, tmp_path, "cpp_class", "return 0.0;")
    (path / "noise.cpp").write_text(THROWS.format(thrown), encoding="utf-8")
    assert reason in failure(path)


def test_a_model_that_failed_so_can_be_initialized_again(make: Maker, tmp_path: Path) -> None:
    model = load_native(noisy(make, tmp_path, "submodel", LATER.format("exit(0);")))
    for _ in range(2):
        with pytest.raises(ModelError):
            run(model)
    assert model.initialize([0.0]) == [1.0]


def test_a_function_of_the_models_own_is_the_one_it_calls(make: Maker, tmp_path: Path) -> None:
    path = noisy(make, tmp_path, "submodel", "return 0.0;")
    own = "static double x;\nvoid quick_exit(int status);\nvoid quick_exit(int status) { x = status; }\n"
    calls = "double noise(double t);\ndouble noise(double t) { (void) t; quick_exit(5); return x; }\n"
    (path / "noise.c").write_text(own + calls, encoding="utf-8")
    assert load_native(path).initialize([0.0]) == [5.0]


def test_a_process_that_ends_by_itself_does_so_with_its_own_code(make: Maker, tmp_path: Path) -> None:
    path = noisy(make, tmp_path, "submodel", LATER.format("exit(0);"))
    program = (
        "import ctypes, sys; from pathlib import Path; from segway_ecc.node.native.load import load_native\n"
        "model = load_native(Path(sys.argv[1])); model.initialize([0.0]); ctypes.CDLL(None).exit(9)"
    )
    assert subprocess.run([sys.executable, "-P", "-c", program, str(path)], check=False).returncode == 9
