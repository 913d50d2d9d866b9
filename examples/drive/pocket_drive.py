# SPDX-License-Identifier: MIT
"""A drive family of your own: small motor controllers on one CAN bus, one for each axis.

Each takes 0x100 + its node (torque in mN m, int16; whether it is to be on; checksum), and sends 0x180 + its node every
10 ms (angle in 0.1 mrad, int32; velocity in 0.01 rad/s, int16; state; checksum). Without a command for 40 ms it
switches its motor off by itself.
"""

import struct

from segway_ecc.drives import (
    BusSettings,
    DriveFamily,
    DriveWatchdog,
    Frame,
    FrameKey,
    Freshness,
    Meaning,
    Observation,
    Phase,
    PhasedDrive,
    Readings,
    WheelSettings,
    stale_after_ns,
)

COMMAND, STATUS = 0x100, 0x180
OFF, ON, TIMED_OUT = range(3)
STATUS_PERIOD_S = 0.01
WATCHDOG_S = 0.04
_COMMAND, _STATUS = struct.Struct("<hB"), struct.Struct("<ihB")


class PocketWheel(WheelSettings, frozen=True, kw_only=True):
    """One controller with its motor."""

    node: int


class PocketSettings(BusSettings, frozen=True, kw_only=True, tag="pocket"):
    """What a robot file has under `hardware`, with `type: pocket`."""

    axes: dict[str, PocketWheel]

    def __post_init__(self):
        """Refuse two controllers of one node."""
        if len({wheel.node for wheel in self.axes.values()}) < len(self.axes):
            raise ValueError("two axes have the same node")


def with_checksum(data):
    """The data, and the byte that makes their sum 0xFF."""
    return data + bytes([0xFF - sum(data) % 256])


def checked(frame, size):
    """The data without their checksum; None where length or checksum is wrong."""
    data = frame.data
    return data[:-1] if not frame.is_remote and len(data) == size + 1 and sum(data) % 256 == 0xFF else None


def command_frame(node, torque_nm, *, on):
    """The frame that commands a torque."""
    raw = min(max(round(torque_nm * 1e3), -0x8000), 0x7FFF)
    return Frame(COMMAND + node, with_checksum(_COMMAND.pack(raw, on)))


def read_command(frame):
    """Torque, N m, and whether the motor is to be on; None where the frame is not intact."""
    data = checked(frame, _COMMAND.size)
    if data is None:
        return None
    raw, on = _COMMAND.unpack(data)
    return raw * 1e-3, bool(on)


def status_frame(node, angle, velocity, state):
    """The frame that reports a motor's angle, rad, velocity, rad/s, and state."""
    turned, speed = round(angle * 1e4), min(max(round(velocity * 100), -0x8000), 0x7FFF)
    return Frame(STATUS + node, with_checksum(_STATUS.pack(turned, speed, state)))


def read_status(frame):
    """Angle, rad, velocity, rad/s, and state; None where the frame is not intact."""
    data = checked(frame, _STATUS.size)
    if data is None:
        return None
    angle, velocity, state = _STATUS.unpack(data)
    return angle * 1e-4, velocity * 1e-2, state


class PocketDrive(PhasedDrive):
    """One wheel; see `Drive`."""

    def __init__(self, link, name, settings, period_s, clock):
        """Drive the wheel `name` over `link`, in a loop of `period_s`, s."""
        super().__init__(clock.now_ns)
        self.name = name
        self._wheel = settings.axes[name]
        self._link = link
        self.signals = {f"{name}.angle": "rad", f"{name}.velocity": "rad/s"}
        self.commands = {f"{name}.torque": "N m"}
        self.limits = (self._wheel.max_torque,)
        key = FrameKey(STATUS + self._wheel.node)
        self.listens_to, self.periods_s = (key,), {key: STATUS_PERIOD_S}
        self.commanded_by = (FrameKey(COMMAND + self._wheel.node),)
        stale_ns = {STATUS: stale_after_ns(STATUS_PERIOD_S, period_s)}
        self._fresh = Freshness(stale_ns, clock.now_ns, settings.ride_through_s)
        self._values, self._state, self._refused = (0.0, 0.0), OFF, 0

    def start(self):
        """Send zero."""
        self._send(0.0, on=False)

    def take_frame(self, frame):
        """Take a status."""
        status = read_status(frame)
        if status is None:
            self._refused += 1
            return False
        angle, velocity, self._state = status
        self._values = (self._wheel.wheel(angle), self._wheel.wheel(velocity))
        self._fresh.mark(STATUS, frame.received_ns)
        self._off_ns = None if self._state == ON else frame.received_ns
        if self._state == ON:
            self._enabling.confirm()
        return True

    def read(self):
        """The newest angle and velocity."""
        age, is_fresh = self._fresh.age(STATUS)
        return Readings(self._values, (age, age), (is_fresh, is_fresh))

    def arming_failures(self):
        """A controller that is silent."""
        if self._fresh.age(STATUS)[1]:
            return []
        return [f"the {self.name} pocket drive (node {self._wheel.node}) is silent; is it powered and on this bus?"]

    @property
    def is_off(self):
        """Whether it has reported so since it was last switched off."""
        return self._enabling.confirms_disable(self._off_ns) and self._fresh.age(STATUS)[1]

    def enable(self):
        """Switch on with the next commands."""
        self._enabling.begin(self._now_ns())

    def command(self, commands):
        """Send the torque, N m, where the motor is on, else zero."""
        torque = commands[0] if self.is_enabled else 0.0
        self._send(torque, on=self._enabling.phase is not Phase.OFF)

    def disable(self):
        """Send zero, and switch off."""
        self._enabling.end(self._now_ns())
        self._send(0.0, on=False)

    def faults(self):
        """A motor that does not switch on, has switched off by itself, or is silent."""
        if self.is_enabled and not self._fresh.age(STATUS)[1]:
            return (f"the {self.name} pocket drive is silent",)
        late = self._enabling.is_overdue(self._now_ns())
        if late or (self.is_enabled and self._state != ON):
            return (f"the {self.name} pocket drive is off: state {self._state}",)
        return ()

    @property
    def health(self):
        """For the diagnostics."""
        return {"state": str(self._state), "refused": str(self._refused), **self._fresh.health}

    def _send(self, wheel_torque, *, on):
        self._link.send(command_frame(self._wheel.node, self._wheel.motor_torque(wheel_torque), on=on))


class PocketStopper:
    """What the guard must know; see `Stopper`."""

    reports = True

    def __init__(self, settings):
        """Know the controllers by their nodes."""
        self.drives = tuple(settings.axes)
        self._names = {wheel.node: name for name, wheel in settings.axes.items()}

    def read(self, frame):
        """What a frame means."""
        name = self._names.get(frame.arbitration_id & 0x7F)
        if name is None or frame.is_extended:
            return None
        if frame.arbitration_id & ~0x7F == STATUS and (status := read_status(frame)):
            return Observation(name, Meaning.ON if status[2] == ON else Meaning.OFF)
        if frame.arbitration_id & ~0x7F == COMMAND and (command := read_command(frame)):
            return Observation(name, Meaning.MOVE if command[1] else Meaning.DISABLE)
        return None

    def stop(self):
        """Zero with the motor off, for all."""
        return [command_frame(node, 0.0, on=False) for node in self._names]


FAMILY = DriveFamily(
    settings=PocketSettings,
    drives=lambda settings, link, period_s, clock: [
        PocketDrive(link, name, settings, period_s, clock) for name in settings.axes
    ],
    stopper=PocketStopper,
    watchdog=lambda _: DriveWatchdog(WATCHDOG_S, "fixed in its firmware"),
)
