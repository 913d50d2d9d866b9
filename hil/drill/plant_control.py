# SPDX-License-Identifier: MIT
"""Faults of a running plant, requested line by line; each line is answered with when it took effect.

    mute                the drives receive, and what they send is lost
    cut                 nothing passes on the bus either way; a serial line goes on
    freeze WHAT         measured values that begin with WHAT, such as left, imu or left.velocity, stay as they are
    heal                undo all of the above
    write NAME VALUE    write a state or parameter of the plant

An answer is the monotonic time, ns, and the line; or the time, `refused:` and why.
"""

import contextlib
import os
from collections.abc import Callable
from typing import Final, Literal

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Model

MAX_LINE_BYTES: Final = 200
_TRUTH: Final = "truth."


class DisturbedLink(LinkFront):
    """The drives' end of a bus, which loses frames on request; a cut cable is not seen from this end. See `Link`.

    Attributes:
        disturbance: `mute`: the drives receive, and what they send is lost; `cut`: nothing passes either way; None
            while all is well.
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


class PlantControl:
    """Disturbs a plant and its bus by lines of text."""

    def __init__(self, robot: SimulatedRobot, link: DisturbedLink, plant: Model, clock: Clock) -> None:
        """Disturb a robot on its link."""
        self._robot = robot
        self._link = link
        self._plant = plant
        self._clock = clock

    def obey(self, line: str) -> str:
        """Do what a line requests; return the answer."""
        refused = None
        match line.split():
            case ["mute" | "cut" as word]:
                self._link.disturbance = word
            case ["freeze", what]:
                refused = self._freeze(what)
            case ["heal"]:
                self._link.disturbance = None
                self._robot.stuck.clear()
            case ["write", name, value]:
                refused = self._write(name, value)
            case _:
                refused = "it must be mute, cut, freeze left|right|imu|SIGNAL, heal, or write NAME VALUE of the plant"
        return f"{self._clock.now_ns()} {line if refused is None else f'refused: {refused}'}"

    def _freeze(self, what: str) -> str | None:
        now = dict(zip(self._robot.output_names, self._robot.outputs, strict=True))
        measured = {name: value for name, value in now.items() if not name.startswith(_TRUTH)}
        chosen = {name: value for name, value in measured.items() if name == what or name.startswith(f"{what}.")}
        self._robot.stuck.update(chosen)
        return None if chosen else f"nothing measured begins with '{what}'; there is {', '.join(measured)}"

    def _write(self, name: str, text: str) -> str | None:
        try:
            self._plant.write(name, float(text))
        except ValueError:
            return f"'{text}' is not a number"
        except ModelError as error:
            return str(error)
        return None


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
