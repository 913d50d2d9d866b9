# SPDX-License-Identifier: MIT
"""The programs that are compared, how each is started, and the plant and the subscriber beside them.

As a program, that subscriber: argument NAMESPACE. It takes nothing of what it subscribes to, so that what is measured
beside it is what publishing costs, and not what receiving does.
"""

import contextlib
import enum
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from segway_ecc.firmware_io.heartbeat import address_of
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.bench.rig import PLANT_PRIORITY, BenchPrograms, Bus, Conditions
from segway_ecc.hil.bench.samples import Samples, read_samples
from segway_ecc.hil.process_usage import Memory, cpu_s, memory, tree
from segway_ecc.hil.processes import last_lines, module_words, program
from segway_ecc.node.cycle.report import MODE_SUFFIX
from segway_ecc.node.errors import ConfigurationError, RecordingError
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import ros_node
from segway_ecc.node.safety.modes import Mode

NAMESPACE: Final = f"/bench_{os.getpid()}"
"""Of all programs in ROS."""
TOPICS: Final = {"odom": "nav_msgs/msg/Odometry", "joint_states": "sensor_msgs/msg/JointState"}
"""Topics that any ROS 2 system subscribes to, and their types."""
_DEPTH: Final = 10
_START_S: Final = 180.0
_END_S: Final = 180.0
"""In an emulated machine, where importing ROS alone takes a minute, and so does leaving it."""
_OVERTIME_S: Final = 5.0
_SETTLE_S: Final = 0.5
"""From the first cycle to where the CPU time of the process begins to count."""
_BEFORE_END_S: Final = 0.2
_SHORTEST_S: Final = 0.1
_POLL_S: Final = 0.01
_ANY_BYTES: Final = 64


@enum.unique
class Contestant(enum.StrEnum):
    """The programs."""

    OURS = "ours"
    USER = "user"
    """rclpy's timer and executor, python-can, the model through ctypes."""
    C = "c"
    BARE = "bare"
    """The loop in C without its work: how late this machine wakes a thread at best."""


@dataclass(frozen=True, slots=True)
class BenchSite:
    """Where a program runs, and for how long."""

    rig: BenchPrograms
    bus: Bus
    conditions: Conditions
    folder: Path

    @property
    def guard(self) -> str:
        """The address of the guard of this bus, without the zero that begins it."""
        return address_of(CanSettings(interface=self.bus.interface, channel=self.bus.channel)).removeprefix("\0")


@dataclass(frozen=True, slots=True)
class ProgramRun:
    """One run of one program.

    Attributes:
        start_s: From its start to its first command to the motors; None where it has none.
        share: CPU time of the process and its children for each second; 1 is a whole core.
        memory: What they held shortly before the end.
        report: What our own command printed as JSON.
        fault: Why our loop was no longer armed at its end, or its log lacks cycles; None where neither is. One that has
            given up does less, and so does one whose recorder does not keep up.
    """

    samples: Samples
    start_s: float | None
    share: float
    memory: Memory
    report: dict[str, Any] | None
    fault: str | None


