# SPDX-License-Identifier: MIT
"""One call that loads a model, whatever it is written in."""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import cast

from segway_ecc.node.errors import ModelError, UnknownNameError
from segway_ecc.node.model.model import Model
from segway_ecc.node.models.locate import PythonSource, import_model_module


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
    if source and (Path(source).exists() or source.lower().endswith(".fmu") or ("/" in source and python is None)):
        return _load_native(Path(source), parameters or {}, method, step_size)
    if method is not None or step_size is not None:
        raise ModelError(f"'{source}' is written in Python and has its own method and step: leave them out")
    if python is None:
        raise ModelError(f"'{source}' names no model: write package.module:Class")
    model_class = getattr(import_model_module(python), python.name, None)
    if not isinstance(model_class, type):
        raise ModelError(f"cannot load model '{source}': module {python.module} has no class {python.name}")
    return cast("Model", model_class(parameters))


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
