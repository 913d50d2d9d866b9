# SPDX-License-Identifier: MIT
"""The wheel board as a `Drive`: enable, command, disable."""

import time
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from msgspec.structs import astuple

from segway_ecc.firmware_io.devices import (
    SUPPLY_STALE_NS,
    SUPPLY_VOLTAGE,
    FrameKey,
    Freshness,
    Readings,
    stale_after_ns,
    with_one_more,
)
from segway_ecc.firmware_io.drives.enabling import Phase, PhasedDrive
from segway_ecc.firmware_io.drives.readings import DriveReading
from segway_ecc.firmware_io.drives.wheel_board.frames import (
    CYCLE_TIME_S,
    MAX_VOLTAGE,
    BoardSession,
    BoardSetup,
    BoardState,
    BoardStatus,
    Endpoint,
    FrameId,
    WheelCommand,
)
from segway_ecc.firmware_io.drives.wheel_board.session import CommandId, CommandSession
from segway_ecc.firmware_io.drives.wheel_board.settings import WATCHDOG_ALLOWED_S, WheelBoardSettings
from segway_ecc.firmware_io.links.link import Frame, Link, NowNs

_WHEELS: Final[Mapping[FrameId, Mapping[str, str]]] = {
    FrameId.LEFT_WHEEL: {"left.angle": "rad", "left.velocity": "rad/s"},
    FrameId.RIGHT_WHEEL: {"right.angle": "rad", "right.velocity": "rad/s"},
}
"""What each frame measures, in the order of its payload, with units."""
_IMU: Final[Mapping[FrameId, Mapping[str, str]]] = {
    FrameId.IMU_GYRO: {f"imu.angular_velocity_{axis}": "rad/s" for axis in "xyz"},
    FrameId.IMU_ACCELERATION: {f"imu.linear_acceleration_{axis}": "m/s2" for axis in "xyz"},
}
_ZERO: Final = WheelCommand(0.0, 0.0, enable=False)
_OFF_BY_ITSELF: Final = frozenset({BoardState.WATCHDOG, BoardState.FAULT})
_WATCHDOG_RESOLUTION_S: Final = 0.000501  # half a step of the frame, and a margin for rounding


