# SPDX-License-Identifier: MIT
"""One call that loads a model, whatever it is written in, and where it lies: beside a file, here, or installed.

A source that lies in a folder carries it: `/home/me/robots/tank:Tank` is the class Tank of tank.py, or of the package
tank, in /home/me/robots. Only that module or package is imported from there; no folder is put on `sys.path`.
"""

import importlib
import importlib.util
import re
import sys
from collections.abc import Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Final, NamedTuple, cast

from segway_ecc.node.errors import ModelError, UnknownNameError, failure_text
from segway_ecc.node.model.model import Model

_SOURCE: Final = re.compile(r"(?:(?P<folder>.*)/)?(?P<module>[^\W\d]\w*(?:\.[^\W\d]\w*)*):(?P<name>[^\W\d]\w*)")
_NAMESPACE: Final = "segway_ecc"
_MOVED: Final = re.compile(r"(node\.models|hil\.plants)\.\w+")
"""Modules with models that stood at the top of the tree in version 0.1."""
_OURS: Final = frozenset(
    {"aiohttp", "can", "canopen", "cantools", "lz4", "matplotlib", "mcap", "msgspec", "mypy_extensions", "numpy"}
    | {"rclpy", "rich", "segway_ecc", "serial", "shtab", "yaml"}
)
"""What the product imports, also where that happens after the model is loaded."""


class PythonSource(NamedTuple):
    """A model in Python: the class `name` of a module that lies in a folder, or in none where it is installed."""

    folder: Path | None
    module: str
    name: str

    @property
    def top(self) -> str:
        """The module or package that is imported first."""
        return self.module.partition(".")[0]

    @classmethod
    def parse(cls, source: str) -> "PythonSource | None":
        """Read `module:Class` or `FOLDER/module:Class`; None where the source is neither."""
        match = _SOURCE.fullmatch(source)
        if match is None:
            return None
        folder = match["folder"]
        return cls(None if folder is None else Path(folder or "/"), match["module"], match["name"])

    def __str__(self) -> str:
        """As `parse` reads it."""
        return f"{'' if self.folder is None else f'{self.folder}/'}{self.module}:{self.name}"


def locate(source: str, folders: Sequence[Path]) -> str:
    """The source with the folder that it lies in; as it is where it lies in none of `folders`.

    They are looked through in their order, such as that of the robot file and the current one; a path in the source,
    which is what `load_model` takes, is relative to them.
    """
    found = PythonSource.parse(source)
    if found is None or _exists(Path(source)):
        places = (folder / source for folder in folders if source)
        return next((str(place) for place in places if _exists(place)), source)
    if found.top == _NAMESPACE or (found.folder is None and _MOVED.fullmatch(found.module)):
        return source
    for folder in folders:
        place = folder if found.folder is None else folder / found.folder
        if _spec_in(place, found.top) is not None:
            return str(found._replace(folder=place.resolve()))
    return source


def locate_recorded(source: str, folders: Sequence[Path]) -> str:
    """Where a model is now that a log names: where it was, or else by its last name in one of `folders`."""
    found = PythonSource.parse(source)
    if found is None:
        return source if _exists(Path(source)) else locate(Path(source).name, folders)
    if found.folder is not None and _spec_in(found.folder, found.top) is not None:
        return source
    return locate(str(found._replace(folder=None)), folders)


def _import_module(source: PythonSource) -> ModuleType:
    if source.folder is None and _MOVED.fullmatch(source.module):
        raise ModelError(f"model '{source}' has the name that it had in version 0.1: write {_NAMESPACE}.{source}")
    if source.module.endswith(".py"):
        module = str(source).replace(".py:", ":")
        raise ModelError(f"'{source}' names a file: name its module, {module}")
    try:
        if source.folder is not None:
            _import_top(source.folder, source.top)
        return importlib.import_module(source.module)
    except ModelError:
        raise
    except ModuleNotFoundError as error:
        if f"{source.module}.".startswith(f"{error.name}."):
            raise ModelError(f"cannot load model '{source}': {error}") from error
        raise ModelError(
            f"cannot load model '{source}': it imports '{error.name}', which is not installed: install it, "
            f"or make the model a package, a folder with __init__.py, that holds it"
        ) from error
    except (ImportError, SyntaxError) as error:
        raise ModelError(f"cannot load model '{source}': {error}") from error
    except (Exception, SystemExit) as error:  # the user's, which may raise anything
        raise _failed(source, error) from error


