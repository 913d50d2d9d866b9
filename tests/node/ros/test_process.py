# SPDX-License-Identifier: MIT
"""The ROS process ends by itself, whatever DDS does. No ROS is needed here: it is DDS that is replaced."""

import os
import subprocess
import sys

import pytest

from tests.patience import PATIENCE_S

HANGING = """
import ctypes, time
from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.ring import RingReader, RingWriter, open_ring
from segway_ecc.node.ros import process
from segway_ecc.node.ros.process import Subscriptions
from segway_ecc.node.ros.protocol import FromLoop, encoder
from segway_ecc.node.safety.modes import Mode

process.HANGS_S = 1


class Hanging:
    def update_subscribed_topics(self):
        return True

    def publish(self, report):
        print("published", flush=True)
        HANG


reports, inboxes = open_ring(4), open_ring(4)
loop = RingWriter(reports)
publishing = process.Publishing(Hanging(), Subscriptions(RingWriter(inboxes), 10**7), RingReader(reports), 10**7)
loop.put(FromLoop.REPORT, encoder.encode(Report(0, Mode.ARMED, [], None)))
publishing.run(0)
"""

UNSUBSCRIBED = """
import itertools, threading, time
from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.ring import RingReader, RingWriter, open_ring
from segway_ecc.node.ros import process
from segway_ecc.node.ros.process import Subscriptions
from segway_ecc.node.ros.protocol import FromLoop, ToLoop, decode_subscribed, encoder
from segway_ecc.node.safety.modes import Mode


class Stage:
    looks = 0
    published = []

    def update_subscribed_topics(self):
        self.looks += 1
        return self.looks > 2

    def publish(self, report):
        self.published.append((self.looks, report.cycle))


def report(stage):
    wanted = True
    for cycle in itertools.count(1):
        for kind, body in inbox.take_messages():
            assert kind == ToLoop.SUBSCRIBED
            wanted = decode_subscribed(body)
            requests.append(wanted)
        if wanted:
            assert loop.put(FromLoop.REPORT, encoder.encode(Report(0, Mode.ARMED, [], None, cycle=cycle, at_ns=cycle)))
        if len(stage.published) >= 3:
            loop.put(FromLoop.END, encoder.encode(None))
            return
        time.sleep(0.002)


reports, inboxes = open_ring(64), open_ring(4)
loop, stage, requests, inbox = RingWriter(reports), Stage(), [], RingReader(inboxes)
publishing = process.Publishing(stage, Subscriptions(RingWriter(inboxes), 10**6), RingReader(reports), 10**6)
threading.Thread(target=report, args=(stage,)).start()
publishing.run(0)
(looks, first), (_, second), (_, third) = stage.published[:3]
print(requests, looks, first > 10, second - first, third - second)
"""


LEAVING = """
import contextlib, time, types
from segway_ecc.node.cycle.interfaces import Inbox
from segway_ecc.node.ring import open_ring
from segway_ecc.node.ros import process

process._LEAVES_S = 1


@contextlib.contextmanager
def ros_node(*_, **__):
    yield None
    time.sleep(1000.0)


class Stage:
    overrides, strangers = {}, ()

    def __init__(self, *_):
        pass

    def take_messages(self, ready):
        return Inbox()

    def serve_parameters(self, ready):
        pass

    def do_background_work(self):
        pass

    def update_subscribed_topics(self):
        return False


class WaitSet(Stage):
    def wait(self, timeout_s):
        time.sleep(0.01)
        return []

    def wake(self):
        pass

    def close(self):
        pass


process.ros_node, process.RosStage, process.WaitSet = ros_node, Stage, WaitSet
ros = types.SimpleNamespace(node_name="model")
settings = types.SimpleNamespace(
    inboxes=open_ring(4), reports=open_ring(4), period_ns=10**7, ros=ros, namespace="", ros_arguments=(),
    is_simulated=False,
)
process.run_ros(settings, 0)
"""


@pytest.mark.parametrize("has_reader", [True, False], ids=["started", "the loop's process ended while ROS started"])
def test_a_process_that_cannot_leave_ros_ends_in_time_and_without_a_word(has_reader: bool) -> None:  # noqa: FBT001 - a case
    read, write = os.pipe()
    if not has_reader:
        os.close(read)
    with subprocess.Popen(
        [sys.executable, "-c", LEAVING], stdin=subprocess.DEVNULL, stdout=write, stderr=subprocess.PIPE
    ) as process:
        os.close(write)
        _, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, errors) == (1, b"")
    if has_reader:
        with os.fdopen(read, "rb") as printed:
            assert printed.read() == b"ready {}\n"


@pytest.mark.parametrize("hang", ["time.sleep(1000.0)", "ctypes.PyDLL(None).sleep(1000)"])
def test_process_ends_itself_where_dds_hangs_even_with_the_interpreter_locked(hang: str) -> None:
    code = HANGING.replace("HANG\n", f"{hang}\n")
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.stdout == "published\n"
    assert done.returncode == 1
    assert done.stderr.startswith("Timeout (0:00:01)!")


def test_process_without_reports_ends_when_its_input_does() -> None:
    read, write = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-c", HANGING.replace("loop.put", "(lambda *_: None)")], stdin=read, stdout=subprocess.PIPE
    ) as process:
        os.close(read)
        os.close(write)
        assert process.wait(60.0) == 0


def test_cycles_are_reported_only_while_somebody_subscribes() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", UNSUBSCRIBED], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.read() == "[False, True] 3 True 1 1\n"
