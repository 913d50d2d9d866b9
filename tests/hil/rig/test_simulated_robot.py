# SPDX-License-Identifier: MIT
import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import pytest

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulated_bus import SimulatedBus, SimulatedLink
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import SectionedModel

TICK_NS = 5_000_000


class Plant(SectionedModel):
    """Remembers what it is given; tells the number of its steps, and a constant."""

    name = "bench"
    step_size = 0.005
    inputs: ClassVar[Sequence[Variable]] = (Variable("left"), Variable("right"), Variable("lift"))
    outputs: ClassVar[Sequence[Variable]] = (Variable("height"), Variable("steps"))

    def initial(self) -> None:
        self.given: list[tuple[float, ...]] = []

    def input(self, u: Sequence[float]) -> None:
        self.given.append(tuple(u))

    def output(self) -> Sequence[float]:
        return (7.0, len(self.given) - 1.0)


class FinePlant(Plant):
    """Five steps a tick."""

    step_size = 0.001


class AdvancingPlant(FinePlant):
    """Makes its steps at once, and remembers how many."""

    def initial(self) -> None:
        super().initial()
        self.batches: list[int] = []

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        self.batches.append(steps)
        for _ in range(steps):
            outputs = self.step(u)
        return outputs


class CoarsePlant(Plant):
    """A step every second tick."""

    step_size = 0.01


class OddPlant(Plant):
    """Neither divides the other."""

    name = "odd"
    step_size = 0.003


class IdlePlant(Plant):
    """Takes nothing."""

    name = "idle"
    inputs: ClassVar[Sequence[Variable]] = ()


class Motors:
    """Gives what it is set to; remembers all it is told."""

    def __init__(self, inputs: Sequence[str], values: Sequence[float], needs: Sequence[str] = ()) -> None:
        self.inputs, self.needs = inputs, needs
        self.values = values
        self.refused_frames = 0
        self.heard: list[Sequence[Frame]] = []
        self.calls: list[tuple[str, int, float]] = []

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        self.heard.append(frames)
        self.calls.append(("obey", now_ns, outputs["steps"]))
        return self.values

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        self.calls.append(("tell", now_ns, outputs["steps"]))


class Sleeper(Motors):
    """Needs no pass before a time, and sets the next one in each pass."""

    next_ns = -math.inf
    period_ns = 3 * TICK_NS

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        super().send_telemetry(now_ns, outputs)
        self.next_ns = now_ns + self.period_ns


class UnseenPlant(Plant):
    """Knows which of its steps nobody looked at."""

    def initial(self) -> None:
        super().initial()
        self.unseen: list[int] = []

    def advance_unseen(self, u: Sequence[float], steps: int) -> Sequence[float]:
        assert steps == 1
        self.unseen.append(len(self.given))
        return self.step(u)


class LosableLink(LinkFront):
    """A link that is lost while it is told to be."""

    is_lost = False

    def receive(self) -> list[Frame]:
        if self.is_lost:
            raise LinkLostError("gone")
        return super().receive()


class Bench:
    """Two devices before a plant, on a bus so fast that what is sent has arrived before the next tick."""

    def __init__(self, plant: Plant | None = None, motors: type[Motors] = Motors) -> None:
        self.now_ns = 0
        bus = SimulatedBus(1_000_000_000, lambda: self.now_ns)
        self.host: SimulatedLink = bus.attach("host")
        self.link = LosableLink(bus.attach("devices"))
        self.plant = plant or Plant()
        self.drive = motors(["right", "left"], (2.0, 1.0), ["steps"])
        self.lift = motors(["lift"], (3.0,), ["height"])
        devices: Sequence[Device] = [self.drive, self.lift]
        self.robot = SimulatedRobot(self.link, devices, self.plant, TICK_NS)

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.now_ns += TICK_NS
            self.robot.tick(self.now_ns)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_before_the_first_tick_the_plant_rests_without_input(bench: Bench) -> None:
    assert bench.drive.calls == []
    assert bench.plant.given == [(0.0, 0.0, 0.0)]
    assert bench.robot.outputs == [7.0, 0.0]
    assert bench.robot.output_names == ["height", "steps"]
    assert bench.robot.link is bench.link
    assert bench.robot.tick_ns == TICK_NS


def test_each_device_gives_its_own_inputs_of_the_plant_by_name(bench: Bench) -> None:
    bench.tick()
    assert bench.plant.given[1:] == [(1.0, 2.0, 3.0)]
    bench.lift.values = (-3.0,)
    bench.tick()
    assert bench.plant.given[2:] == [(1.0, 2.0, -3.0)]
    assert bench.robot.inputs == [1.0, 2.0, -3.0]


