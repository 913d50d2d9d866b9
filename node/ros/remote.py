# SPDX-License-Identifier: MIT
"""The loop's side of ROS, which runs in a process of its own: nothing of DDS can delay or end the loop."""

import contextlib
import dataclasses
import functools
import logging
import os
import subprocess
from collections.abc import Sequence
from typing import Final

import msgspec

from segway_ecc.node.cycle.interfaces import Inbox, Report, Request, Written
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory
from segway_ecc.node.errors import RosUnavailableError
from segway_ecc.node.helper import end_helper, send_task, start_helper
from segway_ecc.node.model.model import Model, write_variable
from segway_ecc.node.ring import RingReader, RingWriter, open_ring, size_ring, slots_for
from segway_ecc.node.robot import Robot
from segway_ecc.node.ros.protocol import (
    FromLoop,
    RosSettings,
    ToLoop,
    TrajectoryPart,
    WriteRequest,
    decode_inbox,
    decode_subscribed,
    decode_trajectory,
    decode_write_request,
    encoder,
)
from segway_ecc.node.safety.modes import ACTIVE, Answer

_REPORTS: Final = 64
"""Cycles that the process may fall behind."""
INBOX_SLOTS: Final = 32
"""Slots, all of which are taken in each cycle: what comes faster waits in DDS, where only the newest is kept."""
_LONGEST_REASON: Final = 900
"""In characters: it is reported in every cycle, and is not to fill the ring."""
_CLOSE_S: Final = 5.0
_logger = logging.getLogger(__name__)


class RosBridge:
    """The ROS process, which imports what it needs while the robot is built, and waits for its settings.

    Attributes:
        reports: File descriptor of the ring to it.
        inboxes: That of the ring from it.
    """

    def __init__(self) -> None:
        self.reports, self.inboxes = open_ring(), open_ring()
        self._descriptors: tuple[int, ...] = self.reports, self.inboxes
        self._process = start_helper("segway_ecc.node.ros.process", (), self._descriptors, subprocess.PIPE)
        self.pid = self._process.pid

    def configure(self, settings: RosSettings) -> None:
        """Send its settings, and wait until the robot is in ROS.

        Raises:
            RosUnavailableError: ROS does not start.
        """
        assert self._process.stdout is not None  # noqa: S101 - it was asked for
        self._release()  # both are mapped by now, here and, by the same numbers, open there
        with contextlib.suppress(BrokenPipeError):  # it has ended, and has reported why
            send_task(self._process, settings)
        with self._process.stdout as output:
            line = output.readline().decode(errors="replace").strip()
        if line != "ready":
            raise RosUnavailableError(line or f"ROS 2 does not start: its process ended with status {self.close()}")

    @property
    def status(self) -> int | None:
        """With what the process has ended; None while it runs."""
        return self._process.poll()

    def close(self) -> int:
        """Let the process end, and return with what it did; see `status`."""
        self._release()
        return end_helper(self._process, _CLOSE_S)

    def _release(self) -> None:
        for descriptor in self._descriptors:
            os.close(descriptor)
        self._descriptors = ()


