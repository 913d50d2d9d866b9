"""A wheel board with a plant behind it, as its firmware would behave."""

from collections.abc import Sequence
from typing import Final

from firmware_io.drives.wheel_board.endpoint import Endpoint, Received
from firmware_io.drives.wheel_board.frames import (
    CYCLE_TIME_S,
    MAX_ANGLE,
    MAX_VELOCITY,
    BoardSetup,
    BoardState,
    BoardStatus,
    FrameId,
    Wheel,
    WheelCommand,
)
from firmware_io.links.link import Link
from hil.errors import PlantMismatchError
from node.model.model import Model

TICK_NS: Final = 5_000_000
"""Period of the firmware's loop, and of the wheel frames."""
SUPPLY_VOLTAGE: Final = 36.0
"""Above the range of commands, so that the motors get what they are told."""
_DEFAULT_WATCHDOG_S: Final = 0.05
_STATUS_TICKS: Final = round(CYCLE_TIME_S[FrameId.BOARD_STATUS] * 1e9 / TICK_NS)
_COMMANDS: Final = ("left.voltage", "right.voltage")
_SIGNALS: Final = ("left.angle", "left.velocity", "right.angle", "right.velocity")
_OFF: Final = (0.0, 0.0)


class SimulatedWheelBoard:
    """Takes commands, runs its watchdog, steps its plant and sends telemetry, one tick at a time.

    Attributes:
        state: What the board is doing.
        voltages: What its motors are given, V.
        outputs: The plant's newest outputs, in the plant's order.
    """

    def __init__(self, link: Link, plant: Model) -> None:
        """Put a plant behind a board on `link`.

        Raises:
            PlantMismatchError: The plant lacks a port, or its step does not divide the board's tick.
        """
        _check(plant)
        self.state = BoardState.DISABLED
        self.voltages: Sequence[float] = _OFF
        self.outputs = plant.initialize(_OFF)
        self._plant = plant
        self._signals = [[v.name for v in plant.outputs].index(name) for name in _SIGNALS]
        self._steps = round(TICK_NS * 1e-9 / plant.step_size)
        self._endpoint = Endpoint(link, frozenset({FrameId.WHEEL_COMMAND, FrameId.BOARD_SETUP}))
        self._watchdog_s = _DEFAULT_WATCHDOG_S
        self._last_command_ns: int | None = None
        self._ticks = 0

    @property
    def refused_frames(self) -> int:
        """Frames refused since power-on."""
        return sum(self._endpoint.refused.values())

    def tick(self, now_ns: int) -> None:
        """One pass of the firmware's loop at time `now_ns`, on the clock that stamps the link's frames."""
        for received in self._endpoint.receive():
            self._obey(received, now_ns)
        self._watch(now_ns)
        for _ in range(self._steps):
            self.outputs = self._plant.step(self.voltages)
        self._tell()
        self._ticks += 1

    def _obey(self, received: Received, now_ns: int) -> None:
        match received.payload:
            case WheelCommand(left, right, enable):
                self._last_command_ns = now_ns
                if not enable:
                    self._switch_off(BoardState.DISABLED)
                elif self.state in (BoardState.DISABLED, BoardState.ENABLED):
                    self.state = BoardState.ENABLED
                    self.voltages = (left, right)
            case BoardSetup(watchdog_s) if self.state is not BoardState.ENABLED:
                self._watchdog_s = watchdog_s

    def _watch(self, now_ns: int) -> None:
        if self.state is not BoardState.ENABLED or self._last_command_ns is None:
            return
        if now_ns - self._last_command_ns > self._watchdog_s * 1e9:
            self._switch_off(BoardState.WATCHDOG)

    def _switch_off(self, state: BoardState) -> None:
        self.state = state
        self.voltages = _OFF

    def _tell(self) -> None:
        left_angle, left_velocity, right_angle, right_velocity = (self.outputs[index] for index in self._signals)
        self._endpoint.send(FrameId.LEFT_WHEEL, _measured(left_angle, left_velocity))
        self._endpoint.send(FrameId.RIGHT_WHEEL, _measured(right_angle, right_velocity))
        if self._ticks % _STATUS_TICKS == 0:
            status = BoardStatus(self.state, SUPPLY_VOLTAGE, self._watchdog_s, self.refused_frames)
            self._endpoint.send(FrameId.BOARD_STATUS, status)


def _measured(angle: float, velocity: float) -> Wheel:
    """What the board tells of a wheel: its counters stop at the ends of their range."""
    return Wheel(min(max(angle, -MAX_ANGLE), MAX_ANGLE), min(max(velocity, -MAX_VELOCITY), MAX_VELOCITY))


def _check(plant: Model) -> None:
    if tuple(v.name for v in plant.inputs) != _COMMANDS:
        raise PlantMismatchError(f"the inputs of plant '{plant.name}' must be {', '.join(_COMMANDS)}, in this order")
    names = [v.name for v in plant.outputs]
    missing = [name for name in _SIGNALS if name not in names]
    if missing:
        raise PlantMismatchError(f"plant '{plant.name}' has no output {', '.join(missing)}; it has {', '.join(names)}")
    if TICK_NS % round(plant.step_size * 1e9) != 0:
        raise PlantMismatchError(
            f"the step of plant '{plant.name}', {plant.step_size} s, must divide the board's tick, {TICK_NS * 1e-9} s"
        )
