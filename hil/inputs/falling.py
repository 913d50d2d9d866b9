# SPDX-License-Identifier: MIT
"""Item 4: a robot that is pushed over, and one whose gyro is wrong."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.hil.inputs.needs import no_ros
from segway_ecc.hil.inputs.rig import Arrangement, Rig
from segway_ecc.hil.inputs.trial import Do, Event, InputTrial, balances, falls
from segway_ecc.node.safety.posture import Posture

_ITEM: Final = 4
_PUSHES: Final = ((150.0, 0.1), (20.0, 1.0))
"""N and s: both robots withstand 74 N for 0.1 s, and 14.5 N for 1 s."""
_WRONG: Final = 0.3
"""rad/s and m/s2; see `hil/scenarios/segway_imu-drifts.yaml`."""
_FALLS_WITHIN_S: Final = 2.0
"""Of a push; a gyro that is wrong is a fault sooner."""
_ENDS: Final = r"^FAULT.*(has fallen|runs away|allowed is)"
_IS_WRONG: Final = r"^FAULT.*the IMU's gyro is off"


def _push(force_n: float, for_s: float) -> Do:
    def do(rig: Rig, _undo: ExitStack) -> Event:
        pushed_ns = rig.request(f"write PushForce {force_n}")
        time.sleep(for_s)
        rig.request("write PushForce 0")
        return Event(pushed_ns)

    return do


def _stand_up(rig: Rig, _undo: ExitStack) -> Event:
    answers: list[str] = []

    def is_taken() -> bool:
        """It is refused, with the reason, for as long as the robot still moves."""
        answers.append(rig.ros.call("stand_up"))
        return answers[-1].startswith("stand_up: done")

    rig.wait(is_taken, "stand_up is refused")
    rig.wait(lambda: rig.state.posture == Posture.BALANCING, "it does not stand up")
    return Event(time.monotonic_ns(), answers[-1:])


def _wrong_imu(rig: Rig, _undo: ExitStack) -> Event:
    return Event(rig.request(f"add imu {_WRONG}"))


def trials() -> Sequence[InputTrial]:
    """All of them."""
    ros = Arrangement(ros=True)
    found = []
    for force_n, for_s in _PUSHES:
        name, ends = f"pushed over by {force_n:g} N for {for_s:g} s", falls(_ENDS, _FALLS_WITHIN_S)
        found.append(InputTrial(_ITEM, name, _push(force_n, for_s), ends, ros, 2.5, needs=no_ros))
        up = balances("stand_up: done")
        found.append(InputTrial(_ITEM, "then stand_up", _stand_up, up, ros, needs=no_ros, follows=True))
    wrong = InputTrial(_ITEM, "the IMU is wrong by 0.3", _wrong_imu, falls(_IS_WRONG, _FALLS_WITHIN_S), look_s=2.5)
    return [*found, wrong]
