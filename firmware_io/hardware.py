# SPDX-License-Identifier: MIT
"""The interface between the robot's hardware and what controls it."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from segway_ecc.firmware_io.value import Value


class Sensors(Value, frozen=True):
    """One consistent snapshot of everything the hardware measured.

    The three sequences are in the order of `Hardware.signals`.

    Attributes:
        values: Newest value of each signal, SI; zero where none has arrived yet.
        ages: Time since each value was received, s; infinite where none has arrived yet.
        valid: Whether each value is fresh enough to be used.
        faults: What the drives report against themselves; empty while all is well.
        ready: Whether every motor follows commands; False while the drives are off or pass through their states.
        events: What happened to the links, or devices reported of themselves, since the last snapshot, for people.
        off: Whether every drive reports that its motors are off; False where one reports otherwise or nothing, and
            while they are asked to be on.
        unseen: The signals that a drive measures only once its motors are on: not valid before, of infinite age.
    """

    values: tuple[float, ...] = ()
    ages: tuple[float, ...] = ()
    valid: tuple[bool, ...] = ()
    faults: tuple[str, ...] = ()
    ready: bool = True
    events: tuple[str, ...] = ()
    off: bool = True
    unseen: tuple[str, ...] = ()


class Diagnosed(Protocol):
    """What reports on itself: the robot's hardware, a drive, a sensor."""

    def arming_failures(self) -> Sequence[str]:
        """The pre-arm checks that fail, each with the remedy; empty where the robot may be armed.

        May be asked at any time: while the motors are on it names nothing that follows from that.
        """

    @property
    def health(self) -> Mapping[str, str]:
        """Its state as text, for diagnostics."""


class Hardware(Diagnosed, Protocol):
    """Motors and sensors. No method blocks, except `open`.

    Five methods operate it; the two of `Diagnosed` are apart, since drives and sensors report in the same way.

    Attributes:
        signals: Names of the values in `Sensors`, such as `left.velocity`, with their units.
        commands: Names of the values that `exchange` takes, such as `left.voltage`, with their units.
        limits: Largest magnitude of each command, in the order of `commands`.
    """

    signals: Mapping[str, str]
    commands: Mapping[str, str]
    limits: Sequence[float]

    def open(self) -> None:
        """Open the links and send the first zero command.

        Raises:
            BusNotFoundError: A link is not there.
        """

    def exchange(self, commands: Sequence[float] | None) -> Sensors:
        """Send `commands` (None sends nothing, for a second exchange in a cycle) and return the newest snapshot."""

    def arm(self) -> None:
        """Begin to let commands reach the motors; they do once `Sensors.ready` is True.

        Raises:
            ArmingRefusedError: The drive is not fit; the reasons state why.
        """

    def disarm(self) -> None:
        """Send zero and switch the motors off; may be called at any time."""

    def close(self) -> None:
        """Disarm and close the links."""


class NoHardware:
    """The hardware of a robot that is all model."""

    signals: Mapping[str, str] = {}
    commands: Mapping[str, str] = {}
    limits: Sequence[float] = ()
    _nothing = Sensors()

    def open(self) -> None:
        """Do nothing."""

    def exchange(self, commands: Sequence[float] | None) -> Sensors:
        """Return the empty snapshot."""
        del commands
        return self._nothing

    def arm(self) -> None:
        """Do nothing."""

    def arming_failures(self) -> Sequence[str]:
        """Nothing is in the way of what has no motors."""
        return ()

    def disarm(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    @property
    def health(self) -> Mapping[str, str]:
        """Nothing to report."""
        return {}
