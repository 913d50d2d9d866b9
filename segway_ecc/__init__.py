# SPDX-License-Identifier: MIT
"""From a control model that works on the bench to the software of a real robot.

What other code may import is what `__all__` lists here and in `segway_ecc.testing`; it stays as it is from one version
to the next. Everything in the rooms `firmware_io`, `node`, `deploy` and `hil` may change.
"""

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from segway_ecc.firmware_io.errors import SegwayEccError
    from segway_ecc.node.config import RobotFile, load_robot
    from segway_ecc.node.cycle.setpoints import Setpoint
    from segway_ecc.node.model.methods import Method
    from segway_ecc.node.model.model import Model
    from segway_ecc.node.model.sectioned import SectionedModel
    from segway_ecc.node.model.simulate import simulate
    from segway_ecc.node.model.variables import Variable, Write
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

_MODULES: Final = {
    "Method": "node.model.methods",
    "Model": "node.model.model",
    "RobotFile": "node.config",
    "SectionedModel": "node.model.sectioned",
    "SegwayEccError": "firmware_io.errors",
    "Setpoint": "node.cycle.setpoints",
    "Variable": "node.model.variables",
    "Write": "node.model.variables",
    "load_model": "node.models.load",
    "load_robot": "node.config",
    "simulate": "node.model.simulate",
}


def __dir__() -> list[str]:
    """The public names, also those not imported yet."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> object:
    """Import a name at its first use: a robot starts without what it does not use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