def test_devices_obey_before_the_plants_step_and_send_after_it(bench: Bench) -> None:
    bench.tick(2)
    expected = [("obey", TICK_NS, 0.0), ("tell", TICK_NS, 1.0), ("obey", 2 * TICK_NS, 1.0), ("tell", 2 * TICK_NS, 2.0)]
    assert bench.drive.calls == bench.lift.calls == expected


def test_a_fine_plant_makes_as_many_steps_as_fit_a_tick() -> None:
    bench = Bench(FinePlant())
    bench.tick(2)
    assert len(bench.plant.given[1:]) == 10
    assert bench.drive.calls[-1] == ("tell", 2 * TICK_NS, 10.0)


def test_a_plant_that_can_makes_all_steps_of_a_tick_at_once() -> None:
    plant = AdvancingPlant()
    bench = Bench(plant)
    bench.tick(2)
    assert plant.batches == [5, 5]
    assert bench.drive.calls[-1] == ("tell", 2 * TICK_NS, 10.0)


def test_a_plant_that_is_put_in_anothers_place_is_the_one_that_steps(bench: Bench) -> None:
    other = AdvancingPlant()
    other.initialize((0.0, 0.0, 0.0))
    bench.robot.plant = other
    assert bench.robot.plant is other
    bench.tick()
    assert bench.plant.given[1:] == []
    assert other.given[1:] == [(1.0, 2.0, 3.0)]
    assert other.batches == [1]


def test_devices_find_the_newest_outputs_whoever_made_them_and_what_is_stuck(bench: Bench) -> None:
    bench.tick()
    bench.robot.outputs = [8.0, 40.0]
    bench.tick()
    bench.robot.stuck["steps"] = -1.0
    bench.tick()
    bench.robot.stuck.clear()
    bench.tick()
    assert [steps for _, _, steps in bench.drive.calls] == [0.0, 1.0, 40.0, 2.0, -1.0, -1.0, 3.0, 4.0]


def test_a_coarse_plant_steps_only_when_its_time_has_passed() -> None:
    bench = Bench(CoarsePlant())
    bench.tick()
    assert bench.plant.given[1:] == []
    assert bench.drive.calls[-1] == ("tell", TICK_NS, 0.0)
    bench.tick()
    assert bench.plant.given[1:] == [(1.0, 2.0, 3.0)]
    assert bench.drive.calls[-1] == ("tell", 2 * TICK_NS, 1.0)
    bench.tick(4)
    assert len(bench.plant.given[1:]) == 3
    assert bench.robot.outputs == [7.0, 3.0]


def test_every_device_receives_every_frame_oldest_first_and_once(bench: Bench) -> None:
    for identifier in (0x300, 0x100):
        bench.host.send(Frame(identifier, b"x"))
        bench.now_ns += 1_000
    bench.tick(2)
    for device in (bench.drive, bench.lift):
        assert [[frame.arbitration_id for frame in frames] for frames in device.heard] == [[0x300, 0x100], []]


