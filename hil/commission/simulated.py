# SPDX-License-Identifier: MIT
"""A simulated robot that is commissioned in lock step, by a person who does as told; it may be wired wrongly."""

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import msgspec

from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.hil.commission.expected import require_two_wheels
from segway_ecc.hil.commission.kill import kill_node
from segway_ecc.hil.commission.miswiring import MiswiredPlant, Miswiring
from segway_ecc.hil.commission.person import Answer, Task
from segway_ecc.hil.commission.session import Session
from segway_ecc.hil.commission.wheel_steps import Found
from segway_ecc.hil.devices.family import simulated_drives
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_plant, simulated_robot
from segway_ecc.node.config import RobotFile
from segway_ecc.node.robot import Robot, build_robot

_PLANTS: Final = "segway_ecc.hil.plants.segway_held"
_HELD: Final = {"left.voltage": f"{_PLANTS}:HeldSegwayPlant", "left.torque": f"{_PLANTS}:HeldSegwayTorquePlant"}
_TILT: Final = 0.7
_UPRIGHT: Final = {"HandPitch": 0.0, "HandRoll": 0.0}
_SAYS_AFTER_S: Final = 0.5
"""How long somebody takes to answer at least."""
_PRESSES_AFTER_S: Final = 0.2
_TURN: Final = 2.0 * math.pi
EXACTLY: Final[Mapping[Task, tuple[float, Mapping[str, float]]]] = {
    Task.LIFT: (0.5, {"OnFloor": 0.0, **_UPRIGHT}),
    Task.TURN_LEFT_WHEEL: (3.0, {"LeftTurn": _TURN}),
    Task.TURN_RIGHT_WHEEL: (3.0, {"RightTurn": _TURN}),
    Task.HOLD_UPRIGHT: (2.0, _UPRIGHT),
    Task.TILT_FORWARD: (2.0, {"HandPitch": _TILT}),
    Task.TILT_RIGHT: (2.0, {"HandRoll": _TILT}),
    Task.TURN_LEFT: (2.5, {"HandYaw": 0.25 * _TURN}),
    Task.BALANCE: (2.0, {"OnFloor": 1.0, **_UPRIGHT}),
    Task.PUSH: (4.0, {"HandTravel": 1.0}),
    Task.SPIN: (6.0, {"HandYaw": 1.25 * _TURN}),
}
"""How long somebody takes, s, and how they then hold the robot, as states of `segway_held`."""


class ScriptedPerson:
    """Does as told with the simulated robot; see `Person`.

    Attributes:
        does: What they do for each task: for how long, s, and how they then hold the robot, by its plant's states.
        robot, rig: The robot in hand, and the clock; None before there is one.
        has_stop: Whether the e-stop has an effect.
        press_stop: (drives, whether it is pressed) -> what it does to them; None where nothing.
    """

    def __init__(self, show: Callable[[str], None] | None = None) -> None:
        """Have no robot in hand yet; `show` is called with what they are shown."""
        self.does: Mapping[Task, tuple[float, Mapping[str, float]]] = EXACTLY
        self._show = show
        self.robot: SimulatedRobot | None = None
        self.rig: LockstepRig | None = None
        self.has_stop = True
        self.press_stop: Callable[[Any, bool], None] | None = None
        self._begun_ns = 0
        self._task = Task.LIFT
        self._lasts_s = 0.0

    def begin(self, task: Task) -> None:
        """See `Person.begin`."""
        self._task, self._begun_ns = task, self._now_ns()
        self._lasts_s, states = self.does.get(task, (_SAYS_AFTER_S, {}))
        if self.robot is not None:
            for name, value in states.items():
                self.robot.plant.write(name, value)
        if task is Task.RELEASE_STOP:
            self._stop(pressed=False)

    def answer(self) -> Answer | None:
        """See `Person.answer`."""
        since_s = (self._now_ns() - self._begun_ns) / NS_PER_S
        if self._task is Task.PRESS_STOP and since_s >= _PRESSES_AFTER_S and self.has_stop:
            self._stop(pressed=True)
        return Answer.DONE if since_s >= self._lasts_s else None

    def read(self, line: str) -> None:
        """See `Person.read`."""
        if self._show is not None:
            self._show(line)

    def _now_ns(self) -> int:
        return 0 if self.rig is None else self.rig.now_ns()

    def _stop(self, *, pressed: bool) -> None:
        """Press or release the e-stop."""
        if self.robot is not None and self.press_stop is not None:
            self.press_stop(self.robot.devices[0], pressed)


