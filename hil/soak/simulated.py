# SPDX-License-Identifier: MIT
"""Hours of driving in lock step with the recorder on, in a process of its own, which is watched from outside.

It receives what to drive in one line of JSON on its standard input, writes one line of JSON
every ten seconds of simulated time, and waits for a line before it drives on: so it is paused while it is sampled,
and every look is at the same place of the program.
"""

import contextlib
import gc
import logging
import sys
import time
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.hil.endurance.endurance import drive
from segway_ecc.hil.process_usage import helpers_of
from segway_ecc.hil.processes import Command, command
from segway_ecc.hil.progress import OnSeconds
from segway_ecc.hil.rig.fronts import RecorderFront
from segway_ecc.hil.soak.watching import LOG, Counted, Watching
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import NodeError
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.robot import Robot

_ANSWER_S: Final = 1200.0
"""Ten simulated seconds take less than one on an idle machine, and minutes where its disk or processors are busy."""
_PATIENCE_S: Final = 0.1
_STARTS_WITHIN_S: Final = 60.0
_BLOCKS: Final = Counted("blocks of memory", 300)
"""Blocks that Python holds (`sys.getallocatedblocks`): every object is one at least."""
_OBJECTS: Final = Counted("objects", 100)
"""Objects that the garbage collector knows, those aside that were there before the loop began."""
_DROPPED: Final = Counted("records dropped", None)
"""Reported, and not judged: that a writer is kept waiting by other programs is no growth."""


class SimulatedSoak(msgspec.Struct, frozen=True):
    """What is driven: a robot file, how long, s, with which share of frames lost either way; and where its log goes."""

    robot: str
    duration_s: float
    frame_loss: float
    log: str


class ProcessSample(msgspec.Struct):
    """What the process reports of itself.

    Attributes:
        blocks: Blocks of memory that Python holds.
        objects: Objects that the garbage collector knows.
        trip: Why the robot ended early; empty where it did not.
        cycles: Cycles driven; 0 until the end.
        dropped: Records that were not kept.
    """

    time_s: float
    blocks: int = 0
    objects: int = 0
    trip: str = ""
    cycles: int = 0
    dropped: int = 0
    is_over: bool = False


def soak(job: SimulatedSoak, watching: Watching, on_progress: OnSeconds) -> ProcessSample:
    """Drive a robot in lock step, and look at its processes every ten simulated seconds; returns how it ended.

    Raises:
        ProcessFailedError: The process ended with an error.
    """
    with command([], watching.folder / "simulated.txt", module=__name__, listens=True) as driving:
        sample = _ask(driving, msgspec.json.encode(job).decode())
        while not sample.is_over:
            process = driving.process.pid
            watching.look(sample.time_s, {"simulated": process, **helpers_of(process)})
            watching.count(sample.time_s, "simulated", _BLOCKS, sample.blocks)
            watching.count(sample.time_s, "simulated", _OBJECTS, sample.objects)
            watching.count(sample.time_s, "simulated", _DROPPED, sample.dropped)
            on_progress(sample.time_s)
            sample = _ask(driving, "on")
        return sample


def _ask(driving: Command, line: str) -> ProcessSample:
    return msgspec.json.decode(driving.ask(line, _ANSWER_S), type=ProcessSample)


class PatientRecorder(RecorderFront):
    """Waits where the writer does not keep up: in lock step the loop runs many times as fast as on a robot.

    `dropped` are the records that were dropped all the same.
    """

    def __init__(self, recorder: ProcessRecorder) -> None:
        """Stand in front of `recorder`."""
        super().__init__(recorder)
        self._recorder = recorder
        self.dropped = 0

    def write(self, record: CycleRecord) -> None:
        """Keep one cycle, and give the writer time where there was no room for it."""
        super().write(record)
        if self._recorder.dropped > self.dropped:
            self.dropped = self._recorder.dropped
            time.sleep(_PATIENCE_S)


def main() -> int:
    """Drive as the first line of the standard input asks."""
    job = msgspec.json.decode(sys.stdin.readline(), type=SimulatedSoak)
    logging.getLogger("segway_ecc.node").setLevel(logging.CRITICAL)
    recorders: list[PatientRecorder] = []

    def keep(robot: Robot) -> PatientRecorder:
        log = Path(job.log)
        recorders.append(PatientRecorder(ProcessRecorder(log, layout_of(robot), provenance_of(robot.file), LOG)))
        give_up_s = time.monotonic() + _STARTS_WITHIN_S
        while log.stat().st_size == 0 and time.monotonic() < give_up_s:
            time.sleep(_PATIENCE_S)  # until the writer has begun its log: in lock step a start is thousands of cycles
        return recorders[0]

    def look(time_s: float) -> None:
        gc.collect(1)  # as the loop does about once a second
        _report(ProcessSample(time_s, sys.getallocatedblocks(), len(gc.get_objects()), dropped=recorders[0].dropped))
        sys.stdin.readline()

    try:
        stretch = drive(load_robot(job.robot), 1, job.duration_s, job.frame_loss, keep=keep, on_progress=look)
    except NodeError as error:
        sys.stderr.write(f"segway-ecc: {error}\n")
        return error.exit_code
    trip = "" if stretch.trip is None else f"{stretch.trip.mode} at {stretch.trip.at_s:.3f} s: {stretch.trip.reason}"
    _report(ProcessSample(stretch.simulated_s, 0, 0, trip, stretch.cycles, recorders[0].dropped, is_over=True))
    return 0


def _report(sample: ProcessSample) -> None:
    sys.stdout.write(msgspec.json.encode(sample).decode() + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        sys.exit(main())
