# SPDX-License-Identifier: MIT
"""Measures the latency here, from a set-point to its motor frame.

Node, plant and publisher are in processes of their own, and this process is on the bus. The publisher may be on
another host: a network namespace at the other end of a wire of its own.
"""

import contextlib
import enum
import importlib.resources
import math
import os
import shutil
import subprocess
import tempfile
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple, Self

import can
import msgspec

from segway_ecc.firmware_io.drives.wheel_board.session import CommandId, voltage_of
from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.latency.setpoints import MOST, STEP, Echo, Timed
from segway_ecc.hil.processes import command, last_lines, module_words, own_ros_domain, program
from segway_ecc.node.cycle.real_time import real_time_priority
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.ros.runtime import require_ros

_HERE: Final = "198.18.98.1"
_THERE: Final = "198.18.98.2"
"""Of the addresses for benchmarks (RFC 2544), which no network has in use."""
ALLOWED_S: Final = 1e-3
"""What a set-point may take beyond one period of the loop, s."""
_NS_PER_S: Final = 1e9
_RECEIVE_S: Final = 0.05
_MARGIN_S: Final = 60.0
_NOTHING: Final[Mapping[str, str]] = {}


@enum.unique
class Where(enum.StrEnum):
    """Where the set-points are published."""

    SAME_PROCESS = "same process"
    OTHER_PROCESS = "other process"
    OTHER_HOST = "other host"


class Latency(msgspec.Struct, frozen=True, kw_only=True):
    """From the moment before a set-point is published to the first motor frame on the bus that is made from it.

    Attributes:
        where: Where they were published; see `Where`.
        actuate: When commands leave; see `segway_ecc.node.config.RobotFile`.
        period_s: Of the loop, s.
        trials: Set-points published, at any phase of the loop.
        missed: Of how many no frame was seen.
        p99_s: The time within which 99 of 100 were there, s.
    """

    where: str
    actuate: str
    period_s: float
    trials: int
    missed: int
    p50_s: float
    p99_s: float
    max_s: float

    @property
    def limit_s(self) -> float:
        """What is required where robot and publisher are on one host, s."""
        return self.period_s + ALLOWED_S

    @property
    def is_within(self) -> bool:
        """Whether that was kept, and no set-point missed."""
        return self.p99_s <= self.limit_s and self.missed == 0

    def text(self) -> str:
        """One line."""
        values = (("p50", self.p50_s), ("p99", self.p99_s), ("max", self.max_s))
        ms = ", ".join(f"{name} {value * 1e3:.2f} ms" for name, value in values)
        return (
            f"{self.where}, actuate {self.actuate}: {ms} ({self.p99_s / self.period_s:.2f} periods at p99) "
            f"of {self.trials} set-points, {self.missed} missed"
        )

    @classmethod
    def of(cls, where: Where, actuate: str, period_s: float, published: Sequence[Timed], seen: Sequence[Timed]) -> Self:
        """From what was published and seen; each number is published once, and `seen` is in order of time.

        Raises:
            ValueError: No set-point was seen at all.
        """
        took = sorted(took_s(published, seen))
        if not took:
            raise ValueError("no set-point came through")
        return cls(
            where=str(where),
            actuate=actuate,
            period_s=period_s,
            trials=len(published),
            missed=len(published) - len(took),
            p50_s=quantile(took, 0.5),
            p99_s=quantile(took, 0.99),
            max_s=took[-1],
        )


def took_s(published: Sequence[Timed], seen: Sequence[Timed]) -> list[float]:
    """For each set-point that was seen: how long after its publication the first frame with it was there, s."""
    times: dict[int, list[int]] = {}
    for frame in seen:
        times.setdefault(frame.number, []).append(frame.at_ns)
    found = []
    for number, at_ns in published:
        later = times.get(number, [])
        place = bisect_left(later, at_ns)
        if place < len(later):
            found.append((later[place] - at_ns) / _NS_PER_S)
    return found


def quantile(ordered: Sequence[float], share: float) -> float:
    """The smallest value that this share of all does not exceed."""
    return ordered[max(math.ceil(share * len(ordered)) - 1, 0)]


