# SPDX-License-Identifier: MIT
"""The process that runs ROS for a loop. Its settings come through standard input.

One thread publishes what the loop hands over, another waits in DDS for what arrives and puts it where the loop looks.
Neither side waits for the other: what lies between them is memory (`segway_ecc.node.ring`).
"""

import contextlib
import faulthandler
import importlib
import json
import logging
import os
import queue
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection
from typing import Final

import msgspec

from segway_ecc.node.cycle.interfaces import Inbox
from segway_ecc.node.cycle.real_time import HELPERS_PRIORITY, SWITCH_INTERVAL_S, helping_threads, real_time_priority
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import ModelError, RosUnavailableError, shortened
from segway_ecc.node.logs import messages
from segway_ecc.node.model.writer import Values
from segway_ecc.node.ring import RingReader, RingWriter
from segway_ecc.node.ros import protocol
from segway_ecc.node.ros.messages import RosObject
from segway_ecc.node.ros.runtime import ENFORCE, STRATEGY, preload, ros_node, why_not_secure
from segway_ecc.node.ros.stage import RosStage
from segway_ecc.node.safety.modes import Answer

_AFTER_NS: Final = 200_000
"""From a report's time to when it is looked for: the loop hands it over within that."""
_SHORTEST_S: Final = 0.0001
_LONGEST_S: Final = 0.01
"""Between two looks where none came in time; each is twice as long as the one before."""
_SIMULATED_S: Final = 0.001
"""Between two looks for what a simulated robot reports, whose time stands still until its client has answered."""
_LOOK_S: Final = 0.1
"""Between two looks who subscribes, and whether the loop's process has gone. Where nobody subscribes to what is
published of each cycle the loop does not report it, and what else it reports waits as long."""
HANGS_S: Final = 10
"""After so long in a call of DDS this process ends with status 1: the loop then knows that it has no ROS. The watchdog
is a thread of C: it runs also while a call of DDS hangs that holds the interpreter's lock. Feeding it takes 50 us."""
_LEAVES_S: Final = 4
"""So long it has to leave ROS: where several nodes left at once, Fast DDS was seen to go round in circles for ever."""
_LOOK_AROUND_S: Final = 0.5
_ANSWER_S: Final = 1.0
_IN_ONE_MESSAGE: Final = 50
"""Set-points and values, so that no message fills the ring."""
_LARGEST_WRITE: Final = 4096
"""Of a request to write parameters, in bytes: half of the ring."""
_UNANSWERED: Final = 100
"""Requests that may wait for the loop's answer; the oldest is discarded."""
_logger = logging.getLogger(__name__)


class WaitSet:
    """Waits for what arrives without taking it, as an executor would."""

    def __init__(self, node: RosObject, stage: RosStage) -> None:
        core = importlib.import_module("rclpy.impl.implementation_singleton").rclpy_implementation
        self._subscriptions, self._services = stage.subscriptions, stage.services
        self._waker = core.GuardCondition(node.context.handle)
        counts = len(self._subscriptions), 1, 0, 0, len(self._services), 0
        self._wait_set = core.WaitSet(*counts, node.context.handle)

    def wait(self, timeout_s: float) -> Collection[int]:
        """Wait until there is something to take, or somebody wakes it; at most so long.

        Returns:
            The pointers of the handles of what has something to take.
        """
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in self._subscriptions:
            wait_set.add_subscription(subscription.handle)
        for service in self._services:
            wait_set.add_service(service.handle)
        wait_set.add_guard_condition(self._waker)
        wait_set.wait(round(timeout_s * 1e9))
        return [*wait_set.get_ready_entities("subscription"), *wait_set.get_ready_entities("service")]

    def wake(self) -> None:
        """Have it wait no longer."""
        self._waker.trigger_guard_condition()

    def close(self) -> None:
        """Let go of what it waits with, before the node does."""
        self._wait_set.destroy_when_not_in_use()
        self._waker.destroy_when_not_in_use()


