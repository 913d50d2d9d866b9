"""The errors of the hardware layer."""

from collections.abc import Sequence
from typing import ClassVar


class HardwareError(Exception):
    """Root of the hardware layer's errors. The text says what happened, where, and what to do."""

    exit_code: ClassVar[int] = 4


class BusNotFoundError(HardwareError):
    """The bus that the configuration names is not there or cannot be opened."""


class LinkLostError(HardwareError):
    """An open link stopped working."""


class ArmingRefusedError(HardwareError):
    """The drive is not fit to be armed.

    Attributes:
        reasons: Each with how to mend it.
    """

    def __init__(self, reasons: Sequence[str]) -> None:
        """Keep the reasons and join them into the text."""
        self.reasons = tuple(reasons)
        super().__init__("; ".join(reasons))
