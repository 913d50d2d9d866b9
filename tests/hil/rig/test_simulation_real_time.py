# SPDX-License-Identifier: MIT
import os
from collections.abc import Sequence
from itertools import pairwise

import can
import pytest
from can.interfaces import virtual
from msgspec import structs

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.drives.wheel_board.frames import WheelCommand
from segway_ecc.firmware_io.drives.wheel_board.session import CommandSession
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.rig.simulation import RealTimePlant, devices_link, hardware_of, simulated_robot
from segway_ecc.node.config import RobotFile, load_robot

MS = 1_000_000
START_NS = 777 * MS
WALL_NS = 1_700_000_000_000_000_000


class ManualClock:
    """A clock that is moved by sleeping on it alone, and that oversleeps where it is told to."""

    def __init__(self, oversleep_ns: dict[int, int] | None = None) -> None:
        self.time_ns = START_NS
        self.sleeps = 0
        self._oversleep_ns = oversleep_ns or {}

    def now_ns(self) -> int:
        return self.time_ns

    def wall_ns(self) -> int:
        return WALL_NS + self.time_ns - START_NS

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.time_ns = max(self.time_ns, deadline_ns) + self._oversleep_ns.get(self.sleeps, 0)
        self.sleeps += 1


class Watch:
    """Sees every tick, and stops the plant after some."""

    def __init__(self, plant: RealTimePlant, ticks: int) -> None:
        self._plant, self._ticks = plant, ticks
        self.stamps: list[int] = []
        self.outputs: list[tuple[float, ...]] = []

    def __call__(self, wall_ns: int, outputs: Sequence[float]) -> None:
        self.stamps.append(wall_ns)
        self.outputs.append(tuple(outputs))
        if len(self.stamps) == self._ticks:
            self._plant.stop("enough")


def made(file: RobotFile, clock: Clock) -> RealTimePlant:
    """The plant of a robot file on the robot's own bus."""
    link = devices_link(hardware_of(file), clock)
    return RealTimePlant(simulated_robot(file, link), clock)


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> str:
    return f"{request.node.nodeid} {os.getpid()}"


@pytest.fixture
def file(channel: str) -> RobotFile:
    hardware = WheelBoardSettings(can=CanSettings(interface="virtual", channel=channel))
    return structs.replace(load_robot("cart-can"), hardware=hardware)


def test_ticks_every_five_milliseconds_from_the_start(file: RobotFile) -> None:
    clock = ManualClock()
    plant = made(file, clock)
    watch = Watch(plant, 10)
    plant.robot.link.open()
    plant.run(watch)

    assert watch.stamps == [WALL_NS + n * 5 * MS for n in range(10)]
    assert (plant.ticks, plant.late, clock.time_ns) == (10, 0, START_NS + 45 * MS)


def test_late_ticks_are_made_up_for_and_counted(file: RobotFile) -> None:
    # The third tick is 17 ms late; those due 5 and 10 ms after it are late by 12 and 7, the next by 2 only.
    plant = made(file, ManualClock({2: 17 * MS}))
    watch = Watch(plant, 10)
    plant.robot.link.open()
    plant.run(watch)

    assert watch.stamps == [WALL_NS + n * 5 * MS for n in range(10)], "each stamp is when the tick was due"
    assert (plant.ticks, plant.late) == (10, 3)


@pytest.mark.parametrize(("oversleep_ns", "late"), [(5 * MS, 0), (5 * MS + 1, 1)])
def test_late_is_more_than_a_whole_tick(file: RobotFile, oversleep_ns: int, late: int) -> None:
    plant = made(file, ManualClock({3: oversleep_ns}))
    plant.robot.link.open()
    plant.run(Watch(plant, 10))
    assert plant.late == late


def test_devices_have_the_last_of_the_ticks_that_are_made_up_for(file: RobotFile) -> None:
    plant = made(file, ManualClock({2: 17 * MS}))
    coast, tick, passes = plant.robot.coast, plant.robot.tick, list[str]()

    def coasted() -> None:
        passes.append("plant")
        coast()

    def ticked(now_ns: int) -> None:
        passes.append("devices")
        tick(now_ns)

    plant.robot.coast, plant.robot.tick = coasted, ticked  # type: ignore[method-assign]
    plant.robot.link.open()
    plant.run(Watch(plant, 8))
    assert passes == ["devices"] * 2 + ["plant"] * 3 + ["devices"] * 3


def test_a_plant_that_never_catches_up_has_devices_all_the_same(file: RobotFile) -> None:
    plant = made(file, ManualClock(dict.fromkeys(range(1000), 7 * MS)))
    passes: list[int] = []

    def ticked(_now_ns: int) -> None:
        passes.append(plant.ticks)

    plant.robot.tick = ticked  # type: ignore[method-assign, assignment]
    plant.robot.link.open()
    plant.run(Watch(plant, 1_000))
    assert plant.late == 1_000
    assert max(later - earlier for earlier, later in pairwise(passes)) == 20, "100 ms of the plant"


