# SPDX-License-Identifier: MIT
"""The arrows between rooms, packages and files, read from the source: every import, at the head of a file or within."""

import ast
import graphlib
import itertools
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
NAMESPACE = "segway_ecc"
FLOORS = ("firmware_io", "node", "deploy", "hil")
"""The rooms from the lowest to the highest; an arrow points down."""

ROS = ("rclpy", "ament_index_python", "builtin_interfaces", "rosidl_runtime_py", "tf2_ros", "std_srvs", "*_msgs")


class Import(NamedTuple):
    """A name that a file imports, or names in a call that imports."""

    file: str
    line: int
    module: str
    name: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line} imports {self.name}"


class Rule(NamedTuple):
    """Modules, and what they may not import; names may end in a star, or begin with one."""

    modules: tuple[str, ...]
    forbidden: tuple[str, ...]
    but_not_in: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()


def ours(*names: str) -> tuple[str, ...]:
    return tuple(f"{NAMESPACE}.{name}" for name in names)


RULES = {
    "firmware_io knows no ROS": Rule(ours("firmware_io"), ROS),
    "models and safety know no I/O and no clock": Rule(
        ours("node.model", "node.models", "node.safety"),
        (*ours("firmware_io"), "time", "socket", "subprocess", "can", *ROS),
        # how a value is made, and the root of all errors
        allowed=ours("firmware_io.value", "firmware_io.errors"),
    ),
    "the cycle knows no ROS": Rule(ours("node.cycle"), (*ours("node.ros"), *ROS)),
    "ROS packages are imported by the ROS stage and the archive's service only": Rule(
        ours(*FLOORS),
        ROS,
        but_not_in=ours("node.ros", "deploy.support.archive_service", "hil.bench.programs"),
    ),
    "simulation knows no safety, ROS or command line": Rule(
        ours("hil.rig", "hil.devices", "hil.plants", "hil.faults"), ours("node.safety", "node.ros", "node.cli")
    ),
    "only verbs, and what runs verbs, know the command line": Rule(
        ours(*FLOORS),
        ours("node.cli"),
        but_not_in=ours(
            "node.cli",
            "node.verbs",
            "deploy.verbs",
            "hil.verbs",
            "hil.bench.ours",
            "hil.commission.spin",
            "hil.drill.stepped_clock",
            "hil.growth.robot",
            "hil.latency.same_process",
        ),
    ),
    "verbs are found by entry point": Rule(
        ours(*FLOORS),
        ours("node.verbs", "deploy.verbs", "hil.verbs"),
        but_not_in=ours("node.verbs", "deploy.verbs", "hil.verbs", "hil.bench.ours"),
    ),
    "nothing imports tests": Rule((NAMESPACE,), ("tests", "conftest", "pytest", "hypothesis", "cantools")),
}


def _sources() -> dict[str, Path]:
    """Every module of the product by its dotted name."""
    paths = [path for room in FLOORS for path in sorted((ROOT / room).rglob("*.py"))]
    paths += sorted((ROOT / NAMESPACE).glob("*.py"))
    return {_module(path): path for path in paths}


