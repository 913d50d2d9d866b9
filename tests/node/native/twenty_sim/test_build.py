# SPDX-License-Identifier: MIT
"""Compiling: once per content, never in the user's folder, and every failure in one line."""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native import compile as native_compile
from segway_ecc.node.native.load import load_native
from tests.fixtures.twenty_sim import generate, models
from tests.fixtures.twenty_sim.made import Layout
from tests.fixtures.twenty_sim.maker import Maker


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache that only this test uses."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "segway-ecc" / "models"


class Compilers:
    """Stand in for gcc and g++, and count how often they are run."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._log = folder / "runs"
        self._log.touch()
        for name in ("gcc", "g++"):
            script = folder / name
            script.write_text(
                f'#!/bin/sh\necho run >> "{self._log}"\nexec {shutil.which(name)} "$@"\n', encoding="utf-8"
            )
            script.chmod(0o755)
        monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")

    @property
    def runs(self) -> int:
        return self._log.read_text(encoding="utf-8").count("run")


@pytest.fixture
def compilers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Compilers:
    folder = tmp_path / "bin"
    folder.mkdir()
    return Compilers(folder, monkeypatch)


def state_of(folder: Path) -> list[tuple[str, str, int]]:
    return [
        (str(path.relative_to(folder)), hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    ]


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_a_model_is_compiled_once_wherever_it_lies(
    make: Maker, compilers: Compilers, tmp_path: Path, shape: str
) -> None:
    path = shutil.copytree(getattr(make, shape)(models.LIMITER).path, tmp_path / "here" / "limiter")
    load_native(path)
    runs = compilers.runs
    assert runs > 2
    load_native(path)
    load_native(path.rename(tmp_path / "elsewhere"))
    assert compilers.runs == runs


def test_a_change_of_any_file_compiles_it_again(make: Maker, compilers: Compilers, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.LIMITER).path, tmp_path / "limiter")
    load_native(path)
    runs = compilers.runs
    for name in ("xxmodel.c", "xxtypes.h"):
        with (path / name).open("a", encoding="utf-8") as file:
            file.write("/* changed */\n")
        load_native(path)
    assert compilers.runs == 3 * runs


def test_another_compiler_compiles_it_again(make: Maker, compilers: Compilers, tmp_path: Path) -> None:
    path = make.submodel(models.LIMITER).path
    load_native(path)
    runs = compilers.runs
    script = tmp_path / "bin" / "gcc"
    script.write_text(script.read_text(encoding="utf-8") + "# another version\n", encoding="utf-8")
    load_native(path)
    assert compilers.runs == 2 * runs


def test_other_flags_compile_it_again(make: Maker, compilers: Compilers, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make.submodel(models.LIMITER).path
    load_native(path)
    runs = compilers.runs
    monkeypatch.setattr(native_compile, "SAME_BITS", ())
    load_native(path)
    assert compilers.runs == 2 * runs


LOADING = """
import sys
from pathlib import Path
from segway_ecc.node.native.load import load_native
model = load_native(Path(sys.argv[1]))
print(model.initialize([0.1]), [model.step([0.1]) for _ in range(10)])
"""


def test_two_processes_at_once_do_not_break_each_other(make: Maker, cache: Path) -> None:
    command = [sys.executable, "-c", LOADING, str(make.submodel(models.LIMITER).path)]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
    outputs = [process.communicate()[0] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert outputs[0] == outputs[1] != b""
    assert len(list(cache.iterdir())) == 1


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class", "partial"])
def test_the_users_folder_is_only_read(make: Maker, tmp_path: Path, shape: str) -> None:
    path = shutil.copytree(getattr(make, shape)(models.LIMITER).path, tmp_path / "limiter")
    before = state_of(path)
    path.chmod(0o555)
    load_native(path)
    path.chmod(0o755)
    assert state_of(path) == before


@pytest.mark.variants(1)
@pytest.mark.parametrize("layout", list(Layout))
def test_paths_may_hold_any_character(tmp_path: Path, layout: Layout) -> None:
    folder = tmp_path / 'Übung 3 "für" Peter\'s $HOME'
    load_native(generate.cpp_class(models.LIMITER, folder / "klasse", layout).path).initialize([1.0])
    load_native(generate.submodel(models.LIMITER, folder / "c").path).initialize([1.0])


def test_headers_under_another_spelling_are_found(make: Maker) -> None:
    assert load_native(make.variant("wrong_case_header").path).initialize([0.0]) == [10.0]


@pytest.mark.variants(1)
@pytest.mark.parametrize("gone", ["MotionProfiles", "EulerAngles"])
def test_headers_that_only_declare_what_is_not_called_are_supplied(make: Maker, tmp_path: Path, gone: str) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    code = path / "xxsubmod.c"
    text = code.read_text(encoding="utf-8")
    if f'"{gone}.h"' not in text:
        code.write_text(f'#include "{gone}.h"\n{text}', encoding="utf-8")
    for file in path.glob(f"{gone}.*"):
        file.unlink()
    assert load_native(path).initialize([0.0]) == [10.0]


def test_copies_are_not_compiled(make: Maker) -> None:
    assert load_native(make.variant("build_copies").path).parameters[0].value == 10.0


def test_what_the_code_warns_of_is_listed_also_from_the_cache(make: Maker, compilers: Compilers) -> None:
    path = make.variant("algebraic_loop").path
    first = load_native(path).description.warnings
    runs = compilers.runs
    assert len(first) == 1
    assert "algebraic loop" in first[0]
    assert first[0].startswith("xx")
    assert load_native(path).description.warnings == first
    assert compilers.runs == runs


def test_a_function_that_is_nowhere_is_named(make: Maker, cache: Path) -> None:
    text = (
        r"^the model in .* calls drive_characteristic, which no file there defines: "
        r"add the source of the library it is in; the whole output is in (.*)$"
    )
    with pytest.raises(ModelError, match=text) as caught:
        load_native(make.variant("missing_dll").path)
    (log,) = cache.glob("*.log")
    assert str(caught.value).endswith(str(log))
    assert "undefined reference" in log.read_text(encoding="utf-8")
    assert list(cache.iterdir()) == [log]


def test_a_function_of_the_user_comes_along(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.variant("missing_dll").path, tmp_path / "dll")
    (path / "drive.c").write_text("double drive_characteristic (double x) { return 2.0 * x; }", encoding="utf-8")
    model = load_native(path)
    assert model.description.warnings == ()
    assert model.initialize([0.75]) == [1.5]


def test_an_undeclared_function_is_reported(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.variant("missing_dll").path, tmp_path / "dll")
    (path / "drive.c").write_text("double drive_characteristic (double x) { return 2.0 * x; }", encoding="utf-8")
    file = path / "xxfuncs.h"
    text = file.read_text(encoding="utf-8")
    declaration = "XXDouble drive_characteristic (XXDouble argument);"
    assert declaration in text
    file.write_text(text.replace(declaration, ""), encoding="utf-8")
    (warning,) = load_native(path).description.warnings
    assert warning == (
        "xxmodel.c calls drive_characteristic without declaring it, so that C takes its result for a whole number"
    )


def test_functions_of_20_sim_that_were_not_copied_are_named(make: Maker) -> None:
    text = r"calls XXMatrixMul, .*, which no file there defines: copy the rest of 20-sim's files too; "
    with pytest.raises(ModelError, match=text):
        load_native(make.partial(models.MATRICES).path, method="RungeKutta4")


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (
            '#include "drive.h"',
            r"^xxmodel.c in .* includes drive.h, which is not there: add it; the whole output is in ",
        ),
        (
            "int x = ;",
            r"^the model in .* does not compile: xxmodel.c:1:9: error: expected expression before ';' token; ",
        ),
    ],
)
def test_code_that_does_not_compile_is_reported_in_one_line(make: Maker, tmp_path: Path, line: str, text: str) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    file = path / "xxmodel.c"
    file.write_text(f"{line}\n{file.read_text(encoding='utf-8')}", encoding="utf-8")
    with pytest.raises(ModelError, match=text) as caught:
        load_native(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_without_a_compiler_the_package_is_named(
    make: Maker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: str
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    language, package = {"submodel": ("C", "gcc"), "cpp_class": (r"C\+\+", r"g\+\+")}[shape]
    text = rf"^there is no {language} compiler here: sudo apt install {package} libc6-dev$"
    with pytest.raises(ModelError, match=text):
        load_native(getattr(make, shape)(models.TANK).path)


def test_a_compiler_that_cannot_be_run_is_named(make: Maker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gcc").write_text("#!/no/such/interpreter\n", encoding="utf-8")
    (tmp_path / "gcc").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ModelError, match=r"^cannot run the compiler .*/gcc: "):
        load_native(make.submodel(models.TANK).path)
