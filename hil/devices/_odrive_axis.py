# SPDX-License-Identifier: MIT
"""One axis of a simulated ODrive: its states, errors, watchdog and torque.

Sources of 0.5, in Firmware/ of github.com/odriverobotics/ODrive: MotorControl/axis.cpp and main.cpp of fw-v0.5.6, and
controller.cpp and motor.cpp of the same line, for what disarms; communication/can/can_simple.cpp for what is sent. The
firmware of 0.6 is not public: what is simulated of it follows its DBC file and the names of its errors.
"""

import enum
import math
from typing import Final

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.odrive.frames import WATCHDOG, Firmware
from segway_ecc.firmware_io.drives.odrive.messages import TORQUE_CONTROL, AxisState
from segway_ecc.firmware_io.drives.odrive.settings import OdriveWheelSettings
from segway_ecc.hil.devices.device import SUPPLY_VOLTAGE

INVALID_STATE: Final = 0x1
MOTOR_FAILED: Final = 0x40
CONTROLLER_FAILED: Final = 0x200
"""Error bits of an axis of 0.5."""
CONTROLLER_OVERSPEED: Final = 0x1
"""Error bit of a controller of 0.5."""
CURRENT_LIMIT_VIOLATION: Final = 0x1000
"""Error bit of a motor of 0.5, and of an axis of 0.6."""
VELOCITY_LIMIT_VIOLATION: Final = 0x8000
"""Error bit of 0.6."""
PASSING_ERRORS: Final = 0x400 | 0x800 | CURRENT_LIMIT_VIOLATION | VELOCITY_LIMIT_VIOLATION
"""Of 0.6: what disarms and is no longer active then, the bus' currents and the limits."""
PROCEDURE_INVALID_STATE: Final = 13
PROCEDURE_NOT_CALIBRATED: Final = 14
"""Procedure results of 0.6."""
ESTOP: Final = {Firmware.V0_5: 0x4000, Firmware.V0_6: 0x2000000}
VELOCITY_CONTROL: Final = 2
POSITION_CONTROL: Final = 3
_ENTER_NS: Final = 2_000_000
"""From the request until the state is another."""
_TORQUE_CONSTANT: Final = 0.1
_MORE_THAN_ASKED: Final = 1.25
_VELOCITY_GAIN: Final = 0.16
_POSITION_GAIN: Final = 20.0


@enum.unique
class Release(enum.StrEnum):
    """The releases that are simulated; two of one firmware have the same frames and differ in what is in them."""

    V0_5_4 = "0.5.4"
    V0_5_5 = "0.5.5"
    V0_5_6 = "0.5.6"
    V0_6_10 = "0.6.10"

    @property
    def numbers(self) -> tuple[int, int, int]:
        """Major, minor and revision."""
        major, minor, revision = (int(part) for part in self.split("."))
        return major, minor, revision

    @property
    def firmware(self) -> Firmware:
        """Which of the two on the bus it is."""
        return Firmware(self.rpartition(".")[0])

    @property
    def estimates_need_closed_loop(self) -> bool:
        """Whether CAN carries zeros for position and velocity until closed loop has been entered once.

        0.5.6 sends the sources of the controller, which are connected when closed-loop control starts; 0.5.5 and older
        send the encoder's own estimates.
        """
        return self is Release.V0_5_6


