# SPDX-License-Identifier: MIT
"""Item 1: writes of parameters."""

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.hil.inputs.needs import no_ros
from segway_ecc.hil.inputs.rig import Arrangement, Misbehaviour, Rig
from segway_ecc.hil.inputs.trial import Do, Event, InputTrial, balances, rests

_ITEM: Final = 1
_WRONG: Final = (("0", 0.0), ("a negative value", -0.05), ("not a number", math.nan))
_ARMED: Final = Arrangement(ros=True)
_DISARMED: Final = Arrangement(ros=True, on_request=True, is_armed=False)
_RAISES: Final = Arrangement(ros=True, model=Misbehaviour(write="name != 'MaxSpeed' or 1 / 0"))


def _set(name: str, value: float) -> Do:
    def do(rig: Rig, _undo: ExitStack) -> Event:
        now_ns = time.monotonic_ns()
        return Event(now_ns, [rig.ros.set_parameter(name, value)])

    return do


def trials() -> Sequence[InputTrial]:
    """All of them."""
    armed = [
        *((f"MaxSpeed is set to {text}", "MaxSpeed", value, "refused: .*MaxSpeed") for text, value in _WRONG),
        *((f"WheelRadius is set to {text}", "WheelRadius", value, "refused: .*WheelRadius") for text, value in _WRONG),
        ("WheelRadius, not tunable while armed, is set to 0.052", "WheelRadius", 0.052, "refused: .*not tunable while"),
        ("MaxSpeed, tunable while armed, is set to 0.8", "MaxSpeed", 0.8, "MaxSpeed: done"),
    ]
    disarmed = [
        (f"WheelRadius is set to {text}", "WheelRadius", value, "refused: .*WheelRadius") for text, value in _WRONG
    ]
    return [
        *(
            InputTrial(_ITEM, f"{what}, armed", _set(name, value), balances(reason), _ARMED, needs=no_ros)
            for what, name, value, reason in armed
        ),
        InputTrial(
            _ITEM,
            "MaxSpeed is set, and the model's write raises, armed",
            _set("MaxSpeed", 0.8),
            balances("MaxSpeed: refused: .*ZeroDivisionError"),
            _RAISES,
            needs=no_ros,
        ),
        *(
            InputTrial(_ITEM, f"{what}, disarmed", _set(name, value), rests(reason), _DISARMED, needs=no_ros)
            for what, name, value, reason in disarmed
        ),
    ]
