# SPDX-License-Identifier: MIT
"""A simulated robot whose node is killed while it drives: plant, guard and node are processes, in real time."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from segway_ecc.hil.commission.session import StepRefusedError
from segway_ecc.hil.commission.wheel_steps import Found
from segway_ecc.hil.drill import trial
from segway_ecc.hil.drill.parts import DrillSetup, lines_of_its_own
from segway_ecc.hil.drill.trial import DrillFault, DrillResult
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.config import RobotFile

Run = Callable[[DrillFault, DrillSetup], DrillResult]
_KILLED: Final = trial.FAULTS["node killed"]


def kill_node(robot: str, file: RobotFile, run: Run = trial.run) -> Found:
    """Have a robot, by its name or the path of its file, stand and drive by its own node, and kill that.

    With the guard, and then by the drives' own watchdog alone, unless the robot does not arm so.

    Raises:
        StepRefusedError: Torque does not end in time, or the robot does not drive.
    """
    if file.arming != "at_start":
        return Found(f"the robot arms by 'arming: {file.arming}': nobody asks it to here", {}, "left out")
    measured: dict[str, float] = {}
    guards = {"with the guard": True, "by the drives' watchdog alone": False}
    if hardware_of(file).guard == "required":
        del guards["by the drives' watchdog alone"]
    for name, guard in guards.items():
        with TemporaryDirectory(prefix="segway-ecc-commission-") as folder:
            lines = lines_of_its_own(hardware_of(file), Path(folder), ("--interface", "local", "--channel", folder))
            setup = DrillSetup(robot, lines, serial=False, guard=guard, stepped=False, folder=Path(folder))
            result = run(_KILLED, setup)
        if result.torque is None:
            raise StepRefusedError(f"the node that is to be killed does not drive the robot: {result.note}")
        if not result.is_as_expected:
            ends = "does not end" if result.torque.zero_s is None else f"ends after {result.torque.last_s * 1e3:.0f} ms"
            raise StepRefusedError(
                f"the node killed while the robot drives, torque {ends} {name}, allowed is {result.within_s * 1e3:.0f} "
                "ms: see the drives' watchdog and the guard; on a busy machine the guard itself is late"
            )
        measured["guard_off_after_s" if guard else "watchdog_off_after_s"] = result.torque.last_s
    times = ", ".join(f"after {took * 1e3:.0f} ms {name}" for took, name in zip(measured.values(), guards, strict=True))
    return Found(f"the node killed while the robot drives, torque ended {times}; allowed 50 ms", measured)
