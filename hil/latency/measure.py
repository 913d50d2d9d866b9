# SPDX-License-Identifier: MIT
"""Measures the latency here: node, plant and publisher in processes of their own, and this process on the bus."""

import contextlib
import importlib.resources
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import can
import msgspec

from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId, WheelCommand, decode
from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.latency.echo import Echo
from segway_ecc.hil.latency.result import Latency, Timed, Where
from segway_ecc.hil.latency.setpoints import MOST, STEP
from segway_ecc.hil.processes import command
from segway_ecc.node.cycle.real_time import real_time_priority
from segway_ecc.node.ros.runtime import require_ros

_RECEIVE_S: Final = 0.05
_MARGIN_S: Final = 60.0
_DOMAINS: Final = 101
_WORDS: Final = 5
_NOTHING: Final[Mapping[str, str]] = {}


def measure(  # noqa: PLR0913 - what there is to choose
    where: Where = Where.OTHER_PROCESS,
    *,
    trials: int = 300,
    actuate: str = "immediately",
    channel: str | None = None,
    publisher: Sequence[str] = (),
    environment: Mapping[str, str] = _NOTHING,
) -> Latency:
    """Measure how long set-points take; about 25 ms each, and some seconds before.

    Args:
        where: Where they are published.
        trials: How many, up to `segway_ecc.hil.latency.setpoints.MOST`.
        actuate: When commands leave: `immediately` or in the `next_cycle`.
        channel: A SocketCAN interface that nobody else uses; None for the virtual bus between processes.
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
    alone = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % _DOMAINS)}
    with tempfile.TemporaryDirectory(prefix="segway-ecc-latency-") as name:
        folder = Path(name)
        robot = folder / "echo.yaml"
        text = importlib.resources.files("segway_ecc.hil.latency").joinpath(robot.name).read_text(encoding="utf-8")
        robot.write_text(f"{text}actuate: {actuate}\n", encoding="utf-8")
        interface, channel = ("local", f"latency_{os.getpid()}") if channel is None else ("socketcan", channel)
        bench = _LatencyProcesses(
            folder, robot, ["--interface", interface, "--channel", channel], {**alone, **environment}
        )
        with (
            _wheel_commands(interface, channel) as bus,
            command(["plant", *bench.words], folder / "plant.txt"),
        ):
            speaking = bench.in_process(trials) if where is Where.SAME_PROCESS else bench.apart(trials, publisher)
            with speaking as process:
                seen = _listen(bus, lambda: process.poll() is not None)
                published = _published(process, folder)
        try:
            return Latency.of(where, actuate, Echo.step_size, published, seen)
        except ValueError as error:
            raise RigError(f"{where}: {error}; the robot's messages: {_last_words(folder / 'node.txt')}") from error


class _LatencyProcesses:
    """What is started."""

    def __init__(self, folder: Path, robot: Path, line: Sequence[str], environment: Mapping[str, str]) -> None:
        self.words = [str(robot), *line]
        self._folder = folder
        self._environment = dict(environment)

    @contextlib.contextmanager
    def in_process(self, trials: int) -> "Iterator[subprocess.Popen[bytes]]":
        """The robot, with the publisher inside."""
        words = [*self.words, str(trials)]
        with command(words, self._folder / "publisher.txt", module="segway_ecc.hil.latency.same_process") as robot:
            yield robot.process

    @contextlib.contextmanager
    def apart(self, trials: int, prefix: Sequence[str]) -> "Iterator[subprocess.Popen[bytes]]":
        """The robot with ROS and its recorder, and the publisher in another process."""
        namespace = f"/latency_{os.getpid()}"
        node = ["run", *self.words, "--ros", "--namespace", namespace, "--log", str(self._folder / "latency.mcap")]
        module = "segway_ecc.hil.latency.publisher"
        words = [*prefix, sys.executable, "-P", "-m", module, namespace, str(trials), str(Echo.step_size)]
        with (
            command(node, self._folder / "node.txt", self._environment),
            (self._folder / "publisher.txt").open("wb") as errors,
            subprocess.Popen(  # noqa: S603 - our own program
                words, stdout=subprocess.PIPE, stderr=errors, env={**os.environ, **self._environment}
            ) as publishing,
        ):
            try:
                yield publishing
            finally:
                publishing.terminate()


def _wheel_commands(interface: str, channel: str) -> can.BusABC:
    filters = [{"can_id": int(FrameId.WHEEL_COMMAND), "can_mask": 0x7FF, "extended": False}]
    try:
        return can.Bus(interface=interface, channel=channel, can_filters=filters)
    except (can.CanError, OSError) as error:
        raise BusNotFoundError(f"cannot listen on {channel}: {error}") from error


def _listen(bus: can.BusABC, is_over: Callable[[], bool]) -> list[Timed]:
    """The motor frames that are there until it is over, each with the set-point that it was made from."""
    seen = []
    with real_time_priority():  # a time is noted when the frame is there, not when other programs let this one run
        while not is_over():
            frame = bus.recv(_RECEIVE_S)
            at_ns = time.monotonic_ns()
            if frame is None or frame.arbitration_id != FrameId.WHEEL_COMMAND:
                continue
            payload, _ = decode(frame.arbitration_id, bytes(frame.data))
            if isinstance(payload, WheelCommand):
                seen.append(Timed(round(payload.left_voltage / STEP), at_ns))
    return seen


def _published(process: "subprocess.Popen[bytes]", folder: Path) -> list[Timed]:
    """The set-points that a process printed as published, once it has ended."""
    output, _ = process.communicate(timeout=_MARGIN_S)
    if process.returncode != 0:
        messages = _last_words(folder / "publisher.txt")
        raise RigError(f"the publisher of set-points ended with exit code {process.returncode}: {messages}")
    return msgspec.json.decode(output, type=list[Timed])


def _last_words(messages: Path) -> str:
    lines = messages.read_text(encoding="utf-8", errors="replace").splitlines() if messages.exists() else []
    return " | ".join(lines[-_WORDS:]) or "nothing"
