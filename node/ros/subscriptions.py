# SPDX-License-Identifier: MIT
"""What arrives from ROS on its way to the loop: a thread waits for it in DDS and puts it where the loop looks."""

import importlib
import queue
import threading
import time
from collections.abc import Callable, Collection
from typing import Final

from segway_ecc.node.cycle.interfaces import Inbox
from segway_ecc.node.errors import ModelError
from segway_ecc.node.ring import RingWriter
from segway_ecc.node.ros.messages import RosObject
from segway_ecc.node.ros.protocol import (
    InboxMessage,
    NumberedAnswer,
    NumberedRequest,
    ToLoop,
    WriteRequest,
    WriteResult,
    encoder,
)
from segway_ecc.node.ros.stage import RosStage
from segway_ecc.node.safety.modes import Answer

_LOOK_AROUND_S: Final = 0.5
_ANSWER_S: Final = 1.0
_IN_ONE_MESSAGE: Final = 50
"""Set-points and values, so that no message fills the ring."""
_UNANSWERED: Final = 100
"""Requests that may wait for the loop's answer; the oldest is discarded."""


class WaitSet:
    """Waits for what arrives without taking it, as an executor would."""

    def __init__(self, node: RosObject, stage: RosStage) -> None:
        """Wait for what `stage` takes on `node`."""
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
        self._period_s = period_ns * 1e-9
        self._number = 0
        self._answers: dict[int, Callable[[Answer], None]] = {}
        self.write_results: queue.SimpleQueue[WriteResult] = queue.SimpleQueue()

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
                    stage.do_background_work()
        finally:
            self.is_running = False

    def report_subscribers(self, *, has_subscribers: bool) -> None:
        """Report to the loop whether anybody subscribes to what is published of each cycle; any thread may."""
        self._put(ToLoop.SUBSCRIBED, has_subscribers)

    def answer(self, answered: NumberedAnswer) -> None:
        """Answer a request."""
        send = self._answers.pop(answered.number, None)
        if send is not None:
            send(answered.answer)

    def write(self, name: str, value: float) -> None:
        """Have the loop write a parameter of the model.

        Raises:
            ModelError: The model refuses it, or the loop does not answer.
        """
        self._number += 1
        self._put(ToLoop.WRITE, WriteRequest(self._number, name, value))
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
        raise ModelError(f"the loop did not answer within {_ANSWER_S:g} s: whether '{name}' was written is not known")

    def hand_over(self, inbox: Inbox) -> None:
        """Hand over what has arrived, in messages that fit."""
        requests = []
        for request in inbox.requests:
            self._number += 1
            self._answers[self._number] = request.answer
            if len(self._answers) > _UNANSWERED:
                del self._answers[next(iter(self._answers))]
            requests.append(NumberedRequest(request.action, self._number))
        setpoints, values, stations = inbox.setpoints, inbox.values, inbox.stations
        while setpoints or values or stations or requests:
            message = InboxMessage(setpoints[:_IN_ONE_MESSAGE], values[:_IN_ONE_MESSAGE], stations, requests)
            self._put(ToLoop.INBOX, message)
            setpoints, values, stations, requests = setpoints[_IN_ONE_MESSAGE:], values[_IN_ONE_MESSAGE:], [], []

    def _put(self, kind: ToLoop, what: object) -> None:
        """Hand a message over; wait where there is no room: DDS keeps what is newest."""
        body = encoder.encode(what)
        while self.is_running:
            with self._putting:
                if self._inboxes.put(kind, body):
                    return
            time.sleep(0.1 * self._period_s)
