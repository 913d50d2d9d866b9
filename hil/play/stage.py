# SPDX-License-Identifier: MIT
"""The keyboard as a stage of the loop, in front of ROS or of nobody, and what it can do but drive."""

import logging
import math
import os
import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from segway_ecc.hil.play.channel import Key, LoopEnd, Snapshot
from segway_ecc.node.cycle.interfaces import Inbox, Report, Request, Stage, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.robot import Robot
from segway_ecc.node.safety.modes import ACTIVE, Action, Answer, Mode, Modes

LINEAR_STEP: Final = 0.1
ANGULAR_STEP: Final = 0.2
MAX_LINEAR: Final = 1.0
MAX_ANGULAR: Final = 2.0
PITCH: Final = "Pitch"
"""The model's output of the tilt, where it has one."""
PUSH_N: Final = 50.0
PUSH_S: Final = 0.1
"""With `PUSH_N` 5 N s: the segway of the case study recovers from 7.5 N s at rest."""
FORCE: Final = "PushForce"
_SHOW_EVERY_S: Final = 0.05
_MESSAGES: Final = 6
_LINK_STATE: Final = re.compile(r"link\.(?:(\w+)\.)?state")
_TIMING: Final = frozenset({"rate_hz", "late", "skipped"})
_STEPS: Final = {
    Key.UP: (LINEAR_STEP, 0.0),
    Key.DOWN: (-LINEAR_STEP, 0.0),
    Key.LEFT: (0.0, ANGULAR_STEP),
    Key.RIGHT: (0.0, -ANGULAR_STEP),
}
_ACTIONS: Final = {
    Key.ARM: Action.ARM,
    Key.DISARM: Action.DISARM,
    Key.STOP: Action.STOP,
    Key.CLEAR_FAULT: Action.CLEAR_FAULT,
}

_logger = logging.getLogger(__name__)


class PlantControls:
    """Sends commands to the plant's process, without waiting for it."""

    def __init__(
        self,
        control: int,
        period_ns: int,
        guard_runs: Callable[[], bool],
        *,
        has_ros: bool = False,
        can_be_pushed: bool,
    ) -> None:
        """Write to the plant's control, a descriptor; `work` is called once in `period_ns`."""
        self.has_ros = has_ros
        self.guard_runs = guard_runs
        self.can_be_pushed = can_be_pushed
        self.is_bus_broken = False
        self._control = control
        self._push_cycles = max(round(PUSH_S * 1e9 / period_ns), 1)
        self._left = 0
        os.set_blocking(control, False)

    def push(self) -> None:
        """Push the robot ahead for a moment, where it can be pushed."""
        if self.can_be_pushed and self._send(f"write {FORCE} {PUSH_N}"):
            self._left = self._push_cycles

    def cut_bus(self) -> None:
        """Cut the bus, where it is whole."""
        self.is_bus_broken = self.is_bus_broken or self._send("cut")

    def repair_bus(self) -> None:
        """Restore the bus, where it was cut."""
        self.is_bus_broken = self.is_bus_broken and not self._send("heal")

    def work(self) -> None:
        """End a push whose time is over."""
        if self._left == 1 and not self._send(f"write {FORCE} 0"):
            return
        self._left = max(self._left - 1, 0)

    def _send(self, line: str) -> bool:
        try:
            return os.write(self._control, f"{line}\n".encode()) > 0
        except OSError:  # full, or the plant is gone
            return False


