# SPDX-License-Identifier: MIT
"""A base station of one simulated robot, on which things can be tried."""

import logging
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from segway_ecc.deploy.station.requests import Reply, once
from segway_ecc.deploy.station.views import Act, Command, Drive, EventView, FleetView, RobotView, TrialView
from segway_ecc.deploy.station.web.shared import Robots
from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.hil.demo.parts import Parts
from segway_ecc.hil.demo.trials import RECOVER, Trial, heal, sentence, trials_for, watch
from segway_ecc.hil.errors import RigError
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import failure_text
from segway_ecc.node.safety.modes import ACTIVE, Mode
from segway_ecc.node.safety.posture import Posture

_ANSWERS_WITHIN_S: Final = 3.0
_IS_UP_WITHIN_S: Final = 20.0
_LOOKS_EVERY_S: Final = 0.1
_AGAIN_S: Final = 1.0
"""Between two requests: a robot that has fallen is taken once it lies still."""
_RECOVERY: Final = TrialView(
    name=RECOVER, title="Bring it back", effect="everything is repaired, and the robot armed and stood up again"
)
_logger = logging.getLogger(__name__)


class TestBench:
    """A station, and trials one at a time; see `deploy.station.web.shared.Robots`."""

    __test__ = False  # of no test runner

    def __init__(
        self, station: Robots, parts: Parts, states: Sequence[str], measured: Sequence[str], clock: Clock
    ) -> None:
        """Try things on the robot of `parts`, whose plant has these states and measured values."""
        self._station = station
        self._parts = parts
        self._clock = clock
        self._states = states
        self._trials: Mapping[str, Trial] = {trial.view.name: trial for trial in trials_for(states, measured)}
        self.trials: Final[Sequence[TrialView]] = (*(trial.view for trial in self._trials.values()), _RECOVERY)
        self.limits: Final[Setpoint] = station.limits
        self._worker = ThreadPoolExecutor(1, "trials")
        self._is_free = threading.Semaphore()

    def fleet(self) -> FleetView:
        """The newest picture."""
        return self._station.fleet()

    def events(self, after: int) -> Sequence[EventView]:
        """The events that are kept and whose number is greater than `after`."""
        return self._station.events(after)

    def refused(self) -> Mapping[str, int]:
        """What the station refused, by cause."""
        return self._station.refused()

    def drive(self, who: str, drive: Drive) -> None:
        """Have the robot driven."""
        self._station.drive(who, drive)

    def leave(self, who: str) -> None:
        """An operator is gone."""
        self._station.leave(who)

    def submit(self, who: str, command: Command, reply: Reply) -> None:
        """Have a command carried out: a trial by us, any other by the station."""
        if command.act is not Act.TRY:
            self._station.submit(who, command, reply)
            return
        answer = once(reply)
        if command.name != RECOVER and command.name not in self._trials:
            answer(False, f"there is no trial '{command.name}'")  # noqa: FBT003 - the contract's form
        elif not self._is_free.acquire(blocking=False):
            answer(False, "the robot is still being watched after the last one")  # noqa: FBT003 - the same
        else:
            self._worker.submit(self._carry_out, who, command, answer)

    def close(self) -> None:
        """End once what is tried has ended."""
        self._worker.shutdown()

    def _carry_out(self, who: str, command: Command, reply: Reply) -> None:
        try:
            text = self._recover(who) if command.name == RECOVER else self._try(self._trials[command.name])
            reply(True, text)  # noqa: FBT003 - the contract's form
        except RigError as error:
            reply(False, str(error))  # noqa: FBT003 - the same
        except Exception as error:  # whatever it is, who asked is waiting for an answer
            _logger.exception("a trial failed, and the station goes on")
            reply(False, failure_text(error))  # noqa: FBT003 - the same
        finally:
            self._is_free.release()

    def _try(self, trial: Trial) -> str:
        return sentence(watch(self._parts, self._robot, self._clock, trial.do(self._parts, self._clock)))

    def _recover(self, who: str) -> str:
        """Repair everything, and lead the robot back; RigError with the reason where it does not come."""
        heal(self._parts, self._states)
        begun_ns, refusal = self._clock.now_ns(), ""
        while (robot := self._robot()) is None or not _is_back(robot):
            if self._since_s(begun_ns) > _IS_UP_WITHIN_S:
                raise RigError(f"it did not come back within {_IS_UP_WITHIN_S:g} s: {refusal or _state(robot)}")
            refusal = self._next_step(who, robot) or refusal
            self._pause(_LOOKS_EVERY_S)
        return f"it is back after {self._since_s(begun_ns):.1f} s: {_state(robot)}"

    def _next_step(self, who: str, robot: RobotView | None) -> str:
        """Take the next step of the way back; why it was refused, or nothing."""
        if robot is None or not robot.is_alive or robot.posture == Posture.STANDING_UP:
            return ""
        if robot.mode == Mode.FAULT:
            act = Act.CLEAR_FAULT
        elif robot.can_stand:
            act = Act.STAND
        else:
            act = Act.ARM
        refusal = self._ask(who, robot.robot, act)
        if refusal:
            self._pause(_AGAIN_S)
        return refusal

    def _ask(self, who: str, robot: str, act: Act) -> str:
        """Have the station command the robot; why that was refused, or nothing."""
        answered = threading.Event()
        answers = list[tuple[bool, str]]()

        def reply(accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
            answers.append((accepted, text))
            answered.set()

        self._station.submit(who, Command(id=1, robot=robot, act=act), reply)
        if not answered.wait(_ANSWERS_WITHIN_S):
            return "the station did not answer"
        accepted, text = answers[0]
        return "" if accepted else text

    def _since_s(self, begun_ns: int) -> float:
        return (self._clock.now_ns() - begun_ns) / NS_PER_S

    def _pause(self, seconds: float) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + round(seconds * NS_PER_S))

    def _robot(self) -> RobotView | None:
        return next(iter(self._station.fleet().robots), None)


def _is_back(robot: RobotView) -> bool:
    return robot.is_alive and robot.mode in ACTIVE and (not robot.posture or robot.posture == Posture.BALANCING)


def _state(robot: RobotView | None) -> str:
    if robot is None:
        return "no robot is seen"
    return f"{robot.mode} {robot.posture}".strip() + f": {robot.reason}"
