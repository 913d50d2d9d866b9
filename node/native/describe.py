"""What a loaded model is, in one form for every flavour."""

from segway_ecc.node.model.model import Model
from segway_ecc.node.native.description import Description, Flavour
from segway_ecc.node.native.library import NativeModel


def describe(model: Model) -> Description:
    """The description of a model; a model of our own in Python describes itself."""
    if isinstance(model, NativeModel):
        return model.description
    kind = type(model)
    return Description(
        name=model.name,
        flavour=Flavour.PYTHON,
        build=f"{kind.__module__}:{kind.__qualname__}",
        method=str(getattr(model, "method", "")),
        step_size=model.step_size,
        finish_time=None,
        inputs=tuple(model.inputs),
        outputs=tuple(model.outputs),
        parameters=tuple(model.parameters),
        states=tuple(model.states),
    )
