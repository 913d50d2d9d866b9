# SPDX-License-Identifier: MIT
"""The ROS stage of a robot on a simulated clock, which it publishes: paced, or in turns with a client."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple, TypeVar

import msgspec

from segway_ecc.node.cycle.interfaces import Inbox, Report, Request, VariableWrite
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.robot import Robot
from segway_ecc.node.ros.remote import RemoteStage, RosBridge

_POLL_S: Final = 0.0002
_AGAIN_S: Final = 0.1
"""Until the first client has sent something, the clock and the robot's state are published again after so long."""
_MOST_WAITING: Final = 16
"""Messages that may wait for the ROS process, so that none is lost however fast the simulation is."""
_LETS_GO_S: Final = 10.0
"""A ROS process that takes nothing for so long has failed, and is not waited for."""
_Answer = TypeVar("_Answer")


class Pace(NamedTuple):
    """How fast simulated time passes.

    Attributes:
        speed: Simulated seconds in a second at most; None for as many as the machine can.
        turn_cycles: After so many cycles the clock is published, and stands until a client has sent something; None
            where the clock waits for nobody, and is published in each cycle.
        patience_s: How long a client may take for its turn, in real time, s.
    """

    speed: float | None
    turn_cycles: int | None
    patience_s: float


class LockstepStage:
    """See `Stage`, and `RemoteStage`. Nothing that the loop reports is lost, and it waits where its clock is to stand.

    A turn begins with the clock, once all that was reported before has been published. It ends with the first
    set-point, value, trajectory, request or write of parameters that arrives, which the next cycle takes: a client that
    sends one message for each clock drives the robot in the same way every time. While a request or a write has no
    answer yet, cycles go on and there is no turn.

    Attributes:
        is_ending: Whether the loop ends, and nobody is waited for any more.
        unanswered: Turns in which nobody sent anything within the patience: what came of such a run may differ each
            time.
    """

    def __init__(
        self,
        bridge: RosBridge,
        robot: Robot,
        pace: Pace,
        namespace: str = "",
        ros_arguments: Sequence[str] = (),
    ) -> None:
        """Bring a simulated robot into ROS at a pace; see `RemoteStage`."""
        self.over: str | None = None
        self.wants_reports = True
        self.unanswered = 0
        self._pace = pace
        self.is_ending: Callable[[], bool] = lambda: False
        self._period_s = robot.period_ns * 1e-9
        self._cycle = -1
        self._turn = 1
        self._open = 0
        self._last: Report | None = None
        self._started_s: float | None = None
        self._remote = RemoteStage(bridge, robot, namespace, ros_arguments, is_simulated=True)

    def take_inbox(self) -> Inbox:
        """What has arrived by the time at which this cycle may begin."""
        self._cycle += 1
        inbox = self._remote.take_inbox()
        if self._last is not None:
            if self._pace.turn_cycles is None:
                self._put_clock(self._last.stamp_ns)
            elif self._cycle >= self._turn:
                self._turn = self._cycle + self._pace.turn_cycles
                if not self._open:
                    self._wait_for_client(inbox, self._last.stamp_ns)
            self._keep_pace()
        return self._with_counted_answers(inbox)

    def publish(self, report: Report) -> None:
        """Hand over what is published of the cycle, once there is room for it."""
        self._last = report
        self._wait_for_room()
        self._remote.publish(report)

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Hand over diagnostics, once there is room for them."""
        self._wait_for_room()
        self._remote.publish_diagnostics(stamp_ns, statuses)

    def do_background_work(self) -> None:
        """There is none."""

    def close(self) -> None:
        """Let the robot leave ROS."""
        self._remote.close()

    def _wait_for_client(self, inbox: Inbox, stamp_ns: int) -> None:
        """Stand still until a client has sent something; for the first one as long as it takes."""
        self._put_clock(stamp_ns)
        began_s = again_s = time.monotonic()
        is_first = self._started_s is None
        while not _is_a_turn(inbox) and not self.is_ending() and self._remote.is_running:
            now_s = time.monotonic()
            if not is_first and now_s - began_s > self._pace.patience_s:
                self.unanswered += 1
                return
            if is_first and now_s - again_s > _AGAIN_S and self._last is not None:
                again_s = now_s
                self._remote.publish(self._last)
                self._put_clock(stamp_ns)
            time.sleep(_POLL_S)
            _add(inbox, self._remote.take_inbox())

    def _keep_pace(self) -> None:
        """Wait until this cycle's time has come, where simulated time is not to pass faster."""
        now_s, simulated_s = time.monotonic(), self._cycle * self._period_s
        if self._started_s is None:
            self._started_s = now_s - (simulated_s / self._pace.speed if self._pace.speed else 0.0)
        if self._pace.speed is not None:
            early_s = self._started_s + simulated_s / self._pace.speed - now_s
            if early_s > 0.0:
                time.sleep(early_s)
            else:
                self._started_s -= early_s  # what was lost is not made up for

    def _put_clock(self, stamp_ns: int) -> None:
        self._wait_for_room()
        self._remote.publish_clock(stamp_ns)

    def _wait_for_room(self) -> None:
        until_s = time.monotonic() + _LETS_GO_S
        while self._remote.waiting > _MOST_WAITING and time.monotonic() < until_s:
            time.sleep(_POLL_S)

    def _with_counted_answers(self, inbox: Inbox) -> Inbox:
        """The same, with a count of what has no answer yet."""
        inbox.requests = [Request(each.action, self._counted(each.answer)) for each in inbox.requests]
        inbox.writes = [VariableWrite(each.values, self._counted(each.answer)) for each in inbox.writes]
        return inbox

    def _counted(self, answer: Callable[[_Answer], None]) -> Callable[[_Answer], None]:
        self._open += 1
        return partial(self._close, answer)

    def _close(self, answer: Callable[[_Answer], None], given: _Answer) -> None:
        self._open -= 1
        answer(given)


def _is_a_turn(inbox: Inbox) -> bool:
    return bool(inbox.setpoints or inbox.values or inbox.trajectories or inbox.requests or inbox.writes)


def _add(inbox: Inbox, more: Inbox) -> None:
    """Put what has arrived later behind what was there."""
    for field in msgspec.structs.fields(Inbox):
        getattr(inbox, field.name).extend(getattr(more, field.name))
