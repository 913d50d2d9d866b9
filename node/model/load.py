"""One call that loads a model, whatever it is written in."""

import importlib
from collections.abc import Mapping
from typing import cast

from node.errors import ModelError
from node.model.model import Model


def load_model(source: str, parameters: Mapping[str, float] | None = None) -> Model:
    """Load a model.

    Args:
        source: `package.module:Class` of a model written in Python.
        parameters: Parameters other than their defaults, by name, in the model's units.

    Raises:
        ModelError: There is no such model, or it refuses a parameter; the text says which.
    """
    module_name, _, class_name = source.partition(":")
    if not (module_name and class_name):
        raise ModelError(f"'{source}' names no model: write package.module:Class")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise ModelError(f"cannot load model '{source}': {error}") from error
    if not isinstance(getattr(module, class_name, None), type):
        raise ModelError(f"cannot load model '{source}': module {module_name} has no class {class_name}")
    return cast("Model", getattr(module, class_name)(parameters))
