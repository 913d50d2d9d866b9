"""Breaks node.safety in every small way there is, and lists what no test notices: `python tests/node/safety/mutate.py`.

Each mutant is one change of one module: an operator, a comparison, a constant, a branch or a statement. It runs against
the tests of its module in a process of its own; nothing on disk is changed.
"""

import ast
import copy
import importlib.abc
import importlib.machinery
import os
import signal
import sys
import types
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import hypothesis.stateful
import msgspec  # noqa: F401 - imported once
import pytest
import yaml  # noqa: F401 - imported once

TESTS: Final = Path(__file__).parent
SAFETY: Final = TESTS.parents[2] / "node" / "safety"
TESTED_BY: Final = {
    "bounds": ["bounds"],
    "check": ["bounds", "plausibility", "monitor"],
    "checklist": ["checklist", "monitor"],
    "plausibility": ["plausibility", "monitor"],
    "tilt": ["tilt", "monitor"],
}
TIMEOUT_S: Final = 40
AT_A_TIME: Final = 3
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
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
    ast.BitOr: (),
}
NAMES: Final = {"min": "max", "max": "min", "any": "all", "all": "any"}


def _changes(node: ast.AST) -> Iterator[ast.AST]:  # noqa: C901 - a table of the kinds of node
    """What could stand in place of a node."""
    match node:
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(value=str(value)):
            yield ast.Constant(value + "?")
        case ast.Name(id=name) if name in NAMES:
            yield ast.Name(NAMES[name], node.ctx)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.If() | ast.IfExp() | ast.While():
            for value in (True, False):
                if not (isinstance(node, ast.While) and value):
                    changed = copy.copy(node)
                    changed.test = ast.Constant(value)
                    yield changed
        case ast.Assign() | ast.AugAssign() | ast.Expr():
            yield ast.Pass()
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) != "None":
            yield ast.Return(ast.Constant(None))


def _is_text(node: ast.AST) -> bool:
    """Whether it is a docstring or another text that stands for itself."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _mutants(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Change each place below `node`, one at a time; yields the line and what was changed while it is changed."""
    for name, child in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list") or (name == "bases"):
            continue
        children = child if isinstance(child, list) else [child]
        for place, old in enumerate(children):
            if not isinstance(old, ast.AST) or _is_text(old) or isinstance(old, (ast.Import, ast.ImportFrom)):
                continue
            for new in (*(kind() for kind in SWAPS.get(type(old), ())), *_changes(old)):
                where: ast.AST = old if hasattr(old, "lineno") else node
                ast.copy_location(new, where)
                _put(node, name, place, new)
                yield getattr(where, "lineno", 0), f"{ast.unparse(old) or type(old).__name__} -> {_text(new)}"
                _put(node, name, place, old)
            yield from _mutants(old)


def _text(node: ast.AST) -> str:
    return ast.unparse(node) or type(node).__name__


def _put(node: ast.AST, name: str, place: int, child: ast.AST) -> None:
    held = getattr(node, name)
    if isinstance(held, list):
        held[place] = child
    else:
        setattr(node, name, child)


class _Mutant(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives the changed module to whoever imports it."""

    def __init__(self, module: str, code: types.CodeType) -> None:
        self.module = module
        self.code = code

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        del path, target
        return importlib.machinery.ModuleSpec(fullname, self) if fullname == self.module else None

    def exec_module(self, module: types.ModuleType) -> None:
        exec(self.code, module.__dict__)  # noqa: S102 - the mutant


def _start(stem: str, tree: ast.Module) -> int:
    """Run the tests of a module against a mutant of it, in a process of its own; returns its id."""
    pid = os.fork()
    if pid:
        return pid
    signal.alarm(TIMEOUT_S)
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    code = 1
    try:
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)  # nobody reads the smallest example
        hypothesis.settings.register_profile("mutants", derandomize=True, database=None, deadline=None, phases=phases)
        hypothesis.settings.load_profile("mutants")
        changed = compile(ast.fix_missing_locations(tree), f"{stem}.py", "exec")
        sys.meta_path.insert(0, _Mutant(f"node.safety.{stem}", changed))
        files = [str(TESTS / f"test_{name}.py") for name in TESTED_BY.get(stem, [stem])]
        code = int(pytest.main(["--noconftest", "--assert=plain", "-x", "-q", "-p", "no:cacheprovider", *files]))
    finally:
        os._exit(code)


def _survives(pid: int) -> bool:
    return os.waitpid(pid, 0)[1] == 0


def _try(stem: str) -> tuple[int, list[str]]:
    """How many mutants of a module there are, and which live; a few run at a time."""
    tree = ast.parse((SAFETY / f"{stem}.py").read_text(encoding="utf-8"))
    if not _survives(_start(stem, tree)):
        raise SystemExit(f"{stem}: its tests fail as it is")
    running: deque[tuple[str, int]] = deque()
    alive: list[str] = []
    count = 0
    for line, change in _mutants(tree):
        count += 1
        running.append((f"{stem}.py:{line}: {change}\n", _start(stem, tree)))
        if len(running) == AT_A_TIME:
            text, pid = running.popleft()
            alive += [text] if _survives(pid) else []
    return count, alive + [text for text, pid in running if _survives(pid)]


def main() -> None:
    """Try every mutant of the modules that are named, or of all; list those that live."""
    sys.path.insert(0, str(TESTS.parents[2]))
    for stem in sys.argv[1:] or sorted(path.stem for path in SAFETY.glob("[!_]*.py")):
        count, alive = _try(stem)
        sys.stdout.write(f"{stem}: {count} mutants, {len(alive)} alive\n{''.join(alive)}")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
