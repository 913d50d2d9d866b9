"""The process that speaks ROS ends by itself, whatever DDS does. No ROS is needed here: it is DDS that is replaced."""

import os
import signal
import subprocess
import sys

HANGING = """
import os, time
from segway_ecc.node.cycle.seams import Report
from segway_ecc.node.ring import RingReader, RingWriter, open_ring
from segway_ecc.node.ros import process
from segway_ecc.node.ros.subscriptions import Subscriptions
from segway_ecc.node.ros.protocol import FromLoop, encoder
from segway_ecc.node.safety.modes import Mode

process.HANGS_S = 1


class Hanging:
    def look_who_listens(self):
        return True

    def publish(self, report):
        print("published", flush=True)
        time.sleep(1000.0)


reports, inboxes = open_ring(4), open_ring(4)
loop = RingWriter(reports)
publishing = process.Publishing(Hanging(), Subscriptions(RingWriter(inboxes), 10**7), RingReader(reports), 10**7)
loop.put(FromLoop.REPORT, encoder.encode(Report(0, Mode.ARMED, [], None)))
publishing.run(0)
"""

UNHEARD = """
import itertools, threading, time
from segway_ecc.node.cycle.seams import Report
from segway_ecc.node.ring import RingReader, RingWriter, open_ring
from segway_ecc.node.ros import process
from segway_ecc.node.ros.subscriptions import Subscriptions
from segway_ecc.node.ros.protocol import FromLoop, ToLoop, decode_subscribed, encoder
from segway_ecc.node.safety.modes import Mode


class Stage:
    looks = 0
    told = []

    def look_who_listens(self):
        self.looks += 1
        return self.looks > 2

    def publish(self, report):
        self.told.append((self.looks, report.cycle))


def report(stage):
    told = True
    for cycle in itertools.count(1):
        for kind, body in inbox.take_all():
            assert kind == ToLoop.SUBSCRIBED
            told = decode_subscribed(body)
            said.append(told)
        if told:
            assert loop.put(FromLoop.REPORT, encoder.encode(Report(0, Mode.ARMED, [], None, cycle=cycle, at_ns=cycle)))
        if len(stage.told) >= 3:
            loop.put(FromLoop.END, encoder.encode(None))
            return
        time.sleep(0.002)


reports, inboxes = open_ring(64), open_ring(4)
loop, stage, said, inbox = RingWriter(reports), Stage(), [], RingReader(inboxes)
publishing = process.Publishing(stage, Subscriptions(RingWriter(inboxes), 10**6), RingReader(reports), 10**6)
threading.Thread(target=report, args=(stage,)).start()
publishing.run(0)
(looks, first), (_, second), (_, third) = stage.told[:3]
print(said, looks, first > 10, second - first, third - second)
"""


def test_where_dds_hangs_the_kernel_ends_it() -> None:
    done = subprocess.run([sys.executable, "-c", HANGING], check=False, capture_output=True, text=True, timeout=60.0)
    assert done.stdout == "published\n"
    assert done.returncode == -signal.SIGALRM


def test_a_process_that_is_handed_nothing_ends_when_its_input_does() -> None:
    read, write = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-c", HANGING.replace("loop.put", "(lambda *_: None)")], stdin=read, stdout=subprocess.PIPE
    ) as process:
        os.close(read)
        os.close(write)
        assert process.wait(60.0) == 0


def test_what_nobody_hears_is_not_told_and_who_comes_hears_all_from_then_on() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", UNHEARD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.read() == "[False, True] 3 True 1 1\n"