class PlayStage:
    """See `Stage`. Set-points come from the keyboard or from the stage behind: the last that sent one drives.

    The keyboard's set-point is renewed while the terminal is alive: where it hangs, set-points fall silent and the
    robot holds, as for any other driver. Of the messages below the view the oldest is discarded; `modes` are the
    robot's, set once its loop is there.
    """

    wants_reports = True

    def __init__(
        self, behind: Stage, terminal: LoopEnd, rig: PlantControls, robot: Robot, modes: Modes | None = None
    ) -> None:
        """Drive `robot`, whose plant is reached over `rig`, from `terminal`."""
        self.messages: deque[str] = deque(maxlen=_MESSAGES)
        self._behind = behind
        self._terminal = terminal
        self._rig = rig
        self._robot = robot
        self.modes = modes
        self._signals = list(robot.wiring.published)
        self._has_posture = robot.file.safety is not None and robot.file.safety.posture is not None
        self._has_pitch = any(v.name == PITCH for v in robot.model.outputs)
        self._show_every = max(round(_SHOW_EVERY_S * 1e9 / robot.period_ns), 1)
        self._cycles = 0
        self._is_driving = False
        self._wanted = REST
        self._in_force = REST
        self._over: str | None = None
        self._hardware: Mapping[str, str] = {}
        self._timing: Mapping[str, str] = {}

    @property
    def over(self) -> str | None:
        """Why the loop is to end."""
        return self._over or self._behind.over

    def take_inbox(self) -> Inbox:
        """What came from behind, and what the keys ask for."""
        inbox = self._behind.take_inbox()
        if inbox.setpoints:
            self._is_driving = False
        for key in self._terminal.pressed():
            self._press(key, inbox)
        if self._terminal.is_gone:
            self._over = self._over or "the terminal is gone"
        self._rig.work()
        return inbox

    def publish(self, report: Report) -> None:
        """Hand on, and show now and then."""
        if self._behind.wants_reports:
            self._behind.publish(report)
        if report.mode not in ACTIVE:
            self._wanted = self._in_force = REST  # arming again never jumps
        elif report.applied is not None:
            self._in_force = report.applied.setpoint
        if self._cycles % self._show_every == 0:
            self._terminal.show(self._snapshot(report))
        self._cycles += 1

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Hand on, and keep what is shown."""
        self._behind.publish_diagnostics(stamp_ns, statuses)
        for status in statuses:
            if status.name.endswith(": hardware"):
                self._hardware = status.values
            elif status.name.endswith(": timing"):
                self._timing = status.values

    def do_background_work(self) -> None:
        """Hand on."""
        self._behind.do_background_work()

    def close(self) -> None:
        """Hand on."""
        self._behind.close()

    def _press(self, key: Key, inbox: Inbox) -> None:
        match key:
            case Key.REST | Key.UP | Key.DOWN | Key.LEFT | Key.RIGHT:
                start, step = self._wanted if self._is_driving else REST, _STEPS.get(key, (0.0, 0.0))
                linear = _within(start.linear_velocity + step[0], MAX_LINEAR)
                angular = _within(start.angular_velocity + step[1], MAX_ANGULAR)
                self._is_driving, self._wanted = True, REST if key is Key.REST else Setpoint(linear, angular)
                inbox.setpoints.append(StampedSetpoint(self._wanted, None))
            case Key.ALIVE if self._is_driving and self._wanted != REST:
                inbox.setpoints.append(StampedSetpoint(self._wanted, None))
            case Key.STAND | Key.SIT if self._has_posture:
                action = Action.STAND_UP if key is Key.STAND else Action.SIT_DOWN
                inbox.requests.append(Request(action, self._log_answer))
            case Key.PUSH:
                self._rig.push()
            case Key.CUT:
                self._rig.cut_bus()
            case Key.REPAIR:
                self._rig.repair_bus()
            case Key.QUIT if self._over is not None:  # at once, wherever it is on its way down
                inbox.requests.append(Request(Action.DISARM, self._log_answer))
            case Key.QUIT:
                self._over = "q was pressed"
            case _ if key in _ACTIONS:
                inbox.requests.append(Request(_ACTIONS[key], self._log_answer))

    def _log_answer(self, answer: Answer) -> None:
        """Log an answer; a change of mode is logged by the loop already."""
        if not answer.accepted:
            _logger.info("refused: %s", answer.message)
        elif self.modes is None or answer.message != f"{self.modes.mode}: {self.modes.reason}":
            _logger.info("%s", answer.message)

    def _snapshot(self, report: Report) -> Snapshot:
        is_armed = report.mode is Mode.ARMED
        states = [(_LINK_STATE.fullmatch(key), state) for key, state in self._hardware.items()]
        links = {match[1] or "can": state for match, state in states if match is not None}
        return Snapshot(
            robot=self._robot.file.name,
            mode=str(report.mode),
            reason="" if self.modes is None else self.modes.reason,
            linear=self._measured(report, "odometry.linear_velocity"),
            angular=self._measured(report, "odometry.angular_velocity"),
            wanted_linear=self._in_force.linear_velocity if is_armed else 0.0,
            wanted_angular=self._in_force.angular_velocity if is_armed else 0.0,
            pitch=self._robot.model.read(PITCH) if self._has_pitch else None,
            posture=None if report.posture is None else report.posture.lower(),
            battery={k: v for k, v in self._hardware.items() if k.endswith("bus_voltage_v")},
            links=links,
            line=self._hardware.get("link.owner"),
            timing={k: v for k, v in self._timing.items() if k in _TIMING},
            messages=list(self.messages),
            has_ros=self._rig.has_ros,
            guard_runs=self._rig.guard_runs(),
            can_be_pushed=self._rig.can_be_pushed,
            is_bus_broken=self._rig.is_bus_broken,
        )

    def _measured(self, report: Report, signal: str) -> float | None:
        if signal not in self._signals:
            return None
        value = report.values[self._signals.index(signal)]
        return value if math.isfinite(value) else None


def _within(value: float, limit: float) -> float:
    """Within a limit, and without what is left of sums of steps."""
    return round(min(max(value, -limit), limit), 6)
