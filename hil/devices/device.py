# SPDX-License-Identifier: MIT
"""What stands at the other end of a link in simulation: a device, and the plant behind it.

Of a plant a rig asks several steps at once, where nobody looks between them.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, Protocol, runtime_checkable

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.node.model.model import Model

SUPPLY_VOLTAGE: Final = 36.0
"""What drives measure of a supply that the plant does not have, V: above what any of them is set to give."""
_PLANT_SUPPLY: Final = "truth.supply_voltage"
Advance = Callable[[Sequence[float], int], Sequence[float]]
"""(inputs, number of steps) -> the outputs after the last of them."""


def supply_voltage(outputs: Mapping[str, float]) -> float:
    """What drives measure of the supply, V, among the plant's newest outputs by name."""
    return outputs.get(_PLANT_SUPPLY, SUPPLY_VOLTAGE)


class Device(Protocol):
    """The firmware of a drive or sensor, one pass of its loop at a time. It sends over the links that it was given.

    Its motors drive the plant's `inputs`, such as `left.torque`; it measures those outputs that it `needs`, such as
    `left.angle`.
    """

    inputs: Sequence[str]
    needs: Sequence[str]

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Take what arrived since the last pass, run the watchdog, and return what the motors give the plant.

        Args:
            frames: All frames on the bus, oldest first; other devices' are among them.
            now_ns: The time, on the clock that stamps the frames.
            outputs: The plant's newest outputs by name.
        """

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send the telemetry that is due."""

    @property
    def refused_frames(self) -> int:
        """Frames meant for it that it refused since power-on."""


@runtime_checkable
class Sleeping(Protocol):
    """A device that needs no pass before `next_ns`, unless a frame arrives: it gives what it gave, and sends nothing.

    That is of its newest pass, which may be asked for at any time; what is done to it from outside may make it earlier.
    Minus infinity is for a device that needs every pass. What it measures of an IMU it measures when it is due, in
    `send_telemetry`.
    """

    @property
    def next_ns(self) -> float:
        """When it is to have its next pass, on the clock that stamps the frames, ns."""


@runtime_checkable
class Unseen(Protocol):
    """A plant that can make steps at less cost where no device looks at its sensors after them."""

    def advance_unseen(self, u: Sequence[float], steps: int) -> Sequence[float]:
        """As `Advancing.advance`; of the outputs, what costs much may be older. What comes after is the same."""


@runtime_checkable
class Advancing(Protocol):
    """A plant that can make several steps at once, at less cost."""

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        """Make one or more steps with the same inputs; returns the outputs after the last one."""


def advance_of(plant: Model) -> Advance:
    """The plant's own way of making several steps, or one after the other."""
    if isinstance(plant, Advancing):
        return plant.advance

    def advance(u: Sequence[float], steps: int) -> Sequence[float]:
        for _ in range(steps - 1):
            plant.step(u)
        return plant.step(u)

    return advance


def unseen_advance_of(plant: Model) -> Advance:
    """The plant's own way of making several steps that nobody looks at, or that of those that are."""
    return plant.advance_unseen if isinstance(plant, Unseen) else advance_of(plant)