class SimulatedAxis:
    """What the firmware keeps of one axis. The current loop, faster than a tick, is taken as perfect.

    Limits are those of an axis that was set up for a robot; `factory_settings` makes them those of a new one.

    Attributes:
        release: What runs on its board.
        settings: Gear, direction and torque constant of its wheel.
        state: See `AxisState`.
        error: Bits that are latched until they are cleared, as the heartbeat has them.
        motor_error, encoder_error, controller_error: What lies behind them; 0.5.
        disarm_reason: The errors that switched the motor off; 0.6.
        procedure_result: How the last request ended; 0.6.
        enable_watchdog, watchdog_timeout_s: Its watchdog, s.
        is_calibrated: Whether closed loop is possible at all.
        has_absolute_encoder: Whether it counts from the encoder's zero after power-on, not from where it stands.
        current_limit_a: Largest motor current, A.
        torque_limit_nm: Largest torque of the motor, N m, whatever its current.
        current_limit_margin_a: How far above that a current disarms the motor, A.
        velocity_limit_rev_s: Speed beyond which torque mode gives less torque.
        velocity_limit_tolerance: How many times that speed is too fast, where `enable_overspeed_error`.
        enable_torque_mode_velocity_limit: Whether that speed limits torque mode.
        counts_per_turn: Of the encoder.
        control_mode: What the input is.
        input_mode: How it is taken: as it is (1), or not at all.
        input_torque_nm: The set-point that is held until another comes.
        velocity_rev_s: Of the motor.
        supply_voltage: Of its board, V.
    """

    def __init__(self, release: Release, settings: OdriveWheelSettings, watchdog_s: float | None) -> None:
        """Make an axis as it is after power-on."""
        self.release = release
        self.firmware = release.firmware
        self.node_id = settings.node_id
        self.settings = settings
        self.enable_watchdog = watchdog_s is not None
        self.watchdog_timeout_s = watchdog_s or 0.0
        self.is_calibrated = True
        self.has_absolute_encoder = False
        self.torque_constant = settings.torque_constant or _TORQUE_CONSTANT
        largest = abs(settings.motor_torque(settings.max_torque))
        self.current_limit_a = _MORE_THAN_ASKED * largest / self.torque_constant
        self.torque_limit_nm = math.inf
        self.current_limit_margin_a = math.inf
        self.velocity_limit_rev_s = math.inf
        self.velocity_limit_tolerance = 1.2
        self.enable_overspeed_error = True
        self.enable_torque_mode_velocity_limit = True
        self.counts_per_turn = 8192
        self._motor_per_wheel = self.settings.motor(1.0)
        self.supply_voltage = SUPPLY_VOLTAGE
        self.restart()

    def restart(self) -> None:
        """Be as after power-on: idle, position mode, counting from here; the watchdog's time begins."""
        self.clear_errors()
        self.state = AxisState.IDLE
        self.procedure_result = 0
        self.control_mode = POSITION_CONTROL
        self.input_mode = 1
        self.input_torque_nm = 0.0
        self.input_velocity_rev_s = 0.0
        self.input_position_rev = 0.0
        self.velocity_rev_s = 0.0
        self._turns = 0.0
        self._origin_turns: float | None = None
        self._requested: AxisState | None = None
        self._requested_ns: int | None = None
        self._fed_ns: int | None = None
        self._has_closed_loop_run = False
        self._flowing_a = 0.0

    def factory_settings(self) -> None:
        """Have the limits of a new board, with fw-v0.5.6: 2 rev/s, 10 A, no watchdog (controller.hpp, motor.hpp)."""
        self.enable_watchdog, self.watchdog_timeout_s = False, 0.0
        self.velocity_limit_rev_s, self.current_limit_a, self.current_limit_margin_a = 2.0, 10.0, 8.0

    @property
    def watchdog_s(self) -> float | None:
        """Time-out of the watchdog, s; None where it is off."""
        return self.watchdog_timeout_s if self.enable_watchdog else None

    @watchdog_s.setter
    def watchdog_s(self, timeout_s: float | None) -> None:
        self.enable_watchdog = timeout_s is not None
        self.watchdog_timeout_s = timeout_s or 0.0

    @property
    def requested_state(self) -> int:
        """What was asked for and is still to be entered; writing it asks."""
        return int(self._requested or AxisState.UNDEFINED)

    @requested_state.setter
    def requested_state(self, state: int) -> None:
        self.request(state)

    @property
    def active_errors(self) -> int:
        """Errors whose cause lasts, or that were latched; 0.6."""
        return self.error & ~PASSING_ERRORS

    @property
    def counts(self) -> int:
        """Encoder counts since power-on."""
        return int((self._turns - (self._origin_turns or 0.0)) * self.counts_per_turn // 1)

    @property
    def position_rev(self) -> float:
        """Turns since power-on, as the encoder resolves them."""
        return self.counts / self.counts_per_turn

    @property
    def can_estimates(self) -> tuple[float, float]:
        """Position, rev, and velocity, rev/s, that CAN carries."""
        if self.release.estimates_need_closed_loop and not self._has_closed_loop_run:
            return 0.0, 0.0
        return self.position_rev, self.velocity_rev_s

    @property
    def torque_nm(self) -> float:
        """Torque of the motor now: nothing unless in closed loop, and without an error."""
        if self.state is not AxisState.CLOSED_LOOP_CONTROL or self.error:
            return 0.0
        limit, wanted = min(self.current_limit_a * self.torque_constant, self.torque_limit_nm), self._wanted()
        if -limit <= wanted <= limit:  # as in most ticks
            return wanted
        return min(max(wanted, -limit), limit)

    @property
    def current_a(self) -> float:
        """Motor current now."""
        return self.torque_nm / self.torque_constant

    @property
    def supply_current_a(self) -> float:
        """What it takes from the supply now, losses not counted."""
        power_w = self.torque_nm * self.velocity_rev_s * TURN
        return power_w / self.supply_voltage if self.supply_voltage else 0.0

    def move(self, angle: float, velocity: float) -> None:
        """Take where the wheel is, rad, and how fast it turns, rad/s."""
        per_wheel = self._motor_per_wheel
        self._turns, self.velocity_rev_s = angle * per_wheel / TURN, velocity * per_wheel / TURN
        if self._origin_turns is None:
            self._origin_turns = float(math.floor(self._turns)) if self.has_absolute_encoder else self._turns

    def feed(self, now_ns: int) -> None:
        """Start the watchdog's time anew."""
        self._fed_ns = now_ns

    def request(self, state: int) -> None:
        """Ask for a state; a new request takes an earlier complaint about a state back."""
        if self.firmware is Firmware.V0_5:
            self.error &= ~INVALID_STATE
        self._requested = AxisState(state) if state in set(AxisState) else AxisState.UNDEFINED
        self._requested_ns = None

    def set_input(
        self, torque_nm: float, velocity_rev_s: float | None = None, position_rev: float | None = None
    ) -> None:
        """Take a set-point of the motor, which counts only in the mode of the last one given; the others feed forward.

        Args:
            torque_nm: Torque, N m.
            velocity_rev_s: Velocity, rev/s; None leaves it.
            position_rev: Position, rev; None leaves it.
        """
        if self.input_mode:
            self.input_torque_nm = torque_nm
            self.input_velocity_rev_s = self.input_velocity_rev_s if velocity_rev_s is None else velocity_rev_s
            self.input_position_rev = self.input_position_rev if position_rev is None else position_rev

    def set_origin(self, position_rev: float) -> None:
        """Call the present position this."""
        self._origin_turns = self._turns - position_rev

    def latch(self, bits: int) -> None:
        """Raise errors: they stay until cleared, and the motor is off at once."""
        self.error |= bits
        if self.error and self.state is not AxisState.IDLE:
            self.disarm_reason |= self.error
            self.state = AxisState.IDLE

    def fail_motor(self, bits: int) -> None:
        """Raise errors of the motor of 0.5; `Motor::disarm_with_error`, fw-v0.5.6."""
        self.motor_error |= bits
        self.latch(MOTOR_FAILED)

    def exceed_current(self) -> None:
        """Raise the error of a current beyond its limit."""
        if self.firmware is Firmware.V0_5:
            self.fail_motor(CURRENT_LIMIT_VIOLATION)
        else:
            self.latch(CURRENT_LIMIT_VIOLATION)

    def clear_errors(self) -> None:
        """Forget the errors."""
        self.error = self.motor_error = self.encoder_error = self.controller_error = self.disarm_reason = 0

    def tick(self, now_ns: int) -> None:
        """One pass: the watchdog, in whatever state, the limits, then what was asked for."""
        if self._fed_ns is None:
            self._fed_ns = now_ns
        if self.error:
            self.latch(0)  # closed loop that was entered with an error ends
        if self.watchdog_s is not None and now_ns - self._fed_ns > self.watchdog_s * 1e9:
            self.latch(WATCHDOG[self.firmware])
        if self.state is AxisState.CLOSED_LOOP_CONTROL:
            self._check_limits()
        if self._requested is None:
            return
        if self._requested_ns is None:
            self._requested_ns = now_ns
        if now_ns - self._requested_ns >= _ENTER_NS:
            requested, self._requested = self._requested, None
            self._enter(requested, now_ns)

    def next_ns(self, now_ns: int) -> float:
        """When, after a pass now, the next one does anything: its torque stays, if no frame comes, until then."""
        is_closed = self.state is AxisState.CLOSED_LOOP_CONTROL
        follows_motion = is_closed and not (
            self.control_mode == TORQUE_CONTROL and self.velocity_limit_rev_s == self.current_limit_margin_a == math.inf
        )
        if self._fed_ns is None or follows_motion or (self.error and self.state is not AxisState.IDLE):
            return -math.inf
        next_ns = math.inf
        watchdog = WATCHDOG[self.firmware]
        if self.watchdog_s is not None and not self.error & watchdog:
            next_ns = self._fed_ns + self.watchdog_s * 1e9
        if self._requested is not None:
            next_ns = min(next_ns, (now_ns if self._requested_ns is None else self._requested_ns) + _ENTER_NS)
        return next_ns

    def _check_limits(self) -> None:
        """Speed (`Controller::update`) and current (`Motor::current_meas_cb`, of before the limit changed)."""
        too_fast = self.velocity_limit_tolerance * self.velocity_limit_rev_s
        if self.enable_overspeed_error and abs(self.velocity_rev_s) > too_fast:
            if self.firmware is Firmware.V0_5:
                self.controller_error |= CONTROLLER_OVERSPEED
                self.latch(CONTROLLER_FAILED)
            else:
                self.latch(VELOCITY_LIMIT_VIOLATION)
        if self.current_limit_margin_a == math.inf:
            return
        flowed_a, self._flowing_a = self._flowing_a, self.current_a
        if abs(flowed_a) > self.current_limit_a + self.current_limit_margin_a:
            self.exceed_current()

    def _enter(self, state: AxisState, now_ns: int) -> None:
        """Enter a state: `Axis::run_state_machine_loop`. 0.5 enters closed loop with an error too, and leaves it."""
        is_0_5 = self.firmware is Firmware.V0_5
        wants_loop = state is AxisState.CLOSED_LOOP_CONTROL
        if state is AxisState.IDLE:
            self.state, self.procedure_result = state, 0
        elif wants_loop and self.is_calibrated and (is_0_5 or not self.error):
            self.state, self.procedure_result = state, 0
            self._has_closed_loop_run = True
            self.input_position_rev = self.position_rev
            self.feed(now_ns)
        elif is_0_5:
            self.latch(INVALID_STATE)
        else:
            is_uncalibrated = wants_loop and not self.is_calibrated
            result = PROCEDURE_NOT_CALIBRATED if is_uncalibrated else PROCEDURE_INVALID_STATE
            self.state, self.procedure_result = AxisState.IDLE, result

    def _wanted(self) -> float:
        """The torque that the control mode makes of the input; velocity and position without integrators."""
        velocity = self.velocity_rev_s
        if self.control_mode == TORQUE_CONTROL:
            limit, torque_nm = self.velocity_limit_rev_s, self.input_torque_nm
            if not self.enable_torque_mode_velocity_limit:
                return torque_nm
            return min(max(torque_nm, _VELOCITY_GAIN * (-limit - velocity)), _VELOCITY_GAIN * (limit - velocity))
        wanted = self.input_velocity_rev_s
        if self.control_mode == POSITION_CONTROL:
            wanted += _POSITION_GAIN * (self.input_position_rev - self.position_rev)
        elif self.control_mode != VELOCITY_CONTROL:
            return 0.0
        return _VELOCITY_GAIN * (wanted - velocity) + self.input_torque_nm