class WheelBoard(PhasedDrive):
    """Two voltage-driven wheels, and an IMU where there is one, behind one board; see `Drive`."""

    name = "board"
    commands: Mapping[str, str] = {"left.voltage": "V", "right.voltage": "V"}
    limits: Sequence[float] = (MAX_VOLTAGE, MAX_VOLTAGE)
    commanded_by: Collection[FrameKey] = frozenset({FrameKey(FrameId.WHEEL_COMMAND), FrameKey(FrameId.BOARD_SETUP)})

    def __init__(
        self, link: Link, settings: WheelBoardSettings, loop_period_s: float, now_ns: NowNs = time.monotonic_ns
    ) -> None:
        """Drive the board at the other end of `link`, exchanged with at `loop_period_s`."""
        super().__init__(now_ns)
        measured = {**_WHEELS, **_IMU} if settings.imu else _WHEELS
        telemetry = frozenset({*measured, FrameId.BOARD_STATUS})
        self._session: CommandSession | None = None
        if settings.protocol == 2:  # noqa: PLR2004 - the version
            self._session = CommandSession()
            self.commanded_by = frozenset(FrameKey(command_id) for command_id in CommandId)
            telemetry |= {FrameId.BOARD_SESSION}
        self.signals: Mapping[str, str] = {
            **{k: v for signals in measured.values() for k, v in signals.items()},
            SUPPLY_VOLTAGE: "V",
        }
        self.listens_to: Collection[FrameKey] = frozenset(FrameKey(frame_id) for frame_id in telemetry)
        # A board behind a quicker loop may send as quickly.
        self.periods_s: Mapping[FrameKey, float] = {
            FrameKey(frame_id): min(CYCLE_TIME_S[frame_id], loop_period_s) for frame_id in measured
        }
        self._link = link
        self._endpoint = Endpoint(link.send, telemetry)
        self._watchdog_s = settings.watchdog_s
        stale_ns: dict[int, int] = {
            frame_id: stale_after_ns(CYCLE_TIME_S[frame_id], loop_period_s) for frame_id in telemetry
        }
        self._status_stale_ns = stale_ns[FrameId.BOARD_STATUS]
        self._fresh = Freshness(stale_ns, now_ns, settings.ride_through_s)
        self._newest: dict[int, tuple[float, ...]] = {k: (0.0,) * len(v) for k, v in measured.items()}
        self._status = BoardStatus(BoardState.DISABLED, 0.0, 0.0, 0)

    def start(self) -> None:
        """Send zero, and set the watchdog."""
        self._send(_ZERO)
        self._set_up()

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the board's frames; see `Sensor.take_frame`."""
        payload = self._endpoint.check(frame)
        if payload is None:
            return False
        received_ns = frame.received_ns
        self._fresh.mark(frame.arbitration_id, received_ns)
        if isinstance(payload, BoardStatus):
            self._status = payload
            if payload.state is BoardState.ENABLED:
                self._enabling.confirm()
            elif payload.state is BoardState.DISABLED:
                # On a line that was just taken a status of before may have confirmed: a slow one brings it 20 ms late.
                self._enabling.retract(received_ns, self._status_stale_ns)
            is_set = abs(payload.watchdog_s - self._watchdog_s) <= _WATCHDOG_RESOLUTION_S
            if not is_set and self._enabling.phase is Phase.OFF:
                # The board was switched on after us, or missed the frame.
                self._set_up()
            self._off_ns = received_ns if payload.state is not BoardState.ENABLED else None
        elif isinstance(payload, BoardSession):
            self._enter(payload)
        else:
            self._newest[frame.arbitration_id] = astuple(payload)
        return True

    def read(self) -> Readings:
        """The wheels' angles and velocities, the IMU's angular velocity and acceleration, the supply's voltage."""
        values: list[float] = []
        ages: list[float] = []
        valid: list[bool] = []
        now_ns = self._now_ns()
        for frame_id, measured in self._newest.items():
            age, is_fresh = self._fresh.age(frame_id, now_ns=now_ns)
            values += measured
            ages += [age] * len(measured)
            valid += [is_fresh] * len(measured)
        supply_age = self._fresh.age(FrameId.BOARD_STATUS, SUPPLY_STALE_NS, now_ns)
        return with_one_more(Readings(tuple(values), tuple(ages), tuple(valid)), self._status.bus_voltage, supply_age)

    def arming_failures(self) -> list[str]:
        """Silence, a watchdog that is off or too long, a state that does not allow motion, or no IMU."""
        if not self._fresh.age(FrameId.BOARD_STATUS)[1]:
            return [f"the wheel board does not answer on {self._link.description}; is it powered and on this bus?"]
        reasons = []
        if self._session is not None and not self._fresh.age(FrameId.BOARD_SESSION)[1]:
            reasons.append("the board does not send BOARD_SESSION; has its firmware version 2? if not, set protocol: 1")
        low, high = WATCHDOG_ALLOWED_S
        if not low - _WATCHDOG_RESOLUTION_S <= self._status.watchdog_s <= high + _WATCHDOG_RESOLUTION_S:
            reasons.append(
                f"the board's watchdog is set to {self._status.watchdog_s:g} s, allowed is {low:g} to {high:g} s; "
                "does its firmware take BOARD_SETUP?"
            )
        if self._status.state in _OFF_BY_ITSELF:
            reasons.append(f"the board reports {self._status.state.name}; if it stays, switch it off and on")
        silent = [frame_id.name for frame_id in _IMU if frame_id in self._newest and not self._fresh.age(frame_id)[1]]
        if silent:
            reasons.append(f"the board does not send {' and '.join(silent)}; has it an IMU? if not, set imu: false")
        return reasons

    @property
    def is_off(self) -> bool:
        """Whether the board's status, fresh and received after the command to disable, is another than ENABLED."""
        return self._enabling.confirms_disable(self._off_ns) and self._fresh.age(FrameId.BOARD_STATUS)[1]

    def enable(self) -> None:
        """Send zero with the motors on from the next cycle, until the board's status confirms it."""
        self._enabling.begin(self._now_ns())

    def command(self, commands: Sequence[float]) -> None:
        """Send the voltages, V, where the board is enabled, else zero."""
        match self._enabling.phase:
            case Phase.ENABLED:
                self._send(WheelCommand(commands[0], commands[1], enable=True))
            case Phase.ENABLING:
                # A board that switched itself off leaves that state by a command that does not enable.
                self._send(WheelCommand(0.0, 0.0, enable=self._status.state not in _OFF_BY_ITSELF))
            case Phase.OFF:
                self._send(_ZERO)

    def disable(self) -> None:
        """Send zero with the motors off.

        What arrives from then on may come over another line, where the board counts anew.
        """
        self._enabling.end(self._now_ns())
        self._endpoint.restart()
        self._send(_ZERO)

    def faults(self) -> tuple[str, ...]:
        """A board that switched its motors off or has restarted, does not switch them on, or has fallen silent."""
        if self._enabling.is_overdue(self._now_ns()):
            return (f"the wheel board does not enable its motors: {self._status.state.name}",)
        if not self.is_enabled:
            return ()
        if self._status.state is not BoardState.ENABLED:
            return (f"the wheel board switched its motors off: {self._status.state.name}",)
        age_s, valid = self._fresh.age(FrameId.BOARD_STATUS)
        return () if valid else (f"the wheel board's status is too old: {age_s * 1e3:.0f} ms",)

    @property
    def readings(self) -> Sequence[DriveReading]:
        """The watchdog that the board has in force, once it has reported it; see `ReportsSettings`."""
        is_reported = self._fresh.age(FrameId.BOARD_STATUS)[1]
        return (DriveReading("watchdog_s", self._status.watchdog_s, "s"),) if is_reported else ()

    @property
    def health(self) -> Mapping[str, str]:
        """What the board reports, and what was refused of it."""
        return {
            **{f"refused.{cause}": str(count) for cause, count in self._endpoint.refused.items()},
            "lost": str(self._endpoint.lost),
            "state": self._status.state.name,
            "bus_voltage_v": f"{self._status.bus_voltage:.3f}",
            "watchdog_s": f"{self._status.watchdog_s:.3f}",
            "refused_frames": str(self._status.refused_frames),
            **({} if self._session is None else {"session": str(self._session.number)}),
            **self._fresh.health,
        }

    def _enter(self, announced: BoardSession) -> None:
        """Enter a session that the board has begun; while it follows commands it begins none."""
        session = self._session
        if session is None or self._enabling.phase is Phase.ENABLED:
            return
        if not session.is_begun or announced.number != session.number:
            session.begin(announced.number, announced.epoch)
            if self._enabling.phase is Phase.OFF:  # what `start` could not send yet: before it arms, the watchdog
                self.start()

    def _send(self, command: WheelCommand) -> None:
        session = self._session
        if session is None:
            self._endpoint.send(FrameId.WHEEL_COMMAND, command)
        elif session.is_begun:
            for frame in session.command(command):
                self._link.send(frame)

    def _set_up(self) -> None:
        session, setup = self._session, BoardSetup(self._watchdog_s)
        if session is None:
            self._endpoint.send(FrameId.BOARD_SETUP, setup)
        elif session.is_begun:
            self._link.send(session.setup(setup))
