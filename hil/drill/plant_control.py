# SPDX-License-Identifier: MIT
"""A running plant: its faults, requested line by line, and what its motors gave, tick by tick.

Each line is answered with when it took effect.

    mute                the drives receive, and what they send is lost
    cut                 nothing passes on the bus either way; a serial line to fall back on goes on
    freeze WHAT         measured values that begin with WHAT, such as left, imu or left.velocity, stay as they are
    add WHAT AMOUNT     measured values that begin with WHAT are too large by AMOUNT, in their unit
    heal                undo all of the above
    write NAME VALUE    write a state or parameter of the plant
    driven              nothing; the answer ends with when a motor was last driven, monotonic, ns, or `never`

An answer is the monotonic time, ns, and the line; or the time, `refused:` and why.
"""

import contextlib
import csv
import itertools
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Final, Literal, NamedTuple

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import Trace
from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Model

MAX_LINE_BYTES: Final = 200
_TRUTH: Final = "truth."
_STAMPS: Final = ("monotonic_ns", "wall_ns")
NOTHING: Final = 1e-4
"""N m or V that drive nothing: a current dies away exponentially, and is never quite zero. The cart needs 0.01 N m."""


class DisturbedLink(LinkFront):
    """The drives' end of a bus, which loses frames on request; a cut cable is not seen from this end. See `Link`.

    The disturbance is None, or `mute`: what the drives send is lost; or `cut`: nothing passes either way.
    """

    disturbance: Literal["mute", "cut"] | None = None

    def send(self, frame: Frame) -> bool:
        """Send, or lose the frame."""
        return self.behind.send(frame) if self.disturbance is None else True

    def receive(self) -> list[Frame]:
        """Receive, or lose what has arrived."""
        try:
            frames = self.behind.receive()
        except LinkLostError:
            if self.disturbance == "cut":
                return []
            raise
        return [] if self.disturbance == "cut" else frames


class DisturbedPort:
    """The drives' end of a serial line in place of a bus, disturbed as that would be; see `Port`."""

    def __init__(self, behind: Port, link: DisturbedLink) -> None:
        """Lose bytes of the port behind, whenever `link` loses frames."""
        self._behind = behind
        self._link = link

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived; what arrives at a cut cable is gone."""
        if self._link.disturbance == "cut":
            self._behind.read(self._behind.in_waiting)
        return self._behind.in_waiting

    def read(self, size: int, /) -> bytes:
        """Take up to `size` bytes."""
        return self._behind.read(size)

    def write(self, data: bytes, /) -> int | None:
        """Queue bytes, or lose them."""
        return self._behind.write(data) if self._link.disturbance is None else len(data)

    def close(self) -> None:
        """Close the port behind."""
        self._behind.close()


class PlantControl:
    """Disturbs a plant and its bus by lines of text."""

    def __init__(self, robot: SimulatedRobot, link: DisturbedLink, plant: Model, clock: Clock) -> None:
        """Disturb a robot on its link."""
        self._robot = robot
        self._link = link
        self._plant = plant
        self._clock = clock
        self._driven_ns: int | None = None

    def note_torque(self, monotonic_ns: int, _wall_ns: int, values: Sequence[float]) -> None:
        """See what the motors give in a tick; see `Trace`."""
        if drives(values):
            self._driven_ns = monotonic_ns

    def obey(self, line: str) -> str:
        """Do what a line requests; return the answer."""
        refused = None
        match line.split():
            case ["mute" | "cut" as word]:
                self._link.disturbance = word
            case ["freeze", what]:
                refused = self._freeze(what)
            case ["add", what, amount]:
                refused = self._add(what, amount)
            case ["heal"]:
                self._link.disturbance = None
                self._robot.stuck.clear()
                self._robot.errors.clear()
            case ["write", name, value]:
                refused = self._write(name, value)
            case ["driven"]:
                line = f"driven {'never' if self._driven_ns is None else self._driven_ns}"
            case _:
                refused = (
                    "it must be mute, cut, freeze left|right|imu|SIGNAL, add imu|SIGNAL AMOUNT, heal, driven, "
                    "or write NAME VALUE of the plant"
                )
        return f"{self._clock.now_ns()} {line if refused is None else f'refused: {refused}'}"

    def _freeze(self, what: str) -> str | None:
        now = dict(zip(self._robot.output_names, self._robot.outputs, strict=True))
        chosen = self._measured(what)
        self._robot.stuck.update({name: now[name] for name in chosen})
        return None if chosen else self._nothing(what)

    def _add(self, what: str, text: str) -> str | None:
        try:
            amount = float(text)
        except ValueError:
            return f"'{text}' is not a number"
        chosen = self._measured(what)
        self._robot.errors.update(dict.fromkeys(chosen, amount))
        return None if chosen else self._nothing(what)

    def _measured(self, what: str) -> list[str]:
        names = (name for name in self._robot.output_names if not name.startswith(_TRUTH))
        return [name for name in names if not what or name == what or name.startswith(f"{what}.")]

    def _nothing(self, what: str) -> str:
        return f"nothing measured begins with '{what}'; there is {', '.join(self._measured(''))}"

    def _write(self, name: str, text: str) -> str | None:
        try:
            self._plant.write(name, float(text))
        except ValueError:
            return f"'{text}' is not a number"
        except ModelError as error:
            return str(error)
        return None


def drives(torques: Sequence[float]) -> bool:
    """Whether motors that are given so much, N m or V, drive anything."""
    return any(abs(torque) > NOTHING for torque in torques)


class LineReader:
    """Reads lines from a descriptor and writes the answers to another, without ever waiting for either."""

    def __init__(self, source: int, sink: int, obey: Callable[[str], str], on_end: Callable[[], None]) -> None:
        """Obey what arrives on `source`; answer on `sink`; call `on_end` once when `source` has ended."""
        self._source = source
        self._sink = sink
        self._obey = obey
        self._on_end = on_end
        self._rest = b""
        self._has_ended = False
        os.set_blocking(source, False)
        os.set_blocking(sink, False)

    def __call__(self) -> None:
        """Answer the lines that have arrived."""
        if self._has_ended:
            return
        try:
            read = os.read(self._source, 4096)
        except BlockingIOError:
            return
        except OSError:
            read = b""
        if not read:
            self._has_ended = True
            self._on_end()
            return
        *lines, self._rest = (self._rest + read).split(b"\n")
        for line in lines:
            is_line = len(line) <= MAX_LINE_BYTES and line.isascii()
            answer = self._obey(line.decode() if is_line else "?")
            with contextlib.suppress(OSError):  # whoever does not read the answers does without
                os.write(self._sink, answer.encode() + b"\n")
        # What is longer than any line can be is no line: its end is refused as one.
        self._rest = self._rest[: MAX_LINE_BYTES + 1]

    def close(self) -> None:
        """Leave the descriptors as they are expected to be: a terminal's are shared with the shell."""
        os.set_blocking(self._source, True)
        os.set_blocking(self._sink, True)


