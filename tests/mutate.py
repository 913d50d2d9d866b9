# SPDX-License-Identifier: MIT
"""Breaks modules in every small way there is, and lists what no test notices: `python tests/mutate.py [MODULE...]`.

A module is named as `node/safety/tilt.py` or `tilt`, several as `node/safety`; all of them without a name. Each mutant
is one change of one module: an operator, a comparison, a constant, a branch or a statement. It runs against the tests
of its module in a process of its own; nothing on disk is changed. What is alive and not listed with its reason in
mutants_accepted.txt, and what is listed there and not alive, is printed and makes the exit code 1.
"""

import ast
import contextlib
import copy
import importlib
import importlib.abc
import importlib.machinery
import itertools
import os
import resource
import sys
import types
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import hypothesis.stateful
import pytest

ROOT: Final = Path(__file__).parents[1]
ACCEPTED: Final = Path(__file__).with_name("mutants_accepted.txt")
MODULES: Final = (
    "node/safety/[!_]*.py",
    "firmware_io/guard/[!_]*.py",
    "firmware_io/heartbeat.py",
    "firmware_io/drives/stopper.py",
    "firmware_io/drives/*/stopper.py",
    "node/cycle/arming.py",
)
ROOMS: Final = ("firmware_io", "node", "deploy", "hil")
# The tests of a module in the order in which they run, where that is not only the file of its own name; one of another
# folder with its path.
TESTED_BY: Final = {
    "node/safety/check": ["check", "monitor"],
    "node/safety/pre_arm": ["pre_arm", "monitor"],
    "node/safety/posture": ["posture", "monitor"],
    "node/safety/monitor": ["monitor", "residual"],
    "node/safety/modes": ["modes", "modes_machine", "modes_station"],
    "node/safety/residual": ["residual_reference", "residual"],
    "node/safety/plausibility": ["plausibility", "plausibility_following", "runaway"],
    "firmware_io/drives/stopper": ["firmware_io/guard/stoppers", "firmware_io/guard/watch"],
    "firmware_io/drives/cia402/stopper": ["firmware_io/guard/stoppers"],
    "firmware_io/drives/moteus/stopper": ["firmware_io/guard/moteus_stopper"],
    "firmware_io/drives/odrive/stopper": ["firmware_io/guard/stoppers"],
    "firmware_io/drives/vesc/stopper": ["firmware_io/guard/stoppers"],
    "firmware_io/drives/wheel_board/stopper": ["firmware_io/guard/stoppers", "firmware_io/guard/session_board"],
    "firmware_io/guard/guard": ["guard", "stoppers"],
    "firmware_io/guard/watch": ["watch", "guard"],
}
AT_A_TIME: Final = 2
CPU_S: Final = 20
MEMORY_BYTES: Final = 4 << 30
SWAPS: Final[dict[type[ast.AST], tuple[type[ast.AST], ...]]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,),
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
}
NAMES: Final = {"min": "max", "max": "min", "any": "all", "all": "any"}


def _changes(node: ast.AST) -> Iterator[ast.AST]:  # noqa: C901 - a table of the kinds of node
    """What could stand in place of a node."""
    match node:
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(value=float(value)):
            yield ast.Constant(value * 1.1 or 1.0)
        case ast.Constant(value=str(value)):
            yield ast.Constant(value + "?")
        case ast.Name(id=name) if name in NAMES:
            yield ast.Name(NAMES[name], node.ctx)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.If() | ast.IfExp():
            yield from (_with(node, test=ast.Constant(value)) for value in (True, False))
        case ast.While():
            yield _with(node, test=ast.Constant(value=False))
        case ast.match_case():
            yield _with(node, guard=ast.Constant(value=False))
        case ast.Assign() | ast.AugAssign() | ast.Expr() | ast.Raise():
            yield ast.Pass()
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) != "None":
            yield ast.Return(ast.Constant(None))


def _with(node: ast.AST, **fields: ast.AST) -> ast.AST:
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def _stays(node: object) -> bool:
    """Whether a mutant of it says nothing: no code, a text that stands for itself, or an import."""
    is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return not isinstance(node, ast.AST) or is_text or isinstance(node, ast.Import | ast.ImportFrom)


def _mutants(node: ast.AST, line: int = 1) -> Iterator[tuple[int, str]]:
    """Change each place below `node`, one at a time; yields the line and what was changed while it is changed."""
    for name, child in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "bases"):
            continue
        for place, old in enumerate(child if isinstance(child, list) else [child]):
            if _stays(old):
                continue
            at = getattr(old.pattern if isinstance(old, ast.match_case) else old, "lineno", line)
            for new in (*(kind() for kind in SWAPS.get(type(old), ())), *_changes(old)):
                _put(node, name, place, ast.copy_location(new, old))
                yield at, f"{_text(old)} -> {_text(new)}"
                _put(node, name, place, old)
            yield from _mutants(old, at)


def _text(node: ast.AST) -> str:
    return (ast.unparse(node).strip() or type(node).__name__).partition("\n")[0]


def _put(node: ast.AST, name: str, place: int, child: ast.AST) -> None:
    held = getattr(node, name)
    if isinstance(held, list):
        held[place] = child
    else:
        setattr(node, name, child)


