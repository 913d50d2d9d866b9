# SPDX-License-Identifier: MIT
"""CiA 402 drives, one an axis, as one `Drive`: they share SYNC, the host's heartbeat and their enabling."""

import importlib.util
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import chain
from typing import Final

from segway_ecc.firmware_io.devices import SUPPLY_VOLTAGE, FrameKey, Readings, with_one_more
from segway_ecc.firmware_io.drives.cia402.frames import (
    Controlword,
    NmtCommand,
    NmtState,
    Service,
    nmt_frame,
    pack_heartbeat,
)
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.cia402.wheel import Cia402Wheel
from segway_ecc.firmware_io.drives.enabling import Phase, PhasedDrive, wheel_signals
from segway_ecc.firmware_io.drives.readings import DriveReading
from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.links.link import Frame, Link

_SYNC: Final = Frame(Service.SYNC, b"")


class MissingLibraryError(HardwareError):
    """A library that only some robots need is not installed."""


class Cia402Drives(PhasedDrive):
    """The drives of all axes; see `Drive`.

    In every cycle goes out, in this order: the host's heartbeat, which feeds the drives' watchdogs, a command to each
    drive, and one SYNC, upon which all drives sample and send their state at the same time.
    """

    name = "drives"

    def __init__(
        self,
        link: Link,
        settings: Cia402Settings,
        loop_period_s: float,
        now_ns: Callable[[], int],
        sleep_until_ns: Callable[[int], None],
    ) -> None:
        """Drive the nodes of `settings` at the other end of `link`; `start` waits on `sleep_until_ns`.

        MissingLibraryError without the canopen library.
        """
        super().__init__(now_ns)
        if importlib.util.find_spec("canopen") is None:
            raise MissingLibraryError(
                "hardware of type cia402 needs the canopen library, which is not installed: "
                "pip install 'segway-ecc[canopen]'"
            )
        measured = [wheel_signals(name) for name in settings.axes]
        self.signals: Mapping[str, str] = dict(chain(*(each.items() for each in measured), ((SUPPLY_VOLTAGE, "V"),)))
        self.commands: Mapping[str, str] = {f"{name}.torque": "N m" for name in settings.axes}
        self.limits: Sequence[float] = tuple(wheel.max_torque for wheel in settings.axes.values())
        self._link = link
        self._settings = settings
        self._cycle_us = round(loop_period_s * 1e6)
        self._sleep_until_ns = sleep_until_ns
        self._wheels = tuple(
            Cia402Wheel(name, wheel, loop_period_s, now_ns, settings.ride_through_s)
            for name, wheel in settings.axes.items()
        )
        self._listeners = {identifier: wheel for wheel in self._wheels for identifier in wheel.listens_to}
        self.listens_to: Collection[FrameKey] = frozenset(map(FrameKey, self._listeners))
        self.periods_s: Mapping[FrameKey, float] = {
            FrameKey(service + wheel.node_id): loop_period_s
            for wheel in self._wheels
            for service in (Service.TPDO1, Service.TPDO2)
        }
        ours = [int(Service.NMT), int(Service.SYNC), Service.HEARTBEAT + settings.host_node_id]
        for wheel in settings.axes.values():
            ours += [Service.RPDO1 + wheel.node_id, Service.SDO_REQUEST + wheel.node_id]
        self.commanded_by: Collection[FrameKey] = frozenset(map(FrameKey, ours))
        self._zeros = (0.0,) * len(self._wheels)
        self._heartbeat = Frame(Service.HEARTBEAT + settings.host_node_id, pack_heartbeat(NmtState.OPERATIONAL))

    def start(self) -> None:
        """Reset all drives, set them up and start their communication; blocks, up to some seconds.

        A drive that cannot be set up speaks against arming from then on.
        """
        from segway_ecc.firmware_io.drives.cia402 import network, setup  # noqa: PLC0415 - needs an optional library

        bus = network.LinkNetwork(self._link, self._now_ns, self._sleep_until_ns)
        setup.commission(bus, self._wheels, self._settings, self._cycle_us)

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the drives' frames; see `Sensor.take_frame`."""
        wheel = None if frame.is_extended else self._listeners.get(frame.arbitration_id)
        return wheel is not None and wheel.take_frame(frame)

    def read(self) -> Readings:
        """The wheels' angles, velocities and torques, and the supply's voltage as the first drive measures it."""
        values: tuple[float, ...] = ()
        ages: tuple[float, ...] = ()
        valid: tuple[bool, ...] = ()
        for wheel in self._wheels:
            of_wheel = wheel.read()
            values += of_wheel.values
            ages += of_wheel.ages
            valid += of_wheel.valid
        readings = Readings(values, ages, valid)
        return with_one_more(readings, self._wheels[0].supply_voltage, self._wheels[0].supply_age)

    def arming_failures(self) -> list[str]:
        """A drive that is not there, not set up with its watchdog on, or not operational."""
        return [reason for wheel in self._wheels for reason in wheel.arming_failures(self._link.description)]

    @property
    def is_off(self) -> bool:
        """Whether all drives report states in which their motors have no torque."""
        return all(wheel.confirms_disable(self._enabling) for wheel in self._wheels)

    def enable(self) -> None:
        """Take all drives through their states from the next cycle on, one step a cycle."""
        for wheel in self._wheels:
            wheel.begin()
        self._enabling.begin(self._now_ns())

    def command(self, commands: Sequence[float]) -> None:
        """Send this cycle's frames, with the wheels' torques, N m, where all drives follow; else with zero."""
        self._link.send(self._heartbeat)
        follow = all(wheel.follows for wheel in self._wheels)
        if follow:
            self._enabling.confirm()
        phase = self._enabling.phase
        # One drive that no longer follows must not leave the others turning the robot.
        torques = commands if phase is Phase.ENABLED and follow else self._zeros
        for wheel, torque in zip(self._wheels, torques, strict=True):
            controlword = Controlword.DISABLE_VOLTAGE
            if phase is Phase.ENABLING:
                controlword = wheel.next_controlword()
            elif phase is Phase.ENABLED and wheel.follows:
                controlword = Controlword.ENABLE_OPERATION
            self._link.send(wheel.pack(controlword, torque))
        self._link.send(_SYNC)
        if phase is Phase.OFF:
            self._restore()

    def disable(self) -> None:
        """Send zero and take the voltage from all motors."""
        self._enabling.end(self._now_ns())
        for wheel in self._wheels:
            self._link.send(wheel.pack(Controlword.DISABLE_VOLTAGE))

    def faults(self) -> tuple[str, ...]:
        """A drive that reports an error, has restarted, fallen silent, does not enable, or has left its motor."""
        if self._enabling.phase is Phase.OFF:
            return ()
        faults = tuple(fault for wheel in self._wheels if (fault := wheel.fault()) is not None)
        if self._enabling.is_overdue(self._now_ns()):
            states = (f"the {wheel.name} drive is {wheel.state or 'unknown'}" for wheel in self._wheels)
            return (*faults, f"the drives do not enable their motors: {', '.join(states)}")
        if self.is_enabled:
            lost = (f"the {w.name} drive left its motor: {w.state or 'unknown'}" for w in self._wheels if not w.follows)
            return (*faults, *lost)
        return faults

    @property
    def readings(self) -> Sequence[DriveReading]:
        """The rated torques that were read while the drives were set up; see `ReportsSettings`."""
        return [reading for wheel in self._wheels for reading in wheel.readings]

    @property
    def health(self) -> Mapping[str, str]:
        """What each drive reports, and what was refused of it."""
        return {f"{wheel.name}.{name}": text for wheel in self._wheels for name, text in wheel.health.items()}

    def _restore(self) -> None:
        """Set up again a drive that has restarted, a request a cycle, and start one whose communication waits."""
        for wheel in self._wheels:
            request = wheel.restoring.next_request()
            if request is not None:
                self._link.send(Frame(Service.SDO_REQUEST + wheel.node_id, request))
            if wheel.needs_start and wheel.trouble is None and not wheel.has_restarted:
                self._link.send(nmt_frame(NmtCommand.START, wheel.node_id))
                wheel.needs_start = False
