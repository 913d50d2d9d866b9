# SPDX-License-Identifier: MIT
"""The loop's side of ROS, which runs in a process of its own: nothing of DDS can delay or end the loop."""

import contextlib
import dataclasses
import functools
import json
import logging
import os
import select
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Final

import msgspec

from segway_ecc.node.cycle.interfaces import Inbox, Report, Request, VariableWrite, Written, written_of
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory
from segway_ecc.node.errors import ConfigurationError, RosUnavailableError, UnknownNameError, shortened
from segway_ecc.node.helper import end_helper, send_task, spawn_helper, start_helper
from segway_ecc.node.model.model import Model
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.ring import RingReader, RingWriter, open_ring, size_ring
from segway_ecc.node.robot import Robot
from segway_ecc.node.ros.description import urdf
from segway_ecc.node.ros.protocol import (
    NO_SIM_TIME,
    USE_SIM_TIME,
    FromLoop,
    RosSettings,
    ToLoop,
    TrajectoryPart,
    decode_inbox,
    decode_stranger,
    decode_subscribed,
    decode_trajectory,
    decode_write_request,
    encoder,
)
from segway_ecc.node.safety.modes import Answer
from segway_ecc.node.safety.residual import SHOWN

INBOX_SLOTS: Final = 32
"""Slots, all of which are taken in each cycle: what comes faster waits in DDS, where only the newest is kept."""
_LONGEST_REASON: Final = 900
"""In characters: it is reported in every cycle, and is not to fill the ring."""
_CLOSE_S: Final = 5.0
_READY: Final = "ready "
_STARTS_WITHIN_S: Final = 60.0
"""A replacement that does not is replaced itself."""
_MODULE: Final = "segway_ecc.node.ros.process"
_SHORTEST_PAUSE_S: Final = 0.1
_LONGEST_PAUSE_S: Final = 30.0
"""Before a process is replaced: each time twice as long, unless the one before lasted longer than this."""
_logger = logging.getLogger(__name__)