def measure(
    where: Where = Where.OTHER_PROCESS,
    *,
    trials: int = 300,
    actuate: str = "immediately",
    publisher: Sequence[str] = (),
    environment: Mapping[str, str] = _NOTHING,
) -> Latency:
    """Measure how long set-points take; about 25 ms each, and some seconds before.

    Args:
        where: Where they are published.
        trials: How many, up to `segway_ecc.hil.latency.setpoints.MOST`.
        actuate: When commands leave: `immediately` or in the `next_cycle`.
        publisher: Begins the command line of their publisher, such as `ip netns exec NAME`.
        environment: Of the robot and of the publisher; what it lacks is a ROS domain of their own on this machine.

    Raises:
        RosUnavailableError: ROS is needed, and not there.
        RigError: A process failed, or no set-point came through.
        ValueError: There are too many trials.
    """
    if not 0 < trials <= MOST:
        raise ValueError(f"from 1 to {MOST} trials, not {trials}")
    if where is not Where.SAME_PROCESS:
        require_ros()
    environment = own_ros_domain() | dict(environment)
    channel = f"latency_{os.getpid()}"
    with tempfile.TemporaryDirectory(prefix="segway-ecc-latency-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        file, messages = folder / "echo.yaml", folder / "publisher.txt"
        text = importlib.resources.files("segway_ecc.hil.latency").joinpath(file.name).read_text(encoding="utf-8")
        file.write_text(f"{text}actuate: {actuate}\n", encoding="utf-8")
        robot = [str(file), "--interface", "local", "--channel", channel]
        bus = stack.enter_context(_wheel_commands(channel))
        stack.enter_context(command(["plant", *robot], folder / "plant.txt"))
        if where is Where.SAME_PROCESS:
            module = "segway_ecc.hil.latency.same_process"
            publishing = command([*robot, str(trials)], messages, module=module)
        else:
            namespace = f"/latency_{os.getpid()}"
            node = ["run", *robot, "--ros", "--namespace", namespace, "--log", str(folder / "latency.mcap")]
            stack.enter_context(command(node, folder / "node.txt", environment))
            words = [*publisher, *module_words("segway_ecc.hil.latency.setpoints"), namespace, str(trials)]
            publishing = program([*words, str(Echo.step_size)], messages, environment)
        process = stack.enter_context(publishing).process
        seen = _listen(bus, lambda: process.poll() is not None)
        output, _ = process.communicate(timeout=_MARGIN_S)
        if process.returncode != 0:
            why = f"ended with exit code {process.returncode}: {last_lines(messages)}"
            raise RigError(f"the publisher of set-points {why}")
        try:
            published = msgspec.json.decode(output, type=list[Timed])
            return Latency.of(where, actuate, Echo.step_size, published, seen)
        except ValueError as error:
            raise RigError(f"{where}: {error}; the robot's messages: {last_lines(folder / 'node.txt')}") from error


def _wheel_commands(channel: str) -> can.BusABC:
    filters = [{"can_id": int(CommandId.RIGHT_COMMAND), "can_mask": 0x7FF, "extended": False}]
    try:
        return can.Bus(interface="local", channel=channel, can_filters=filters)
    except (can.CanError, OSError) as error:
        raise BusNotFoundError(f"cannot listen on {channel}: {error}") from error


def _listen(bus: can.BusABC, is_over: Callable[[], bool]) -> list[Timed]:
    """The frames that complete a command, until it is over, each with the set-point that it was made from."""
    seen = []
    with real_time_priority():  # a time is noted when the frame is there, not when other programs let this one run
        while not is_over():
            frame = bus.recv(_RECEIVE_S)
            at_ns = time.monotonic_ns()
            if frame is not None and frame.arbitration_id == CommandId.RIGHT_COMMAND:
                seen.append(Timed(round(voltage_of(bytes(frame.data)) / STEP), at_ns))
    return seen


class OtherHost(NamedTuple):
    """How to run a program there: what begins its command line, and an environment.

    With that it and whoever is here find each other in ROS, and nobody else.
    """

    prefix: Sequence[str]
    environment: Mapping[str, str]


def other_host_lacks() -> str | None:
    """What it takes and is not here; None where nothing lacks."""
    if os.geteuid() != 0:
        return "only root may make one (a network namespace)"
    return None if shutil.which("ip") else "no ip command (sudo apt-get install iproute2)"


@contextlib.contextmanager
def other_host() -> Iterator[OtherHost]:
    """Have one while the context lasts.

    Raises:
        ConfigurationError: The kernel does not make one.
    """
    name, ours, theirs = f"ecc{os.getpid()}", f"eccr{os.getpid()}", f"eccs{os.getpid()}"
    inside = ["ip", "netns", "exec", name]
    peers = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": f"{_HERE};{_THERE}"}
    with contextlib.ExitStack() as stack:
        stack.callback(_run, ["ip", "netns", "delete", name])
        stack.callback(_run, ["ip", "link", "delete", ours])
        for words in (
            ["ip", "netns", "add", name],
            ["ip", "link", "add", ours, "type", "veth", "peer", "name", theirs],
            ["ip", "link", "set", theirs, "netns", name],
            ["ip", "address", "add", f"{_HERE}/30", "dev", ours],
            ["ip", "link", "set", ours, "up"],
            [*inside, "ip", "address", "add", f"{_THERE}/30", "dev", theirs],
            [*inside, "ip", "link", "set", "lo", "up"],
            [*inside, "ip", "link", "set", theirs, "up"],
        ):
            done = _run(words)
            if done.returncode != 0:
                raise ConfigurationError(f"no other host to be had: {' '.join(words)}: {done.stderr.strip()}")
        yield OtherHost(inside, peers)


def _run(words: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - no shell reads our words
