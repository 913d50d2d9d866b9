"""The model runtime: sections, integration methods, named variables."""

from node.model.load import load_model

__all__ = ["load_model"]