def run_contestant(who: Contestant, place: BenchSite, duration_s: float) -> ProgramRun:
    """Run a program for a while.

    Raises:
        ConfigurationError: It ended with an error, or not in time.
    """
    samples, messages = place.folder / f"{who}.samples", place.folder / f"{who}.txt"
    samples.unlink(missing_ok=True)
    words, environment = _words(who, place, samples, duration_s), {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with contextlib.closing(_heartbeats(place)) as heartbeats:
        began_s = time.monotonic()
        with program(words, messages, environment) as started:
            process = started.process
            start_s = None if who is Contestant.BARE else _first_heartbeat(heartbeats, process) - began_s
            heartbeats.close()  # a sender then finds nobody, as where no guard runs
            time.sleep(_SETTLE_S)
            pids = tree(process.pid)
            from_s, used_s = time.monotonic(), cpu_s(pids)
            time.sleep(max(duration_s - _SETTLE_S - _BEFORE_END_S, _SHORTEST_S))
            share = (cpu_s(pids) - used_s) / (time.monotonic() - from_s)
            held = memory(pids)
            output = _ended(process, who)
    whole = {0, RecordingError.exit_code} if who is Contestant.OURS else {0}
    if process.returncode not in whole or not samples.exists():
        why = f"ended with exit code {process.returncode}: {last_lines(messages)}"
        raise ConfigurationError(f"the program '{who}' {why}")
    report = msgspec.json.decode(output, type=dict[str, Any]) if who is Contestant.OURS else None
    fault = None if report is None else _fault(report, process.returncode)
    return ProgramRun(read_samples(samples), start_s, share, held, report, fault)


def _fault(report: Mapping[str, Any], code: int) -> str | None:
    """Why our loop did less than it should, by its report and its exit code."""
    mode = next(values for name, values in report["diagnostics"].items() if name.endswith(MODE_SUFFIX))
    if mode["mode"] != Mode.ARMED:
        return str(mode["reason"])
    return "its log lacks records" if code else None


@contextlib.contextmanager
def plant(place: BenchSite) -> Iterator[dict[str, int]]:
    """The plant, at the other end of the bus for as long as the context lasts.

    Yields:
        Afterwards, what it saw: its ticks, how many were late, commands that it took, and those that it refused.

    Raises:
        ConfigurationError: It does not start.
    """
    bus, rig = place.bus, place.rig
    seen: dict[str, int] = {}
    priority = PLANT_PRIORITY if place.conditions.priority else 0
    where = [bus.interface, bus.place(bus.plant_channel), str(rig.period_ns), str(priority)]
    with program([str(rig.board), *where], place.folder / "board.txt", listens=True) as started:
        process = started.process
        if process.stdout is None or process.stdout.readline() != b"ready\n":
            raise ConfigurationError(f"the plant of the bench does not start on {bus.plant_channel}")
        yield seen
        output, _ = process.communicate(timeout=_END_S)  # which closes its standard input, so that it ends
        seen.update(msgspec.json.decode(output, type=dict[str, int]))


def _heartbeats(place: BenchSite) -> socket.socket:
    """The guard's socket; who sends there for the first time has no key of the guard yet, so all send alike."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    made.bind(f"\0{place.guard}")
    made.settimeout(_POLL_S)
    return made


def _first_heartbeat(heartbeats: socket.socket, process: subprocess.Popen[bytes]) -> float:
    """When the first heartbeat came, with which a program begins to command the motors; monotonic, s."""
    deadline_s = time.monotonic() + _START_S
    while time.monotonic() < deadline_s and process.poll() is None:
        with contextlib.suppress(TimeoutError):
            heartbeats.recv(_ANY_BYTES)
            break
    return time.monotonic()


def _words(who: Contestant, place: BenchSite, samples: Path, duration_s: float) -> Sequence[str]:
    bus, rig = place.bus, place.rig
    line = ["--interface", bus.interface, "--channel", bus.channel, "--duration", str(duration_s)]
    line += ["--namespace", NAMESPACE]
    if who is Contestant.OURS:
        words = ["run", str(rig.robot), "--json", *line, "--log", str(place.folder / "bench.mcap")]
        return [*module_words("segway_ecc.hil.bench.ours"), str(samples), *words]
    if who is Contestant.USER:
        words = ["--model", str(rig.library), *line, "--period", str(rig.period_ns * 1e-9)]
        words += ["--guard", place.guard, "--samples", str(samples)]
        return [*module_words("segway_ecc.hil.bench.same_settings"), *words]
    channel = "-" if who is Contestant.BARE else bus.place(bus.channel)
    numbers = (rig.period_ns, round(duration_s * 1e9 / rig.period_ns), place.conditions.priority)
    isolated = place.conditions.isolated
    pinned = ["taskset", "--cpu-list", ",".join(map(str, isolated))] if isolated else []
    return [*pinned, str(rig.loop), bus.interface, channel, place.guard, *map(str, numbers), str(samples)]


def _ended(process: subprocess.Popen[bytes], who: Contestant) -> bytes:
    """What a program printed, once it has ended.

    Ours runs for a number of cycles, which is long where it loses deadlines: it is asked to stop when its time is up.
    """
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.communicate(timeout=_OVERTIME_S)[0]
    process.terminate()
    try:
        return process.communicate(timeout=_END_S)[0]
    except subprocess.TimeoutExpired as error:
        raise ConfigurationError(f"the program '{who}' does not end") from error


@contextlib.contextmanager
def listening(namespace: str = NAMESPACE) -> Iterator[None]:
    """Have `TOPICS` in a namespace subscribed to while the context lasts.

    Raises:
        ConfigurationError: ROS does not start there.
    """
    words = [*module_words(__name__), namespace]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:  # noqa: S603 - our own
        try:
            if process.stdout is None or process.stdout.readline() != b"ready\n":
                raise ConfigurationError("the listener of the bench does not start")
            yield
        finally:
            process.communicate()  # which closes its standard input, so that it ends


def _subscribe() -> None:
    """Subscribe, and wait for the end of standard input."""
    with ros_node("listener", sys.argv[1]) as node:
        subscriptions = [
            node.create_subscription(message_type(kind), topic, _never_called, _DEPTH) for topic, kind in TOPICS.items()
        ]
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.read()
        del subscriptions


def _never_called(_message: object) -> None:
    raise AssertionError("nothing is taken")


if __name__ == "__main__":
    _subscribe()
