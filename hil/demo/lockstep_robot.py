# SPDX-License-Identifier: MIT
"""A robot, its guard and its plant in lock step, in one thread at the pace of real time: without processes and ROS.

Where the machine does not keep up, the robot's time runs slower, and nothing in it is late: what it shows is what the
same robot does in every proof in lock step.
"""

import contextlib
import datetime as dt
import logging
import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Final, Self, TypeVar

from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.hil.demo.local_network import LocalNetwork, LocalStage
from segway_ecc.hil.demo.parts import Part, Parts
from segway_ecc.hil.drill.plant_control import DisturbedLink, PlantControl
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.lockstep_guard import LockstepGuard
from segway_ecc.hil.rig.simulation import WALL_START_NS, LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.errors import ConfigurationError, NodeError
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.log_name import name_of_log
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.robot import build_robot

_IDLE_NS: Final = 5_000_000
"""While no node runs, the plant's time goes on in steps of this."""
_MOST_BEHIND_NS: Final = 50_000_000
"""A robot that is later than this does not make up for it: its time is that much behind from then on."""
_ANSWERS_WITHIN_S: Final = 5.0
_LOOKS_EVERY_S: Final = 0.002
_Given = TypeVar("_Given")
_logger = logging.getLogger(__name__)


class NodeKilledError(RigError):
    """The node was killed, as somebody asked."""


class PacedClock:
    """A rig's time, held to real time; see `Clock`. Between two deadlines it does what other threads ask for.

    Attributes:
        node_is_killed: Whether who waits on it is to end as if killed.
    """

    def __init__(self, rig: LockstepRig, real: Clock) -> None:
        """Pace a rig, whose wall clock is that of `real` from now on."""
        self.now_ns = rig.now_ns
        self.node_is_killed = False
        self._rig = rig
        self._real = real
        self._ahead_ns = real.now_ns() - rig.now_ns()
        self._wall_ahead_ns = real.wall_ns() - WALL_START_NS - rig.now_ns()
        self._asked: deque[Callable[[], None]] = deque()

    def wall_ns(self) -> int:
        """Time since the Unix epoch, ns."""
        return self._rig.wall_ns() + self._wall_ahead_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Let the robot's world run up to the deadline, and real time reach it.

        Raises:
            NodeKilledError: The node is to end meanwhile.
        """
        self._rig.sleep_until_ns(deadline_ns)
        late_ns = self._real.now_ns() - deadline_ns - self._ahead_ns
        if late_ns > _MOST_BEHIND_NS:
            self._ahead_ns += late_ns
        self._real.sleep_until_ns(deadline_ns + self._ahead_ns)
        while self._asked:
            self._asked.popleft()()
        if self.node_is_killed:
            self.node_is_killed = False
            raise NodeKilledError("the node was killed, as was asked")

    def ask(self, call: Callable[[], _Given]) -> _Given:
        """Have something done by the thread that waits on this clock; what it gave.

        Raises:
            RigError: The thread does not come to it.
        """
        answer = Future[_Given]()

        def carry_out() -> None:
            try:
                answer.set_result(call())
            except Exception as error:  # noqa: BLE001 - it is for who asked, and ends no robot
                answer.set_exception(error)

        self._asked.append(carry_out)
        try:
            return answer.result(_ANSWERS_WITHIN_S)
        except TimeoutError:
            raise RigError(f"the simulation did not answer within {_ANSWERS_WITHIN_S:g} s") from None


class WatchedClock:
    """A paced clock for other threads, which wait until its time has come; see `Clock`."""

    def __init__(self, paced: PacedClock, real: Clock) -> None:
        """Watch a clock."""
        self.now_ns, self.wall_ns = paced.now_ns, paced.wall_ns
        self._real = real

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Wait until the robot's time has come, or ten times as long has passed."""
        last_ns = self._real.now_ns() + 10 * max(deadline_ns - self.now_ns(), 0)
        while self.now_ns() < deadline_ns and self._real.now_ns() < last_ns:
            self._real.sleep_until_ns(self._real.now_ns() + round(_LOOKS_EVERY_S * NS_PER_S))