def test_telemetry_goes_over_the_bus_and_the_bus_is_closed_in_the_end(file: RobotFile, channel: str) -> None:
    plant = made(file, ManualClock())
    plant.robot.link.open()
    with can.Bus(interface="virtual", channel=channel) as host:
        plant.run(Watch(plant, 8))
        assert len(virtual.channels[channel]) == 1, "only the host is left on the bus"
        heard = []
        while (message := host.recv(0)) is not None:
            heard.append(message.arbitration_id)
    assert [heard.count(frame_id) for frame_id in (0x120, 0x121, 0x130, 0x131)] == [8, 8, 2, 2]
    assert len(heard) == 20


def test_commands_move_the_plant_and_damaged_ones_are_counted(file: RobotFile, channel: str) -> None:
    plant = made(file, ManualClock())
    watch = Watch(plant, 8)
    plant.robot.link.open()
    session = CommandSession()
    session.begin(1)
    off = session.command(WheelCommand(0.0, 0.0, enable=False))
    left, right = session.command(WheelCommand(6.0, 6.0, enable=True))
    damaged = structs.replace(right, data=right.data[:-1] + bytes((right.data[-1] ^ 1,)))
    with can.Bus(interface="virtual", channel=channel) as host:
        for sent in (*off, left, right, damaged):
            host.send(can.Message(arbitration_id=sent.arbitration_id, data=sent.data, is_extended_id=False))
        plant.run(watch)

    assert plant.robot.refused_frames == 1
    ahead = [outputs[plant.robot.output_names.index("truth.x")] for outputs in watch.outputs]
    assert ahead == sorted(ahead)
    assert ahead[-1] > ahead[0] > 0


def test_stopped_before_it_runs_it_does_not_tick(file: RobotFile, channel: str) -> None:
    plant = made(file, ManualClock())
    plant.robot.link.open()
    plant.stop()
    plant.run(None)
    assert plant.ticks == 0
    assert channel not in virtual.channels


def test_runs_unobserved_until_it_is_stopped(file: RobotFile) -> None:
    class StoppingClock(ManualClock):
        def sleep_until_ns(self, deadline_ns: int) -> None:
            super().sleep_until_ns(deadline_ns)
            if self.sleeps == 3:
                plant.stop()

    plant = made(file, StoppingClock())
    plant.robot.link.open()
    plant.run(None)
    assert plant.ticks == 3, "the present tick is finished"


def test_a_failing_observer_leaves_no_bus_open(file: RobotFile, channel: str) -> None:
    def observe(_wall_ns: int, _outputs: Sequence[float]) -> None:
        raise OSError("disk full")

    plant = made(file, ManualClock())
    plant.robot.link.open()
    with pytest.raises(OSError, match="disk full"):
        plant.run(observe)
    assert channel not in virtual.channels


def test_reports_its_bus_and_its_outputs(file: RobotFile, channel: str) -> None:
    plant = made(file, ManualClock())
    assert plant.robot.link.description == f"virtual {channel}"
    assert plant.robot.output_names[:4] == ["left.angle", "left.velocity", "right.angle", "right.velocity"]


def test_a_bus_that_is_not_there_is_refused_on_opening(file: RobotFile) -> None:
    hardware = WheelBoardSettings(can=CanSettings(interface="slcan", channel="/no/such/port"))
    plant = made(structs.replace(file, hardware=hardware), ManualClock())
    with pytest.raises(BusNotFoundError, match="/no/such/port"):
        plant.robot.link.open()


def test_the_motors_inputs_are_traced_with_the_real_start_of_the_tick(file: RobotFile) -> None:
    plant = made(file, ManualClock({1: 2 * MS}))
    told: list[tuple[int, int, tuple[float, ...]]] = []

    def trace(monotonic_ns: int, wall_ns: int, inputs: Sequence[float]) -> None:
        told.append((monotonic_ns, wall_ns, tuple(inputs)))

    plant.robot.link.open()
    plant.run(Watch(plant, 3), trace)

    began = [0, 7 * MS, 10 * MS]
    assert told == [(START_NS + ns, WALL_NS + ns, (0.0, 0.0)) for ns in began]


def test_what_is_done_before_a_tick_is_in_force_in_it(file: RobotFile, channel: str) -> None:
    plant = made(file, ManualClock())
    calls: list[int] = []

    def before_tick() -> None:
        calls.append(plant.ticks)
        if plant.ticks == 2:
            plant.robot.stuck["left.velocity"] = 50.0

    plant.robot.link.open()
    with can.Bus(interface="virtual", channel=channel) as host:
        plant.run(Watch(plant, 4), None, before_tick)
        speeds = [int.from_bytes(m.data[4:6], "little") for m in iter(lambda: host.recv(0), None) if is_left(m)]

    assert calls == [0, 1, 2, 3]
    assert speeds == [0, 0, 5000, 5000]  # 0.01 rad/s


def is_left(message: can.Message) -> bool:
    return message.arbitration_id == 0x120
