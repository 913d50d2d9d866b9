# SPDX-License-Identifier: MIT
"""Drives and sensors on one link, made into the robot's `Hardware`."""

import itertools
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.command_gate import CommandGate
from segway_ecc.firmware_io.devices import Drive, FrameKey, Sensor
from segway_ecc.firmware_io.drives.readings import DriveReading, StandbyListener, readings_of
from segway_ecc.firmware_io.errors import ArmingRefusedError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.firmware_io.links.joined_link import JoinedLink
from segway_ecc.firmware_io.links.link import Link, NowNs
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.sender_rate import SenderRate
from segway_ecc.firmware_io.switching import SWITCH_WITHIN_NS, Switching

_EVENTS_KEPT: Final = 16


class Assembly:
    """The drives and sensors of a robot; see `Hardware`.

    Every frame that has arrived is handed to the device that listens to it, so that each keeps the newest of each kind;
    frames that nobody listens to are somebody else's. Where the link is a redundant one and passes to its other line,
    the drives are switched off and on again through their own states, over that line.

    Attributes:
        switching: What passes between the lines of a redundant link; None where there is one line.
    """

    def __init__(
        self,
        link: Link,
        drives: Sequence[Drive],
        sensors: Sequence[Sensor] = (),
        now_ns: NowNs = time.monotonic_ns,
        *,
        gate: CommandGate | None = None,
    ) -> None:
        """Join devices that send over `link`; ValueError where two want the same frame or measure the same signal.

        Without a `gate` the robot is alone on its bus, and commands of any age are sent.
        """
        self._link = link
        self._drives = tuple(drives)
        self._devices: tuple[Sensor, ...] = (*drives, *sensors)
        self.signals: Mapping[str, str] = {}
        self._listeners: dict[tuple[int, bool], Sensor] = {}
        for device in self._devices:
            twice = self.signals.keys() & device.signals.keys()
            if twice:
                raise ValueError(f"{device.name} measures {', '.join(sorted(twice))}, which another device measures")
            self.signals = {**self.signals, **device.signals}
            for key in map(FrameKey._make, device.listens_to):
                if key in self._listeners:
                    other = self._listeners[key].name
                    raise ValueError(f"{other} and {device.name} both listen to frame 0x{key.arbitration_id:X}")
                self._listeners[key] = device
        self._rates = {
            (key.arbitration_id, key.is_extended): SenderRate(round(period_s * 1e9))
            for device in self._devices
            for key, period_s in device.periods_s.items()
        }
        self._standby_listeners = {drive.name: drive for drive in drives if isinstance(drive, StandbyListener)}
        self._now_ns = now_ns
        self._judged_ns: int | None = None
        self.commands: Mapping[str, str] = {k: v for d in drives for k, v in d.commands.items()}
        self.limits: Sequence[float] = tuple(limit for d in drives for limit in d.limits)
        ends = list(itertools.accumulate(len(drive.commands) for drive in drives))
        self._parts = [(drive, slice(end - len(drive.commands), end)) for drive, end in zip(drives, ends, strict=True)]
        self._received_ns: dict[str, int] = {}
        self._armed = False
        self._gate = CommandGate(drives, None, None, now_ns) if gate is None else gate
        self._events: deque[str] = deque(maxlen=_EVENTS_KEPT)
        main = link.main if isinstance(link, JoinedLink) else link
        self.switching = Switching(main, now_ns) if isinstance(main, RedundantLink) else None

    def open(self) -> None:
        """Claim the bus, open the link and start every device; see `Hardware.open`.

        Raises:
            BusOwnedError: Another controller owns the bus, on this machine or by the frames on it; nothing was sent.
        """
        self._gate.claim()
        self._link.open()
        self._gate.look_for_another(self._link)
        for device in self._devices:
            device.start()

    def exchange(self, commands: Sequence[float] | None) -> Sensors:
        """Hand out what has arrived, send the commands, return the newest snapshot; see `Hardware.exchange`."""
        for frame in self._link.receive():
            key = (frame.arbitration_id, frame.is_extended)
            device = self._listeners.get(key)
            if device is None:
                self._gate.strangers.take_frame(frame)
                continue
            rate = self._rates.get(key)
            if rate is not None:
                rate.take_frame(frame)
            if device.take_frame(frame) and self.switching is not None:
                self._received_ns[device.name] = frame.received_ns
        self._look_for_other_senders()
        if self.switching is not None:
            self._switch(self.switching)
        if commands is not None:
            if self._gate.passes(self._events, is_armed=self._armed):
                for drive, part in self._parts:
                    drive.command(commands[part])
            else:
                for drive in self._drives:
                    drive.disable()
        return self._snapshot()

    def arm(self) -> None:
        """Begin to switch the motors on; see `Hardware.arm`."""
        reasons = self.arming_failures()
        if reasons:
            raise ArmingRefusedError(reasons)
        self._armed = True
        self._gate.begin()
        for drive in self._drives:
            drive.enable()

    def arming_failures(self) -> Sequence[str]:
        """The pre-arm checks of drives, sensors and bus that fail; see `Hardware.arming_failures`."""
        reasons = [reason for device in self._devices for reason in device.arming_failures()]
        return [*reasons, *self._gate.arming_failures()]

    def disarm(self) -> None:
        """Send zero with the motors off."""
        self._armed = False
        self._gate.end()
        for drive in self._drives:
            drive.disable()

    def close(self) -> None:
        """Disarm, close the link and give the bus back."""
        self.disarm()
        self._link.close()
        self._gate.close()

    @property
    def health(self) -> Mapping[str, str]:
        """The state of the link and of every device."""
        health = {"link": self._link.description}
        health |= {f"link.{name}": text for name, text in self._link.health.items()}
        for device in self._devices:
            health |= {f"{device.name}.{name}": text for name, text in device.health.items()}
        if self.switching is not None:
            health |= self.switching.health
        return {**health, **self._gate.health}

    @property
    def readings(self) -> Sequence[DriveReading]:
        """What the drives have read back of their settings; see `ReportsSettings`."""
        return [reading for drive in self._drives for reading in readings_of(drive)]

    def _look_for_other_senders(self) -> None:
        """Note what brought more than its device sends; a serial line has one sender, with a rate of its own."""
        now_ns, judged_ns = self._now_ns(), self._judged_ns
        is_serial = self.switching is not None and self.switching.link.is_on_fallback
        self._judged_ns = None if is_serial else now_ns
        for key, rate in self._rates.items():
            if judged_ns is None or is_serial:
                rate.begin()
            elif rate.finds_another(now_ns - judged_ns):
                self._gate.strangers.note_another_sender(FrameKey._make(key), rate.period_ns)

    def _switch(self, switching: Switching) -> None:
        # Which drives answer on the standby line; sensors that are only on that line are read there too.
        for frame in switching.link.aside:
            device = self._listeners.get((frame.arbitration_id, frame.is_extended))
            if device in self._drives:
                switching.link.note_standby()
                listener = self._standby_listeners.get(device.name)
                if listener is not None:
                    listener.take_standby_frame(frame)
            elif device is not None:
                device.take_frame(frame)
        received_ns = [self._received_ns.get(drive.name) for drive in self._drives]
        event = switching.judge(received_ns, is_armed=self._armed)
        if event is not None:
            self._events.append(event)
            for drive in self._drives:
                drive.disable()
                if self._armed:
                    drive.enable()
        ready = self._armed and all(drive.is_enabled for drive in self._drives)
        self._events.extend(switching.measure(received_ns, is_ready=ready))

    def _snapshot(self) -> Sensors:
        values: list[float] = []
        ages: list[float] = []
        valid: list[bool] = []
        unseen: tuple[str, ...] = ()
        switching = self.switching
        for device in self._devices:
            readings = device.read()
            values += readings.values
            ages += readings.ages
            unseen += readings.unseen
            self._events.extend(readings.events)
            # The robot must not fall for a change of lines: while they change, slightly old values are still valid. A
            # drive that has fallen silent on one line, while the other is good, is about to answer there.
            if switching is not None and (
                switching.is_under_way or (switching.link.standby_is_good and device in self._drives)
            ):
                valid += [
                    v or age * 1e9 <= SWITCH_WITHIN_NS for v, age in zip(readings.valid, readings.ages, strict=True)
                ]
            else:
                valid += readings.valid
        faults = self._gate.faults
        ready, off = True, not self._armed
        for drive in self._drives:
            faults += drive.faults()
            ready = ready and drive.is_enabled
            off = off and drive.is_off
        events = tuple(self._events)
        self._events.clear()
        return Sensors(tuple(values), tuple(ages), tuple(valid), faults, ready, events, off, unseen)
