# SPDX-License-Identifier: MIT
"""Drives that take a while to arm: who asked has the answer once they have, or have failed."""

from collections.abc import Callable

import pytest

from segway_ecc.firmware_io.errors import ArmingRefusedError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.interfaces import HardwareAnswer
from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointSchedule
from segway_ecc.node.safety.modes import POSTURES, Action, Answer, Mode
from segway_ecc.node.safety.pre_arm import PreArmCheck
from segway_ecc.testing import RecordingHardware


class Desk:
    """An arming manager, its hardware, and the answers it gave."""

    def __init__(self, *, arm_at_start: bool = False) -> None:
        self.hardware = RecordingHardware({}, {}, ())
        self.items: list[PreArmCheck] = []
        self.schedule = SetpointSchedule(timeout_cycles=50, tolerance_cycles=10, horizon_cycles=100)
        self.arming = ArmingManager(
            self.hardware, self.schedule, arm_at_start=arm_at_start, checklist=lambda: tuple(self.items)
        )
        self.answers: list[Answer] = []

    def ask(self, action: Action) -> None:
        self.arming.act(action, self.answers.append)

    def pass_cycle(self, *faults: str, ready: bool = False) -> Mode:
        self.arming.observe(faults, ready=ready, setpoints_silent=False)
        return self.arming.modes.mode


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_the_robot_is_armed_once_its_drives_are_ready_and_not_before(desk: Desk) -> None:
    desk.ask(Action.ARM)
    assert [desk.pass_cycle() for _ in range(3)] == [Mode.DISARMED] * 3
    assert desk.answers == []
    assert desk.pass_cycle(ready=True) is Mode.ARMED
    assert [answer.accepted for answer in desk.answers] == [True]
    assert desk.hardware.journal == ["arm"]


def test_drives_that_fail_while_arming_are_disarmed_with_the_reason(desk: Desk) -> None:
    desk.ask(Action.ARM)
    desk.pass_cycle()
    desk.pass_cycle("left drive: over-voltage", "right drive: silent")
    assert desk.answers == [Answer(accepted=False, message="left drive: over-voltage; right drive: silent")]
    assert desk.hardware.journal == ["arm", "disarm"]
    assert desk.pass_cycle(ready=True) is Mode.DISARMED, "what was given up does not arm later"


def test_two_who_ask_are_both_answered_and_the_drives_asked_once(desk: Desk) -> None:
    desk.ask(Action.ARM)
    desk.pass_cycle()
    desk.ask(Action.ARM)
    desk.pass_cycle(ready=True)
    assert [answer.accepted for answer in desk.answers] == [True, True]
    assert desk.hardware.journal == ["arm"]


@pytest.mark.parametrize(
    ("action", "mode"), [(Action.DISARM, Mode.DISARMED), (Action.STOP, Mode.FAULT), (Action.CLEAR_FAULT, Mode.DISARMED)]
)
def test_anything_else_that_is_asked_breaks_the_arming_off(desk: Desk, action: Action, mode: Mode) -> None:
    desk.ask(Action.ARM)
    desk.ask(action)
    first, _ = desk.answers
    assert (first.accepted, first.message) == (False, f"broken off: asked to {action}")
    assert desk.hardware.journal == ["arm", "disarm"]
    assert desk.pass_cycle(ready=True) is mode


@pytest.mark.parametrize("action", sorted(POSTURES))
def test_a_robot_without_posture_refuses_one_and_goes_on_arming(desk: Desk, action: Action) -> None:
    desk.ask(Action.ARM)
    desk.ask(action)
    assert [answer.accepted for answer in desk.answers] == [False]
    assert desk.pass_cycle(ready=True) is Mode.ARMED


def test_it_arms_again_out_of_a_fault_where_nothing_keeps_it_from_arming(desk: Desk) -> None:
    desk.arming.fail("it fell")
    desk.items = [PreArmCheck("tilt", False, "it leans")]  # noqa: FBT003 - whether it passed
    desk.arming.arm_again(desk.answers.append)
    assert (desk.pass_cycle(ready=True), desk.hardware.journal) == (Mode.FAULT, [])
    desk.items = []
    desk.arming.arm_again(desk.answers.append)
    assert desk.pass_cycle(ready=True) is Mode.ARMED
    assert [answer.accepted for answer in desk.answers] == [False, True]


def test_a_failure_while_arming_is_a_fault_and_answers(desk: Desk) -> None:
    desk.ask(Action.ARM)
    desk.arming.fail("the bus is gone")
    assert desk.arming.modes.mode is Mode.FAULT
    assert desk.answers == [Answer(accepted=False, message="the bus is gone")]
    assert desk.hardware.armed is False


