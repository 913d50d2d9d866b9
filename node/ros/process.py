# SPDX-License-Identifier: MIT
"""The process that runs ROS for a loop. Its settings come through standard input.

One thread publishes what the loop hands over, another waits in DDS for what arrives. Neither side waits for the other:
what lies between them is memory (`segway_ecc.node.ring`).
"""

import contextlib
import faulthandler
import logging
import os
import select
import signal
import sys
import threading
import time
from typing import Final

import msgspec

from segway_ecc.node.cycle.real_time import HELPERS_PRIORITY, SWITCH_INTERVAL_S, helping_threads, real_time_priority
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RosUnavailableError
from segway_ecc.node.logs import messages
from segway_ecc.node.ring import RingReader, RingWriter
from segway_ecc.node.ros.protocol import (
    FromLoop,
    RosSettings,
    decode_answer,
    decode_report,
    decode_stamp,
    decode_status,
    decode_write_result,
)
from segway_ecc.node.ros.runtime import preload, ros_node
from segway_ecc.node.ros.stage import RosStage
from segway_ecc.node.ros.subscriptions import Subscriptions, WaitSet

_AFTER_NS: Final = 200_000
"""From a report's time to when it is looked for: the loop hands it over within that."""
_SHORTEST_S: Final = 0.0001
_LONGEST_S: Final = 0.01
"""Between two looks where none came in time; each is twice as long as the one before."""
_LOOK_S: Final = 0.1
"""Between two looks who subscribes, and whether the loop's process has gone. Where nobody subscribes to what is
published of each cycle the loop does not report it, and what else it reports waits as long."""
HANGS_S: Final = 10
"""After so long in a call of DDS this process ends with status 1: the loop then knows that it has no ROS."""
_LEAVES_S: Final = 4
"""So long it has to leave ROS: where several nodes left at once, Fast DDS was seen to go round in circles for ever."""


def end_process_after(seconds: float) -> None:
    """End this process with status 1 and a trace of its threads, unless this is called again before.

    The watchdog is a thread of C: it runs also while a call of DDS hangs that holds the interpreter's lock, as those
    that publish do. A call takes 50 us.
    """
    faulthandler.dump_traceback_later(seconds, exit=True)


class Publishing:
    """Publishes what the loop hands over until the loop ends, or has gone."""

    def __init__(self, stage: RosStage, subscriptions: Subscriptions, reports: RingReader, period_ns: int) -> None:
        """Publish on `stage` what comes through `reports`, about once in `period_ns`."""
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
                time.sleep(_LOOK_S)
            elif self._reported_ns == before_ns:
                time.sleep(pause_s)
                pause_s = min(2.0 * pause_s, _LONGEST_S)
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
        end_process_after(HANGS_S)
        before, self._has_subscribers = self._has_subscribers, self._stage.update_subscribed_topics()
        if self._has_subscribers is not before:
            self._subscriptions.report_subscribers(has_subscribers=self._has_subscribers)

    def _handle(self, kind: int, body: bytes) -> None:
        match kind:
            case FromLoop.REPORT:
                if self._has_subscribers:
                    report = decode_report(body)
                    self._reported_ns = report.at_ns
                    self._stage.publish(report)
            case FromLoop.STATUS:
                self._statuses.append(decode_status(body))
            case FromLoop.DIAGNOSTICS:
                self._stage.publish_diagnostics(decode_stamp(body), self._statuses)
                self._statuses = []
            case FromLoop.ANSWER:
                self._subscriptions.answer(decode_answer(body))
            case FromLoop.WRITTEN:
                self._subscriptions.write_results.put(decode_write_result(body))
            case _:
                self._is_over = True


def run_ros(settings: RosSettings, source: int) -> None:
    """Be the robot in ROS until the loop ends.

    Args:
        settings: What the robot is.
        source: A file descriptor, which ends when the loop's process has.

    Raises:
        RosUnavailableError: ROS does not start.
    """
    subscriptions = Subscriptions(RingWriter(settings.inboxes), settings.period_ns)
    arguments = settings.ros.node_name, settings.namespace, settings.ros_arguments
    with contextlib.ExitStack() as stack:
        with helping_threads():  # those of DDS and the one that listens; the one that publishes is this one
            node = stack.enter_context(ros_node(*arguments, parameters=True))
            stage = RosStage(node, settings, subscriptions.write)
            wait_set = WaitSet(node, stage)
            listening = threading.Thread(target=subscriptions.run, args=(wait_set, stage), name="subscriptions")
            listening.start()
        publishing = Publishing(stage, subscriptions, RingReader(settings.reports), settings.period_ns)
        print("ready", flush=True)  # noqa: T201 - read by who started this process
        try:
            with real_time_priority(HELPERS_PRIORITY):
                publishing.run(source)
        finally:
            end_process_after(_LEAVES_S)
            subscriptions.is_running = False
            wait_set.wake()
            listening.join()
            wait_set.close()


def main() -> int:
    """Run as a process; the signals that end the loop leave it to publish what the loop reports last."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGABRT):
        signal.signal(number, signal.SIG_IGN)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        preload()
        line = sys.stdin.buffer.readline()  # empty where the loop's process has ended before it had a robot
        if line:
            with messages():
                run_ros(msgspec.json.decode(line, type=RosSettings), sys.stdin.fileno())
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
        logging.getLogger(__name__).exception("the ROS process failed")
    # Not sys.exit: the interpreter would stop the watchdog before the destructors of DDS run, which may hang too.
    os._exit(status)
