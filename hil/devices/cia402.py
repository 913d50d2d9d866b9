# SPDX-License-Identifier: MIT
"""CiA 402 drives as their firmware behaves: CANopen nodes with the profile's state machine, in torque modes.

Sources: CiA 301 for 0x1001, 0x1018, EMCY and abort codes; CiA 402 (IEC 61800-7-201) for modes, 0x6087 and 0x60C2.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.cia402.frames import DriveState, Emergency, Service
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices._canopen_slave import CanopenSlave, Key, ObjectEntry
from segway_ecc.hil.devices.device import supply_voltage
from segway_ecc.hil.devices.family import SimulatedDrives

TICK_NS: Final = 1_000_000
"""Period of the firmware's loop."""
RATED_TORQUE_MNM: Final = 1_500
"""What 0x6076 reads."""
MAX_TORQUE_PERMILLE: Final = 3_000
"""Where the motor's current saturates, 0x6072."""
_PERMILLE_MNM: Final = 1e-6 * RATED_TORQUE_MNM
"""One step of 0x6071, N m."""
PROFILE_TORQUE: Final = 4
CYCLIC_TORQUE: Final = 10
"""Modes of operation in which a drive gives torque."""
PRODUCT_CODE: Final = 402
REVISION: Final = 0x0001_0000
INTERPOLATION_FAULT: Final = Emergency(0x6320, 0x21)
"""A wrong parameter; error register: generic, and of the profile."""
OVER_CURRENT: Final = Emergency(0x2310, 0x03)
"""Continuous over-current; error register: generic, and of the current."""
_CONTROLWORD: Final = 0x6040
_MODE: Final = 0x6060
_PERIOD: Final = 0x60C2
_DC_LINK: Final = 0x6079
_MILLIVOLT: Final = 0.001

_STATUSWORDS: Final = {
    DriveState.NOT_READY: 0x0000,
    DriveState.SWITCH_ON_DISABLED: 0x0240,
    DriveState.READY: 0x0231,
    DriveState.SWITCHED_ON: 0x0233,
    DriveState.OPERATION_ENABLED: 0x1237,
    DriveState.QUICK_STOP_ACTIVE: 0x0217,
    DriveState.FAULT_REACTION_ACTIVE: 0x021F,
    DriveState.FAULT: 0x0218,
}
"""With remote (bit 9), voltage (bit 4) and, in operation, following (bit 12)."""
_ON: Final = (DriveState.READY, DriveState.SWITCHED_ON, DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE)
_OBJECTS: Final[Mapping[Key, ObjectEntry]] = {
    (0x1000, 0): ObjectEntry(4, 0x0002_0192, "r"),
    (0x1018, 0): ObjectEntry(1, 4, "r"),
    (0x1018, 1): ObjectEntry(4, 0, "r"),
    (0x1018, 2): ObjectEntry(4, PRODUCT_CODE, "r"),
    (0x1018, 3): ObjectEntry(4, REVISION, "r"),
    (0x1018, 4): ObjectEntry(4, 0, "r"),
    (0x6007, 0): ObjectEntry(2, 1),
    (0x6040, 0): ObjectEntry(2, 0, mappable=True),
    (0x6041, 0): ObjectEntry(2, _STATUSWORDS[DriveState.SWITCH_ON_DISABLED], "r", mappable=True),
    (0x605A, 0): ObjectEntry(2, 2),
    (0x6060, 0): ObjectEntry(1, 0, mappable=True),
    (0x6061, 0): ObjectEntry(1, 0, "r", mappable=True),
    (0x6064, 0): ObjectEntry(4, 0, "r", mappable=True),
    (0x606C, 0): ObjectEntry(4, 0, "r", mappable=True),
    (0x6071, 0): ObjectEntry(2, 0, mappable=True),
    (0x6072, 0): ObjectEntry(2, MAX_TORQUE_PERMILLE),
    (0x6076, 0): ObjectEntry(4, RATED_TORQUE_MNM, "r"),
    (0x6077, 0): ObjectEntry(2, 0, "r", mappable=True),
    (_DC_LINK, 0): ObjectEntry(4, 0, "r", mappable=True),
    (0x6087, 0): ObjectEntry(4, 10_000),
    (_PERIOD, 0): ObjectEntry(1, 2, "r"),
    (_PERIOD, 1): ObjectEntry(1, 1),
    (_PERIOD, 2): ObjectEntry(1, 0xFD),
    (0x6502, 0): ObjectEntry(4, 0, "r"),
}
"""The objects of the profile, as after power-on; the period of the set-points is 1 ms, and 0x6087 in 0.1 % a second."""


