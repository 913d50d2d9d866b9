# SPDX-License-Identifier: MIT
"""The hardware of a recorded run answers as recorded."""

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest

from segway_ecc.firmware_io.errors import ArmingRefusedError, LinkLostError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.cycle.interfaces import (
    UNSEEN_CALL,
    CycleRecord,
    HardwareAnswer,
    Inbox,
    Request,
    StampedSetpoint,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.replay.recorded import RecordedRobot
from segway_ecc.node.replay.replay import replay
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.testing import RecordingHardware, ScriptedClock

Run = Callable[..., Path]
CYCLES = 80


def setpoint(linear: float, stamp_ns: int | None = None) -> Inbox:
    return Inbox(setpoints=[StampedSetpoint(Setpoint(linear, 0.1), stamp_ns)])


def asked(*actions: Action) -> Inbox:
    return Inbox(requests=[Request(action, lambda _answer: None) for action in actions])


def scripted(actuate: str = "next_cycle") -> tuple[Robot, RecordingHardware, ScriptedClock]:
    """The cart with a board that measures what it is set to."""
    file: RobotFile = msgspec.structs.replace(load_robot("cart-can"), actuate=actuate, arming="on_request")
    real = build_robot(file, LockstepRig(500_000))
    hardware = RecordingHardware(real.hardware.signals, real.hardware.commands, real.hardware.limits)
    hardware.measured = Sensors((0.0, 0.5, 0.0, 0.25, 36.0), (0.001,) * 5, (True,) * 5)
    clock = ScriptedClock()
    return Robot(file, real.model, hardware, wire(real.model, hardware, file.wiring), clock), hardware, clock


def computed_and_recorded(path: Path) -> Sequence[tuple[Mode, Mode]]:
    pairs: list[tuple[Mode, Mode]] = []
    outcome = replay(path, look=lambda recorded, computed: pairs.append((recorded.mode, computed.mode)))
    assert (outcome.difference, outcome.gap, outcome.cycles) == (None, None, CYCLES)
    return pairs


@pytest.mark.parametrize("actuate", ["next_cycle", "immediately"])
def test_answers_of_the_hardware_are_given_again(path: Path, run: Run, actuate: str) -> None:
    robot, hardware, clock = scripted(actuate)
    clock.events[5] = lambda: setattr(hardware, "reasons", ("too hot",))
    clock.events[8] = lambda: setattr(hardware, "reasons", ())
    clock.events[9] = lambda: hardware.raises.update(arm=ArmingRefusedError(("the fuse",)))
    clock.events[12] = hardware.raises.clear
    clock.events[20] = lambda: hardware.raises.update(exchange=LinkLostError("the bus is gone"))
    clock.events[23] = hardware.raises.clear
    arm = asked(Action.ARM)
    run(path, {6: arm, 10: arm, 13: arm, 25: asked(Action.CLEAR_FAULT, Action.ARM), 30: setpoint(1.0)}, robot=robot)
    modes = [recorded for recorded, _ in computed_and_recorded(path)]

    assert modes[:13] == [Mode.DISARMED] * 13
    assert modes[13:20] == [Mode.ARMED] * 7
    assert modes[20:25] == [Mode.FAULT] * 5
    assert modes[25] is Mode.ARMED


def test_a_link_that_is_lost_only_when_sending_is_lost_again(path: Path, run: Run) -> None:
    robot, hardware, clock = scripted("immediately")
    exchange, lost = hardware.exchange, list[str]()

    def failing(commands: Sequence[float] | None) -> Sensors:
        if lost and commands is not None:
            raise LinkLostError(lost[0])
        return exchange(commands)

    hardware.exchange = failing  # type: ignore[method-assign]  # only what is sent fails
    clock.events[20] = lambda: lost.append("it does not send")
    run(path, {5: asked(Action.ARM)}, robot=robot)
    modes = [recorded for recorded, _ in computed_and_recorded(path)]

    assert modes[19] is Mode.ARMED
    assert modes[20] is Mode.FAULT


def test_late_cycles_and_what_drives_report_come_out_the_same(path: Path, run: Run) -> None:
    robot, hardware, clock = scripted()
    clock.late_ns.update({15: 3_000_000, 16: 45_000_000})
    hot = Sensors((0.0,) * 5, (0.001,) * 5, (True,) * 5, ("left: hot",), events=("line 2",))
    clock.events[30] = lambda: setattr(hardware, "measured", hot)
    run(path, {5: asked(Action.ARM)}, robot=robot)

    assert computed_and_recorded(path)[30][0] is Mode.FAULT


def test_the_model_starts_from_the_snapshot_that_it_started_from() -> None:
    robot, _, _ = scripted()
    hardware = RecordedRobot(layout_of(robot))
    first, second = Sensors((1.0,) * 5), Sensors((2.0,) * 5)
    zeros = (0.0, 0.0)
    record = CycleRecord(0, 0, Mode.DISARMED, 0, second, Setpoint(0.0, 0.0), (), (), zeros, (), (), initial=first)
    hardware.pass_to(record)

    assert [hardware.exchange(zeros), hardware.exchange(zeros)] == [first, second]


def test_signals_that_were_not_seen_before_the_motors_were_on_are_unseen_again() -> None:
    robot, _, _ = scripted()
    hardware = RecordedRobot(layout_of(robot))
    answers = [HardwareAnswer(UNSEEN_CALL, ("left.angle",)), HardwareAnswer("obstacles", ("it is hot",))]
    measured = Sensors((1.0,) * 5)
    record = CycleRecord(
        1, 0, Mode.DISARMED, 0, measured, Setpoint(0.0, 0.0), (), (), (0.0, 0.0), (), (), answers=answers
    )
    hardware.pass_to(record)
    hardware.exchange(None)

    assert hardware.exchange(None).values == measured.values
    assert hardware.record is not None
    assert hardware.record.sensors.unseen == ("left.angle",)
    assert hardware.arming_failures() == ("it is hot",)
