"""The wheel board as `Hardware`: arm, command, disarm."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from firmware_io.drives.wheel_board.endpoint import Endpoint, Received
from firmware_io.drives.wheel_board.frames import BoardSetup, BoardState, BoardStatus, FrameId, Wheel, WheelCommand
from firmware_io.drives.wheel_board.limits import COMMAND_LIMITS, WATCHDOG_ALLOWED_S, stale_after_ns
from firmware_io.errors import ArmingRefusedError
from firmware_io.hardware import Sensors
from firmware_io.links.link import Link

_TELEMETRY: Final = frozenset({FrameId.LEFT_WHEEL, FrameId.RIGHT_WHEEL, FrameId.BOARD_STATUS})
_ZERO: Final = WheelCommand(0.0, 0.0, enable=False)
_OFF_BY_ITSELF: Final = frozenset({BoardState.WATCHDOG, BoardState.FAULT})
_WATCHDOG_RESOLUTION_S: Final = 0.000501  # half a step of the frame, and room for what floats add


class WheelBoard:
    """Two voltage-driven wheels behind one board; see `Hardware`."""

    signals: Mapping[str, str] = {
        "left.angle": "rad",
        "left.velocity": "rad/s",
        "right.angle": "rad",
        "right.velocity": "rad/s",
    }
    commands: Mapping[str, str] = {"left.voltage": "V", "right.voltage": "V"}
    limits: Sequence[float] = tuple(COMMAND_LIMITS.values())

    def __init__(
        self, link: Link, watchdog_s: float, loop_period_s: float, now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """Drive the board at the other end of `link`, its watchdog set to `watchdog_s` (0.02 to 0.05 s)."""
        self._link = link
        self._endpoint = Endpoint(link, _TELEMETRY)
        self._watchdog_s = watchdog_s
        self._now_ns = now_ns
        self._stale_ns = {frame_id: stale_after_ns(frame_id, loop_period_s) for frame_id in _TELEMETRY}
        self._wheels = {FrameId.LEFT_WHEEL: Wheel(0.0, 0.0), FrameId.RIGHT_WHEEL: Wheel(0.0, 0.0)}
        self._status = BoardStatus(BoardState.DISABLED, 0.0, 0.0, 0)
        self._received_ns: dict[FrameId, int] = {}
        self._enabled = False

    def open(self) -> None:
        """Open the link, send zero, and set the watchdog; see `Hardware.open`."""
        self._link.open()
        self._send(_ZERO)
        self._endpoint.send(FrameId.BOARD_SETUP, BoardSetup(self._watchdog_s))

    def exchange(self, commands: Sequence[float] | None) -> Sensors:
        """Send the voltages and return the newest snapshot; see `Hardware.exchange`."""
        for received in self._endpoint.receive():
            self._keep(received)
        if commands is not None:
            self._send(WheelCommand(commands[0], commands[1], enable=True) if self._enabled else _ZERO)
        return self._snapshot()

    def arm(self) -> None:
        """Enable the motors; see `Hardware.arm`."""
        reasons = self._obstacles()
        if reasons:
            raise ArmingRefusedError(reasons)
        self._enabled = True

    def disarm(self) -> None:
        """Send zero with the motors off."""
        self._enabled = False
        self._send(_ZERO)

    def close(self) -> None:
        """Disarm and close the link."""
        self.disarm()
        self._link.close()

    @property
    def health(self) -> Mapping[str, str]:
        """The link's and the board's state for diagnostics."""
        counters = {f"link.{name}": text for name, text in self._link.counters.as_text().items()}
        refused = {f"refused.{cause}": str(count) for cause, count in self._endpoint.refused.items()}
        return {
            "link": self._link.description,
            **counters,
            **refused,
            "link.lost": str(self._endpoint.lost),
            "board.state": self._status.state.name,
            "board.bus_voltage_v": f"{self._status.bus_voltage:.3f}",
            "board.watchdog_s": f"{self._status.watchdog_s:.3f}",
            "board.refused_frames": str(self._status.refused_frames),
        }

    def _send(self, command: WheelCommand) -> None:
        self._endpoint.send(FrameId.WHEEL_COMMAND, command)

    def _keep(self, received: Received) -> None:
        self._received_ns[received.frame_id] = received.received_ns
        match received.payload:
            case Wheel():
                self._wheels[received.frame_id] = received.payload
            case BoardStatus(watchdog_s=in_force):
                self._status = received.payload
                if abs(in_force - self._watchdog_s) > _WATCHDOG_RESOLUTION_S and not self._enabled:
                    # The board was switched on after us, or missed the frame.
                    self._endpoint.send(FrameId.BOARD_SETUP, BoardSetup(self._watchdog_s))

    def _snapshot(self) -> Sensors:
        left, right = self._wheels[FrameId.LEFT_WHEEL], self._wheels[FrameId.RIGHT_WHEEL]
        left_age, left_valid = self._age(FrameId.LEFT_WHEEL)
        right_age, right_valid = self._age(FrameId.RIGHT_WHEEL)
        return Sensors(
            (left.angle, left.velocity, right.angle, right.velocity),
            (left_age, left_age, right_age, right_age),
            (left_valid, left_valid, right_valid, right_valid),
            self._faults(),
        )

    def _faults(self) -> tuple[str, ...]:
        if not self._enabled:
            return ()
        if self._status.state in _OFF_BY_ITSELF:
            return (f"the wheel board switched its motors off: {self._status.state.name}",)
        age_s, valid = self._age(FrameId.BOARD_STATUS)
        return () if valid else (f"the wheel board's status is too old: {age_s * 1e3:.0f} ms",)

    def _age(self, frame_id: FrameId) -> tuple[float, bool]:
        received_ns = self._received_ns.get(frame_id)
        if received_ns is None:
            return math.inf, False
        age_ns = self._now_ns() - received_ns
        return age_ns * 1e-9, age_ns <= self._stale_ns[frame_id]

    def _obstacles(self) -> list[str]:
        if not self._age(FrameId.BOARD_STATUS)[1]:
            return [f"the wheel board does not answer on {self._link.description}; is it powered and on this bus?"]
        reasons = []
        low, high = WATCHDOG_ALLOWED_S
        if not low - _WATCHDOG_RESOLUTION_S <= self._status.watchdog_s <= high + _WATCHDOG_RESOLUTION_S:
            reasons.append(
                f"the board's watchdog stands at {self._status.watchdog_s:g} s, allowed is {low:g} to {high:g} s; "
                "does its firmware take BOARD_SETUP?"
            )
        if self._status.state in _OFF_BY_ITSELF:
            reasons.append(f"the board reports {self._status.state.name}; if it stays, switch it off and on")
        return reasons
