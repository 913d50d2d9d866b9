from collections.abc import Sequence
from typing import ClassVar

import pytest

from firmware_io.drives.wheel_board.endpoint import Endpoint
from firmware_io.drives.wheel_board.frames import (
    BoardSetup,
    BoardState,
    BoardStatus,
    FrameId,
    Payload,
    Wheel,
    WheelCommand,
    encode,
)
from firmware_io.links.link import Frame
from hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from hil.errors import PlantMismatchError
from hil.simulated_bus import SimulatedBus
from node.model.sectioned import SectionedModel
from node.model.variables import Variable

ON = WheelCommand(3.0, -4.0, enable=True)
OFF = WheelCommand(3.0, -4.0, enable=False)
VOLTS = Variable("left.voltage", "V"), Variable("right.voltage", "V")
SIGNALS = tuple(Variable(name) for name in ("left.angle", "left.velocity", "right.angle", "right.velocity"))


class Plant(SectionedModel):
    """Remembers what it is given, and tells constants; its outputs stand in no particular order."""

    name = "bench"
    step_size = 0.001
    inputs: ClassVar[Sequence[Variable]] = VOLTS
    outputs: ClassVar[Sequence[Variable]] = (Variable("steps"), *reversed(SIGNALS))

    def initial(self) -> None:
        self.given: list[tuple[float, ...]] = []

    def input(self, u: Sequence[float]) -> None:
        self.given.append(tuple(u))

    def output(self) -> Sequence[float]:
        return (len(self.given) - 1.0, 4.0, 3.0, 2.0, 1.0)


class Bench:
    """A board on a bus so fast that what is sent has arrived before the next tick."""

    def __init__(self) -> None:
        self.now_ns = 0
        bus = SimulatedBus(1_000_000_000, lambda: self.now_ns)
        self.host_link = bus.attach("host")
        telemetry = frozenset({FrameId.LEFT_WHEEL, FrameId.RIGHT_WHEEL, FrameId.BOARD_STATUS})
        self.host = Endpoint(self.host_link, telemetry)
        self.plant = Plant()
        self.board = SimulatedWheelBoard(bus.attach("board"), self.plant)

    def tick(self, *commands: WheelCommand, times: int = 1) -> None:
        """Send commands, and let the board tick one period later."""
        for command in commands:
            self.host.send(FrameId.WHEEL_COMMAND, command)
        for _ in range(times):
            self.now_ns += TICK_NS
            self.board.tick(self.now_ns)

    def motors(self) -> tuple[BoardState, tuple[float, ...]]:
        """The board's state and what its motors are given."""
        return self.board.state, tuple(self.board.voltages)

    def heard(self) -> list[tuple[FrameId, Payload]]:
        """All telemetry so far, since it was last asked for."""
        self.now_ns += 1_000
        return [(received.frame_id, received.payload) for received in self.host.receive()]

    def status(self) -> BoardStatus:
        """Tick until the board tells its status."""
        self.heard()
        self.tick(times=4)
        (status,) = (payload for _, payload in self.heard() if isinstance(payload, BoardStatus))
        return status


class RunawayPlant(Plant):
    """Beyond what the frames can tell."""

    def output(self) -> Sequence[float]:
        return (0.0, 321.0, -200_001.0, -321.0, 200_001.0)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_wheels_are_told_every_tick_and_the_status_every_twenty_milliseconds(bench: Bench) -> None:
    bench.tick(times=8)
    ids = [frame_id for frame_id, _ in bench.heard()]
    wheels, status = [FrameId.LEFT_WHEEL, FrameId.RIGHT_WHEEL], [FrameId.BOARD_STATUS]
    assert ids == 2 * (wheels + status + 3 * wheels)
    assert TICK_NS == 5_000_000


def test_a_plant_beyond_the_range_of_the_frames_is_told_at_its_end() -> None:
    now_ns = 0
    bus = SimulatedBus(1_000_000_000, lambda: now_ns)
    host = Endpoint(bus.attach("host"), frozenset({FrameId.LEFT_WHEEL, FrameId.RIGHT_WHEEL}))
    SimulatedWheelBoard(bus.attach("board"), RunawayPlant()).tick(0)
    now_ns = TICK_NS
    assert [received.payload for received in host.receive()] == [Wheel(200_000.0, -320.0), Wheel(-200_000.0, 320.0)]


def test_signals_are_found_by_name(bench: Bench) -> None:
    bench.tick()
    told = dict(bench.heard())
    for frame_id, expected in ((FrameId.LEFT_WHEEL, (1.0, 2.0)), (FrameId.RIGHT_WHEEL, (3.0, 4.0))):
        wheel = told[frame_id]
        assert isinstance(wheel, Wheel)
        assert wheel == pytest.approx(expected)


def test_the_plant_makes_as_many_steps_as_fit_a_tick_under_the_newest_voltages(bench: Bench) -> None:
    bench.tick()
    bench.tick(ON)
    assert bench.plant.given[1:] == [(0.0, 0.0)] * 5 + [(3.0, -4.0)] * 5
    assert bench.board.outputs[0] == 10


def test_starts_with_its_motors_off_and_stays_so_without_a_command(bench: Bench) -> None:
    bench.tick(times=100)
    assert bench.motors()[0] is BoardState.DISABLED
    assert set(bench.plant.given) == {(0.0, 0.0)}