class Subscriptions:
    """Waits for what arrives, and hands it to the loop.

    Attributes:
        is_running: Whether it still listens, or has not begun to; cleared to end it, once what it waits with is woken.
        write_results: What came of writing parameters, for `write`.
    """

    def __init__(self, inboxes: RingWriter, period_ns: int) -> None:
        """Put it into `inboxes`, where a loop of this period looks."""
        self.is_running = True
        self._inboxes = inboxes
        self._putting = threading.Lock()
        self._refused: set[protocol.ToLoop] = set()
        self._period_s = period_ns * 1e-9
        self._number = 0
        self._answers: dict[int, Callable[[Answer], None]] = {}
        self.write_results: queue.SimpleQueue[protocol.WriteResult] = queue.SimpleQueue()

    def run(self, wait_set: WaitSet, stage: RosStage) -> None:
        """Listen until it is stopped."""
        look_s = time.monotonic()
        try:
            while self.is_running:
                ready = wait_set.wait(_LOOK_AROUND_S)
                self.hand_over(stage.take_messages(ready))
                stage.serve_parameters(ready)
                if time.monotonic() > look_s:
                    look_s = time.monotonic() + _LOOK_AROUND_S
                    seen = len(stage.strangers)
                    stage.do_background_work()
                    for text in stage.strangers[seen:]:
                        self.put(protocol.ToLoop.STRANGER, shortened(text))
        finally:
            self.is_running = False

    def answer(self, answered: protocol.NumberedAnswer) -> None:
        """Answer a request."""
        send = self._answers.pop(answered.number, None)
        if send is not None:
            send(answered.answer)

    def write(self, values: Values) -> None:
        """Have the loop write parameters of the model, all of them or none.

        Raises:
            ModelError: They are refused, or too many at once, or the loop does not answer.
        """
        self._number += 1
        request = protocol.WriteRequest(self._number, tuple(values))
        if len(protocol.encoder.encode(request)) > _LARGEST_WRITE:
            raise ModelError(f"{len(values)} parameters are too many at once: set them in several requests")
        self.put(protocol.ToLoop.WRITE, request)
        deadline_s = time.monotonic() + _ANSWER_S
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            try:
                result = self.write_results.get(timeout=left_s)
            except queue.Empty:
                break
            if result.number == self._number:
                if result.refusal is not None:
                    raise ModelError(result.refusal)
                return
        names = ", ".join(f"'{name}'" for name, _ in values)
        raise ModelError(f"the loop did not answer within {_ANSWER_S:g} s: whether {names} was written is not known")

    def hand_over(self, inbox: Inbox) -> None:
        """Hand over what has arrived, in messages that fit."""
        requests = []
        for request in inbox.requests:
            self._number += 1
            self._answers[self._number] = request.answer
            if len(self._answers) > _UNANSWERED:
                del self._answers[next(iter(self._answers))]
            requests.append(protocol.NumberedRequest(request.action, self._number))
        setpoints, values, stations = inbox.setpoints, inbox.values, inbox.stations
        introductions = inbox.introductions
        while setpoints or values or stations or requests or introductions:
            numbers = setpoints[:_IN_ONE_MESSAGE], values[:_IN_ONE_MESSAGE]
            self.put(protocol.ToLoop.INBOX, protocol.InboxMessage(*numbers, stations, requests, introductions))
            setpoints, values = setpoints[_IN_ONE_MESSAGE:], values[_IN_ONE_MESSAGE:]
            stations, requests, introductions = [], [], []
        for stamp_ns, points, unsupported in inbox.trajectories:
            for begin in range(0, len(points) or 1, _IN_ONE_MESSAGE):
                part = points[begin : begin + _IN_ONE_MESSAGE], begin, len(points)
                self.put(protocol.ToLoop.TRAJECTORY, protocol.TrajectoryPart(stamp_ns, *part, unsupported))

    def put(self, kind: protocol.ToLoop, what: object) -> None:
        """Hand a message over, in any thread; wait where there is no room: DDS keeps what is newest.

        One that can never fit is refused at once: whoever waited for room would take no stop any more.
        """
        body = protocol.encoder.encode(what)
        if len(body) > self._inboxes.room:
            self._refuse(kind, len(body))
            return
        while self.is_running:
            with self._putting:
                if self._inboxes.put(kind, body):
                    return
            time.sleep(0.1 * self._period_s)

    def _refuse(self, kind: protocol.ToLoop, size: int) -> None:
        """Have the loop count it; report the first of each kind."""
        if kind not in self._refused:
            self._refused.add(kind)
            text = "a message to the loop (%s) is refused: of %d bytes it can never fit into %d"
            _logger.error(text, kind.name, size, self._inboxes.room)
        self.put(protocol.ToLoop.REFUSED, None)


