# SPDX-License-Identifier: MIT
"""From a control model that works on the bench to the software of a real robot.

What other code may import is what `__all__` lists here, in `segway_ecc.drives` and in `segway_ecc.testing`; it stays as
it is from one version to the next. Everything in the rooms `firmware_io`, `node`, `deploy` and `hil` may change.
"""

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself would cost a start more than all of this
if TYPE_CHECKING:
    from segway_ecc.firmware_io.errors import SegwayEccError
    from segway_ecc.node.config import RobotFile, load_robot
    from segway_ecc.node.cycle.setpoints import Setpoint
    from segway_ecc.node.model.model import Model, Variable, Write, simulate
    from segway_ecc.node.model.sectioned import Method, SectionedModel
    from segway_ecc.node.models.load import load_model

__all__ = [
    "Method",
    "Model",
    "RobotFile",
    "SectionedModel",
    "SegwayEccError",
    "Setpoint",
    "Variable",
    "Write",
    "load_model",
    "load_robot",
    "simulate",
]

_MODULES = {
    "Method": "node.model.sectioned",
    "Model": "node.model.model",
    "RobotFile": "node.config",
    "SectionedModel": "node.model.sectioned",
    "SegwayEccError": "firmware_io.errors",
    "Setpoint": "node.cycle.setpoints",
    "Variable": "node.model.model",
    "Write": "node.model.model",
    "load_model": "node.models.load",
    "load_robot": "node.config",
    "simulate": "node.model.model",
}


def __dir__() -> list[str]:
    """The public names, also those not imported yet."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> object:
    """Import a name at its first use: a robot starts without what it does not use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib  # noqa: PLC0415 - the command imports nothing before it has taken Ctrl-C

    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
