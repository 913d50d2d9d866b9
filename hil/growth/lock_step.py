# SPDX-License-Identifier: MIT
"""The loop in lock step, without ROS: models of many ports with the recorder on, and many drives on one bus.

Each drive is an ODrive axis with its own simulated firmware.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.drives.odrive.driver import Odrive
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings, OdriveWheelSettings
from segway_ecc.firmware_io.hardware import NoHardware
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.devices.odrive import TICK_NS, SimulatedOdrive
from segway_ecc.hil.growth.cost import Axis, MeteredClock, Point, cost_of
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import ModelSection, RobotFile
from segway_ecc.node.cycle.interfaces import NoRecorder, NoStage
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.load import load_model
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.robot import Robot

BITRATE: Final = 1_000_000
"""The most that classic CAN allows, bit/s."""
PORTS_CYCLES: Final = 900
"""Fewer than there are slots between the loop and the process that writes the log, so that it never waits for one."""
DRIVES_CYCLES: Final = 500
_WARM_UP: Final = 200
"""Cycles that are not counted; in them the drives prove their watchdogs, and are armed."""
_PERIOD_S: Final = 0.01
_PLANT: Final = "segway_ecc.hil.plants.cart:CartTorquePlant"


class _Through(SectionedModel):
    """Gives each input as an output: what is measured is the way to the model and back, and not the model."""

    name = "through"
    step_size = _PERIOD_S
    method = Method.DISCRETE

    def input(self, u: Sequence[float]) -> None:
        self.taken = u

    def output(self) -> Sequence[float]:
        return self.taken


class _Rest(SectionedModel):
    """Commands no torque to any drive, and is wired to the velocity of each."""

    name = "rest"
    step_size = _PERIOD_S
    method = Method.DISCRETE

    def output(self) -> Sequence[float]:
        return [0.0] * len(self.outputs)


def _with_ports(kind: type[SectionedModel], inputs: dict[str, str], outputs: dict[str, str]) -> SectionedModel:
    """A model of a kind, with ports of these names and units."""
    ports = {"inputs": inputs, "outputs": outputs}
    made = {name: tuple(Variable(*port) for port in each.items()) for name, each in ports.items()}
    filled: type[SectionedModel] = type(kind.__name__, (kind,), made)
    return filled()


def measure_ports(ports: int) -> Point:
    """The cost with a model of so many ports, an even number: half of them inputs, half outputs."""
    clock = MeteredClock(LockstepRig(BITRATE))
    inputs, outputs = ({f"{way}{i}": "1" for i in range(ports // 2)} for way in ("In", "Out"))
    model = _with_ports(_Through, inputs, outputs)
    wiring = dict.fromkeys(inputs, "setpoint.linear_velocity")
    file = RobotFile(name="through", model=ModelSection(source="through"), wiring=wiring, arming="at_start")
    robot = Robot(file, model, NoHardware(), wire(model, NoHardware(), wiring), clock)
    with tempfile.TemporaryDirectory(prefix="segway-ecc-growth-") as name:
        try:
            recorder = ProcessRecorder(Path(name) / "growth.mcap", layout_of(robot))
        except RecordingError as error:
            return Point(axis=Axis.PORTS, size=ports, cost=None, refused=str(error))
        robot.loop(NoStage(), recorder).run(PORTS_CYCLES)
    return Point(axis=Axis.PORTS, size=ports, cost=cost_of(clock.taken_ns[_WARM_UP:]))


class _Pairs:
    """The simulated drives, two and two with a plant of their own; ticked as one robot."""

    def __init__(self, robots: Sequence[SimulatedRobot]) -> None:
        self.tick_ns = TICK_NS
        self.outputs: Sequence[float] = ()
        self._robots = robots

    def tick(self, now_ns: int) -> None:
        for robot in self._robots:
            robot.tick(now_ns)


class _Rig(LockstepRig):
    """A rig whose bus hands out frames while the node waits: what the wire costs is no cost of the cycle."""

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Let the devices run up to the deadline, and the wire too."""
        super().sleep_until_ns(deadline_ns)
        self.bus.deliver()


def measure_drives(drives: int) -> Point:
    """The cost with so many drives, an even number."""
    rig = _Rig(BITRATE)
    clock = MeteredClock(rig)
    wheels = {
        f"drive{i}": OdriveWheelSettings(node_id=i, axis=1 if i % 2 else 0, torque_constant=0.1, max_torque=3.0)
        for i in range(drives)
    }
    can = CanSettings(interface="local", channel="growth", bitrate=BITRATE)
    settings = OdriveSettings(can=can, firmware="0.5", watchdog_s=0.04, axes=wheels)
    rig.attach(_Pairs([_pair(rig, settings, first) for first in range(0, drives, 2)]))  # type: ignore[arg-type]  # as one
    link = rig.bus.attach("node")
    hardware = Assembly(link, [Odrive(link, name, settings, _PERIOD_S, rig.now_ns) for name in wheels], (), rig.now_ns)
    velocities = {f"{name}_velocity": "rad/s" for name in wheels}
    model = _with_ports(_Rest, velocities, {f"{name}_torque": "N m" for name in wheels})
    wiring = {v.name: v.name.replace("_", ".") for v in (*model.inputs, *model.outputs)}
    file = RobotFile(name="drives", model=ModelSection(source="rest"), wiring=wiring, arming="at_start")
    robot = Robot(file, model, hardware, wire(model, hardware, wiring), clock)
    loop = robot.loop(NoStage(), NoRecorder())
    cycles = _WARM_UP + DRIVES_CYCLES
    loop.run(cycles)
    sent, received = link.counters.sent, link.counters.received
    notes = {"mode": str(loop.modes.mode), "frames out, in per cycle": f"{sent / cycles:.1f}, {received / cycles:.1f}"}
    return Point(axis=Axis.DRIVES, size=drives, cost=cost_of(clock.taken_ns[_WARM_UP:], notes))


def _pair(rig: LockstepRig, settings: OdriveSettings, first: int) -> SimulatedRobot:
    link = rig.bus.attach(f"drives {first} and {first + 1}")
    axes = {"left": settings.axes[f"drive{first}"], "right": settings.axes[f"drive{first + 1}"]}
    pair = OdriveSettings(can=settings.can, firmware="0.5", watchdog_s=0.04, axes=axes)
    link.open()
    return SimulatedRobot(link, [SimulatedOdrive(link, pair)], load_model(_PLANT), TICK_NS)