class Publishing:
    """Publishes what the loop hands over until the loop ends, or has gone."""

    def __init__(
        self,
        stage: RosStage,
        subscriptions: Subscriptions,
        reports: RingReader,
        period_ns: int,
        *,
        is_simulated: bool = False,
    ) -> None:
        """Publish on `stage` what comes through `reports`, about once in `period_ns`, or whenever it is simulated."""
        self._longest_s, self._idle_s = (_SIMULATED_S, _SIMULATED_S) if is_simulated else (_LONGEST_S, _LOOK_S)
        self._stage = stage
        self._subscriptions = subscriptions
        self._reports = reports
        self._period_ns = period_ns
        self._statuses: list[DiagnosticStatus] = []
        self._reported_ns = 0
        self._has_subscribers = True
        self._is_over = False

    def run(self, source: int) -> None:
        """Publish; `source` is a file descriptor which ends when the loop's process has."""
        pause_s, looked_s = _SHORTEST_S, time.monotonic()
        self._look_who_subscribes()
        while not self._is_over and self._subscriptions.is_running:
            before_ns = self._reported_ns
            for kind, body in self._reports.take_messages():
                self._handle(kind, body)
            if not self._has_subscribers:
                time.sleep(self._idle_s)
            elif self._reported_ns == before_ns:
                time.sleep(pause_s)
                pause_s = min(2.0 * pause_s, self._longest_s)
            else:
                # The loop wakes nobody, which would cost it more than all the rest: when it will report is known.
                early_ns = self._reported_ns + self._period_ns + _AFTER_NS - time.monotonic_ns()
                time.sleep(min(max(early_ns, 0), self._period_ns) * 1e-9)
                pause_s = _SHORTEST_S
            if time.monotonic() - looked_s > _LOOK_S:
                looked_s = time.monotonic()
                self._look_who_subscribes()
                self._is_over = self._is_over or bool(select.select([source], [], [], 0.0)[0])

    def _look_who_subscribes(self) -> None:
        faulthandler.dump_traceback_later(HANGS_S, exit=True)
        before, self._has_subscribers = self._has_subscribers, self._stage.update_subscribed_topics()
        if self._has_subscribers is not before:
            self._subscriptions.put(protocol.ToLoop.SUBSCRIBED, self._has_subscribers)

    def _handle(self, kind: int, body: bytes) -> None:
        match kind:
            case protocol.FromLoop.REPORT:
                if self._has_subscribers:
                    report = protocol.decode_report(body)
                    self._reported_ns = report.at_ns
                    self._stage.publish(report)
            case protocol.FromLoop.STATUS:
                self._statuses.append(protocol.decode_status(body))
            case protocol.FromLoop.DIAGNOSTICS:
                self._stage.publish_diagnostics(protocol.decode_stamp(body), self._statuses)
                self._statuses = []
            case protocol.FromLoop.ANSWER:
                self._subscriptions.answer(protocol.decode_answer(body))
            case protocol.FromLoop.CLOCK:
                self._stage.publish_clock(protocol.decode_stamp(body))
            case protocol.FromLoop.WRITTEN:
                self._subscriptions.write_results.put(protocol.decode_write_result(body))
            case _:
                self._is_over = True


def run_ros(settings: protocol.RosSettings, source: int) -> None:
    """Be the robot in ROS until the loop ends; `source` is a file descriptor that ends when the loop's process has.

    Raises:
        RosUnavailableError: ROS does not start.
    """
    subscriptions = Subscriptions(RingWriter(settings.inboxes), settings.period_ns)
    arguments = settings.ros.node_name, settings.namespace, settings.ros_arguments
    with contextlib.ExitStack() as stack:
        with helping_threads():  # those of DDS and the one that listens; the one that publishes is this one
            is_simulated = settings.is_simulated
            if (open_end := why_not_secure(os.environ)) is not None:
                _logger.warning("%s; set %s=%s", open_end, STRATEGY, ENFORCE)
            node = stack.enter_context(ros_node(*arguments, parameters=True, is_simulated=is_simulated))
            stage = RosStage(node, settings, subscriptions.write)
            wait_set = WaitSet(node, stage)
            listening = threading.Thread(target=subscriptions.run, args=(wait_set, stage), name="subscriptions")
            listening.start()
        reports = RingReader(settings.reports)
        publishing = Publishing(stage, subscriptions, reports, settings.period_ns, is_simulated=is_simulated)
        with contextlib.suppress(BrokenPipeError):  # the loop's process has ended: `source` shows it
            print("ready", json.dumps(stage.overrides), flush=True)  # noqa: T201 - read by who started this process
        try:
            with real_time_priority(HELPERS_PRIORITY):
                publishing.run(source)
        finally:
            # Where each thread is matters to nobody who leaves.
            nowhere = os.open(os.devnull, os.O_WRONLY)
            faulthandler.dump_traceback_later(_LEAVES_S, exit=True, file=nowhere)
            subscriptions.is_running = False
            wait_set.wake()
            listening.join()
            wait_set.close()


def main() -> int:
    """Run as a process; the signals that end the loop leave it to publish what the loop reports last."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGABRT):
        signal.signal(number, signal.SIG_IGN)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    # What ROS and DDS print by themselves is no answer of this process.
    sys.stdout = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), 1)
    try:
        preload()
        line = sys.stdin.buffer.readline()  # empty where the loop's process has ended before it had a robot
        if line:
            with messages():
                run_ros(msgspec.json.decode(line, type=protocol.RosSettings), sys.stdin.fileno())
    except RosUnavailableError as error:
        with contextlib.suppress(BrokenPipeError):
            print(error, flush=True)  # noqa: T201 - as above
        return error.exit_code
    return 0


if __name__ == "__main__":
    status = 1
    try:
        status = main()
    except Exception:
        _logger.exception("the ROS process failed")
    # Not sys.exit: the interpreter would stop the watchdog before the destructors of DDS run, which may hang too.
    os._exit(status)