def _module(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    within = parts[1:] if parts[0] == NAMESPACE else parts
    return ".".join((NAMESPACE, *within)).removesuffix(".__init__")


SOURCES = _sources()

Trees = Mapping[str, ast.Module]
Imports = Mapping[str, tuple[Import, ...]]


# Read where they are used, and not kept: each worker collects this file, and walks through what it keeps.
@pytest.fixture(scope="module")
def trees() -> Trees:
    return {module: ast.parse(path.read_text(encoding="utf-8")) for module, path in SOURCES.items()}


@pytest.fixture(scope="module")
def imports(trees: Trees) -> Imports:
    return {module: tuple(_imports(module, tree)) for module, tree in trees.items()}


def _within(module: str, pattern: str) -> bool:
    """Whether a module is `pattern` or below it."""
    if pattern.startswith("*"):
        return module.split(".", maxsplit=1)[0].endswith(pattern[1:])
    return module == pattern or module.startswith(f"{pattern}.")


def _within_any(module: str, patterns: tuple[str, ...]) -> bool:
    return any(_within(module, pattern) for pattern in patterns)


def _named(node: ast.AST) -> Iterator[str]:
    """The modules that a node imports; of `from a import b` both a and a.b, since b may be a module."""
    match node:
        case ast.Import(names=names):
            yield from (alias.name for alias in names)
        case ast.ImportFrom(module=str(module), names=names, level=0):
            yield module
            yield from (name for alias in names if (name := f"{module}.{alias.name}") in SOURCES)
        case ast.Call(func=ast.Attribute(attr="import_module") | ast.Name(id="import_module" | "__import__")):
            yield from _text(node)


def _text(call: ast.Call) -> Iterator[str]:
    """The module in a call that imports: a literal, or the beginning of a formatted text."""
    match call.args[:1]:
        case [ast.Constant(value=str(name))]:
            yield name
        case [ast.JoinedStr(values=[ast.Constant(value=str(beginning)), *_])]:
            yield beginning.rstrip(".")


def _imports(module: str, tree: ast.Module) -> Iterator[Import]:
    file = str(SOURCES[module].relative_to(ROOT))
    for node in ast.walk(tree):
        for name in _named(node):
            yield Import(file, getattr(node, "lineno", 0), module, name)


def _breaches(rule: Rule, imports: Imports) -> list[str]:
    modules = [m for m in SOURCES if _within_any(m, rule.modules) and not _within_any(m, rule.but_not_in)]
    assert modules, f"there is no module in {rule.modules}: the rule would never fail"
    return [
        str(found)
        for module in modules
        for found in imports[module]
        if _within_any(found.name, rule.forbidden) and not _within_any(found.name, rule.allowed)
    ]


@pytest.mark.parametrize("rule", RULES.values(), ids=list(RULES))
def test_arrows_point_one_way(rule: Rule, imports: Imports) -> None:
    breaches = _breaches(rule, imports)
    assert not breaches, "\n".join(breaches)


def _room(name: str) -> str:
    """The room of one of our modules."""
    return name.split(".")[1]


def _package(name: str) -> str:
    """The room and what stands directly in it: a package, or a file of its own."""
    return ".".join(name.split(".")[1:3])


def _arrows(unit: Callable[[str], str], imports: Imports) -> dict[str, dict[str, Import]]:
    """From each unit to those that it imports, with one import that says so."""
    arrows: dict[str, dict[str, Import]] = defaultdict(dict)
    for module in SOURCES:
        if module.count(".") == 0:
            continue
        for found in imports[module]:
            if found.name in SOURCES and found.name.count(".") > 0 and unit(found.name) != unit(module):
                arrows[unit(module)].setdefault(unit(found.name), found)
    return arrows


def test_no_arrow_points_up_to_a_higher_room(imports: Imports) -> None:
    upward = [
        str(found)
        for room, targets in _arrows(_room, imports).items()
        for target, found in targets.items()
        if room in FLOORS and target in FLOORS and FLOORS.index(target) > FLOORS.index(room)
    ]
    assert not upward, "\n".join(upward)


def _circle(arrows: dict[str, dict[str, Import]]) -> list[str]:
    """The imports of a circle, if there is one."""
    try:
        graphlib.TopologicalSorter({unit: set(targets) for unit, targets in arrows.items()}).prepare()
    except graphlib.CycleError as error:
        names: list[str] = error.args[1]
        return [str(arrows[b][a]) for a, b in itertools.pairwise(names)]
    return []


def test_no_circle_between_the_packages_of_the_rooms(imports: Imports) -> None:
    circle = _circle(_arrows(_package, imports))
    assert not circle, "\n".join(circle)


def test_no_circle_between_files(imports: Imports) -> None:
    circle = _circle(_arrows(lambda module: module, imports))
    assert not circle, "\n".join(circle)


def test_a_circle_would_be_found() -> None:
    first, second = Import("a.py", 1, "a", "b"), Import("b.py", 1, "b", "a")
    assert sorted(_circle({"a": {"b": first}, "b": {"a": second}})) == [str(first), str(second)]


def test_a_module_that_is_imported_by_a_computed_name_can_only_be_what_is_known(trees: Trees) -> None:
    """Such calls escape the rules above, so each one is listed."""
    computed = [
        module.removeprefix(f"{NAMESPACE}.")
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and _is_import(node) and not list(_text(node))
    ]
    assert computed == [
        "node.cli.main",  # a verb, by its name
        "node.models.load",  # the model that the robot file names
        "node.ros.messages",  # a ROS message by its type's name
        "node.ros.runtime",  # what of ROS is imported before it is needed
        "segway_ecc",  # a public name, at its first use
    ]


def _is_import(call: ast.Call) -> bool:
    match call.func:
        case ast.Attribute(attr="import_module") | ast.Name(id="import_module" | "__import__"):
            return True
    return False


def test_imports_are_absolute(trees: Trees) -> None:
    relative = [
        f"{SOURCES[module].relative_to(ROOT)}:{node.lineno} imports {'.' * node.level}{node.module or ''}"
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.level > 0
    ]
    assert not relative, "\n".join(relative)


def _uses_of_the_float_clock(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id="time"), attr="time", lineno=line):
                yield line
            case ast.ImportFrom(module="time", names=names, lineno=line) if any(a.name in {"time", "*"} for a in names):
                yield line
            case ast.Import(names=names, lineno=line) if any(a.name == "time" and a.asname for a in names):
                yield line