@dataclass(frozen=True, slots=True)
class DriveKind:
    """What distinguishes one maker's drive from another's.

    Attributes:
        lacks: The objects that it does not have.
        modes: Its modes of operation, as 0x6502 shows them.
        keeps_mode_silently: Whether it accepts another mode in 0x6060 without an abort, and shows the old in 0x6061.
        needs_sync_period: Whether 0x60C2 must be the period of SYNC, or it faults when it is enabled in a cyclic mode.
    """

    lacks: Collection[int] = ()
    modes: Collection[int] = (CYCLIC_TORQUE,)
    keeps_mode_silently: bool = False
    needs_sync_period: bool = False

    def objects(self, node_id: int) -> dict[Key, ObjectEntry]:
        """Its object dictionary, as after power-on; its serial number is its node's."""
        objects = {key: replace(entry) for key, entry in _OBJECTS.items() if key[0] not in self.lacks}
        if (0x1018, 4) in objects:
            objects[0x1018, 4].put(node_id)
        if (0x6502, 0) in objects:
            objects[0x6502, 0].put(sum(1 << (mode - 1) for mode in self.modes))
        if not self.keeps_mode_silently:
            objects[_MODE, 0].allowed = {0, *self.modes}
        return objects


class SimulatedDrive:
    """One drive, whose motor gives `torque`, N m."""

    def __init__(self, link: Link, settings: Cia402WheelSettings, kind: DriveKind) -> None:
        """Switch a drive of a kind on."""
        self._settings = settings
        self._kind = kind
        self.state = DriveState.SWITCH_ON_DISABLED
        self.torque = 0.0
        self._last_controlword = 0
        self._origin_counts = 0
        self._position_counts = 0
        self._permille = 0.0
        self._sync_ns: int | None = None
        self._sync_period_ns = 0
        self.slave = CanopenSlave(link, settings.node_id, kind.objects(settings.node_id), self._lose_host)

    def switch_off(self) -> None:
        """Cut its supply: it is silent, and its motor free."""
        self.slave.is_powered = False
        self.state, self.torque = DriveState.NOT_READY, 0.0

    def switch_on(self) -> None:
        """Give it its supply again: it counts from zero, and has lost its set-up."""
        self.slave.is_powered = True
        self.slave.reset()
        self._origin_counts = self._position_counts
        self._last_controlword = 0
        self.state = DriveState.SWITCH_ON_DISABLED

    def obey(self, frames: Sequence[Frame], now_ns: int) -> float:
        """Process what has arrived, and return the torque at the wheel, N m."""
        objects = self.slave.objects
        if self.state is DriveState.FAULT_REACTION_ACTIVE:
            self.state = DriveState.FAULT
        for frame in frames:
            self.slave.receive(frame, now_ns)
            if frame.arbitration_id == Service.SYNC and not frame.is_extended:
                self._sync_period_ns = now_ns - (now_ns if self._sync_ns is None else self._sync_ns)
                self._sync_ns = now_ns
        was_enabled = self.state is DriveState.OPERATION_ENABLED
        self._follow(objects[_CONTROLWORD, 0].value)
        if not was_enabled and self.state is DriveState.OPERATION_ENABLED and not self._has_sync_period():
            self.fail(INTERPOLATION_FAULT)
        if self.slave.is_powered:
            self.slave.watch(now_ns)
        if objects[_MODE, 0].value in self._kind.modes or not objects[_MODE, 0].value:
            objects[0x6061, 0].put(objects[_MODE, 0].value)
        permille = self._wanted_permille()
        objects[0x6077, 0].put(permille)
        self.torque = permille * _PERMILLE_MNM
        return self._settings.wheel_torque(self.torque)

    def fail(self, cause: Emergency) -> None:
        """Report an error, and go to FAULT with the next pass."""
        self.slave.send_emergency(cause)
        self.state = DriveState.FAULT_REACTION_ACTIVE

    def _wanted_permille(self) -> int:
        """The torque: in cyclic mode the target itself, in profile mode on its way there with the slope of 0x6087."""
        objects = self.slave.objects
        mode, limit = objects[0x6061, 0].value, objects[0x6072, 0].value
        target = min(max(objects[0x6071, 0].signed, -limit), limit)
        if self.state is not DriveState.OPERATION_ENABLED or mode not in (PROFILE_TORQUE, CYCLIC_TORQUE):
            self._permille = 0.0
        elif mode == CYCLIC_TORQUE:
            self._permille = target
        else:
            step = objects[0x6087, 0].value * TICK_NS * 1e-9
            self._permille += min(max(target - self._permille, -step), step)
        return round(self._permille)

    def _has_sync_period(self) -> bool:
        """Whether the period of the set-points is that of SYNC, to a tick, where the drive needs that."""
        objects = self.slave.objects
        if not self._kind.needs_sync_period or objects[0x6061, 0].value != CYCLIC_TORQUE:
            return True
        period_ns = objects[_PERIOD, 1].value * 10.0 ** (9 + objects[_PERIOD, 2].signed)
        return abs(period_ns - self._sync_period_ns) <= TICK_NS

    def send_telemetry(self, now_ns: int, angle: float, velocity: float, supply: float) -> None:
        """Measure the wheel (rad, rad/s) and the supply (V), and send what is due."""
        counts, objects = self._settings.counts_per_turn, self.slave.objects
        self._position_counts = int(self._settings.motor(angle) / TURN * counts // 1)
        objects[0x6064, 0].put(self._position_counts - self._origin_counts)
        objects[0x606C, 0].put(round(self._settings.motor(velocity) / TURN / self._settings.velocity_unit_turns))
        objects[0x6041, 0].put(_STATUSWORDS[self.state])
        if _DC_LINK not in self._kind.lacks:
            objects[_DC_LINK, 0].put(max(round(supply / _MILLIVOLT), 0))
        self.slave.send_telemetry(now_ns)

    def _lose_host(self) -> None:
        """What 0x6007 asks for where the host's heartbeat has stopped; a quick stop ends at once in torque mode."""
        if self.state is not DriveState.OPERATION_ENABLED:
            return
        match self.slave.objects[0x6007, 0].value:
            case 1:
                self.state = DriveState.FAULT_REACTION_ACTIVE
            case 2 | 3:
                self.state = DriveState.SWITCH_ON_DISABLED

    def _follow(self, controlword: int) -> None:
        """The transitions of the profile's state machine, one a controlword."""
        rising, self._last_controlword = controlword & ~self._last_controlword, controlword
        if self.state is DriveState.FAULT:
            if rising & 0x80:
                self.state = DriveState.SWITCH_ON_DISABLED
                self.slave.send_emergency(Emergency(0, 0))
        elif not controlword & 0x02:
            self.state = DriveState.SWITCH_ON_DISABLED if self.state in _ON else self.state
        elif controlword & 0x04:
            self._climb(controlword & 0x0F)
        elif self.state is DriveState.OPERATION_ENABLED:
            stays = self.slave.objects[0x605A, 0].signed > 4  # noqa: PLR2004 - 5 to 8 stay in quick stop active
            self.state = DriveState.QUICK_STOP_ACTIVE if stays else DriveState.SWITCH_ON_DISABLED
        elif self.state in (DriveState.READY, DriveState.SWITCHED_ON):
            self.state = DriveState.SWITCH_ON_DISABLED

    def _climb(self, command: int) -> None:
        match self.state, command:
            case ((DriveState.SWITCH_ON_DISABLED | DriveState.SWITCHED_ON | DriveState.OPERATION_ENABLED), 0x06 | 0x0E):
                self.state = DriveState.READY
            case (DriveState.READY, 0x07 | 0x0F) | (DriveState.OPERATION_ENABLED, 0x07):
                self.state = DriveState.SWITCHED_ON
            case ((DriveState.SWITCHED_ON | DriveState.QUICK_STOP_ACTIVE), 0x0F):
                self.state = DriveState.OPERATION_ENABLED


class SimulatedCia402:
    """All drives; see `Device`.

    Attributes:
        axes: By the name of their axis.
    """

    def __init__(
        self, link: Link, settings: Cia402Settings, port: Port | None = None, kind: DriveKind = DriveKind()
    ) -> None:
        """Switch the drives on, of one kind; they have no serial line."""
        del port
        self.inputs: Sequence[str] = [f"{name}.torque" for name in settings.axes]
        self.needs: Sequence[str] = [f"{name}.{value}" for name in settings.axes for value in ("angle", "velocity")]
        self.axes = {name: SimulatedDrive(link, wheel, kind) for name, wheel in settings.axes.items()}
        self._ends = [(drive, f"{name}.angle", f"{name}.velocity") for name, drive in self.axes.items()]

    @property
    def refused_frames(self) -> int:
        """Frames refused since power-on."""
        return sum(drive.slave.refused_frames for drive in self.axes.values())

    def obey(self, frames: Sequence[Frame], now_ns: int, _outputs: Mapping[str, float]) -> Sequence[float]:
        """Take commands and watch the host's heartbeat; see `Device.obey`."""
        return [drive.obey(frames, now_ns) for drive in self.axes.values()]

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send what is due; see `Device.send_telemetry`."""
        supply = supply_voltage(outputs)
        for drive, angle, velocity in self._ends:
            drive.send_telemetry(now_ns, outputs[angle], outputs[velocity], supply)


KINDS: Final[Mapping[str, DriveKind]] = {
    "cyclic": DriveKind(),
    "all-modes": DriveKind(modes=(1, 3, 4, 8, 9, 10)),
    "sync-period": DriveKind(needs_sync_period=True),
    "no-identity": DriveKind(lacks=(0x1018,)),
    "no-supply": DriveKind(lacks=(_DC_LINK,)),
    "profile-torque": DriveKind(modes=(PROFILE_TORQUE,)),
    "silent-refusal": DriveKind(modes=(PROFILE_TORQUE,), lacks=(0x6502,), keeps_mode_silently=True),
}
"""By name, for robot files; the last two cannot drive a robot, and are refused with the reason."""


def _of(kind: DriveKind) -> Callable[[Cia402Settings, Link, Port | None], SimulatedCia402]:
    return lambda settings, link, port: SimulatedCia402(link, settings, port, kind)


def _fail(drives: SimulatedCia402) -> None:
    next(iter(drives.axes.values())).fail(OVER_CURRENT)


SIMULATED: Final[SimulatedDrives[Cia402Settings, SimulatedCia402]] = SimulatedDrives(
    tick_ns=TICK_NS,
    device=lambda settings, link, port: SimulatedCia402(link, settings, port),
    variants={name: _of(kind) for name, kind in KINDS.items()},
    fail=_fail,
)
