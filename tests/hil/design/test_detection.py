# SPDX-License-Identifier: MIT
"""How soon each fault of a driving segway is noticed, in lock step, on simulated time."""

import itertools
from collections.abc import Callable, Mapping
from typing import NamedTuple, cast

import pytest
from msgspec import structs
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId, Wheel, decode, encode
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.odrive import SimulatedOdrive
from segway_ecc.hil.devices.wheel_board import SimulatedWheelBoard
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoRecorder, NoStage, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Mode, Transition
from segway_ecc.node.safety.settings import SafetySettings

PERIOD_NS = 5_000_000
BEGIN_NS = 3_000_000_000
"""When it fails: it has stood up and drives."""
DRIVING = Setpoint(0.5, 0.4)
ROBOTS = ("segway", "segway-odrive")
IMU = tuple(f"imu.{what}_{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz")


class Seen(NamedTuple):
    now_ns: int
    mode: Mode
    sensors: Sensors
    refused: Mapping[str, str]
    pitch: float
    is_on: bool


class Tap(LinkFront):
    """Changes or loses what the node receives."""

    def __init__(self, link: LinkFront) -> None:
        super().__init__(link)
        self.change: Callable[[Frame], Frame | None] = lambda frame: frame

    def receive(self) -> list[Frame]:
        changed = (self.change(frame) for frame in self.behind.receive())
        return [frame for frame in changed if frame is not None]


