"""The arrows between the packages, read from the source: what a module imports, at its head or anywhere within."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("firmware_io", "node", "hil", "deploy")
ROS = ("rclpy", "ament_index_python", "builtin_interfaces", "rosidl_runtime_py", "tf2_ros", "std_srvs", "*_msgs")

HIL_MAY_IMPORT = {
    "node.config": "the robot file names the bus and the plant",
    "node.cycle.clock": "the rig in real time waits on the node's kind of clock",
    "node.model.model": "a plant is a model",
    "node.model.methods": "a plant that integrates itself is a discrete model",
    "node.model.sectioned": "a plant is written as any model in Python is",
    "node.model.load": "a plant is loaded as any model is",
    "node.model.variables": "a plant's ports are variables of a model",
    "node.models.cart": "the cart's plant shares its equations with the cart's model",
    "node.models.segway_parameters": "the segway's plant and its controller are of one robot",
}


class Import(NamedTuple):
    """A name that a file imports, or names in a call that imports."""

    file: str
    line: int
    name: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line} imports {self.name}"


class Rule(NamedTuple):
    """Modules, and what they may not import; names may end in a star, or begin with one."""

    modules: tuple[str, ...]
    forbidden: tuple[str, ...]
    but_not_in: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()


RULES = {
    "firmware_io stands alone": Rule(("firmware_io",), ("node", "hil", "deploy", *ROS)),
    "models and safety know no world": Rule(
        ("node.model", "node.models", "node.safety"),
        ("firmware_io", "hil", "time", "socket", "subprocess", "can", *ROS),
        allowed=("firmware_io.value",),  # how a value is made, not where it comes from
    ),
    "the cycle knows no ROS and no rig": Rule(("node.cycle",), ("hil", "node.ros", *ROS)),
    "ROS packages are imported in node.ros only": Rule(PACKAGES, ROS, but_not_in=("node.ros", "node.bench.programs")),
    "the rig takes of the node what it says it takes": Rule(("hil",), ("node",), allowed=tuple(HIL_MAY_IMPORT)),
    "the rig knows no safety, ROS, command line or case study": Rule(
        ("hil",), ("node.safety", "node.ros", "node.cli", "node.case_study")
    ),
    "the node runs without the rig": Rule(
        ("node",),
        ("hil",),
        but_not_in=(
            "node.cli",
            "node.bench",
            "node.campaign",
            "node.case_study",
            "node.drill",
            "node.growth",
            "node.latency",
            "node.play",
            "node.soak",
            "node.study",
        ),
    ),
    "only the command line knows deployment": Rule(
        ("firmware_io", "node", "hil"), ("deploy",), but_not_in=("node.cli",)
    ),
    "deployment knows no rig and no command line": Rule(("deploy",), ("hil", "node.cli")),
    "nothing imports tests": Rule(PACKAGES, ("tests", "conftest", "pytest", "hypothesis", "cantools")),
}


def _sources() -> dict[str, Path]:
    """Every module of the product by its dotted name."""
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    return {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}


SOURCES = _sources()
TREES = {module: ast.parse(path.read_text(encoding="utf-8")) for module, path in SOURCES.items()}


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


def _imports(module: str) -> Iterator[Import]:
    file = str(SOURCES[module].relative_to(ROOT))
    for node in ast.walk(TREES[module]):
        for name in _named(node):
            yield Import(file, getattr(node, "lineno", 0), name)


def _breaches(rule: Rule) -> list[str]:
    modules = [m for m in SOURCES if _within_any(m, rule.modules) and not _within_any(m, rule.but_not_in)]
    assert modules, f"there is no module in {rule.modules}: the rule would never fail"
    return [
        str(found)
        for module in modules
        for found in _imports(module)
        if _within_any(found.name, rule.forbidden) and not _within_any(found.name, rule.allowed)
    ]


@pytest.mark.parametrize("rule", RULES.values(), ids=list(RULES))
def test_arrows_point_one_way(rule: Rule) -> None:
    breaches = _breaches(rule)
    assert not breaches, "\n".join(breaches)


def test_a_module_that_is_imported_by_a_computed_name_can_only_be_what_is_known() -> None:
    """Such calls escape the rules above, so each one is listed."""
    computed = [
        module
        for module, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and _is_import(node) and not list(_text(node))
    ]
    assert computed == [
        "node.model.load",  # the model that the robot file names
        "node.ros.messages",  # a ROS message by its type's name
        "node.ros.runtime",  # what of ROS is imported before it is needed
    ]


def _is_import(call: ast.Call) -> bool:
    match call.func:
        case ast.Attribute(attr="import_module") | ast.Name(id="import_module" | "__import__"):
            return True
    return False


def test_what_the_rig_takes_of_the_node_is_really_taken() -> None:
    taken = {found.name for module in SOURCES if _within(module, "hil") for found in _imports(module)}
    assert set(HIL_MAY_IMPORT) <= taken, "an entry that nothing needs any more"


def test_imports_are_absolute() -> None:
    relative = [
        f"{SOURCES[module].relative_to(ROOT)}:{node.lineno} imports {'.' * node.level}{node.module or ''}"
        for module, tree in TREES.items()
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


def test_nothing_reads_the_wall_clock_as_a_float() -> None:
    uses = [
        f"{SOURCES[module].relative_to(ROOT)}:{line} uses time.time; take a clock's now_ns or wall_ns"
        for module, tree in TREES.items()
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
        "firmware_io/drives/{}/limits.py",
        "firmware_io/drives/{}/settings.py",
        "firmware_io/drives/{}/stop.py",
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
        "firmware_io/imus/{}/limits.py",
        "firmware_io/imus/{}/settings.py",
        "hil/devices/{}.py",
    ],
)
def test_an_imu_has_all_its_parts(imu: str, path: str) -> None:
    assert (ROOT / path.format(imu)).is_file(), f"IMU {imu} lacks {path.format(imu)}"


def test_every_simulated_device_stands_in_for_a_drive_family_or_an_imu() -> None:
    # What begins with an underscore is a part of one of them.
    devices = {path.stem for path in (ROOT / "hil" / "devices").glob("[!_]*.py")} - {"device"}
    assert devices == {*FAMILIES, *IMUS}