def _import_top(folder: Path, top: str) -> None:
    spec = _spec_in(folder, top)
    if spec is None or spec.loader is None:
        raise ModelError(f"there is no module or package '{top}' in {folder}")
    if top in sys.modules and _origin(sys.modules[top]) == spec.origin:
        return
    taken = _taken_by(top)
    if taken is not None:
        raise ModelError(f"cannot load {spec.origin}: the name '{top}' is taken by {taken}; rename the file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[top] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(top, None)
        raise


def _taken_by(top: str) -> str | None:
    if top in sys.stdlib_module_names:
        return "Python's standard library"
    if top in _OURS:
        return "a package that segway-ecc uses"
    if top in sys.modules:
        return f"another module, {_origin(sys.modules[top]) or 'already imported'}"
    return None


def _spec_in(folder: Path, top: str) -> ModuleSpec | None:
    PathFinder.invalidate_caches()  # the file may be newer than the last look into its folder
    spec = PathFinder.find_spec(top, [str(folder.absolute())])
    return None if spec is None or spec.origin is None else spec


def _origin(module: ModuleType) -> str | None:
    return None if module.__spec__ is None else module.__spec__.origin


def load_model(
    source: str,
    parameters: Mapping[str, float] | None = None,
    *,
    method: str | None = None,
    step_size: float | None = None,
) -> Model:
    """Load a model.

    Args:
        source: `package.module:Class` of a model written in Python that is installed, `FOLDER/module:Class` of one
            that lies in a folder, a folder of C or C++ that 20-sim generated, or an `.fmu` file.
        parameters: Parameters other than their defaults, by name, in the model's units. They act from the start, also
            in the equations that run once.
        method: The integration method of generated code that is incomplete and does not name it.
        step_size: The step of generated code, or of an FMU, that does not give it, s.

    Raises:
        ModelError: There is no such model, or it refuses a parameter; the text says which.
    """
    python = PythonSource.parse(source)
    if source and (_exists(Path(source)) or source.lower().endswith(".fmu") or ("/" in source and python is None)):
        return _load_native(Path(source), parameters or {}, method, step_size)
    if method is not None or step_size is not None:
        raise ModelError(f"'{source}' is written in Python and has its own method and step: leave them out")
    if python is None:
        raise ModelError(f"'{source}' names no model: write package.module:Class")
    model_class = getattr(_import_module(python), python.name, None)
    if not isinstance(model_class, type):
        raise ModelError(f"cannot load model '{source}': module {python.module} has no class {python.name}")
    try:
        return cast("Model", model_class(parameters))
    except ModelError:
        raise
    except (Exception, SystemExit) as error:  # as above
        raise _failed(python, error) from error


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # as a name that is too long
        return False


def _failed(source: PythonSource, error: BaseException) -> ModelError:
    return ModelError(f"cannot load model '{source}': {failure_text(error)}")


def _load_native(path: Path, parameters: Mapping[str, float], method: str | None, step_size: float | None) -> Model:
    # Only here: compilers and loaders are no business of a model in Python.
    native = importlib.import_module("segway_ecc.node.native.load")
    model = cast("Model", native.load_native(path, method=method, step_size=step_size))
    names = {variable.name for variable in model.parameters}
    for name, value in parameters.items():
        if name not in names:
            raise UnknownNameError(f"parameter of model '{model.name}'", name, [v.name for v in model.parameters])
        # Before the first initialize, which keeps it: so it stands in the initial and static equations too.
        model.write(name, value)
    return model
