# SPDX-License-Identifier: MIT
"""The posture of a robot that balances, joined to its mode, to what stands it up, and to those who ask for it."""

from collections.abc import MutableSequence, Sequence
from typing import Final

from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.interfaces import Inbox, Request
from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.safety.modes import STATION_LOST, STOPPED, Action, Answer, Mode
from segway_ecc.node.safety.monitor import SafetyMonitor
from segway_ecc.node.safety.posture import UP, Posture, PostureWatch
from segway_ecc.node.safety.settings import PostureSettings

_HALF_WAY: Final = 0.5
"""The value that is set stands for standing from here on."""


class PostureControl:
    """Stands the robot up and sits it down: its model is asked to stand only while the posture is one of standing.

    Attributes:
        watch: The posture.
    """

    def __init__(
        self,
        settings: PostureSettings,
        set_names: Sequence[str],
        monitor: SafetyMonitor,
        arming: ArmingManager,
        period_s: float,
    ) -> None:
        """Watch by the robot file's settings, with a period in s.

        Raises:
            UnknownNameError: What stands it up is not among `set_names`.
        """
        self.watch = PostureWatch(settings, period_s)
        self._place = stand_place(settings, set_names)
        self._monitor = monitor
        self._arming = arming
        self._stands_once_armed = False
        self._has_refused = False

    @property
    def is_up(self) -> bool:
        """Whether the robot would fall where torque ended: it is up, or on its way up or down."""
        return self._arming.is_active and self.watch.posture not in {Posture.RESTING, Posture.FALLEN}

    @property
    def gives_torque(self) -> bool:
        """Whether the motors may push: at rest they may not, also while the robot is armed."""
        return self.watch.posture is not Posture.RESTING

    def act(self, request: Request, set_values: MutableSequence[float]) -> None:
        """Carry out what an operator asks, or refuse it."""
        action, reply = request.action, request.answer
        if action is Action.STAND_UP:
            self._ask_to_stand_up(request, set_values)
        elif action is Action.SIT_DOWN:
            reply(self._sit_down(set_values))
        else:
            self._stands_once_armed = False
            self._arming.act(action, reply)
            if action is Action.CLEAR_FAULT and self._arming.modes.mode is not Mode.FAULT:
                self.watch.clear()

    def refusal(self, place: int, value: float) -> str | None:
        """Why a value that somebody sets is not taken: a robot that fell or is in FAULT stands up only on request.

        A reason is given once in a row, so that it may be logged; else it is empty.
        """
        modes = self._arming.modes
        if place != self._place or value < _HALF_WAY:
            return None
        if self.watch.posture is not Posture.FALLEN and modes.mode is not Mode.FAULT:
            self._has_refused = False
            return None
        has_refused, self._has_refused = self._has_refused, True
        return "" if has_refused else f"to stand up was refused: {self._why_down()}; ask for it with ~/stand_up"

    def look(self, set_values: MutableSequence[float]) -> Sequence[str]:
        """Take a cycle before its mode is decided; the faults."""
        if self._stands_once_armed and self._arming.is_active:
            self._stands_once_armed = False
            set_values[self._place] = 1.0
        wants_up = set_values[self._place] >= _HALF_WAY
        fault = self.watch.look(self._monitor.body, active=self._arming.is_active, wants_up=wants_up)
        return () if fault is None else (fault,)

    def settle(self, set_values: MutableSequence[float]) -> None:
        """Take the mode of this cycle; a robot that has fallen is asked to stand no more."""
        if self._arming.is_active:
            self.watch.clear()  # armed again
        else:
            self.watch.lose_torque(self._monitor.body, self._arming.modes.reason)
        if not self._arming.is_live:
            self._stands_once_armed = False
        if self.watch.posture is Posture.FALLEN:
            set_values[self._place] = 0.0

    def model_values(self, set_values: Sequence[float]) -> Sequence[float]:
        """The values that anybody may set, as the model is to have them."""
        if self.watch.posture in UP or set_values[self._place] < _HALF_WAY:
            return set_values
        values = list(set_values)
        values[self._place] = 0.0
        return values

    def sit_down_first(self, inbox: Inbox) -> Inbox:
        """What arrived in a cycle of a robot that is to end, which stands up no more, and sits down."""
        requests: list[Request] = []
        for request in inbox.requests:
            if request.action in {Action.ARM, Action.STAND_UP}:
                request.answer(Answer(accepted=False, message="the robot ends: it sits down first"))
            else:
                requests.append(request)
        inbox.requests = [*requests, Request(Action.SIT_DOWN, _ignore)]
        return inbox

    def _ask_to_stand_up(self, request: Request, set_values: MutableSequence[float]) -> None:
        arming, posture = self._arming, self.watch.posture
        if arming.is_active and arming.modes.reason == STATION_LOST:  # which sits it down in the end
            message = f"{STATION_LOST}: the robot does not stand up before one is back"
            request.answer(Answer(accepted=False, message=message))
        elif arming.is_active:
            set_values[self._place] = 1.0
            already = "stands already" if posture in UP else "stands up"
            request.answer(Answer(accepted=True, message=f"the robot {already}"))
        elif arming.modes.mode is Mode.FAULT and (posture is not Posture.FALLEN or arming.modes.reason == STOPPED):
            request.answer(Answer(accepted=False, message=f"clear the fault first: {arming.modes.reason}"))
        else:
            arming.arm_again(request.answer)
            self._stands_once_armed = arming.is_live

    def _sit_down(self, set_values: MutableSequence[float]) -> Answer:
        if self.watch.posture is Posture.FALLEN:
            return Answer(accepted=False, message=self._why_down())
        self._stands_once_armed = False
        set_values[self._place] = 0.0
        return Answer(accepted=True, message="the robot sits down" if self.is_up else "the robot rests already")

    def _why_down(self) -> str:
        modes = self._arming.modes
        return (
            f"the robot is {modes.mode}: {modes.reason}" if modes.mode is Mode.FAULT else f"FALLEN: {self.watch.reason}"
        )


def stand_place(settings: PostureSettings | None, set_names: Sequence[str]) -> int:
    """The place of what stands the robot up among the values that anybody may set.

    Raises:
        UnknownNameError: There is none.
    """
    if settings is None:
        return 0
    if settings.stand not in set_names:
        raise UnknownNameError("value of safety.posture.stand that is wired as set.<name>", settings.stand, set_names)
    return list(set_names).index(settings.stand)


def _ignore(_answer: Answer) -> None:
    """Nobody waits for it."""