class RosBridge:
    """The ROS process, which imports what it needs while the robot is built, and waits for its settings.

    Attributes:
        reports: File descriptor of the ring to it.
        inboxes: That of the ring from it.
        pid: Of the process that runs, or has ended last.
        status: With what that has ended; None while it runs.
        ended: How many have ended that were not to, and were replaced.
        rings: Those of a process that has taken the place of another, until the loop takes them over.
    """

    def __init__(self) -> None:
        self.reports, self.inboxes = open_ring(), open_ring()
        self._descriptors: tuple[int, ...] = self.reports, self.inboxes
        self._process = start_helper(_MODULE, (), self._descriptors, subprocess.PIPE)
        self.pid = self._process.pid
        self.status: int | None = None
        self.ended = 0
        self.rings: tuple[RingWriter, RingReader] | None = None
        self._input: IO[bytes] | None = self._process.stdin
        self._closing = threading.Event()
        self._supervisor: threading.Thread | None = None

    def configure(self, settings: RosSettings) -> dict[str, float | None]:
        """Send its settings, and wait until the robot is in ROS.

        Returns:
            What the command line has of parameters; see `ModelParameters.overrides`.

        Raises:
            RosUnavailableError: ROS does not start.
        """
        assert self._process.stdout is not None  # noqa: S101 - it was asked for
        self._release()  # both are mapped by now, here and, by the same numbers, open there
        with contextlib.suppress(BrokenPipeError):  # it has ended, and has reported why
            send_task(self._process, settings)
        with self._process.stdout as output:
            line = output.readline().decode(errors="replace").strip()
        if not line.startswith(_READY):
            raise RosUnavailableError(line or f"ROS 2 does not start: its process ended with status {self.close()}")
        overrides: dict[str, float | None] = json.loads(line.removeprefix(_READY))
        return overrides

    def keep_running(self, settings: RosSettings, values: Mapping[str, float]) -> None:
        """Replace it where it ends, by a thread beside the loop; `values` are those of the parameters by then."""
        self._supervisor = threading.Thread(target=self._keep_running, args=(settings, values), daemon=True)
        self._supervisor.start()

    def close(self) -> int:
        """Let the process end, and return with what it did; see `status`."""
        self._release()
        if self._supervisor is None:
            self.status = end_helper(self._process, _CLOSE_S)
            return self.status
        self._closing.set()
        self._end_input()
        self._supervisor.join(_CLOSE_S)
        if self._supervisor.is_alive():
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
            self._supervisor.join()
        return self.status or 0

    def _keep_running(self, settings: RosSettings, values: Mapping[str, float]) -> None:
        pause_s, began_s = 0.5 * _SHORTEST_PAUSE_S, time.monotonic()
        self.status = self._process.wait()
        self._end_input()
        while not self._closing.is_set():
            self.ended += 1
            lasted = time.monotonic() - began_s > _LONGEST_PAUSE_S
            pause_s = _SHORTEST_PAUSE_S if lasted else min(2.0 * pause_s, _LONGEST_PAUSE_S)
            _logger.warning(
                "the ROS process has ended with status %d: the robot goes on as without a network, and another is "
                "started in %g s",
                self.status,
                pause_s,
            )
            if not self._closing.wait(pause_s):
                began_s = time.monotonic()
                parameters = tuple(dataclasses.replace(each, value=values[each.name]) for each in settings.parameters)
                self._run_another(msgspec.structs.replace(settings, parameters=parameters, is_again=True))

    def _run_another(self, settings: RosSettings) -> None:
        """Run one with rings of its own, since those of the one that died may hold half a message; until it ends."""
        try:
            with _made_rings(settings.report_slots) as (reports, inboxes):
                rings = RingWriter(reports), RingReader(inboxes)
                self.pid, self._input, output = spawn_helper(_MODULE, (reports, inboxes))
        except OSError as error:
            _logger.warning("it cannot be started: %s", error.strerror)
            return
        self.status = None
        if self._closing.is_set():
            self._end_input()
        with output, contextlib.suppress(OSError, ValueError):  # it has ended, or is to end
            task = msgspec.structs.replace(settings, reports=reports, inboxes=inboxes)
            self._input.write(msgspec.json.encode(task) + b"\n")
            self._input.flush()
            if not select.select([output], [], [], _STARTS_WITHIN_S)[0]:
                os.kill(self.pid, signal.SIGKILL)
            line = output.readline().decode(errors="replace").strip()
            if line.startswith(_READY):
                self.rings = rings
                _logger.info("the robot is in ROS again")
            elif line:
                _logger.warning(line)
        self.status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        self._end_input()

    def _end_input(self) -> None:
        with contextlib.suppress(OSError):  # what was sent last may have no reader any more
            if self._input is not None:
                self._input.close()

    def _release(self) -> None:
        for descriptor in self._descriptors:
            os.close(descriptor)
        self._descriptors = ()


@contextlib.contextmanager
def _made_rings(report_slots: int) -> Iterator[tuple[int, int]]:
    with contextlib.ExitStack() as exits:
        reports = open_ring(report_slots)
        exits.callback(os.close, reports)
        inboxes = open_ring(INBOX_SLOTS)
        exits.callback(os.close, inboxes)
        yield reports, inboxes


