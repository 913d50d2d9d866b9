"""The process that speaks ROS ends by itself, whatever DDS does. No ROS is needed here: it is DDS that is replaced."""

import os
import signal
import subprocess
import sys

HANGING = """
import os, time
from node.cycle.seams import Report
from node.ring import RingReader, RingWriter, open_ring
from node.ros import process
from node.ros.arrivals import Arrivals
from node.ros.exchanged import FromLoop, encoder
from node.safety.modes import Mode

process.HANGS_S = 1


class Hanging:
    def look_who_listens(self):
        return True

    def publish(self, report):
        print("published", flush=True)
        time.sleep(1000.0)


reports, inboxes = open_ring(4), open_ring(4)
loop = RingWriter(reports)
publishing = process.Publishing(Hanging(), Arrivals(RingWriter(inboxes), 10**7), RingReader(reports), 10**7)
loop.put(FromLoop.REPORT, encoder.encode(Report(0, Mode.ARMED, [], None)))
publishing.run(0)
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