class RemoteStage:
    """See `segway_ecc.node.cycle.interfaces.Stage`. In each cycle it reads and writes memory, and makes no system call.

    Where the process has ended, the robot goes on without it while it is armed, as it does without a network, and the
    loop ends as soon as it is not, so that a service manager may start it anew.

    Attributes:
        over: Why the world outside has ended, which ends the loop; None while it goes on.
        wants_reports: Whether anybody subscribes to what is published of each cycle.
        dropped: Messages that did not get through, mostly because the process did not keep up.
    """

    def __init__(self, bridge: RosBridge, robot: Robot, namespace: str = "", ros_arguments: Sequence[str] = ()) -> None:
        """Bring a robot into ROS.

        Args:
            bridge: The process that is to run ROS for it.
            robot: The robot that is to be in ROS.
            namespace: Where it lives in the ROS graph.
            ros_arguments: What followed `--ros-args` on the command line, that flag included.

        Raises:
            RosUnavailableError: ROS does not start.
        """
        self.over: str | None = None
        self.dropped = 0
        self._model: Model = robot.model
        self._bridge = bridge
        self._buffer = bytearray()
        self._is_gone = False
        self._points: list[TimedSetpoint] = []
        self.wants_reports = True
        wiring = robot.wiring
        settings = RosSettings(
            robot=robot.file.name,
            ros=robot.file.ros,
            namespace=namespace,
            ros_arguments=tuple(ros_arguments),
            period_ns=robot.period_ns,
            published=tuple(wiring.published),
            topics=tuple(wiring.topics),
            set_names=wiring.set_names,
            parameters=tuple(dataclasses.replace(v, value=self._model.read(v.name)) for v in self._model.parameters),
            reports=bridge.reports,
            inboxes=bridge.inboxes,
        )
        size_ring(settings.reports, _REPORTS * slots_for(settings.report_bytes))
        size_ring(settings.inboxes, INBOX_SLOTS)
        self._reports, self._inboxes = RingWriter(settings.reports), RingReader(settings.inboxes)
        bridge.configure(settings)

    def take_inbox(self) -> Inbox:
        """Everything that has arrived; see `Stage.take`. What is to be written to the model is."""
        inbox = Inbox()
        for _ in range(INBOX_SLOTS):
            taken = self._inboxes.take_message()
            if taken is None:
                break
            kind, body = taken
            try:
                match kind:
                    case ToLoop.WRITE:
                        self._write(decode_write_request(body), inbox)
                    case ToLoop.SUBSCRIBED:
                        self.wants_reports = decode_subscribed(body)
                    case ToLoop.TRAJECTORY:
                        self._collect(decode_trajectory(body), inbox)
                    case _:
                        message = decode_inbox(body)
                        inbox.setpoints += message.setpoints
                        inbox.values += message.values
                        inbox.stations += message.stations
                        for action, number in message.requests:
                            inbox.requests.append(Request(action, functools.partial(self._answer, number)))
            except msgspec.DecodeError:  # whatever that process does, the loop goes on
                self.dropped += 1
        return inbox

    def publish(self, report: Report) -> None:
        """Hand over what is published of the cycle."""
        if len(report.reason) > _LONGEST_REASON:
            report = msgspec.structs.replace(report, reason=report.reason[:_LONGEST_REASON])
        encoder.encode_into(report, self._buffer)
        if not self._reports.put(FromLoop.REPORT, self._buffer):
            self.dropped += 1
        if self._is_gone and report.mode not in ACTIVE:
            self.over = "the ROS process has ended"

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Hand over diagnostics, one status at a time so that each fits."""
        # NumberedRequest here, about once a second in the slack of a cycle, because handing over does not show it.
        if not self._is_gone and (status := self._bridge.status) is not None:
            self._is_gone = self.wants_reports = True  # so that it is seen when the robot is no longer armed
            _logger.warning(
                "the ROS process has ended with status %d: the robot goes on without ROS while it is armed, and ends "
                "when it is not",
                status,
            )
        for each in statuses:
            self._put(FromLoop.STATUS, each)
        self._put(FromLoop.DIAGNOSTICS, stamp_ns)

    def do_background_work(self) -> None:
        """Nothing to do: the process does it."""

    def close(self) -> None:
        """Let the robot leave ROS."""
        self._put(FromLoop.END, None)
        self._bridge.close()
        if self.dropped and not self._is_gone:
            _logger.warning("%d messages to or from ROS did not get through: its process did not keep up", self.dropped)

    def _collect(self, part: TrajectoryPart, inbox: Inbox) -> None:
        """Keep the parts of a trajectory until all are there; one that lacks a part is discarded and counted."""
        if part.begin == 0:
            self._points = []
        elif part.begin != len(self._points):
            self._points = []
            self.dropped += 1
            return
        self._points += part.points
        if len(self._points) == part.total:
            inbox.trajectories.append(Trajectory(part.stamp_ns, tuple(self._points)))
            self._points = []

    def _write(self, request: WriteRequest, inbox: Inbox) -> None:
        refusal = write_variable(self._model, request.name, request.value)
        inbox.written.append(Written(request.name, request.value, refusal))
        self._put(FromLoop.WRITTEN, (request.number, refusal or None))

    def _answer(self, number: int, answer: Answer) -> None:
        self._put(FromLoop.ANSWER, (number, answer))

    def _put(self, kind: FromLoop, what: object) -> None:
        if not self._reports.put(kind, encoder.encode(what)):
            self.dropped += 1