class _NodeLink(LinkFront):
    """A node's end of the bus: what a killed one sends on its way out goes nowhere. See `Link`."""

    is_dead = False

    def send(self, frame: Frame) -> bool:
        """Send, while the node lives."""
        return True if self.is_dead else self.behind.send(frame)


class LockstepRobot(Parts):
    """Runs while its context lasts.

    Attributes:
        clock: The robot's time, for other threads.
        network: Where the station reaches it.
    """

    def __init__(self, file: RobotFile, logs: Path, real: Clock) -> None:
        """Prepare a robot; each start of its node writes a log of its own into `logs`.

        Raises:
            ConfigurationError: It is on no CAN bus.
            NoSimulationError: It names no plant, or nothing simulates it.
        """
        hardware = hardware_of(file)
        if not isinstance(hardware, BusSettings):
            raise ConfigurationError(f"robot '{file.name}' is on no CAN bus: its demo needs ROS (--ros)")
        self._file = file
        self._logs = logs
        self._hardware = hardware
        self._rig = rig = LockstepRig.of(hardware)
        self._paced = PacedClock(rig, real)
        self.clock: Final = WatchedClock(self._paced, real)
        self.network: Final = LocalNetwork()
        ends = rig.ends(hardware)
        self._node_end = ends.node
        link = DisturbedLink(ends.devices)
        simulated = simulated_robot(file, link, ends.port, ends.imu_port)
        self._control = PlantControl(simulated, link, simulated.plant, self._paced)
        rig.attach(simulated, lambda *_: self._control.note_torque(rig.now_ns(), 0, simulated.inputs))
        self._guard = LockstepGuard(hardware, rig)
        rig.add(self._guard)
        self._link = _NodeLink(self._node_end)
        self._loop: Loop | None = None
        self._is_over = False
        self._wants_node = True
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)

    def __enter__(self) -> Self:
        """Start it."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the node, zero first, and the thread."""
        self._is_over = True
        if self._loop is not None:
            self._loop.stop("the demo ends")
        self._thread.join(_ANSWERS_WITHIN_S)

    def kill(self, part: Part) -> int:
        """See `Parts.kill`."""

        def end_guard() -> int:
            self._guard.end()
            return self._rig.now_ns()

        def end_node() -> int:
            self._link.is_dead, self.network.is_alive, self._paced.node_is_killed = True, False, True
            return self._rig.now_ns()

        return self._paced.ask(end_guard if part == "guard" else end_node)

    def revive(self) -> None:
        """See `Parts.revive`."""

        def start() -> None:
            self._wants_node = not self.network.is_alive
            if self._guard.next_ns is None:
                self._guard = LockstepGuard(self._hardware, self._rig)
                self._rig.add(self._guard)

        self._paced.ask(start)

    def _ask(self, line: str) -> tuple[int, str]:
        stamp, _, answer = self._paced.ask(lambda: self._control.obey(line)).partition(" ")
        return int(stamp), answer

    def _run(self) -> None:
        while not self._is_over:
            if self._wants_node:
                self._wants_node = False
                self._run_node()
            else:
                with contextlib.suppress(NodeKilledError):  # there is none to kill
                    self._paced.sleep_until_ns(self._rig.now_ns() + _IDLE_NS)

    def _run_node(self) -> None:
        """Run a node until it ends, by whatever; a robot whose node has failed stands there as one that was killed."""
        self._link = link = _NodeLink(self._node_end)
        try:
            robot = build_robot(self._file, self._paced, link)
            path = self._logs / name_of_log(self._file.name, dt.datetime.now(dt.UTC), os.getpid())
            recorder = CycleLog(path, layout_of(robot), provenance_of(self._file))
            self._loop = loop = robot.loop(LocalStage(robot, self.network), recorder)
            self.network.is_alive = True
            loop.run()
        except NodeKilledError:
            pass
        except (NodeError, HardwareError) as error:
            _logger.warning("%s", error)
        finally:
            self.network.is_alive = False
