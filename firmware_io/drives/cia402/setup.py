# SPDX-License-Identifier: MIT
"""Getting the drives ready before the loop starts: reset, set up with every value read back, communication started."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, cast

import canopen
from canopen.objectdictionary import ODVariable
from canopen.pdo import PdoMap

from segway_ecc.firmware_io.drives.cia402.frames import (
    MAX_TORQUE_SHARE,
    PDOS,
    PERMILLE,
    MappedObject,
    NmtCommand,
    Service,
    nmt_frame,
    rated_torque,
)
from segway_ecc.firmware_io.drives.cia402.limits import (
    CYCLIC_SYNCHRONOUS_TORQUE,
    Identity,
    interpolation_period,
    mode_refusal,
)
from segway_ecc.firmware_io.drives.cia402.network import LinkNetwork, PumpedNode, object_dictionary
from segway_ecc.firmware_io.drives.cia402.settings import (
    ANSWER_WITHIN_NS,
    HEARTBEAT_PERIOD_MS,
    Cia402Settings,
    Cia402WheelSettings,
)
from segway_ecc.firmware_io.drives.cia402.wheel import Cia402Wheel, Restoring
from segway_ecc.firmware_io.errors import HardwareError, LinkLostError

PROFILE: Final = 402
EVERY_SYNC: Final = 1
AT_ONCE: Final = 255
"""An RPDO of this transmission type acts when it arrives, be that before or after SYNC, whose identifier is lower."""
_WATCHDOG_ALLOWED_MS: Final = (20, 50)
"""Range of the drive's consumer heartbeat time (0x1016) that the robot may be armed with, ms."""
_SUPPLY_PERIOD_US: Final = 100_000
"""How often the drive sends the voltage of its supply, as near as a count of SYNCs comes, us."""
_MAX_SYNCS: Final = 240
"""The most SYNCs that a PDO can be sent every so many of (CiA 301, transmission type)."""
_BOOT_WITHIN_NS: Final = 5_000_000_000
"""After the order to start anew, a drive that has not reported by then is not there."""
_SETTLE_NS: Final = 100_000_000
"""After all drives have reported."""
_DISABLE_VOLTAGE: Final = 2
"""Of 0x6007: where the host's heartbeat stops, the motor is to run free, as when a robot is disarmed."""
_DISABLE_DRIVE: Final = 0
"""Of 0x605A: the same for a quick stop that something at the drive causes; the profile's default would brake."""
_NOT_VALID: Final = 1 << 31
_ATTEMPTS: Final = 3
_EQUAL: Final = 1e-3
"""Relative: 0x6072 counts in thousandths."""
_ABORT_NO_OBJECT: Final = frozenset({0x06020000, 0x06090011})


class SetUpError(HardwareError):
    """A drive could not be set up; the text states at which object."""


class DriveData(NamedTuple):
    """What a drive reported while it was set up.

    Attributes:
        rated_torque: Of its motor, N m.
        max_torque: The largest that it lets the motor give, N m; None where it does not report it.
        max_speed_rpm: The fastest that it lets the motor turn, rpm; None where it does not report it.
        identity: What it is.
    """

    rated_torque: float
    max_torque: float | None
    max_speed_rpm: float | None
    identity: Identity


def set_up(network: LinkNetwork, settings: Cia402Settings, wheel: Cia402WheelSettings, cycle_us: int) -> DriveData:
    """Set up a drive that has just been reset, for SYNC each `cycle_us`, and leave it pre-operational; blocks.

    Raises:
        SetUpError: It does not answer, or is not or does not become what it must be.
        LinkLostError: The link is gone.
    """
    try:
        frame = nmt_frame(NmtCommand.PRE_OPERATIONAL, wheel.node_id)
        network.send_message(frame.arbitration_id, frame.data)
    except canopen.SdoCommunicationError as error:
        raise SetUpError(str(error)) from error
    return _SetUp(network, settings, wheel, cycle_us).run()


