# SPDX-License-Identifier: MIT
"""The arming manager: the modes, joined to the drives' arming and to the set-points."""

from collections.abc import Callable, Sequence

from segway_ecc.firmware_io.errors import ArmingRefusedError
from segway_ecc.firmware_io.hardware import Hardware
from segway_ecc.node.cycle.interfaces import HardwareAnswer
from segway_ecc.node.cycle.setpoints import SetpointSchedule
from segway_ecc.node.safety.modes import ACTIVE, POSTURES, Action, Answer, Mode, Modes, refused
from segway_ecc.node.safety.pre_arm import PreArmCheck, failed_checks

Reply = Callable[[Answer], None]
Evaluate = Callable[[], Sequence[PreArmCheck]]


class ArmingManager:
    """Arms the drives on the way into an active mode; on any way out of one disarms them and discards the set-points.

    Drives take a while to pass through their states: whoever asks to arm has the answer once they have, or have failed.

    Attributes:
        modes: What the robot is allowed to do, and why.
        arming_refusal: What keeps a robot that arms itself from doing so; None where nothing does.
        checklist: Goes through what must hold before the drives are asked to arm.
        answers: What the hardware answered in the present cycle, where that decides; whoever runs the cycles clears it.
    """

    def __init__(
        self, hardware: Hardware, schedule: SetpointSchedule, *, arm_at_start: bool, checklist: Evaluate = tuple
    ) -> None:
        """Start disarmed; with `arm_at_start`, arm as soon as every check passes."""
        self.modes = Modes()
        self.arming_refusal: str | None = None
        self.checklist = checklist
        self.answers: list[HardwareAnswer] = []
        self._hardware = hardware
        self._schedule = schedule
        self._arms_itself = arm_at_start
        self._live = False
        self._is_arming = False
        self._replies: list[Reply] = []

    @property
    def is_active(self) -> bool:
        """Whether commands may reach the motors."""
        return self.modes.mode in ACTIVE

    @property
    def is_live(self) -> bool:
        """Whether the drives were asked to arm and have not been disarmed since."""
        return self._live

    def act(self, action: Action, reply: Reply) -> None:
        """Carry out what an operator asks, or refuse it.

        Args:
            action: What is asked.
            reply: Called with what came of it; for arming, once the drives have armed or failed to.
        """
        if action is Action.ARM:
            self._arm(reply)
        elif action in POSTURES:  # of a robot that has none
            reply(self.modes.ask(action))
        else:
            self._give_up(f"broken off: asked to {action}")
            if action is not Action.CLEAR_FAULT:
                self._arms_itself = False
            reply(self.modes.ask(action))
        self._settle()

    def arm_again(self, reply: Reply) -> None:
        """Arm, out of a fault too, which is cleared only where nothing keeps the robot from arming."""
        self._arm(reply, clears_fault=True)

    def arm_itself(self) -> None:
        """Arm a robot that arms itself, and was not switched off or at fault since it started."""
        if self._arms_itself and not self._live:

            def note(answer: Answer) -> None:
                self.arming_refusal = answer.message

            self.act(Action.ARM, note)

    def observe(
        self, faults: Sequence[str], *, ready: bool, setpoints_silent: bool, station_lost: bool = False
    ) -> None:
        """Look at this cycle's faults, whether the drives follow commands, the set-points and the base station."""
        if self._is_arming:
            if faults:
                self._give_up("; ".join(faults))
            elif ready:
                self._answer(self.modes.ask(Action.ARM))
        self.modes.observe(faults, setpoints_silent=setpoints_silent, station_lost=station_lost)
        self._settle()

    def disarm(self, reason: str) -> None:
        """Switch the motors off, or break the arming off, by the robot's own decision; a fault stays one."""
        if self._live:
            self._give_up(reason)
            self._arms_itself = False
            self.modes.disarm(reason)
            self._settle()

    def fail(self, reason: str) -> None:
        """Enter FAULT at once, from any mode."""
        self._give_up(reason)
        self.modes.fail(reason)
        self._settle()

    def _arm(self, reply: Reply, *, clears_fault: bool = False) -> None:
        if self._is_arming:
            self._replies.append(reply)
            return
        mode = self.modes.mode
        if mode is not Mode.DISARMED and not (clears_fault and mode is Mode.FAULT):
            reply(self.modes.ask(Action.ARM))
            return
        reasons = failed_checks(self.checklist())
        if reasons:
            reply(refused(reasons))
            return
        try:
            self._hardware.arm()
        except ArmingRefusedError as error:
            self.answers.append(HardwareAnswer("arm", error.reasons))
            reply(refused(error.reasons or ("the drive refuses and gives no reason",)))
            return
        if mode is Mode.FAULT:
            self.modes.ask(Action.CLEAR_FAULT)
        self._live = self._is_arming = True
        self._replies = [reply]

    def _give_up(self, reason: str) -> None:
        """Refuse those who wait for the drives to arm, if any."""
        self._answer(self.modes.ask(Action.ARM, (reason,)))

    def _answer(self, answer: Answer) -> None:
        replies, self._replies, self._is_arming = self._replies, [], False
        for reply in replies:
            reply(answer)

    def _settle(self) -> None:
        if self.modes.mode is Mode.FAULT:
            self._arms_itself = False
        if self.is_active:
            self.arming_refusal = None
        if self._live and not self._is_arming and not self.is_active:
            self._live = False
            self._schedule.clear()
            self._hardware.disarm()
