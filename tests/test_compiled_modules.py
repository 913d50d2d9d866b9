# SPDX-License-Identifier: MIT
"""The modules that a compiled wheel compiles, by what can be read from the source; `make test-compiled` runs them."""

import ast
from collections.abc import Iterator, Mapping

import pytest

from tests.compiled_modules import COMPILED, HOOK, PROJECT, ROOT, WHEEL

Trees = Mapping[str, ast.Module]


# Read where they are used, and not kept: each worker collects this file.
@pytest.fixture(scope="module")
def trees() -> Trees:
    return {
        str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8"))
        for package in WHEEL["packages"]
        for room in sorted((ROOT / package).iterdir())
        for path in ([room] if room.suffix == ".py" else sorted(room.rglob("*.py")))
    }


def test_nothing_is_compiled_unless_asked_for() -> None:
    assert HOOK["enable-by-default"] is False


@pytest.mark.parametrize("path", COMPILED)
def test_a_module_that_is_compiled_is_there(path: str, trees: Trees) -> None:
    assert path in trees


def test_the_list_is_sorted_and_has_each_module_once() -> None:
    assert sorted(set(COMPILED)) == COMPILED


def _classes(tree: ast.Module) -> Iterator[ast.ClassDef]:
    return (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef))


def _is_open(kind: ast.ClassDef) -> bool:
    """Whether classes in plain Python may build on it: it says so, or mypyc leaves it a class of Python."""
    bases = {ast.unparse(base) for base in kind.bases}
    is_python = bases & {"Protocol", "NamedTuple", "enum.Enum", "enum.StrEnum", "enum.IntEnum", "enum.IntFlag"}
    return bool(is_python) or any("allow_interpreted_subclasses=True" in ast.unparse(d) for d in kind.decorator_list)


def _built_on_ours(tree: ast.Module) -> Iterator[tuple[ast.ClassDef, str]]:
    """Each class of a file, with the name of each class of ours that it imports and builds on."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules = {name.asname or name.name: (node.module or "", name.name) for node in imports for name in node.names}
    for kind in _classes(tree):
        for base in kind.bases:
            named = base.value if isinstance(base, ast.Subscript) else base
            module, name = modules.get(ast.unparse(named), ("", ""))
            if module.startswith("segway_ecc"):
                yield kind, name


def test_no_class_in_plain_python_builds_on_one_that_is_compiled(trees: Trees) -> None:
    """It would be refused with a TypeError, at its first use; also one of the tests or of the examples."""
    closed = {kind.name for path in COMPILED for kind in _classes(trees[path]) if not _is_open(kind)}
    others = {
        str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8"))
        for folder in ("tests", "examples")
        for path in sorted((ROOT / folder).rglob("*.py"))
    }
    plain = {path: tree for path, tree in trees.items() if path not in COMPILED} | others
    breaches = [
        f"{path}:{kind.lineno} {kind.name} builds on {base}"
        for path, tree in plain.items()
        for kind, base in _built_on_ours(tree)
        if base in closed
    ]
    assert not breaches, "\n".join(sorted(breaches))


def test_a_class_that_builds_on_one_of_ours_is_found() -> None:
    tree = ast.parse(
        "from segway_ecc.drives import Freshness as F, PhasedDrive\n"
        "from elsewhere import Link\n"
        "class Sum: ...\n"
        "class A(PhasedDrive): ...\n"
        "class B(F[str]): ...\n"
        "class C(Sum, Link): ...\n"
    )
    assert [(kind.name, base) for kind, base in _built_on_ours(tree)] == [("A", "PhasedDrive"), ("B", "Freshness")]


@pytest.mark.parametrize("path", COMPILED)
def test_no_class_that_is_compiled_has_options_of_its_own(path: str, trees: Trees) -> None:
    """mypyc drops them without a word: they are inherited from `segway_ecc.firmware_io.value.Value`."""
    for kind in _classes(trees[path]):
        options = {keyword.arg for keyword in kind.keywords}
        assert not options or (options == {"frozen"} and ast.unparse(kind.bases[0]) == "Value"), kind.name


@pytest.mark.parametrize("path", COMPILED)
def test_no_tuple_of_floats_is_final_without_a_wider_type(path: str, trees: Trees) -> None:
    """Compiled, reading it raises NameError (mypyc issue 1183): write `Final[Sequence[float]]`."""
    for node in trees[path].body:
        match node:
            case ast.AnnAssign(annotation=ast.Name(id="Final"), value=ast.Tuple([ast.Constant(float()), *_])):
                pytest.fail(f"{path}:{node.lineno} is a Final tuple that begins with a float")


def test_no_module_that_is_compiled_is_run_as_a_program() -> None:
    """`python -m` finds no code in what is compiled."""
    assert not [path for path in COMPILED if "__main__" in (ROOT / path).read_text(encoding="utf-8")]


def test_source_distribution_carries_every_room_behind_a_link() -> None:
    """hatchling puts a folder in once, at its first path; without the rest an sdist has no rooms."""
    links = {f"{package}/{path.name}" for package in WHEEL["packages"] for path in (ROOT / package).iterdir()}
    links = {name for name in links if (ROOT / name).is_symlink()}
    included = PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["force-include"]
    assert links
    assert included == {name: name for name in links}