def test_motors_get_the_voltages_of_an_enabling_command(bench: Bench) -> None:
    bench.tick(ON)
    assert bench.motors() == (BoardState.ENABLED, (3.0, -4.0))
    bench.tick(WheelCommand(-1.0, 2.0, enable=True))
    assert tuple(bench.board.voltages) == (-1.0, 2.0)


def test_a_command_that_does_not_enable_switches_off_whatever_its_voltages_say(bench: Bench) -> None:
    bench.tick(OFF)
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0))
    bench.tick(ON)
    bench.tick(OFF)
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0))


def test_of_commands_in_one_tick_the_last_one_counts(bench: Bench) -> None:
    bench.tick(ON, OFF)
    assert bench.motors()[0] is BoardState.DISABLED
    bench.tick(OFF, ON)
    assert bench.motors()[0] is BoardState.ENABLED


@pytest.mark.parametrize(("watchdog_s", "ticks"), [(None, 10), (0.05, 10), (0.02, 4), (0.1, 20)])
def test_the_watchdog_switches_off_once_the_time_has_passed(bench: Bench, watchdog_s: float | None, ticks: int) -> None:
    if watchdog_s is not None:
        bench.host.send(FrameId.BOARD_SETUP, BoardSetup(watchdog_s))
        bench.tick()
    bench.tick(ON)

    bench.tick(times=ticks)
    assert bench.motors() == (BoardState.ENABLED, (3.0, -4.0))
    bench.tick()
    assert bench.motors() == (BoardState.WATCHDOG, (0.0, 0.0))
    assert bench.plant.given[-1] == (0.0, 0.0)


def test_commands_in_time_keep_the_watchdog_quiet(bench: Bench) -> None:
    for _ in range(10):
        bench.tick(ON, times=10)
    assert bench.motors()[0] is BoardState.ENABLED


def test_an_expired_watchdog_is_left_only_through_a_command_that_does_not_enable(bench: Bench) -> None:
    bench.tick(ON, times=12)
    bench.tick(ON)
    assert bench.motors() == (BoardState.WATCHDOG, (0.0, 0.0))
    bench.tick(OFF)
    assert bench.motors()[0] is BoardState.DISABLED
    bench.tick(ON)
    assert bench.motors()[0] is BoardState.ENABLED


def test_the_watchdog_is_set_while_disabled_only_and_told_in_the_status(bench: Bench) -> None:
    assert bench.status().watchdog_s == pytest.approx(0.05)
    bench.host.send(FrameId.BOARD_SETUP, BoardSetup(0.03))
    assert bench.status() == pytest.approx((BoardState.DISABLED, 36.0, 0.03, 0))

    bench.tick(ON)
    bench.host.send(FrameId.BOARD_SETUP, BoardSetup(1.0))
    status = bench.status()
    assert status == pytest.approx((BoardState.ENABLED, 36.0, 0.03, 0))


def test_the_status_tells_an_expired_watchdog(bench: Bench) -> None:
    bench.tick(ON, times=12)
    assert bench.status().state is BoardState.WATCHDOG


def test_refused_frames_are_counted_told_and_do_not_feed_the_watchdog(bench: Bench) -> None:
    bench.tick(ON)
    damaged = bytearray(encode(FrameId.WHEEL_COMMAND, ON, 1))
    damaged[0] ^= 1
    for _ in range(11):
        bench.host_link.send(Frame(FrameId.WHEEL_COMMAND, bytes(damaged)))
        bench.tick()
    bench.host_link.send(Frame(FrameId.BOARD_SETUP, b"short"))
    status = bench.status()

    assert bench.motors()[0] is BoardState.WATCHDOG
    assert bench.board.refused_frames == status.refused_frames == 12


def test_foreign_frames_are_nobodys_fault(bench: Bench) -> None:
    bench.host_link.send(Frame(0x7FF, b"whatever"))
    bench.tick()
    assert bench.board.refused_frames == 0


class SwappedPlant(Plant):
    name = "swapped"
    inputs = VOLTS[::-1]


class InputlessPlant(Plant):
    name = "inputless"
    inputs: ClassVar[Sequence[Variable]] = ()


class HalfBlindPlant(Plant):
    name = "half-blind"
    outputs = SIGNALS[:1]


class CoarsePlant(Plant):
    name = "coarse"
    step_size = 0.01


class OddPlant(Plant):
    name = "odd"
    step_size = 0.003


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        (SwappedPlant, "the inputs of plant 'swapped' must be left.voltage, right.voltage, in this order"),
        (InputlessPlant, "the inputs of plant 'inputless' must be left.voltage, right.voltage, in this order"),
        (
            HalfBlindPlant,
            "plant 'half-blind' has no output left.velocity, right.angle, right.velocity; it has left.angle",
        ),
        (CoarsePlant, "the step of plant 'coarse', 0.01 s, must divide the board's tick, 0.005 s"),
        (OddPlant, "the step of plant 'odd', 0.003 s, must divide the board's tick, 0.005 s"),
    ],
)
def test_a_plant_that_does_not_fit_is_told_what_is_missing(plant: type[Plant], message: str) -> None:
    with pytest.raises(PlantMismatchError) as error:
        SimulatedWheelBoard(SimulatedBus(500_000, lambda: 0).attach("board"), plant())
    assert str(error.value) == message
