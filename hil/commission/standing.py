# SPDX-License-Identifier: MIT
"""The last steps: the robot's own loop stands it up, first held by a hand, then alone, and sits it down again."""

from typing import Final

from segway_ecc.hil.commission.session import StepRefusedError
from segway_ecc.hil.commission.wheel_steps import Found
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoRecorder, NoStage, Request
from segway_ecc.node.robot import Robot
from segway_ecc.node.safety.modes import Action, Answer, Mode
from segway_ecc.node.safety.posture import Posture

_SETTLES_S: Final = 1.5
"""Before it is asked: the pre-arm checks look at the last second."""
_ARMS_WITHIN_S: Final = 10.0
_ASKS_EVERY_S: Final = 0.5
_ENDS_WITHIN_S: Final = 40.0


class _Watch(NoRecorder):
    """Asks the robot to stand, sees for how long it balances, and ends the world when that is long enough."""

    def __init__(self, robot: Robot, seconds: float) -> None:
        self.balanced_s = self.stood_up_after_s = 0.0
        self.reason: str | None = None
        self.refusal = ""
        self.stage = _AskingStage(self)
        self.cycles = 0
        self.is_armed = False
        self._seconds, self.period_s = seconds, robot.period_ns * 1e-9
        self._posture: Posture | None = None
        self._wheels = [list(robot.hardware.signals).index(f"{side}.angle") for side in ("left", "right")]
        self.turned = [0.0, 0.0]
        self._start: list[float] | None = None

    def write(self, record: CycleRecord) -> None:
        """Look at a cycle."""
        self.cycles += 1
        self.is_armed = self.is_armed or record.mode in {Mode.ARMED, Mode.HOLD}
        if record.posture is not None:
            self._posture = record.posture.posture
            self.reason = record.posture.reason or self.reason
        if self._posture is Posture.BALANCING:
            angles = [record.sensors.values[place] for place in self._wheels]
            if self._start is None:
                self._start, self.stood_up_after_s = angles, self.cycles * self.period_s
            turns = (abs(angle - start) for angle, start in zip(angles, self._start, strict=True))
            self.turned = [max(now, before) for now, before in zip(turns, self.turned, strict=True)]
            self.balanced_s += self.period_s
        elapsed_s = self.cycles * self.period_s
        if self.balanced_s >= self._seconds:
            self.stage.over = f"it balanced for {self._seconds:g} s"
        elif record.mode is Mode.FAULT or self._posture is Posture.FALLEN:
            self.stage.over = "it fell, or is in FAULT"
        elif not self.is_armed and elapsed_s > _SETTLES_S + _ARMS_WITHIN_S:
            self.stage.over = "it did not arm"

    def note(self, answer: Answer) -> None:
        """Keep why it was refused."""
        self.refusal = "" if answer.accepted else answer.message


class _AskingStage(NoStage):
    """The world: asks to stand up until the robot is armed."""

    def __init__(self, watch: _Watch) -> None:
        self.over: str | None = None
        self._watch = watch

    def take_inbox(self) -> Inbox:
        """A request now and then, until it is armed."""
        watch = self._watch
        every = max(round(_ASKS_EVERY_S / watch.period_s), 1)
        if watch.is_armed or watch.cycles * watch.period_s < _SETTLES_S or watch.cycles % every:
            return Inbox()
        return Inbox(requests=[Request(Action.STAND_UP, watch.note)])


def stand(robot: Robot, seconds: float) -> Found:
    """Run the robot's own loop until it has balanced for some seconds, then sit it down.

    Raises:
        StepRefusedError: It does not arm, falls, or does not balance for so long.
    """
    posture = None if robot.file.safety is None else robot.file.safety.posture
    if posture is None:
        raise StepRefusedError("the robot file has no safety.posture: it cannot be asked to stand up and sit down")
    watch = _Watch(robot, seconds)
    loop = robot.loop(watch.stage, watch)
    loop.sits_down_first = True
    loop.run(round((_SETTLES_S + _ARMS_WITHIN_S + _ENDS_WITHIN_S + seconds) / watch.period_s))
    measured = {
        "balanced_s": watch.balanced_s,
        "stood_up_after_s": watch.stood_up_after_s,
        "left_turned_rad": watch.turned[0],
        "right_turned_rad": watch.turned[1],
    }
    if not watch.is_armed:
        refusal = watch.refusal or loop.arming_refusal or loop.modes.reason
        raise StepRefusedError(f"the robot does not arm: {refusal}")
    if watch.balanced_s < seconds:
        raise StepRefusedError(
            f"the robot balanced for {watch.balanced_s:.1f} s of {seconds:g}: {watch.reason or loop.modes.reason}"
        )
    farthest = max(watch.turned)
    return Found(f"balanced for {watch.balanced_s:.1f} s; a wheel turned by {farthest:.2f} rad at the most", measured)