def test_a_robot_that_disarms_itself_breaks_the_arming_off_with_its_reason() -> None:
    desk = Desk(arm_at_start=True)
    desk.arming.arm_itself()
    live = [desk.arming.is_live]
    desk.arming.disarm("nobody is there")
    live.append(desk.arming.is_live)
    desk.arming.arm_itself()
    assert live == [True, False]
    assert desk.pass_cycle(ready=True) is Mode.DISARMED, "nor does it begin again"
    assert desk.arming.arming_refusal == "nobody is there"
    assert desk.hardware.journal == ["arm", "disarm"]


def test_a_robot_that_disarms_itself_is_off_at_once_and_not_twice(desk: Desk) -> None:
    desk.ask(Action.ARM)
    desk.pass_cycle(ready=True)
    live = [desk.arming.is_live]
    for _ in range(2):
        desk.arming.disarm("nobody is there")
        live.append(desk.arming.is_live)
    assert desk.hardware.journal == ["arm", "disarm"]
    assert live == [True, False, False]
    assert (desk.arming.modes.mode, desk.arming.modes.reason) == (Mode.DISARMED, "nobody is there")


def test_a_lost_station_holds_a_robot_that_has_just_armed(desk: Desk) -> None:
    desk.ask(Action.ARM)
    desk.arming.observe((), ready=True, setpoints_silent=False, station_lost=True)
    assert (desk.arming.modes.mode, desk.arming.is_active) == (Mode.HOLD, True)


def test_a_robot_that_arms_itself_tries_again_until_it_is_armed() -> None:
    desk = Desk(arm_at_start=True)
    desk.arming.arm_itself()
    desk.pass_cycle("left drive: silent")
    told = [desk.arming.arming_refusal]
    desk.arming.arm_itself()
    desk.arming.arm_itself()
    assert desk.pass_cycle(ready=True) is Mode.ARMED
    told.append(desk.arming.arming_refusal)
    assert told == ["left drive: silent", None]
    desk.arming.arm_itself()
    assert desk.hardware.journal == ["arm", "disarm", "arm"]


def test_a_robot_that_was_disarmed_while_it_armed_itself_stays_disarmed() -> None:
    desk = Desk(arm_at_start=True)
    desk.arming.arm_itself()
    desk.ask(Action.DISARM)
    desk.arming.arm_itself()
    assert desk.pass_cycle(ready=True) is Mode.DISARMED
    assert desk.hardware.journal == ["arm", "disarm"]


def test_drives_that_pass_through_their_states_again_while_armed_leave_the_mode_alone(desk: Desk) -> None:
    """As they do when a redundant link changes lines: the hardware reports a fault where they fail to."""
    desk.ask(Action.ARM)
    desk.pass_cycle(ready=True)
    assert desk.pass_cycle(ready=False) is Mode.ARMED


def test_snapshot_is_ready_by_default() -> None:
    assert Sensors().ready is True


LEANING = PreArmCheck("tilt", passed=False, text="0.40 rad from upright; hold it upright")
ROLLING = PreArmCheck("wheels_still", passed=False, text="9.00 rad/s; let them come to rest")
UNPRIVILEGED = PreArmCheck("real_time", passed=False, text="not granted", is_warning=True)


def test_failed_checks_refuse_arming_with_every_reason_before_drives_are_asked(desk: Desk) -> None:
    desk.items = [LEANING, UNPRIVILEGED, ROLLING]
    desk.ask(Action.ARM)
    reasons = "tilt: 0.40 rad from upright; hold it upright; wheels_still: 9.00 rad/s; let them come to rest"
    assert desk.answers == [Answer(accepted=False, message=reasons)]
    assert desk.hardware.journal == []
    assert desk.pass_cycle(ready=True) is Mode.DISARMED


def test_a_warning_does_not_keep_the_robot_from_arming(desk: Desk) -> None:
    desk.items = [UNPRIVILEGED]
    desk.ask(Action.ARM)
    assert desk.pass_cycle(ready=True) is Mode.ARMED


@pytest.mark.parametrize("items", [[], [LEANING]])
def test_fault_refuses_arming_before_checks_and_drives_are_asked(desk: Desk, items: list[PreArmCheck]) -> None:
    desk.items = items
    desk.arming.fail("smoke")
    desk.ask(Action.ARM)
    assert desk.answers == [Answer(accepted=False, message="clear the fault first: smoke")]
    assert "arm" not in desk.hardware.journal


def test_self_arming_robot_waits_for_its_pre_arm_checks() -> None:
    desk = Desk(arm_at_start=True)
    desk.items = [ROLLING]
    desk.arming.arm_itself()
    assert desk.arming.arming_refusal == "wheels_still: 9.00 rad/s; let them come to rest"
    desk.items.clear()
    desk.arming.arm_itself()
    assert desk.pass_cycle(ready=True) is Mode.ARMED


