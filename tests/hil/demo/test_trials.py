# SPDX-License-Identifier: MIT
"""What is done to the robot that is shown, and the sentence about what became of it."""

import itertools

import msgspec
import pytest

from segway_ecc.deploy.station.views import RobotView
from segway_ecc.hil.demo.trials import Trial, heal, sentence, trials_for, watch
from segway_ecc.testing import ScriptedClock
from tests.hil.demo.fake_parts import FakeParts

SEGWAY = ("PushForce", "Slope", "Payload"), ("left.angle", "right.angle", "imu.angular_velocity_x", "truth.x")
CART = (), ("left.angle", "right.angle", "truth.x")
UP = RobotView(robot="/", is_alive=True, mode="ARMED", posture="BALANCING", pitch=0.02, reason="asked to arm")
DOWN = msgspec.structs.replace(UP, mode="FAULT", posture="FALLEN", reason="left.angle is too old")
GONE = msgspec.structs.replace(UP, is_alive=False)


def names(plant: tuple[tuple[str, ...], tuple[str, ...]]) -> list[str]:
    return [trial.view.name for trial in trials_for(*plant)]


def trial(name: str) -> Trial:
    return next(trial for trial in trials_for(*SEGWAY) if trial.view.name == name)


@pytest.fixture
def parts() -> FakeParts:
    return FakeParts(ScriptedClock())


def test_each_plant_has_what_can_be_done_to_it() -> None:
    only = {"push", "push-back", "load", "slope", "freeze-imu"}
    assert set(names(SEGWAY)) - set(names(CART)) == only
    assert {"cut", "kill-node", "kill-guard", "freeze-wheel"} <= set(names(CART))


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("push", ["write PushForce 50.0", "write PushForce 0"]),
        ("push-back", ["write PushForce -50.0", "write PushForce 0"]),
        ("load", ["write Payload 1.5"]),
        ("slope", ["write Slope 0.087"]),
        ("cut", ["cut"]),
        ("mute", ["mute"]),
        ("freeze-imu", ["freeze imu"]),
        ("freeze-wheel", ["freeze left"]),
    ],
)
def test_the_plant_is_told(parts: FakeParts, name: str, lines: list[str]) -> None:
    begun_ns = parts.clock.now_ns()
    assert trial(name).do(parts, parts.clock) == begun_ns
    assert parts.lines == lines


@pytest.mark.parametrize("part", ["node", "guard"])
def test_a_process_is_killed(parts: FakeParts, part: str) -> None:
    trial(f"kill-{part}").do(parts, parts.clock)
    assert parts.killed == [part]


def test_healing_undoes_all_that_the_plant_has(parts: FakeParts) -> None:
    heal(parts, ("PushForce", "Other"))
    assert (parts.lines, parts.revivals) == (["heal", "write PushForce 0"], 1)


def test_torque_that_ended_is_timed(parts: FakeParts) -> None:
    since_ns = parts.clock.now_ns()
    parts.driven = lambda: since_ns + 38_000_000
    seen = watch(parts, lambda: DOWN, parts.clock, since_ns)
    assert seen.zero_after_s == pytest.approx(0.038)
    assert sentence(seen) == "zero torque after 38 ms; FAULT FALLEN: left.angle is too old"


def test_of_many_reasons_the_first_is_told(parts: FakeParts) -> None:
    parts.driven = lambda: None
    silent = msgspec.structs.replace(DOWN, reason="left.angle is too old; right.angle is too old; no command came")
    seen = watch(parts, lambda: silent, parts.clock, parts.clock.now_ns())
    assert sentence(seen) == "zero torque after 0 ms; FAULT FALLEN: left.angle is too old, and 2 more"


@pytest.mark.parametrize("driven_ns", [None, 5])
def test_motors_that_were_off_already_end_at_once(parts: FakeParts, driven_ns: int | None) -> None:
    parts.driven = lambda: driven_ns
    assert watch(parts, lambda: DOWN, parts.clock, parts.clock.now_ns()).zero_after_s == 0.0


def test_one_that_drives_on_tells_how_far_it_leaned(parts: FakeParts) -> None:
    pitches = itertools.chain([0.1, -0.15], itertools.repeat(0.0))
    seen = watch(parts, lambda: msgspec.structs.replace(UP, pitch=next(pitches)), parts.clock, parts.clock.now_ns())
    assert sentence(seen) == "it drives on, and leaned by 8.6° at most"


def test_one_without_tilt_only_drives_on(parts: FakeParts) -> None:
    seen = watch(parts, lambda: msgspec.structs.replace(UP, pitch=None), parts.clock, parts.clock.now_ns())
    assert sentence(seen) == "it drives on"


@pytest.mark.parametrize("robot", [None, GONE])
def test_one_whose_node_is_gone_is_said_to_be_so(parts: FakeParts, robot: RobotView | None) -> None:
    parts.driven = lambda: None
    seen = watch(parts, lambda: robot, parts.clock, parts.clock.now_ns())
    assert sentence(seen) == "zero torque after 0 ms; its node is not heard any more"
