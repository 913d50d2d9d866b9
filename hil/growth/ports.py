# SPDX-License-Identifier: MIT
"""The loop with models of many ports, in lock step: recorder on, no hardware, no ROS."""

import functools
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.hardware import NoHardware
from segway_ecc.hil.growth.cost import Axis, MeteredClock, Point, cost_of
from segway_ecc.hil.rig.lockstep import LockstepRig
from segway_ecc.node.config import ModelSection, RobotFile
from segway_ecc.node.cycle.interfaces import NoStage
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.robot import Robot

CYCLES: Final = 900
"""Fewer than there are slots between the loop and the process that writes the log, so that it never waits for one."""
_WARM_UP: Final = 200
_BITRATE: Final = 1_000_000


class _Through(SectionedModel):
    """Gives each input as an output: what is measured is the way to the model and back, and not the model."""

    name = "through"
    step_size = 0.01
    method = Method.DISCRETE

    def input(self, u: Sequence[float]) -> None:
        """Take them all."""
        self.taken = u

    def output(self) -> Sequence[float]:
        """Give them all."""
        return self.taken


@functools.cache
def _model(ports: int) -> type[_Through]:
    """A model with half of the ports as inputs and half as outputs."""
    return type(
        f"Through{ports}",
        (_Through,),
        {
            "inputs": tuple(Variable(f"In{i}", "1") for i in range(ports // 2)),
            "outputs": tuple(Variable(f"Out{i}", "1") for i in range(ports // 2)),
        },
    )


def measure(ports: int) -> Point:
    """The cost with a model of so many ports, an even number."""
    clock = MeteredClock(LockstepRig(_BITRATE))
    model = _model(ports)()
    wiring = {variable.name: "setpoint.linear_velocity" for variable in model.inputs}
    file = RobotFile(name="through", model=ModelSection(source="through"), wiring=wiring, arming="at_start")
    robot = Robot(file, model, NoHardware(), wire(model, NoHardware(), wiring), clock)
    with tempfile.TemporaryDirectory(prefix="segway-ecc-growth-") as name:
        try:
            recorder = ProcessRecorder(Path(name) / "growth.mcap", layout_of(robot))
        except RecordingError as error:
            return Point(axis=Axis.PORTS, size=ports, cost=None, refused=str(error))
        robot.loop(NoStage(), recorder).run(CYCLES)
    return Point(axis=Axis.PORTS, size=ports, cost=cost_of(clock.taken_ns[_WARM_UP:]))
