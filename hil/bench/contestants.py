"""The programs that are compared, and how each is started."""

import contextlib
import enum
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from segway_ecc.firmware_io.heartbeat import HeartbeatListener, address_of
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.bench.conditions import Conditions
from segway_ecc.hil.bench.process_cost import Memory, cpu_s, memory, tree
from segway_ecc.hil.bench.rig import BenchPrograms, Bus
from segway_ecc.node.cycle.report import MODE_SUFFIX
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.modes import Mode

_CHILD: Final = (sys.executable, "-P", "-m", "segway_ecc.hil.child")
"""Before the parent's process id and a module: a program that ends with us."""
NAMESPACE: Final = f"/bench_{os.getpid()}"
"""Of all programs in ROS."""
_START_S: Final = 180.0
_END_S: Final = 180.0
"""In an emulated machine, where importing ROS alone takes a minute, and so does leaving it."""
_LAST_LINES: Final = 3
_OVERTIME_S: Final = 5.0
_SETTLE_S: Final = 0.5
"""From the first cycle to where the CPU time of the process begins to count."""
_BEFORE_END_S: Final = 0.2
_SHORTEST_S: Final = 0.1


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
        samples: The file with its samples.
        start_s: From its start to its first command to the motors; None where it has none.
        share: CPU time of the process and its children for each second; 1 is a whole core.
        memory: What they held shortly before the end.
        report: What our own command printed as JSON.
        fault: Why our loop was no longer armed at its end; None where it was. One that has given up does less.
    """

    samples: Path
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
    command = _COMMANDS[who](place, samples, duration_s)
    with messages.open("wb") as errors, contextlib.closing(_Heartbeats(place)) as heartbeats:
        began_s = time.monotonic()
        with _process(command, errors.fileno()) as process:
            start_s = None if who is Contestant.BARE else heartbeats.wait(process, _START_S) - began_s
            heartbeats.close()
            share, held = _watch(process, duration_s)
            output = _ended(process, who)
    if process.returncode != 0 or not samples.exists():
        last = messages.read_text(encoding="utf-8", errors="replace").splitlines()[-_LAST_LINES:]
        raise ConfigurationError(f"the program '{who}' ended with exit code {process.returncode}: {' | '.join(last)}")
    report = msgspec.json.decode(output, type=dict[str, Any]) if who is Contestant.OURS else None
    return ProgramRun(samples, start_s, share, held, report, _fault(report))


def _fault(report: dict[str, Any] | None) -> str | None:
    if report is None:
        return None
    mode = next(values for name, values in report["diagnostics"].items() if name.endswith(MODE_SUFFIX))
    return None if mode["mode"] == Mode.ARMED else str(mode["reason"])


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
    where = [bus.interface, bus.place(bus.plant_channel), str(rig.period_ns), str(place.conditions.plant_priority)]
    with (place.folder / "board.txt").open("wb") as errors:
        process = subprocess.Popen(  # noqa: S603 - compiled here, and no shell reads its words
            [str(rig.board), *where], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors
        )
    try:
        if process.stdout is None or process.stdout.readline() != b"ready\n":
            raise ConfigurationError(f"the plant of the bench does not start on {bus.plant_channel}")
        yield seen
        output, _ = process.communicate(timeout=_END_S)  # which closes its standard input, so that it ends
        seen.update(msgspec.json.decode(output, type=dict[str, int]))
    finally:
        process.kill()
        process.communicate()


class _Heartbeats:
    """Receives, as the guard would, the heartbeat with which a program first commands the motors."""

    def __init__(self, place: BenchSite) -> None:
        self._listener = HeartbeatListener(CanSettings(interface=place.bus.interface, channel=place.bus.channel))
        self._listener.open()

    def wait(self, process: subprocess.Popen[bytes], timeout_s: float) -> float:
        """When the first one came, monotonic, s."""
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s and process.poll() is None:
            if any(True for _ in self._listener.take_heartbeats()):
                return time.monotonic()
            time.sleep(0.001)
        return time.monotonic()

    def close(self) -> None:
        """Stop receiving; a sender then finds nobody, as where no guard runs."""
        self._listener.close()


def _ours(place: BenchSite, samples: Path, duration_s: float) -> Sequence[str]:
    bus = place.bus
    words = ["run", str(place.rig.robot), "--interface", bus.interface, "--channel", bus.channel, "--json"]
    words += ["--duration", str(duration_s), "--namespace", NAMESPACE, "--log", str(place.folder / "bench.mcap")]
    return [*_CHILD, str(os.getpid()), "segway_ecc.hil.bench.ours", str(samples), *words]


def _user(place: BenchSite, samples: Path, duration_s: float) -> Sequence[str]:
    bus, period_s = place.bus, place.rig.period_ns * 1e-9
    words = ["--model", str(place.rig.library), "--interface", bus.interface, "--channel", bus.channel]
    words += ["--period", str(period_s), "--duration", str(duration_s)]
    words += ["--namespace", NAMESPACE, "--guard", place.guard, "--samples", str(samples)]
    return [*_CHILD, str(os.getpid()), "segway_ecc.hil.bench.same_settings", *words]


def _c(place: BenchSite, samples: Path, duration_s: float) -> Sequence[str]:
    return _loop(place, samples, duration_s, place.bus.place(place.bus.channel))


def _bare(place: BenchSite, samples: Path, duration_s: float) -> Sequence[str]:
    return _loop(place, samples, duration_s, "-")


def _loop(place: BenchSite, samples: Path, duration_s: float, channel: str) -> Sequence[str]:
    period_ns = place.rig.period_ns
    cycles = round(duration_s * 1e9 / period_ns)
    numbers = (period_ns, cycles, place.conditions.priority)
    isolated = place.conditions.isolated
    pinned = ["taskset", "--cpu-list", ",".join(map(str, isolated))] if isolated else []
    return [*pinned, str(place.rig.loop), place.bus.interface, channel, place.guard, *map(str, numbers), str(samples)]


_COMMANDS: Final[dict[Contestant, Callable[[BenchSite, Path, float], Sequence[str]]]] = {
    Contestant.OURS: _ours,
    Contestant.USER: _user,
    Contestant.C: _c,
    Contestant.BARE: _bare,
}


def _ended(process: subprocess.Popen[bytes], who: Contestant) -> bytes:
    """What a program printed, once it has ended.

    Ours runs for a number of cycles, which is long where it loses deadlines: it is asked to stop when its time is up.
    """
    try:
        return process.communicate(timeout=_OVERTIME_S)[0]
    except subprocess.TimeoutExpired:
        process.terminate()
    try:
        return process.communicate(timeout=_END_S)[0]
    except subprocess.TimeoutExpired as error:
        raise ConfigurationError(f"the program '{who}' does not end") from error


@contextlib.contextmanager
def _process(command: Sequence[str], errors: int) -> Iterator[subprocess.Popen[bytes]]:
    """A program that has ended when the context is left, whatever happens."""
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, env=environment)  # noqa: S603 - our own programs, and no shell reads their words
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def _watch(process: subprocess.Popen[bytes], duration_s: float) -> tuple[float, Memory]:
    """The share of a core that a program and its children take while it runs, and the memory that they hold."""
    time.sleep(_SETTLE_S)
    pids = tree(process.pid)
    began_s, used_s = time.monotonic(), cpu_s(pids)
    time.sleep(max(duration_s - _SETTLE_S - _BEFORE_END_S, _SHORTEST_S))
    elapsed_s = time.monotonic() - began_s
    return (cpu_s(pids) - used_s) / elapsed_s, memory(pids)