class _Mutant(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives the changed module to whoever imports it; without code, whoever imports it fails."""

    def __init__(self, module: str, code: types.CodeType | None = None) -> None:
        self.module = f"segway_ecc.{module.replace('/', '.')}"
        self.code = code

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        del path, target
        return importlib.machinery.ModuleSpec(fullname, self) if fullname == self.module else None

    def exec_module(self, module: types.ModuleType) -> None:
        if self.code is None:
            raise ImportError(self.module)
        exec(self.code, module.__dict__)  # noqa: S102 - the mutant


def _load_all_but(module: str) -> None:
    """Import what does not depend on a module, so that not every mutant has to."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "segway_ecc"]:
        del sys.modules[name]
    finder = _Mutant(module)
    sys.meta_path.insert(0, finder)
    for path in (path for room in ROOMS for path in (ROOT / room).rglob("[!_]*.py")):
        with contextlib.suppress(ImportError):
            importlib.import_module(".".join(("segway_ecc", *path.relative_to(ROOT).with_suffix("").parts)))
    sys.meta_path.remove(finder)


def _start(module: str, tree: ast.Module) -> int:
    """Run the tests of a module against a mutant of it, in a process of its own; returns its id."""
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        changed = compile(ast.fix_missing_locations(tree), f"{module}.py", "exec")
        sys.meta_path.insert(0, _Mutant(module, changed))
        files = _tests_of(module)
        folder = str(files[0].parent)
        options = ["--confcutdir", folder, "--assert=plain", "-x", "-q", "--timeout=60", "-p", "no:cacheprovider"]
        code = int(pytest.main([*options, *map(str, files)]))
    finally:
        os._exit(code)


def _tests_of(module: str) -> list[Path]:
    own, _, stem = module.rpartition("/")
    found = []
    for test in TESTED_BY.get(module, [stem]):
        folder, _, name = test.rpartition("/")
        found.append(ROOT / "tests" / (folder or own) / f"test_{name}.py")
    return found


class Change(NamedTuple):
    """A mutant: where it is, the line as it was, and what was changed of it."""

    module: str
    line: int
    source: str
    change: str

    @property
    def name(self) -> str:
        """What it is accepted by; lines move."""
        return f"{self.module}.py: {self.source}: {self.change}"

    def __str__(self) -> str:
        return f"{self.module}.py:{self.line}: {self.source}: {self.change}"


def _try(module: str) -> Iterator[tuple[Change, bool]]:
    """The mutants of a module, and whether each lives; a few run at a time."""
    text = (ROOT / f"{module}.py").read_text(encoding="utf-8")
    tree, lines = ast.parse(text), text.splitlines()
    _load_all_but(module)
    if os.waitpid(_start(module, tree), 0)[1] != 0:
        raise SystemExit(f"{module}: its tests fail as it is")
    running: dict[int, Change] = {}
    for line, change in _mutants(tree):
        if len(running) == AT_A_TIME:
            yield _next(running)
        running[_start(module, tree)] = Change(module, line, lines[line - 1].strip(), change)
    while running:
        yield _next(running)


def _next(running: dict[int, Change]) -> tuple[Change, bool]:
    """Wait for the first to end; whether all of its tests passed."""
    pid, status = os.wait()
    return running.pop(pid), status == 0


def _accepted() -> Iterator[str]:
    """The names of the mutants that may live; the line below each gives the reason."""
    lines = [line for line in ACCEPTED.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    for name, reason in itertools.zip_longest(lines[::2], lines[1::2], fillvalue=""):
        if name.startswith(" ") or not reason.startswith("    "):
            raise SystemExit(f"{ACCEPTED.name}: '{name}' has no reason: write it below, indented by four")
        yield name


def _report(module: str, accepted: Counter[str]) -> int:
    """Try a module; print what should not be, and return 1 where there was any."""
    allowed = Counter({name: number for name, number in accepted.items() if name.startswith(f"{module}.py: ")})
    alive = status = 0
    for count, (mutant, lives) in enumerate(_try(module), 1):
        alive += lives
        sys.stderr.write(f"\r{module}: {count} mutants, {alive} alive")
        if lives and allowed[mutant.name] <= 0:
            sys.stdout.write(f"{mutant}\n")
            sys.stdout.flush()
            status = 1
        allowed[mutant.name] -= lives
    sys.stderr.write("\n")
    for name in (+allowed).elements():
        sys.stdout.write(f"accepted, but not alive: {name}\n")
        status = 1
    return status


def _modules(names: Sequence[str]) -> list[str]:
    """The modules that are meant, all of them where none is named."""
    paths = sorted(path.relative_to(ROOT).with_suffix("") for pattern in MODULES for path in ROOT.glob(pattern))
    wanted = {name.removesuffix(".py").rstrip("/") for name in names}
    known = {str(path): {str(path), path.name, str(path.parent)} for path in paths}
    unknown = wanted - set().union(*known.values())
    if unknown:
        raise SystemExit(f"no such module: {', '.join(sorted(unknown))}; there is {', '.join(known)}")
    return [module for module, called in known.items() if not wanted or wanted & called]


def main() -> int:
    """Try the modules that are named; the exit code is 1 where anything is not as it should be."""
    sys.path.insert(0, str(ROOT))
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)  # nobody reads the smallest example
    hypothesis.settings.register_profile("mutants", derandomize=True, database=None, deadline=None, phases=phases)
    hypothesis.settings.load_profile("mutants")
    accepted = Counter(_accepted())
    return max(_report(module, accepted) for module in _modules(sys.argv[1:]))


if __name__ == "__main__":
    sys.exit(main())
