# SPDX-License-Identifier: MIT
"""The root of all our errors, and the errors of the hardware layer."""

from collections.abc import Sequence
from typing import ClassVar


class SegwayEccError(Exception):
    """Root of our errors. The text states what happened, where, and what to do; a command ends with its exit code."""

    exit_code: ClassVar[int] = 1

    def __str__(self) -> str:
        """The text in one line: what a name from outside would end or overwrite it with is shown as an escape."""
        text = super().__str__()
        return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class HardwareError(SegwayEccError):
    """Root of the hardware layer's errors."""

    exit_code = 4


class BusNotFoundError(HardwareError):
    """The bus that the configuration names is not there or cannot be opened."""


class LinkLostError(HardwareError):
    """An open link stopped working."""


class ArmingRefusedError(HardwareError):
    """The drive is not fit to be armed, for `reasons`, each with the remedy."""

    def __init__(self, reasons: Sequence[str]) -> None:
        """Keep the reasons and join them into the text."""
        self.reasons = tuple(reasons)
        super().__init__("; ".join(reasons))


class PluginError(HardwareError):
    """A drive family, an IMU or a simulated device is not installed, or cannot be imported or used."""