class Tick(NamedTuple):
    """One tick of the drives' firmware: when it began (monotonic, ns), and whether it left any motor driven."""

    monotonic_ns: int
    is_driven: bool


class Torque(NamedTuple):
    """What became of the torque after a fault.

    Attributes:
        last_s: From the fault to the last tick with torque, s; 0 where there was none after it.
        zero_s: From the fault to the first tick of the torque-free end, s; None where torque went on to the end.
        gap_s: Longest time without torque between two ticks that had it, s.
    """

    last_s: float
    zero_s: float | None
    gap_s: float


def trace_writer(file: IO[str], inputs: Sequence[str]) -> Trace:
    """Write each tick as a line of CSV; `file` is to be line-buffered where somebody looks on."""
    file.write(",".join([*_STAMPS, *inputs]) + "\n")

    def write(monotonic_ns: int, wall_ns: int, values: Sequence[float]) -> None:
        file.write(",".join([str(monotonic_ns), str(wall_ns), *map(repr, values)]) + "\n")

    return write


def read_trace(path: Path) -> list[Tick]:
    """The ticks so far; a last line that is not whole yet is left out."""
    if not path.exists():
        return []
    text = path.read_text(encoding="ascii")
    rows = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))[1:]
    return [Tick(int(row[0]), drives([float(value) for value in row[len(_STAMPS) :]])) for row in rows]


def driven_since_ns(ticks: Sequence[Tick]) -> int | None:
    """When the motors were driven first; None where they never were."""
    return next((tick.monotonic_ns for tick in ticks if tick.is_driven), None)


def torque_after(ticks: Sequence[Tick], fault_ns: int, until_ns: int) -> Torque:
    """What became of the torque between a fault and the end of looking."""
    seen = [tick for tick in ticks if fault_ns < tick.monotonic_ns <= until_ns]
    driven = [index for index, tick in enumerate(seen) if tick.is_driven]
    after = driven[-1] + 1 if driven else 0
    zero_ns = seen[after].monotonic_ns if after < len(seen) else None
    stamps = [fault_ns, *(seen[index].monotonic_ns for index in driven)]
    # A gap: ticks without torque lie before a driven one.
    gaps = [
        later - earlier
        for (earlier, later), (before, place) in zip(
            itertools.pairwise(stamps), itertools.pairwise([-1, *driven]), strict=True
        )
        if place - before > 1
    ]
    return Torque(
        last_s=(stamps[-1] - fault_ns) * 1e-9,
        zero_s=None if zero_ns is None else (zero_ns - fault_ns) * 1e-9,
        gap_s=max(gaps, default=0) * 1e-9,
    )