class SimulatedSite:
    """A simulated segway in lock step; see `Workplace`."""

    is_simulated = True

    def __init__(
        self,
        file: RobotFile,
        error: Miswiring | None = None,
        show: Callable[[str], None] | None = None,
        killed: str | None = None,
    ) -> None:
        """Commission the simulated robot of a file, wired rightly or with an error; `show` is called with each outcome.

        With `killed`, the robot's name or the path of its file, its node is run too, in real time, and killed.

        Raises:
            NoSimulationError: It has no plant, or its drives are none that this simulates.
            RigError: It is not on two wheels; see `require_two_wheels`.
        """
        require_two_wheels(file)
        section = file.simulation
        if section is None:
            raise NoSimulationError(f"robot '{file.name}' has no plant: add simulation.plant to its file")
        self.file = msgspec.structs.replace(file, commissioned="optional")
        self._drives = simulated_drives(hardware_of(file))
        self.person = ScriptedPerson(show)
        self.person.press_stop = self._drives.press_stop
        self._error, self._killed = error, killed
        commands = {variable.name for variable in simulated_plant(file).inputs}
        held = [plant for name, plant in _HELD.items() if name in commands]
        if not held:
            raise NoSimulationError(f"robot '{file.name}' is no segway whose wheels take voltages or torques")
        self._section, self._held = section, held[0]

    @contextlib.contextmanager
    def session(self) -> Iterator[Session]:
        """See `Workplace.session`; the person holds it."""
        with self._simulated(self._held) as (rig, robot, simulated):
            self.person.rig, self.person.robot = rig, simulated
            robot.hardware.open()
            with contextlib.closing(robot.hardware):
                yield Session(self.file, robot.hardware, rig, robot.period_ns / NS_PER_S, self.person)

    @contextlib.contextmanager
    def robot(self) -> Iterator[Robot]:
        """See `Workplace.robot`; nobody holds it, and it lies on its bumper."""
        with self._simulated(self._section.plant, lies=True) as (rig, robot, simulated):
            self.person.rig, self.person.robot = rig, simulated
            yield robot

    def kill(self) -> Found:
        """See `Workplace.kill`: in lock step there is no process of its own."""
        if self._killed is not None:
            return kill_node(self._killed, self.file)
        return Found("simulated in lock step: there is no process to kill; --kill runs one", {}, "left out")

    @contextlib.contextmanager
    def _simulated(self, plant: str, *, lies: bool = False) -> Iterator[tuple[LockstepRig, Robot, SimulatedRobot]]:
        """The rig with the robot in front of a plant; `lies` on its front bumper at first."""
        parameters = dict(self._section.parameters)
        if self._error is not None:
            parameters |= self._error.parameters or {}
        if lies:
            parameters["InitialPitch"] = parameters.get("StopAngle", simulated_plant(self.file).read("StopAngle"))
        section = msgspec.structs.replace(self._section, plant=plant, parameters=parameters)
        file = msgspec.structs.replace(self.file, simulation=section, arming="on_request")
        rig = LockstepRig.of(hardware_of(file))
        ends = rig.ends(hardware_of(file))
        end = ends.devices
        simulated = simulated_robot(file, end, ends.port, ends.imu_port)
        if self._error is not None:
            simulated.plant = MiswiredPlant(simulated.plant, self._error)
            simulated.outputs = simulated.plant.initialize(simulated.inputs)
            self._take_away(simulated, self._error.lacks)
        rig.attach(simulated)
        robot = build_robot(file, rig, ends.node)
        end.open()
        with contextlib.closing(end):
            yield rig, robot, simulated

    def _take_away(self, simulated: SimulatedRobot, part: str) -> None:
        self.person.has_stop = part != "e-stop"
        if part == "watchdog" and self._drives.lose_watchdog is not None:
            self._drives.lose_watchdog(simulated.devices[0])