class _SetUp:
    def __init__(
        self, network: LinkNetwork, settings: Cia402Settings, wheel: Cia402WheelSettings, cycle_us: int
    ) -> None:
        self._network = network
        self._settings = settings
        self._wheel = wheel
        self._cycle_us = cycle_us
        self._node = PumpedNode(wheel.node_id, object_dictionary())
        network.add_node(self._node)

    def run(self) -> DriveData:
        """Go through all of it, in the order that the profile wants; see `set_up`."""
        profile = self._read(0x1000) & 0xFFFF
        if profile != PROFILE:
            raise SetUpError(
                f"its device type 0x1000 names profile {profile}, not 402; is the node id that of a drive?"
            )
        identity = Identity._make(self._read_if_there(0x1018, part) for part in range(1, len(Identity._fields) + 1))
        self._write(0x6040, 0, 0)
        self._write_checked(0x1017, 0, HEARTBEAT_PERIOD_MS)
        self._watchdog()
        self._write_if_there(0x605A, _DISABLE_DRIVE)
        rated = self._rated_torque()
        most, speed_rpm = self._max_torque(rated), self._read_if_there(0x6080)
        self._set_mode()
        self._write_checked(0x1005, 0, Service.SYNC)
        self._write_if_there(0x1006, self._cycle_us)
        self._map(self._node.rpdo[1], Service.RPDO1, AT_ONCE)
        self._map(self._node.tpdo[1], Service.TPDO1, EVERY_SYNC)
        self._map(self._node.tpdo[2], Service.TPDO2, EVERY_SYNC)
        self._map_supply()
        self._switch_off(4, Service.TPDO4)
        return DriveData(rated, most, speed_rpm, identity)

    def _set_mode(self) -> None:
        """Have it take torques in each cycle, of the period of SYNC."""
        supported = self._read_if_there(0x6502)
        refusal = mode_refusal(supported)
        if refusal is not None:
            raise SetUpError(refusal)
        try:
            self._write(0x6060, 0, CYCLIC_SYNCHRONOUS_TORQUE)
        except SetUpError as error:
            if not isinstance(error.__cause__, canopen.SdoAbortedError):
                raise
            raise SetUpError(mode_refusal(supported, f"refuses it: {error.__cause__}")) from error.__cause__
        if not self._network.wait_until(lambda: self._read(0x6061) == CYCLIC_SYNCHRONOUS_TORQUE, ANSWER_WITHIN_NS):
            raise SetUpError(mode_refusal(supported, f"stays in mode {self._read(0x6061)}, as 0x6061 reads"))
        value, exponent = interpolation_period(self._cycle_us)
        self._write_if_there(0x60C2, value, 1)
        self._write_if_there(0x60C2, exponent, 2)

    def _watchdog(self) -> None:
        asked_host, asked_ms = self._settings.host_node_id, round(self._settings.watchdog_s * 1e3)
        self._write(0x1016, 1, asked_host << 16 | asked_ms)
        found = self._read(0x1016, 1)
        host, time_ms = found >> 16, found & 0xFFFF
        low, high = _WATCHDOG_ALLOWED_MS
        if host != asked_host or not low <= time_ms <= high:
            raise SetUpError(
                f"its watchdog 0x1016:01 is set to {time_ms} ms for node {host}, asked was {asked_ms} ms for "
                f"node {asked_host}, allowed is {low} to {high} ms; does it take a heartbeat consumer?"
            )
        self._write_checked(0x6007, 0, _DISABLE_VOLTAGE)

    def _rated_torque(self) -> float:
        max_torque = self._wheel.max_torque / self._wheel.gear_ratio
        rated = rated_torque(self._read(0x6076))
        if rated <= 0.0 or max_torque > rated * MAX_TORQUE_SHARE:
            raise SetUpError(
                f"its rated torque 0x6076 reads {rated:g} N m, which a torque of {max_torque:g} N m at the motor does "
                "not go with; set 0x6076 to the value on the motor's plate"
            )
        return rated

    def _max_torque(self, rated: float) -> float | None:
        """What 0x6072 lets the motor give, N m; refused where max_torque is more, which the drive would cut."""
        share = self._read_if_there(0x6072)
        if share is None:
            return None
        needed, most = abs(self._wheel.motor_torque(self._wheel.max_torque)), share * PERMILLE * rated
        if most < needed * (1.0 - _EQUAL):
            raise SetUpError(
                f"its largest torque 0x6072 is {share} thousandths of the rated torque, {most:g} N m; max_torque takes "
                f"{needed:.4g} N m at the motor: set 0x6072 to {math.ceil(needed / rated / PERMILLE)} or more where "
                "drive and motor bear it, or lower max_torque"
            )
        return most

    def _map(self, pdo: PdoMap, service: Service, transmission_type: int) -> None:
        """Map a PDO by the library; its present COB-ID is read first, for the bit that allows remote requests."""
        objects = PDOS[service]
        asked = (service + self._wheel.node_id, transmission_type, True)
        try:
            pdo.read()
            pdo.clear()
            for mapped in objects:
                pdo.add_variable(mapped.object_index, 0, mapped.bits)
            pdo.cob_id, pdo.trans_type, pdo.enabled = asked
            pdo.save()
            pdo.read()
        except (canopen.SdoCommunicationError, canopen.SdoAbortedError, canopen.ObjectDictionaryError) as error:
            raise SetUpError(f"{service.name} cannot be mapped: {error}") from error
        found = tuple(MappedObject(variable.index, variable.length) for variable in pdo.map)
        if (found, (pdo.cob_id, pdo.trans_type, pdo.enabled)) != (objects, asked):
            raise SetUpError(f"{service.name} is not mapped as asked: does the drive allow mapping?")

    def _map_supply(self) -> None:
        """Have the supply's voltage sent now and then; a drive need not support that."""
        every = min(max(_SUPPLY_PERIOD_US // self._cycle_us, EVERY_SYNC), _MAX_SYNCS)
        try:
            self._map(self._node.tpdo[3], Service.TPDO3, every)
        except SetUpError as error:
            if isinstance(error.__cause__, canopen.SdoCommunicationError):
                raise
            self._switch_off(3, Service.TPDO3)

    def _switch_off(self, number: int, service: Service) -> None:
        """Switch a TPDO off, where the drive has it."""
        self._write_if_there(0x1800 + number - 1, _NOT_VALID | (service + self._wheel.node_id), 1)

    def _write_checked(self, index: int, subindex: int, value: int) -> None:
        self._write(index, subindex, value)
        found = self._read(index, subindex)
        if found != value:
            raise SetUpError(f"its object {_name(index, subindex)} reads {found} after {value} was written")

    def _write_if_there(self, index: int, value: int, subindex: int = 0) -> None:
        """Write an object that a drive need not have."""
        try:
            self._write_checked(index, subindex, value)
        except SetUpError as error:
            cause = error.__cause__
            if not (isinstance(cause, canopen.SdoAbortedError) and cause.code in _ABORT_NO_OBJECT):
                raise

    def _read_if_there(self, index: int, subindex: int = 0) -> int | None:
        """What an object holds that a drive need not have."""
        try:
            return self._read(index, subindex)
        except SetUpError as error:
            if isinstance(error.__cause__, canopen.SdoAbortedError):
                return None
            raise

    def _write(self, index: int, subindex: int, value: int) -> None:
        try:
            self._node.sdo.download(index, subindex, self._variable(index, subindex).encode_raw(value))
        except (canopen.SdoCommunicationError, canopen.SdoAbortedError) as error:
            raise SetUpError(f"its object {_name(index, subindex)} cannot be written: {error}") from error

    def _read(self, index: int, subindex: int = 0) -> int:
        try:
            return int(self._variable(index, subindex).decode_raw(self._node.sdo.upload(index, subindex)))
        except (canopen.SdoCommunicationError, canopen.SdoAbortedError, canopen.ObjectDictionaryError) as error:
            raise SetUpError(f"its object {_name(index, subindex)} cannot be read: {error}") from error

    def _variable(self, index: int, subindex: int) -> ODVariable:
        return cast("ODVariable", self._node.object_dictionary.get_variable(index, subindex))


def _name(index: int, subindex: int) -> str:
    return f"0x{index:04X}:{subindex:02X}"


def commission(network: LinkNetwork, wheels: Sequence[Cia402Wheel], settings: Cia402Settings, cycle_us: int) -> None:
    """Reset the drives' communication, set each up for SYNC each `cycle_us`, and start it; blocks.

    The reset makes the set-up begin from the same state every time, as it does after the drive was switched on. Why a
    drive could not be set up is left as its `trouble`.
    """
    for wheel in wheels:
        network.link.send(nmt_frame(NmtCommand.RESET_COMMUNICATION, wheel.node_id))
    try:
        network.wait_until(lambda: all(network.boots[wheel.node_id] for wheel in wheels), _BOOT_WITHIN_NS)
        # A drive that was switched on a moment ago reports that, and then the reset.
        network.wait_until(lambda: False, _SETTLE_NS)
    except LinkLostError as error:
        for wheel in wheels:
            wheel.trouble = str(error)
        return
    boots = [_set_up_wheel(network, wheel, settings, cycle_us) for wheel in wheels]
    for wheel, booted in zip(wheels, boots, strict=True):
        if wheel.trouble is None and network.boots[wheel.node_id] != booted:
            wheel.restart()
        elif wheel.trouble is None:
            network.link.send(nmt_frame(NmtCommand.START, wheel.node_id))


def _set_up_wheel(network: LinkNetwork, wheel: Cia402Wheel, settings: Cia402Settings, cycle_us: int) -> int:
    """Set a drive up, anew where it restarts meanwhile; how often it had started when that began."""
    for _ in range(_ATTEMPTS):
        booted = network.boots[wheel.node_id]
        network.exchanges[wheel.node_id] = []
        try:
            data = set_up(network, settings, wheel.settings, cycle_us)
        except (SetUpError, LinkLostError) as error:
            wheel.trouble = str(error)
        else:
            wheel.trouble = None
            wheel.rated_torque, wheel.max_torque, wheel.max_speed_rpm, wheel.identity = data
        if network.boots[wheel.node_id] == booted:
            break
    else:
        wheel.trouble = "it restarts again and again"
    if wheel.trouble is None:
        wheel.restoring = Restoring(network.exchanges[wheel.node_id], network.now_ns)
    return booted
