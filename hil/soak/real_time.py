# SPDX-License-Identifier: MIT
"""A robot in real time: the node with ROS and its recorder, a plant, and a station that drives it."""

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from segway_ecc.hil.processes import command
from segway_ecc.hil.soak.watching import LOG, Watching, helpers_of
from segway_ecc.node.recording.log_quota import MB

OnProgress = Callable[[float], None]
"""Called with the seconds done so far."""

_SETTLE_S: Final = 3.0
_END_S: Final = 60.0
_DOMAINS: Final = 101
"""ROS domains 1 to 101 have ports that Linux gives to nobody else by itself."""


class RealTimeSoak(msgspec.Struct, frozen=True):
    """What is run.

    Attributes:
        robot: The robot file.
        duration_s: How long, s.
        every_s: How often its processes are looked at, s.
        ros: Whether with ROS.
    """

    robot: str
    duration_s: float
    every_s: float
    ros: bool


class RealTimeResult(msgspec.Struct, frozen=True):
    """How the run went.

    Attributes:
        node: What the node reports of its run.
        modes: Messages of the topic `mode`, by mode and reason; empty without ROS.
    """

    node: dict[str, Any]
    modes: dict[str, int]


def soak(run: RealTimeSoak, watching: Watching, folder: Path, on_progress: OnProgress) -> RealTimeResult:
    """RealTimeSoak a robot for some time, and look at its processes every few seconds.

    Args:
        run: What is run.
        watching: Takes what is seen.
        folder: For the log and the messages; `watching` looks at the log there.
        on_progress: Called with every look.

    Raises:
        ProcessFailedError: One of the processes ended with an error.
    """
    line = ["--channel", f"soak_{os.getpid()}", "--interface", "local"]
    namespace = f"/soak_{os.getpid()}"
    # A domain of its own: what DDS keeps of the neighbours' participants is not the robot's growth.
    alone = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % _DOMAINS)}
    node = ["run", run.robot, *line, "--duration", str(run.duration_s), "--json", "--log", str(folder / "soak.mcap")]
    node += ["--log-limit", str(LOG.total_bytes / MB), "--log-file-size", str(LOG.file_bytes / MB)]
    node += ["--namespace", namespace] if run.ros else ["--no-ros"]
    with contextlib.ExitStack() as stack:
        plant = stack.enter_context(command(["plant", run.robot, *line], folder / "plant.txt"))
        controller = stack.enter_context(command(node, folder / "node.txt", alone))
        processes = {"node": controller.process.pid, "plant": plant.process.pid}
        if run.ros:
            words = [namespace, str(run.duration_s - _SETTLE_S)]
            station = stack.enter_context(
                command(words, folder / "station.txt", alone, module="segway_ecc.hil.soak.station"),
            )
            processes["station"] = station.process.pid
        begun_s, turn = time.monotonic(), 1
        while turn * run.every_s < run.duration_s - _SETTLE_S:
            time.sleep(max(begun_s + turn * run.every_s - time.monotonic(), 0.0))
            processes |= helpers_of(processes["node"])
            watching.look(time.monotonic() - begun_s, processes)
            on_progress(time.monotonic() - begun_s)
            turn += 1
        return RealTimeResult(controller.result(_END_S), station.result(_END_S)["modes"] if run.ros else {})
