# SPDX-License-Identifier: MIT
"""The packaged segways, in lock step, while no telemetry reaches the node for a moment."""

from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from segway_ecc.hil.design.balance import ScriptedStage
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder, NoStage, Request
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Action, Answer, Mode

MS = 1_000_000
STANDS_NS = 3_000 * MS
EVERY_NS = 400 * MS


class Gaps:
    """Silences the drives and sensors for a while, again and again; see `Source`."""

    def __init__(self, link: FaultyLink, length_ns: int, times: int) -> None:
        self._link = link
        self._turns = self._make(length_ns, times)
        self.next_ns: int | None = next(self._turns)

    def _make(self, length_ns: int, times: int) -> Iterator[int | None]:
        for turn in range(times):
            yield STANDS_NS + turn * (EVERY_NS + MS)  # each begins elsewhere in the cycle
            self._link.fault = LinkFault.STALE
            yield STANDS_NS + turn * (EVERY_NS + MS) + length_ns
            self._link.fault = None
        yield None

    def act(self) -> None:
        self.next_ns = next(self._turns)


def run(name: str, gap_ms: int, ride_through_s: float | None = None) -> tuple[Loop, float, dict[str, str]]:
    """The loop after five gaps, the largest tilt since the first, rad, and the health of the hardware."""
    file = load_robot(name)
    if ride_through_s is not None:
        file = replace(file, hardware=replace(file.hardware, ride_through_s=ride_through_s))
    rig = LockstepRig.of(hardware_of(file))
    plant = simulated_robot(file, rig.bus.attach("plant"))
    link = FaultyLink(rig.bus.attach("node"))
    robot = build_robot(file, rig, link)
    rig.add(Gaps(link, gap_ms * MS, 5))
    pitch, tilts = plant.output_names.index("truth.pitch"), [0.0]

    def observe(_wall_ns: int, outputs: object) -> None:
        if rig.now_ns() > STANDS_NS:
            tilts.append(abs(outputs[pitch]))  # type: ignore[index]

    rig.attach(plant, observe)
    loop = robot.loop(NoStage(), NoRecorder())
    loop.run((STANDS_NS + 6 * EVERY_NS) // robot.period_ns)
    return loop, max(tilts), dict(robot.hardware.health)


@pytest.mark.parametrize("name", ["segway", "segway-odrive", "segway-moteus"])
def test_a_gap_of_50_ms_is_balanced_through_and_counted(name: str) -> None:
    loop, tilt, health = run(name, 50)

    assert loop.modes.mode is Mode.ARMED
    assert tilt < 0.05
    devices = {key: text for key, text in health.items() if key.endswith(".gaps")}
    assert set(devices.values()) == {"5"}
    longest = [float(text) for key, text in health.items() if key.endswith(".longest_gap_ms")]
    assert all(50.0 <= each <= 70.0 for each in longest)


@pytest.mark.parametrize("name", ["segway", "segway-odrive", "segway-moteus"])
def test_a_longer_one_is_a_fault(name: str) -> None:
    loop, _, _ = run(name, 90)

    assert loop.modes.mode is Mode.FAULT
    assert "too old" in loop.modes.reason


@pytest.mark.parametrize("name", ["segway", "segway-odrive", "segway-moteus"])
def test_without_the_setting_20_ms_are_enough_to_drop_it(name: str) -> None:
    loop, tilt, _ = run(name, 20, 0.0)

    assert loop.modes.mode is Mode.FAULT
    assert tilt > 0.3


@pytest.mark.parametrize("robot", ["segway", "segway-odrive"])
@pytest.mark.parametrize("seconds", [1.2, 1.5, 1.9])
def test_a_robot_that_fell_unseen_stands_up_again_when_it_is_seen(robot: str, seconds: float) -> None:
    """Its model took the last that it saw for what is, upright, and drove off as it was asked to stand."""
    file = load_robot(robot)
    rig = LockstepRig.of(hardware_of(file))
    plant = simulated_robot(file, rig.bus.attach("plant"))
    rig.attach(plant)
    link = FaultyLink(rig.bus.attach("node"))
    made = build_robot(file, rig, link)
    rig.add(Gaps(link, round(seconds * 1000) * MS, 1))
    answers = list[Answer]()
    asks_at_s = STANDS_NS / 1e9 + seconds + 0.7  # it must lie still for half a second

    def ask() -> None:
        stage.requests.append(Request(Action.STAND_UP, answers.append))

    stage = ScriptedStage({asks_at_s: ask}, made.period_ns)
    loop = made.loop(stage, NoRecorder())
    loop.run(round((asks_at_s + 5.0) * 1e9 / made.period_ns))
    assert [answer.message for answer in answers] == ["ARMED: asked to arm"]
    assert loop.modes.mode is Mode.ARMED
    pitch, velocity = (plant.output_names.index(f"truth.{name}") for name in ("pitch", "linear_velocity"))
    assert abs(plant.outputs[pitch]) < 0.1
    assert abs(plant.outputs[velocity]) < 0.2
