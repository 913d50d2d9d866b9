# SPDX-License-Identifier: MIT
"""One drive with its wheel, as the loop knows it: what it reports, and the next command for its state machine."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.devices import SUPPLY_STALE_NS, Freshness, Readings, WrappedCounter, stale_after_ns
from segway_ecc.firmware_io.drives.cia402.frames import (
    EMERGENCY,
    SDO_READ,
    WITHOUT_TORQUE,
    Controlword,
    DriveState,
    DriveStatus,
    Emergency,
    NmtState,
    Service,
    TorqueCommand,
    is_answer,
    motor_angle,
    motor_velocity,
    state_of,
    step_towards_operation,
    unpack_heartbeat,
    unpack_supply,
)
from segway_ecc.firmware_io.drives.cia402.limits import Identity
from segway_ecc.firmware_io.drives.cia402.settings import ANSWER_WITHIN_NS, HEARTBEAT_PERIOD_MS, Cia402WheelSettings
from segway_ecc.firmware_io.drives.enabling import Enabling
from segway_ecc.firmware_io.drives.readings import DriveReading
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, NowNs

_HEARD: Final = (Service.TPDO1, Service.TPDO2, Service.TPDO3, Service.SDO_REPLY, Service.HEARTBEAT, EMERGENCY)
_POSITION_BITS: Final = 32


class Exchange(NamedTuple):
    """An SDO request, and what the drive answered."""

    request: bytes
    answer: bytes


class Restoring:
    """Sets up a drive again that has restarted: in the loop, one request a cycle, without waiting.

    It asks what the drive was asked when it was set up, and is content with the same answers only. The set-up begins
    with the drive as it is after a reset, so the answers are the same if the drive is. A value that is read may take a
    moment to become what it was: reading is repeated until the time is up. `failure` is why the drive could not be set
    up again; None where it was, or nothing was tried.
    """

    def __init__(self, exchanges: Sequence[Exchange], now_ns: NowNs) -> None:
        """Remember how the drive was set up; nothing is to be done until `begin`."""
        self.failure: str | None = None
        self._exchanges = tuple(exchanges)
        self._now_ns = now_ns
        self._place = len(self._exchanges)
        self._deadline_ns = 0
        self._is_waiting = False

    @property
    def is_under_way(self) -> bool:
        """Whether the drive is not yet what it was."""
        return self.failure is None and self._place < len(self._exchanges)

    def begin(self) -> None:
        """The drive has lost its set-up; start from the beginning."""
        self.failure = None
        self._place = 0
        self._is_waiting = False
        self._deadline_ns = 0

    def next_request(self) -> bytes | None:
        """What to send in this cycle; None where there is nothing to send, or an answer is waited for."""
        if not self.is_under_way:
            return None
        now_ns = self._now_ns()
        if self._deadline_ns and now_ns > self._deadline_ns:
            self.failure = f"{_object(self._exchanges[self._place].request)} is not answered as it was"
            return None
        if self._is_waiting:
            return None
        self._is_waiting = True
        self._deadline_ns = self._deadline_ns or now_ns + ANSWER_WITHIN_NS
        return self._exchanges[self._place].request

    def take_answer(self, answer: bytes) -> bool:
        """Take an SDO answer; False where none was waited for, or it answers something else."""
        if not (self.is_under_way and self._is_waiting):
            return False
        request, expected = self._exchanges[self._place]
        if not (answer and is_answer(request, answer)):
            return False
        self._is_waiting = False
        if answer == expected:
            self._place += 1
            self._deadline_ns = 0
        elif request[0] != SDO_READ:
            self.failure = f"{_object(request)} is not answered as it was"
        return True


def _object(request: bytes) -> str:
    """The object that a request is about, for people."""
    return f"object 0x{int.from_bytes(request[1:3], 'little'):04X}:{request[3]:02X}"


class Cia402Wheel:
    """The newest state of a drive.

    Attributes:
        rated_torque: The rated torque of its motor, N m; None until it is set up.
        max_torque: The largest that it lets its motor give (0x6072), N m; None where it does not say.
        max_speed_rpm: The fastest that it lets its motor turn (0x6080), rpm; None where it does not say.
        identity: What it is; None until it is set up.
        trouble: Why it is not set up; None where it is.
        state: The state in its statusword; None before the first, or for one the profile does not know.
        supply_voltage: What it measured of its supply, V.
        emergency: The error it reported since `begin`; None where there is none.
    """

    def __init__(
        self, name: str, settings: Cia402WheelSettings, loop_period_s: float, now_ns: NowNs, ride_through_s: float = 0.0
    ) -> None:
        """Begin with a drive from which nothing has been received."""
        self.name = name
        self.node_id = settings.node_id
        self.rated_torque: float | None = None
        self.max_torque: float | None = None
        self.max_speed_rpm: float | None = None
        self.identity: Identity | None = None
        self.trouble: str | None = "it has not been set up"
        self.restoring = Restoring((), now_ns)
        self.state: DriveState | None = None
        self.nmt: NmtState | None = None
        self.emergency: Emergency | None = None
        self.needs_start = False
        self.supply_voltage = 0.0
        self.listens_to = frozenset(service + settings.node_id for service in _HEARD)
        self.settings = settings
        self._counter = WrappedCounter(_POSITION_BITS)
        self._values = [0.0, 0.0, 0.0]
        self._last_sent = int(Controlword.DISABLE_VOLTAGE)
        self._was_off = False
        self._off_ns: int | None = None
        self._refused: Counter[str] = Counter()
        stale_ns = dict.fromkeys((Service.TPDO1, Service.TPDO2), stale_after_ns(loop_period_s, loop_period_s))
        stale_ns[Service.HEARTBEAT] = stale_after_ns(HEARTBEAT_PERIOD_MS * 1e-3, loop_period_s)
        stale_ns[Service.TPDO3] = SUPPLY_STALE_NS
        self._fresh = Freshness(stale_ns, now_ns, ride_through_s)

    @property
    def has_restarted(self) -> bool:
        """Whether the drive has lost its set-up and has not got it back."""
        return self.restoring.is_under_way or self.restoring.failure is not None

    @property
    def is_operational(self) -> bool:
        """Whether its PDOs are exchanged."""
        return self.nmt is NmtState.OPERATIONAL and not self.has_restarted

    @property
    def follows(self) -> bool:
        """Whether its motor follows commands, and it was off since `begin`."""
        return self._was_off and self.is_operational and self.state is DriveState.OPERATION_ENABLED

    def confirms_disable(self, enabling: Enabling) -> bool:
        """Disable feedback: whether a statusword, fresh and received since, has a state without torque."""
        return enabling.confirms_disable(self._off_ns) and self._fresh.age(Service.TPDO1)[1]

    def take_frame(self, frame: Frame) -> bool:
        """Take one of its frames; False for one that is not intact, which is counted, or that nobody waits for."""
        service = Service(frame.arbitration_id - self.node_id)
        try:
            match service:
                case Service.TPDO1:
                    self._take_status(DriveStatus.unpack(frame.data), frame.received_ns)
                case Service.TPDO2:
                    velocity = motor_velocity(frame.data, self.settings.velocity_unit_turns)
                    self._values[1] = self.settings.wheel(velocity)
                case Service.TPDO3:
                    self.supply_voltage = unpack_supply(frame.data)
                case Service.HEARTBEAT:
                    self.nmt = unpack_heartbeat(frame.data)
                    if self.nmt is NmtState.BOOT_UP:
                        self.restart()
                    self.needs_start = self.nmt in (NmtState.PRE_OPERATIONAL, NmtState.STOPPED)
                case Service.SDO_REPLY:
                    return self.restoring.take_answer(frame.data)
                case _:
                    emergency = Emergency.unpack(frame.data)
                    # That all is well again does not make undone what happened since the drive was enabled.
                    self.emergency = emergency if emergency.code else self.emergency
                    return True
        except FrameRefusedError as error:
            self._refused[error.refusal] += 1
            return False
        self._fresh.mark(service, frame.received_ns)
        return True

    def begin(self) -> None:
        """It is to be enabled: what it reported before does not count, and it must be off before it is on."""
        self.emergency = None
        self._was_off = False
        self._last_sent = int(Controlword.DISABLE_VOLTAGE)

    def next_controlword(self) -> Controlword:
        """The next step on the way to its motor following commands; a drive that is found on is switched off first."""
        self._was_off = self._was_off or self.state is not DriveState.OPERATION_ENABLED
        return step_towards_operation(self.state, self._last_sent) if self._was_off else Controlword.DISABLE_VOLTAGE

    def pack(self, controlword: Controlword, wheel_torque: float = 0.0) -> Frame:
        """The frame with a controlword and a torque at the wheel, N m; limited, and zero where it is not finite."""
        limit = self.settings.max_torque
        limited = min(max(wheel_torque, -limit), limit) if math.isfinite(wheel_torque) else 0.0
        command = TorqueCommand.of(controlword, self.settings.motor_torque(limited), self.rated_torque)
        self._last_sent = int(controlword)
        return Frame(Service.RPDO1 + self.node_id, command.pack())

    def read(self) -> Readings:
        """Angle (rad), velocity (rad/s) and torque (N m) at the wheel."""
        status_age, status_valid = self._fresh.age(Service.TPDO1)
        velocity_age, velocity_valid = self._fresh.age(Service.TPDO2)
        return Readings(
            tuple(self._values), (status_age, velocity_age, status_age), (status_valid, velocity_valid, status_valid)
        )

    @property
    def supply_age(self) -> tuple[float, bool]:
        """Age of the supply's voltage, s, and whether it is fresh; a drive need not send it."""
        return self._fresh.age(Service.TPDO3)

    def fault(self) -> str | None:
        """What is wrong with a drive that is to be enabled, or is; None while all is well."""
        if self.has_restarted:
            return f"the {self.name} drive has restarted"
        if self.emergency is not None:
            return f"the {self.name} drive reports {self.emergency.description}, its state is {self.state or 'unknown'}"
        if self.nmt is not NmtState.OPERATIONAL:
            return f"the {self.name} drive has left the operational state: {self._nmt_name}"
        return self._stale

    def arming_failures(self, where: str) -> list[str]:
        """What speaks against enabling it."""
        drive = f"the {self.name} drive (node {self.node_id})"
        if self.trouble is not None:
            return [f"{drive} on {where} is not set up: {self.trouble}; fix that, then start the node again"]
        if self.restoring.failure is not None:
            return [f"{drive} restarted and {self.restoring.failure}; is it the same drive? start the node again"]
        if self.restoring.is_under_way:
            return [f"{drive} restarted and is being set up again; try again in a second"]
        if not self._fresh.age(Service.HEARTBEAT)[1]:
            return [f"{drive} does not answer on {where}; is it powered and on this bus?"]
        silent = self._stale if self.is_operational else f"{drive} is not operational: {self._nmt_name}"
        return [] if silent is None else [f"{silent}; try again in a second, or switch it off and on"]

    @property
    def readings(self) -> Sequence[DriveReading]:
        """What was read of its limits while it was set up."""
        if self.rated_torque is None:
            return []
        own = [DriveReading(f"{self.name}_rated_torque_n_m", self.rated_torque, "N m")]
        if self.max_torque is not None:
            own.append(DriveReading(f"{self.name}_max_torque_n_m", self.max_torque, "N m"))
        if self.max_speed_rpm is not None:
            own.append(DriveReading(f"{self.name}_max_speed_rpm", self.max_speed_rpm, "rpm"))
        return own

    @property
    def health(self) -> Mapping[str, str]:
        """What the drive reports, and what was refused of it."""
        return {
            **{f"refused.{cause}": str(count) for cause, count in self._refused.items()},
            "state": str(self.state or "unknown"),
            "nmt": self._nmt_name,
            **self._fresh.health,
            "emergency": "none" if self.emergency is None else self.emergency.description,
            "bus_voltage_v": f"{self.supply_voltage:.3f}" if self.supply_age[1] else "not reported",
            "rated_torque_nm": "unknown" if self.rated_torque is None else f"{self.rated_torque:g}",
            "identity": "unknown" if self.identity is None else str(self.identity),
            "set_up": self.trouble or self.restoring.failure or ("under way" if self.has_restarted else "yes"),
        }

    @property
    def _stale(self) -> str | None:
        """What it has sent too long ago; None where all is fresh."""
        for kind, name in ((Service.HEARTBEAT, "heartbeat"), (Service.TPDO1, "status"), (Service.TPDO2, "velocity")):
            age_s, valid = self._fresh.age(kind)
            if not valid:
                return f"the {name} of the {self.name} drive is too old: {age_s * 1e3:.0f} ms"
        return None

    @property
    def _nmt_name(self) -> str:
        return "not received" if self.nmt is None else self.nmt.name.lower().replace("_", "-")

    def _take_status(self, status: DriveStatus, received_ns: int) -> None:
        self.state = state_of(status.statusword)
        if self.state is None:
            self._refused[Refusal.UNKNOWN] += 1
        self._off_ns = received_ns if self.state in WITHOUT_TORQUE else None
        angle = motor_angle(self._counter.follow(status.position_counts), self.settings.counts_per_turn)
        self._values[0] = self.settings.wheel(angle)
        self._values[2] = self.settings.wheel_torque(status.motor_torque(self.rated_torque or 0.0))

    def restart(self) -> None:
        """It has restarted: what it was set up to is gone."""
        self.state = None
        self._off_ns = None
        self._counter.resume()
        self.restoring.begin()
