# SPDX-License-Identifier: MIT
"""Item 9: the robot's ROS process dies."""

import os
import signal
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.hil.inputs.needs import no_ros
from segway_ecc.hil.inputs.rig import Arrangement, Rig
from segway_ecc.hil.inputs.ros_client import ros_client
from segway_ecc.hil.inputs.trial import Event, InputTrial, balances, falls, rests
from segway_ecc.hil.process_usage import helpers_of

_ITEM: Final = 9
_BACK: Final = "the robot is in ROS again"
_BACK_WITHIN_S: Final = 3.0
_SEEN_WITHIN_S: Final = _BACK_WITHIN_S + 3.0
"""DDS announces a new participant at once, and where that is lost every 3 s (Fast DDS, lease announcements)."""
_PATIENCE_S: Final = 30.0
_LAST_S: Final = 0.2
"""What the dead process had published is received within this time."""
_SERVICE_S: Final = 1.0
"""A service is answered and in effect within this time of its call, on a robot that is in ROS."""


def _kill(rig: Rig, _undo: ExitStack) -> Event:
    pid = helpers_of(rig.parts.node.process.pid)["ros"]
    now_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGKILL)
    rig.wait_for(_BACK, _PATIENCE_S)
    back_s = (time.monotonic_ns() - now_ns) * 1e-9
    rig.ros.spin(_LAST_S)
    rig.ros.mode = {}  # what comes now is another process'
    rig.ros.wait_for_robot(_PATIENCE_S)
    seen_s = (time.monotonic_ns() - now_ns) * 1e-9
    limits = (("in ROS again", back_s, _BACK_WITHIN_S), ("received by others", seen_s, _SEEN_WITHIN_S))
    wrong = [f"{what} after {took_s:.2f} s, not {limit_s:g} s" for what, took_s, limit_s in limits if took_s > limit_s]
    return Event(now_ns, [f"in ROS again after {back_s:.2f} s, received by others after {seen_s:.2f} s"], wrong=wrong)


def _stop(rig: Rig, _undo: ExitStack) -> Event:
    with ros_client(rig.namespace) as client:  # others see the dead process' services for 20 s yet
        client.wait_for_robot(_PATIENCE_S)
        now_ns = time.monotonic_ns()
        return Event(now_ns, [client.call("stop")])


def trials() -> Sequence[InputTrial]:
    """All of them."""
    armed, disarmed = Arrangement(ros=True), Arrangement(ros=True, on_request=True, is_armed=False)
    back = "in ROS again after"
    return [
        InputTrial(_ITEM, "the ROS process is killed, armed", _kill, balances(back), armed, needs=no_ros),
        InputTrial(
            _ITEM, "then a stop over ROS", _stop, falls("stop: done", _SERVICE_S), armed, needs=no_ros, follows=True
        ),
        InputTrial(_ITEM, "the ROS process is killed, disarmed", _kill, rests(back), disarmed, needs=no_ros),
    ]
