"""Who may move the motors: the modes, joined to the drives' arming and to the set-points."""

from collections.abc import Sequence

from firmware_io.errors import ArmingRefusedError
from firmware_io.hardware import Hardware
from node.cycle.setpoints import SetpointSchedule
from node.safety.modes import ACTIVE, Action, Answer, Mode, Modes


class Authority:
    """Arms the drives on the way into an active mode; on any way out of one disarms them and forgets the set-points.

    Attributes:
        modes: What the robot is allowed to do, and why.
        arming_obstacle: What keeps a robot that arms itself from doing so; None where nothing does.
    """

    def __init__(self, hardware: Hardware, schedule: SetpointSchedule, *, arm_at_start: bool) -> None:
        """Start disarmed; with `arm_at_start`, arm as soon as nothing speaks against it."""
        self.modes = Modes()
        self.arming_obstacle: str | None = None
        self._hardware = hardware
        self._schedule = schedule
        self._arm_pending = arm_at_start
        self._live = False

    @property
    def is_active(self) -> bool:
        """Whether commands may reach the motors."""
        return self.modes.mode in ACTIVE

    def act(self, action: Action) -> Answer:
        """Carry out what an operator asks, or refuse it."""
        if action in (Action.DISARM, Action.STOP):
            self._arm_pending = False
        answer = self._arm() if action is Action.ARM else self.modes.ask(action)
        self._settle()
        return answer

    def arm_itself(self) -> None:
        """Arm a robot that arms itself and has not yet."""
        if self._arm_pending:
            answer = self.act(Action.ARM)
            self._arm_pending = not answer.accepted
            self.arming_obstacle = None if answer.accepted else answer.message

    def observe(self, faults: Sequence[str], *, setpoints_silent: bool) -> None:
        """Look at this cycle's faults and set-points."""
        self.modes.observe(faults, setpoints_silent=setpoints_silent)
        self._settle()

    def fail(self, reason: str) -> None:
        """Enter FAULT at once, from any mode."""
        self.modes.fail(reason)
        self._settle()

    def _arm(self) -> Answer:
        if self.modes.mode is not Mode.DISARMED:
            return self.modes.ask(Action.ARM)
        try:
            self._hardware.arm()
        except ArmingRefusedError as error:
            return self.modes.ask(Action.ARM, error.reasons or ("the drive refuses and does not say why",))
        self._live = True
        return self.modes.ask(Action.ARM)

    def _settle(self) -> None:
        if self.modes.mode is Mode.FAULT:
            self._arm_pending = False
        if self._live and not self.is_active:
            self._live = False
            self._schedule.clear()
            self._hardware.disarm()
