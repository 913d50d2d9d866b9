# SPDX-License-Identifier: MIT
"""What stands at the other end of a link in simulation."""

from collections.abc import Mapping, Sequence
from typing import Final, Protocol

from segway_ecc.firmware_io.links.link import Frame

SUPPLY_VOLTAGE: Final = 36.0
"""What drives measure of a supply that the plant does not have, V: above what any of them is set to give."""
_PLANT_SUPPLY: Final = "truth.supply_voltage"


def supply_voltage(outputs: Mapping[str, float]) -> float:
    """What drives measure of the supply, V, among the plant's newest outputs by name."""
    return outputs.get(_PLANT_SUPPLY, SUPPLY_VOLTAGE)


class Device(Protocol):
    """The firmware of a drive or sensor, one pass of its loop at a time. It sends over the links that it was given.

    Attributes:
        inputs: The plant's inputs that its motors drive, such as `left.torque`.
        needs: The plant's outputs that it measures, such as `left.angle`.
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