def test_nothing_reads_the_wall_clock_as_a_float(trees: Trees) -> None:
    uses = [
        f"{SOURCES[module].relative_to(ROOT)}:{line} uses time.time; take a clock's now_ns or wall_ns"
        for module, tree in trees.items()
        for line in _uses_of_the_float_clock(tree)
    ]
    assert not uses, "\n".join(uses)


FAMILIES = sorted(path.name for path in (ROOT / "firmware_io" / "drives").iterdir() if (path / "__init__.py").exists())


def test_there_are_drive_families() -> None:
    assert "wheel_board" in FAMILIES


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(
    "path",
    [
        "firmware_io/drives/{}/frames.py",
        "firmware_io/drives/{}/driver.py",
        "firmware_io/drives/{}/settings.py",
        "firmware_io/drives/{}/stopper.py",
        "firmware_io/drives/{}/family.py",
        "hil/devices/{}.py",
    ],
)
def test_a_drive_family_has_all_its_parts(family: str, path: str) -> None:
    assert (ROOT / path.format(family)).is_file(), f"drive family {family} lacks {path.format(family)}"


IMUS = sorted(path.name for path in (ROOT / "firmware_io" / "imus").iterdir() if (path / "__init__.py").exists())


def test_there_are_imus() -> None:
    assert "xsens_mti" in IMUS


@pytest.mark.parametrize("imu", IMUS)
@pytest.mark.parametrize(
    "path",
    [
        "firmware_io/imus/{}/frames.py",
        "firmware_io/imus/{}/driver.py",
        "firmware_io/imus/{}/settings.py",
        "firmware_io/imus/{}/family.py",
        "hil/devices/{}.py",
    ],
)
def test_an_imu_has_all_its_parts(imu: str, path: str) -> None:
    assert (ROOT / path.format(imu)).is_file(), f"IMU {imu} lacks {path.format(imu)}"


def test_every_simulated_device_stands_in_for_a_drive_family_or_an_imu() -> None:
    # What begins with an underscore is a part of one of them.
    devices = {path.stem for path in (ROOT / "hil" / "devices").glob("[!_]*.py")} - {"device", "family"}
    assert devices == {*FAMILIES, *IMUS}