class ScriptedStage(NoStage, NoRecorder):
    """Says the set-point in each cycle until a time, does once what a test wants, and keeps each cycle."""

    def __init__(self, run: "Run", silent_from_ns: int | None) -> None:
        self.seen: list[Seen] = []
        self._run, self._silent_from_ns = run, silent_from_ns
        self._is_done = False

    def close(self) -> None:
        """Nothing is open."""

    def write_diagnostics(self, *_: object) -> None:
        """Not looked at."""

    def publish_diagnostics(self, *_: object) -> None:
        """Not looked at."""

    def take_inbox(self) -> Inbox:
        run, now_ns = self._run, self._run.rig.now_ns()
        if now_ns >= BEGIN_NS and not self._is_done:
            self._is_done = True
            run.event()
        if self._silent_from_ns is not None and now_ns >= self._silent_from_ns:
            return Inbox()
        return Inbox(setpoints=[StampedSetpoint(DRIVING if now_ns > BEGIN_NS // 2 else REST, None)])

    def write(self, record: CycleRecord) -> None:
        run = self._run
        if run.rig.now_ns() > BEGIN_NS - 10 * PERIOD_NS:
            is_on, pitch = run.is_on(), run.truth("pitch")
            self.seen.append(
                Seen(run.rig.now_ns(), record.mode, record.sensors, run.robot.hardware.health, pitch, is_on)
            )


class Run:
    """One robot, which fails as a test says."""

    def __init__(
        self, name: str, plant: Mapping[str, float] | None = None, safety: SafetySettings | None = None
    ) -> None:
        file = load_robot(name)
        if safety is not None:
            file = structs.replace(file, safety=safety)
        self.rig = LockstepRig.of(hardware_of(file))
        self.simulated = simulated_robot(file, self.rig.bus.attach("plant"))
        for parameter, value in (plant or {}).items():
            self.simulated.plant.write(parameter, value)
        self.simulated.outputs = self.simulated.plant.initialize(self.simulated.inputs)
        self.beyond_ns: list[int] = []
        self.tilt = 0.8
        self.rig.attach(self.simulated, self._look)
        self.tap = Tap(cast("LinkFront", self.rig.bus.attach("node")))
        self.robot = build_robot(file, self.rig, self.tap)
        self.event: Callable[[], None] = lambda: None
        self.history: list[Transition] = []

    def run(self, seconds: float, silent_from_ns: int | None = None) -> list[Seen]:
        world = ScriptedStage(self, silent_from_ns)
        loop = self.robot.loop(world, world)
        loop.run(round((BEGIN_NS + seconds * 1e9) / PERIOD_NS))
        self.history = list(loop.modes.history)
        return world.seen

    def freeze(self, names: tuple[str, ...]) -> None:
        values = dict(zip(self.simulated.output_names, self.simulated.outputs, strict=True))
        self.simulated.stuck = {name: values[name] for name in names}

    def truth(self, name: str) -> float:
        return self.simulated.outputs[self.simulated.output_names.index(f"truth.{name}")]

    def is_on(self) -> bool:
        device = self.simulated.devices[0]
        if isinstance(device, SimulatedWheelBoard):
            return device.state.name == "ENABLED"
        assert isinstance(device, SimulatedOdrive)
        return all(axis.state == 8 for axis in device.axes)  # AXIS_STATE_CLOSED_LOOP_CONTROL

    def signal(self, name: str) -> int:
        return list(self.robot.hardware.signals).index(name)

    def _look(self, _wall_ns: int, _outputs: object) -> None:
        if abs(self.truth("pitch")) > self.tilt:
            self.beyond_ns.append(self.rig.now_ns())


def fault_ns(seen: list[Seen]) -> int:
    """When the fault was noticed; up to then all was well."""
    place = next(i for i, cycle in enumerate(seen) if cycle.mode is not Mode.ARMED)
    assert seen[place].mode is Mode.FAULT
    return seen[place].now_ns


def spoil(run: Run, spoilt: Callable[[Frame], Frame]) -> list[int]:
    """Spoil one frame of the left wheel; returns when it arrived, once it has."""
    arrived: list[int] = []

    def change(frame: Frame) -> Frame:
        if frame.arbitration_id != FrameId.LEFT_WHEEL or run.rig.now_ns() < BEGIN_NS or arrived:
            return frame
        # Of the five frames of a period the newest is the one that would be used.
        if run.rig.now_ns() - frame.received_ns > PERIOD_NS:
            return frame
        arrived.append(frame.received_ns)
        return spoilt(frame)

    run.tap.change = change
    return arrived


def wrong_crc(frame: Frame) -> Frame:
    """An angle of 6.5536 rad more, and the CRC of before."""
    return replace(frame, data=frame.data[:2] + bytes([frame.data[2] ^ 1]) + frame.data[3:])


def wrong_counter(frame: Frame) -> Frame:
    """Another angle, intact in itself, with a counter that has gone back."""
    payload, counter = decode(frame.arbitration_id, frame.data)
    assert isinstance(payload, Wheel)
    moved = replace(payload, angle=payload.angle + 6.5536)
    return replace(frame, data=encode(FrameId.LEFT_WHEEL, moved, counter - 2))


@pytest.mark.parametrize(("spoilt", "cause"), [(wrong_crc, "crc"), (wrong_counter, "counter")])
def test_a_bad_frame_is_refused_in_the_cycle_in_which_it_arrives_and_never_used(
    spoilt: Callable[[Frame], Frame], cause: str
) -> None:
    run = Run("segway")
    arrived = spoil(run, spoilt)
    seen = run.run(0.2)
    name, angle = f"board.refused.{cause}", run.signal("left.angle")
    at = next(i for i, cycle in enumerate(seen) if name in cycle.refused)
    assert seen[at].refused[name] == "1" == seen[-1].refused[name]
    assert 0 <= seen[at].now_ns - arrived[0] <= PERIOD_NS
    before, then = seen[at - 1].sensors, seen[at].sensors
    assert then.values[angle] == before.values[angle]
    assert then.ages[angle] == pytest.approx(before.ages[angle] + PERIOD_NS * 1e-9)
    values = [cycle.sensors.values[angle] for cycle in seen]
    assert all(abs(b - a) < 0.3 for a, b in itertools.pairwise(values))
    assert {cycle.mode for cycle in seen} == {Mode.ARMED}


SILENT = {
    "segway": {
        "left.angle": {0x120},
        "right.velocity": {0x121},
        "imu.angular_velocity_y": {0x122},
        "imu.linear_acceleration_x": {0x123},
        "all": set(range(0x800)),
    },
    "segway-odrive": {
        "left.angle": {16 << 5 | 9},  # Get_Encoder_Estimates of its node
        "imu.angular_velocity_y": {0x32},  # RateOfTurn
        "imu.linear_acceleration_x": {0x34},  # Acceleration
        "all": set(range(0x800)),
    },
}


def silenced(name: str, what: str) -> tuple[int, float, float]:
    """When it was noticed, ns after it fell silent, and how old its value was then and in the cycle before, s."""
    run = Run(name)
    lost = SILENT[name][what]
    run.tap.change = lambda frame: None if run.rig.now_ns() > BEGIN_NS and frame.arbitration_id in lost else frame
    seen = run.run(0.2)
    noticed_ns = fault_ns(seen)
    signal = run.signal("left.angle" if what == "all" else what)
    at = next(cycle for cycle in seen if cycle.now_ns == noticed_ns)
    before = next(cycle for cycle in seen if cycle.now_ns == noticed_ns - PERIOD_NS)
    assert "too old" in run.history[-1].reason
    return noticed_ns - BEGIN_NS, at.sensors.ages[signal], before.sensors.ages[signal]


@pytest.mark.parametrize(("name", "what"), [(name, what) for name, kinds in SILENT.items() for what in kinds])
def test_silence_is_a_fault_once_it_is_longer_than_what_is_ridden_through(name: str, what: str) -> None:
    after_ns, age, age_before = silenced(name, what)
    # The first cycle in which the last good value is older than three periods and `ride_through_s`.
    assert age_before <= 0.065 < age <= 0.070
    assert after_ns <= 13 * PERIOD_NS


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("names", [("left.angle", "left.velocity"), ("right.angle", "right.velocity"), IMU])
def test_a_frozen_sensor_is_a_fault_within_100_ms(name: str, names: tuple[str, ...]) -> None:
    run = Run(name)
    run.event = lambda: run.freeze(names)
    noticed_ns = fault_ns(run.run(0.5))
    assert noticed_ns - BEGIN_NS <= 100_000_000
    side = names[0].partition(".")[0]
    assert any(
        word in run.history[-1].reason for word in ("the IMU is frozen", f"the {side} encoder", f"{side}.velocity")
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_the_tilt_limit_is_noticed_within_a_cycle_of_the_first_sample_beyond_it(name: str) -> None:
    # With sensors that are nearly right (quite right ones would repeat their values), and a body that nothing stops.
    whole = load_robot(name).safety
    assert whole is not None
    alone = SafetySettings(tilt_limit_rad=whole.tilt_limit_rad)  # else the speed of the wheels is noticed before
    run = Run(name, {"SensorErrors": 0.2, "ImuLatency": 0.0, "StopAngle": 1.4}, alone)
    run.event = lambda: run.simulated.plant.write("PushForce", 250.0)
    noticed_ns = fault_ns(run.run(1.0))
    assert "the body leans" in run.history[-1].reason
    assert 0 <= noticed_ns - run.beyond_ns[0] <= 2 * PERIOD_NS


@pytest.mark.parametrize("name", ROBOTS)
def test_a_lost_command_link_is_a_hold_and_the_motors_stay_on(name: str) -> None:
    run = Run(name)
    seen = run.run(10.5, silent_from_ns=BEGIN_NS)
    held = [cycle for cycle in seen if cycle.mode is Mode.HOLD]
    assert held[0].now_ns - BEGIN_NS == pytest.approx(500_000_000, abs=2 * PERIOD_NS)
    assert {cycle.mode for cycle in seen} == {Mode.ARMED, Mode.HOLD}
    assert seen[-1].now_ns - held[0].now_ns >= 9_900_000_000
    assert all(cycle.is_on for cycle in seen)
    assert max(abs(cycle.pitch) for cycle in seen) < 0.2
    assert abs(run.truth("linear_velocity")) < 0.1
    assert abs(run.truth("angular_velocity")) < 0.05