def passes(bench: Bench) -> list[int]:
    """The ticks in which the lift had a pass."""
    return [now_ns // TICK_NS for call, now_ns, _ in bench.lift.calls if call == "obey"]


def test_while_all_devices_sleep_the_plant_goes_on_with_what_they_gave() -> None:
    bench = Bench(motors=Sleeper)
    bench.tick(8)
    assert passes(bench) == [1, 4, 7]
    assert [steps for call, _, steps in bench.lift.calls if call == "tell"] == [1.0, 4.0, 7.0]
    assert bench.plant.given[1:] == [(1.0, 2.0, 3.0)] * 8


def test_a_frame_wakes_them_up() -> None:
    bench = Bench(motors=Sleeper)
    bench.tick(2)
    bench.host.send(Frame(0x300, b"x"))
    bench.tick(4)
    assert passes(bench) == [1, 3, 6]
    assert [frame.arbitration_id for frame in bench.lift.heard[1]] == [0x300]


def test_one_that_is_due_wakes_all_and_one_that_never_sleeps_keeps_all_awake() -> None:
    bench = Bench(motors=Sleeper)
    bench.lift.period_ns = 2 * TICK_NS  # type: ignore[attr-defined]
    bench.tick(7)
    assert passes(bench) == [1, 3, 5, 7]
    bench.lift.next_ns = -math.inf  # type: ignore[attr-defined]
    bench.tick()
    assert passes(bench)[-1] == 8


@pytest.mark.parametrize(("plant", "unseen"), [(UnseenPlant, [2, 3, 5, 6]), (Plant, [])])
def test_a_plant_knows_when_nobody_looks(plant: type[Plant], unseen: list[int]) -> None:
    bench = Bench(plant(), Sleeper)
    bench.tick(7)
    assert getattr(bench.plant, "unseen", []) == unseen
    assert len(bench.plant.given[1:]) == 7


def test_a_plant_that_steps_seldom_is_always_seen() -> None:
    class Coarse(UnseenPlant):
        step_size = 2 * TICK_NS * 1e-9

    bench = Bench(Coarse(), Sleeper)
    bench.tick(6)
    assert bench.plant.unseen == []  # type: ignore[attr-defined]


def test_refused_frames_are_those_of_all_devices(bench: Bench) -> None:
    bench.drive.refused_frames, bench.lift.refused_frames = 2, 5
    assert bench.robot.refused_frames == 7


def test_a_link_that_is_lost_carries_nothing_and_stops_neither_plant_nor_devices(bench: Bench) -> None:
    bench.host.send(Frame(0x100, b"x"))
    bench.link.is_lost = True
    bench.tick(2)
    bench.link.is_lost = False
    assert [list(frames) for frames in bench.drive.heard] == [[], []]
    assert [call for call, _, _ in bench.drive.calls] == ["obey", "tell"] * 2
    assert bench.robot.outputs == [7.0, 2.0]
    bench.tick()
    assert len(bench.drive.heard[2]) == 1


def _refusal(devices: Sequence[Motors], plant: Plant) -> str:
    with pytest.raises(PlantMismatchError) as error:
        SimulatedRobot(SimulatedBus(500_000, lambda: 0).attach("devices"), devices, plant, TICK_NS)
    return str(error.value)


@pytest.mark.parametrize(
    ("devices", "plant", "message"),
    [
        ([Motors(["left"], (0.0,))], Plant(), "plant 'bench' takes left, right, lift; the drives give left"),
        ([Motors(["left"], (0.0,))], IdlePlant(), "plant 'idle' takes nothing; the drives give left"),
        ([], Plant(), "plant 'bench' takes left, right, lift; the drives give nothing"),
        (
            [Motors(["left", "right"], (0.0, 0.0)), Motors(["left", "lift"], (0.0, 0.0))],
            Plant(),
            "plant 'bench' takes left, right, lift; the drives give left, right, left, lift",
        ),
        (
            [Motors(["left", "right", "lift"], (0.0,) * 3, ["steps", "depth", "width"])],
            Plant(),
            "plant 'bench' has no output depth, width; it has height, steps",
        ),
        (
            [Motors(["left", "right", "lift"], (0.0,) * 3)],
            OddPlant(),
            "the step of plant 'odd', 0.003 s, and the tick of the drives, 0.005 s, must divide one another",
        ),
    ],
)
def test_a_plant_that_does_not_fit_is_refused_with_the_reason(
    devices: Sequence[Motors], plant: Plant, message: str
) -> None:
    assert _refusal(devices, plant) == message


def test_a_tick_of_the_plant_alone_holds_what_the_motors_give_and_leaves_the_devices_out() -> None:
    motors, plant = Motors(["left", "right", "lift"], [1.0, 2.0, 3.0]), Plant()
    robot = SimulatedRobot(SimulatedBus(500_000, lambda: 0).attach("plant"), [motors], plant, TICK_NS)
    robot.tick(0)
    called = len(motors.calls)
    motors.values = [5.0, 5.0, 5.0]
    robot.coast()
    assert len(motors.calls) == called
    assert plant.given[-1] == (1.0, 2.0, 3.0)
    assert robot.outputs[1] == 2.0
    robot.tick(TICK_NS)
    assert plant.given[-1] == (5.0, 5.0, 5.0)


def test_a_coarse_plant_steps_every_second_tick_whether_the_devices_have_it_or_not() -> None:
    motors = Motors(["left", "right", "lift"], [0.0] * 3)
    robot = SimulatedRobot(SimulatedBus(500_000, lambda: 0).attach("plant"), [motors], CoarsePlant(), TICK_NS)
    steps = []
    for is_behind in (False, True, True, False, True, False):
        if is_behind:
            robot.coast()
        else:
            robot.tick(0)
        steps.append(robot.outputs[1])
    assert steps == [0.0, 1.0, 1.0, 2.0, 2.0, 3.0]