class RemoteStage:
    """See `segway_ecc.node.cycle.interfaces.Stage`. In each cycle it reads and writes memory, and makes no system call.

    Where the process has ended, the robot goes on without it, as it does without a network, until another has taken its
    place.

    Attributes:
        over: None: the loop goes on without ROS.
        wants_reports: Whether anybody subscribes to what is published of each cycle.
        dropped: Messages that did not get through, mostly because the process did not keep up.
    """

    def __init__(
        self,
        bridge: RosBridge,
        robot: Robot,
        namespace: str = "",
        ros_arguments: Sequence[str] = (),
        *,
        is_simulated: bool = False,
    ) -> None:
        """Bring a robot into ROS.

        Args:
            bridge: The process that is to run ROS for it.
            robot: The robot that is to be in ROS.
            namespace: Where it lives in the ROS graph.
            ros_arguments: What followed `--ros-args` on the command line, that flag included.
            is_simulated: Whether the robot's clock is a simulated one, which the rest of ROS is to follow.

        Raises:
            ConfigurationError: A parameter on the command line is refused; the others reach the model here already.
            RosUnavailableError: ROS does not start.
        """
        self.over: str | None = None
        self.dropped = 0
        self._model: Model = robot.model
        self._bridge = bridge
        self._buffer = bytearray()
        self._robot_name = robot.file.name
        self._ended = 0
        self._points: list[TimedSetpoint] = []
        self._strangers: list[str] = []
        self.wants_reports = True
        wiring, variables = robot.wiring, robot.variables
        parameters = [variables[each.name] for each in self._model.parameters]
        settings = RosSettings(
            robot=robot.file.name,
            ros=robot.file.ros,
            namespace=namespace,
            ros_arguments=tuple(ros_arguments),
            period_ns=robot.period_ns,
            published=tuple(wiring.published),
            topics=tuple(wiring.topics),
            set_names=wiring.set_names,
            stand=safety.posture.stand if (safety := robot.file.safety) and safety.posture else None,
            wheel_radius=robot.file.geometry.wheel_radius,
            pitch=None if (pitch := robot.file.ros.pitch) is None else list(wiring.topics).index(pitch),
            description=urdf(robot.file, wiring.published),
            residual=SHOWN if safety and safety.residual else (),
            parameters=tuple(dataclasses.replace(v, value=self._model.read(v.name)) for v in parameters),
            reports=bridge.reports,
            inboxes=bridge.inboxes,
            is_simulated=is_simulated,
        )
        size_ring(settings.reports, settings.report_slots)
        size_ring(settings.inboxes, INBOX_SLOTS)
        self._values = {variable.name: variable.value for variable in settings.parameters}
        self._reports, self._inboxes = RingWriter(settings.reports), RingReader(settings.inboxes)
        writer, overrides = VariableWriter(self._model, variables), bridge.configure(settings)
        self._overrides: list[Written] | None = self._override(writer, overrides)
        bridge.keep_running(settings, self._values)

    def take_inbox(self) -> Inbox:
        """What has arrived; see `Stage.take_inbox`. Of writes one: what follows it waits for the next cycle."""
        inbox = Inbox()
        if self._bridge.rings is not None:
            (self._reports, self._inboxes), self._bridge.rings = self._bridge.rings, None
            self._points, self._strangers, self.wants_reports = [], [], True
        if self._overrides is not None:  # nothing else in the first: a replay writes them before the initial equations
            inbox.written, self._overrides = self._overrides, None
            return inbox
        for _ in range(INBOX_SLOTS):
            taken = self._inboxes.take_message()
            if taken is None:
                break
            try:
                if self._handle(*taken, inbox):
                    break  # a write takes as long as some steps, and its sender waits for the answer
            except msgspec.DecodeError:  # whatever that process does, the loop goes on
                self.dropped += 1
        return inbox

    def _handle(self, kind: int, body: bytes, inbox: Inbox) -> bool:
        """Whether it was a write of variables."""
        match kind:
            case ToLoop.WRITE:
                number, values = decode_write_request(body)
                answer = functools.partial(self._answer_write, self._reports, number, values)
                inbox.writes.append(VariableWrite(values, answer))
            case ToLoop.SUBSCRIBED:
                self.wants_reports = decode_subscribed(body)
            case ToLoop.STRANGER:
                self._strangers.append(decode_stranger(body))
            case ToLoop.REFUSED:
                self.dropped += 1
            case ToLoop.TRAJECTORY:
                self._collect(decode_trajectory(body), inbox)
            case _:
                message = decode_inbox(body)
                inbox.setpoints += message.setpoints
                inbox.values += message.values
                inbox.stations += message.stations
                inbox.introductions += message.introductions
                for action, number in message.requests:
                    inbox.requests.append(Request(action, functools.partial(self._answer, self._reports, number)))
        return kind == ToLoop.WRITE

    def publish(self, report: Report) -> None:
        """Hand over what is published of the cycle."""
        if len(report.reason) > _LONGEST_REASON:
            report = msgspec.structs.replace(report, reason=report.reason[:_LONGEST_REASON])
        encoder.encode_into(report, self._buffer)
        self._count(is_put=self._reports.put(FromLoop.REPORT, self._buffer))

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Hand over diagnostics, one status at a time so that each fits."""
        ended, total, is_running = self._ended, self._bridge.ended, self._bridge.status is None
        level, text = Level.OK, "its process runs"
        if total > ended:
            level, text = (
                Level.WARN,
                f"its process has ended and was replaced {total - ended} times since the last report",
            )
        elif self._strangers:
            level, text = Level.WARN, shortened("; ".join(self._strangers))
        self._ended = total if is_running and self._bridge.rings is None else ended
        values = {"replaced": str(total), "dropped": str(self.dropped), "strangers": str(len(self._strangers))}
        for each in (*statuses, DiagnosticStatus(level, f"{self._robot_name}: ros", text, values)):
            self._put(FromLoop.STATUS, each)
        self._put(FromLoop.DIAGNOSTICS, stamp_ns)

    def publish_clock(self, stamp_ns: int) -> None:
        """Hand over simulated time, ns since the Unix epoch, which is published after what was handed over before."""
        self._put(FromLoop.CLOCK, stamp_ns)

    @property
    def waiting(self) -> int:
        """How many messages the process has not taken; 0 where it has ended."""
        return self._reports.held() if self._bridge.status is None else 0

    @property
    def is_running(self) -> bool:
        """Whether its process runs."""
        return self._bridge.status is None

    def do_background_work(self) -> None:
        """Nothing to do: the process does it."""

    def close(self) -> None:
        """Let the robot leave ROS."""
        self._put(FromLoop.END, None)
        self._bridge.close()
        if self.dropped:
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
            inbox.trajectories.append(Trajectory(part.stamp_ns, tuple(self._points), part.unsupported))
            self._points = []

    def _override(self, writer: VariableWriter, given: Mapping[str, float | None]) -> list[Written]:
        """Write what the command line has of parameters, before the first cycle; what is recorded of it."""
        names = [variable.name for variable in self._model.parameters]
        values: list[tuple[str, float]] = []
        for name, value in given.items():
            if name == USE_SIM_TIME:
                raise ConfigurationError(f"parameter override: {NO_SIM_TIME}")
            if name not in names:
                unknown = UnknownNameError(f"parameter of model '{self._model.name}'", name, names)
                raise ConfigurationError(f"parameter override: {unknown}")
            if value is None:
                raise ConfigurationError(
                    f"parameter override: '{name}' takes a floating-point number: write it with a point, such as 1.0"
                )
            values.append((name, value))
        refusal = writer.write(values)
        if refusal:
            raise ConfigurationError(f"parameter override: {refusal}")
        self._values.update(values)
        return written_of(values)

    def _answer_write(
        self, reports: RingWriter, number: int, values: Sequence[tuple[str, float]], refusal: str
    ) -> None:
        if not refusal:
            self._values.update(values)
        self._count(is_put=reports.put(FromLoop.WRITTEN, encoder.encode((number, refusal or None))))

    def _answer(self, reports: RingWriter, number: int, answer: Answer) -> None:
        self._count(is_put=reports.put(FromLoop.ANSWER, encoder.encode((number, answer))))

    def _put(self, kind: FromLoop, what: object) -> None:
        self._count(is_put=self._reports.put(kind, encoder.encode(what)))

    def _count(self, *, is_put: bool) -> None:
        self.dropped += not is_put and self._bridge.status is None