@pytest.mark.parametrize(
    ("reasons", "message"),
    [
        (("left drive: no calibration", "right drive: too hot"), "left drive: no calibration; right drive: too hot"),
        ((), "the drive refuses and gives no reason"),
    ],
)
def test_immediate_refusal_of_the_drives_is_answered_and_recorded(
    desk: Desk, reasons: tuple[str, ...], message: str
) -> None:
    desk.hardware.raises["arm"] = ArmingRefusedError(reasons)
    desk.ask(Action.ARM)
    assert desk.answers == [Answer(accepted=False, message=message)]
    assert desk.arming.answers == [HardwareAnswer("arm", reasons)], "a replay needs it, for no signal shows it"
    assert (desk.arming.is_live, desk.pass_cycle(ready=True)) == (False, Mode.DISARMED)


WAYS_OUT: dict[str, Callable[[Desk], object]] = {
    "disarm": lambda desk: desk.ask(Action.DISARM),
    "stop": lambda desk: desk.ask(Action.STOP),
    "fault": lambda desk: desk.pass_cycle("left drive: too hot"),
    "failure": lambda desk: desk.arming.fail("the bus is gone"),
    "its own decision": lambda desk: desk.arming.disarm("nobody is there"),
}


@pytest.mark.parametrize("way", WAYS_OUT)
def test_a_robot_that_arms_itself_does_so_never_again_once_it_was_switched_off(way: str) -> None:
    desk = Desk(arm_at_start=True)
    desk.arming.arm_itself()
    desk.pass_cycle(ready=True)
    WAYS_OUT[way](desk)
    desk.ask(Action.CLEAR_FAULT)
    desk.arming.arm_itself()
    assert desk.pass_cycle(ready=True) is Mode.DISARMED
    assert desk.hardware.journal == ["arm", "disarm"]


def test_a_failure_before_it_has_armed_itself_takes_the_wish_away_too() -> None:
    desk = Desk(arm_at_start=True)
    desk.arming.fail("the bus is gone")
    desk.ask(Action.CLEAR_FAULT)
    desk.arming.arm_itself()
    assert desk.pass_cycle(ready=True) is Mode.DISARMED


@pytest.mark.parametrize("way", WAYS_OUT)
def test_a_fault_and_its_clearing_do_not_make_a_robot_arm_itself_that_was_not_to(desk: Desk, way: str) -> None:
    desk.ask(Action.ARM)
    desk.pass_cycle(ready=True)
    WAYS_OUT[way](desk)
    desk.ask(Action.CLEAR_FAULT)
    desk.arming.arm_itself()
    assert desk.pass_cycle(ready=True) is Mode.DISARMED


@pytest.mark.parametrize("attempt", ["clear a fault", "disarm itself"])
def test_what_does_nothing_to_a_robot_at_rest_does_not_keep_it_from_arming_itself(attempt: str) -> None:
    desk = Desk(arm_at_start=True)
    desk.items = [ROLLING]
    desk.arming.arm_itself()
    if attempt == "clear a fault":
        desk.ask(Action.CLEAR_FAULT)
        assert [answer.accepted for answer in desk.answers] == [False]
    else:
        desk.arming.disarm("nobody is there")
    desk.items.clear()
    desk.arming.arm_itself()
    assert desk.pass_cycle(ready=True) is Mode.ARMED


def test_nothing_hinders_a_robot_that_an_operator_armed_before_it_did_so_itself() -> None:
    desk = Desk(arm_at_start=True)
    desk.items = [ROLLING]
    desk.arming.arm_itself()
    desk.items.clear()
    desk.ask(Action.ARM)
    desk.pass_cycle(ready=True)
    desk.arming.arm_itself()
    assert desk.arming.arming_refusal is None
    assert desk.hardware.journal == ["arm"]


@pytest.mark.parametrize("way", WAYS_OUT)
def test_set_points_of_before_do_not_move_a_robot_that_is_armed_again(desk: Desk, way: str) -> None:
    desk.ask(Action.ARM)
    desk.pass_cycle(ready=True)
    desk.schedule.add(Setpoint(1.0, 0.5), 10, 10)
    assert desk.schedule.due(10) == Setpoint(1.0, 0.5)
    desk.schedule.add(Setpoint(2.0, 0.0), 20, 10)
    WAYS_OUT[way](desk)
    desk.ask(Action.CLEAR_FAULT)
    desk.ask(Action.ARM)
    assert desk.pass_cycle(ready=True) is Mode.ARMED
    assert [desk.schedule.due(cycle) for cycle in (10, 20, 30)] == [REST] * 3
