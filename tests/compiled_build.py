"""What is installed is compiled. Run by `make test-compiled` only, and so not called test_something."""

import importlib
import tomllib
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from node.cycle import cycle

ROOT = Path(__file__).parents[1]
HOOK = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
MODULES = [name[1:] for name in HOOK["wheel"]["hooks"]["mypyc"]["include"]]


def test_the_cycle_is_compiled() -> None:
    assert cycle.__file__.endswith(".so")


@pytest.mark.parametrize("path", MODULES)
def test_a_module_is_compiled_and_its_source_is_there(path: str) -> None:
    module = importlib.import_module(path.removesuffix(".py").replace("/", "."))
    assert module.__file__ is not None
    assert module.__file__.endswith(tuple(EXTENSION_SUFFIXES))
    assert (Path(module.__file__).parent / Path(path).name).is_file()
