# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.node.safety.modes import ACTIVE, Action, Answer, Mode, Modes, Transition

OBSTACLES = ("no supply: switch it on", "no watchdog")


def reach(mode: Mode, *, station_lost: bool = False) -> Modes:
    modes = Modes()
    if mode in ACTIVE:
        modes.ask(Action.ARM)
    if mode is Mode.HOLD:
        modes.observe([], setpoints_silent=not station_lost, station_lost=station_lost)
    if mode is Mode.FAULT:
        modes.fail("smoke")
    assert modes.mode is mode
    return modes


def test_it_starts_disarmed() -> None:
    assert (Modes().mode, Modes().reason, Modes().cycle) == (Mode.DISARMED, "just started", 0)


def test_the_words_of_an_operator_are_those_of_the_interface() -> None:
    assert [*Action] == ["arm", "disarm", "stop", "clear_fault", "stand_up", "sit_down"]
    assert [*Mode] == ["DISARMED", "ARMED", "HOLD", "FAULT"]


def test_torque_is_allowed_in_two_modes_only() -> None:
    assert {Mode.ARMED, Mode.HOLD} == ACTIVE


# Mode, request -> mode, accepted, message.
REQUESTS = [
    (Mode.DISARMED, Action.ARM, Mode.ARMED, True, "ARMED: asked to arm"),
    (Mode.ARMED, Action.ARM, Mode.ARMED, True, "armed already"),
    (Mode.HOLD, Action.ARM, Mode.HOLD, True, "armed already"),
    (Mode.FAULT, Action.ARM, Mode.FAULT, False, "clear the fault first: smoke"),
    (Mode.DISARMED, Action.DISARM, Mode.DISARMED, True, "DISARMED: asked to disarm"),
    (Mode.ARMED, Action.DISARM, Mode.DISARMED, True, "DISARMED: asked to disarm"),
    (Mode.HOLD, Action.DISARM, Mode.DISARMED, True, "DISARMED: asked to disarm"),
    (Mode.FAULT, Action.DISARM, Mode.FAULT, True, "the motors are off already, by a fault"),
    (Mode.DISARMED, Action.STOP, Mode.FAULT, True, "FAULT: stop was pressed"),
    (Mode.ARMED, Action.STOP, Mode.FAULT, True, "FAULT: stop was pressed"),
    (Mode.HOLD, Action.STOP, Mode.FAULT, True, "FAULT: stop was pressed"),
    (Mode.FAULT, Action.STOP, Mode.FAULT, True, "FAULT: stop was pressed"),
    (Mode.DISARMED, Action.CLEAR_FAULT, Mode.DISARMED, False, "there is no fault to clear: the robot is DISARMED"),
    (Mode.ARMED, Action.CLEAR_FAULT, Mode.ARMED, False, "there is no fault to clear: the robot is ARMED"),
    (Mode.HOLD, Action.CLEAR_FAULT, Mode.HOLD, False, "there is no fault to clear: the robot is HOLD"),
    (Mode.FAULT, Action.CLEAR_FAULT, Mode.DISARMED, True, "DISARMED: fault cleared"),
    *(
        (mode, action, mode, False, "this robot neither stands up nor sits down on request")
        for action in (Action.STAND_UP, Action.SIT_DOWN)
        for mode in Mode
    ),
]


def test_the_table_of_requests_is_whole() -> None:
    assert [(mode, action) for action in Action for mode in Mode] == [(row[0], row[1]) for row in REQUESTS]


@pytest.mark.parametrize(("mode", "action", "then", "accepted", "message"), REQUESTS)
def test_what_a_request_does(mode: Mode, action: Action, then: Mode, accepted: bool, message: str) -> None:  # noqa: FBT001 - a column of the table
    modes = reach(mode)
    assert modes.ask(action) == Answer(accepted, message)
    assert modes.mode is then


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("action", [action for action in Action if action is not Action.ARM])
def test_failed_checks_refuse_only_arming(mode: Mode, action: Action) -> None:
    free, hindered = reach(mode), reach(mode)
    assert hindered.ask(action, OBSTACLES) == free.ask(action)
    assert hindered.mode is free.mode


def test_arming_is_refused_with_every_failed_check() -> None:
    modes = Modes()
    assert modes.ask(Action.ARM, OBSTACLES) == Answer(accepted=False, message="no supply: switch it on; no watchdog")
    assert (modes.mode, modes.reason) == (Mode.DISARMED, "just started")


def test_who_is_armed_already_is_not_hindered() -> None:
    assert reach(Mode.HOLD).ask(Action.ARM, OBSTACLES).accepted


# Mode, a fault is there, set-points are silent -> mode, reason (None: as before).
OBSERVATIONS = [
    (Mode.DISARMED, False, False, Mode.DISARMED, None),
    (Mode.DISARMED, False, True, Mode.DISARMED, None),
    (Mode.DISARMED, True, False, Mode.DISARMED, None),
    (Mode.DISARMED, True, True, Mode.DISARMED, None),
    (Mode.ARMED, False, False, Mode.ARMED, None),
    (Mode.ARMED, False, True, Mode.HOLD, "no set-point arrives any more"),
    (Mode.ARMED, True, False, Mode.FAULT, "too hot; too fast"),
    (Mode.ARMED, True, True, Mode.FAULT, "too hot; too fast"),
    (Mode.HOLD, False, False, Mode.ARMED, "set-points arrive again"),
    (Mode.HOLD, False, True, Mode.HOLD, None),
    (Mode.HOLD, True, False, Mode.FAULT, "too hot; too fast"),
    (Mode.HOLD, True, True, Mode.FAULT, "too hot; too fast"),
    (Mode.FAULT, False, False, Mode.FAULT, None),
    (Mode.FAULT, False, True, Mode.FAULT, None),
    (Mode.FAULT, True, False, Mode.FAULT, None),
    (Mode.FAULT, True, True, Mode.FAULT, None),
]


@pytest.mark.parametrize(("mode", "fault", "silent", "then", "reason"), OBSERVATIONS)
def test_what_is_observed_leads_to_the_most_severe_mode(
    mode: Mode,
    fault: bool,  # noqa: FBT001 - a column of the table
    silent: bool,  # noqa: FBT001 - a column of the table
    then: Mode,
    reason: str | None,
) -> None:
    modes = reach(mode)
    before = modes.reason
    modes.observe(["too hot", "too fast"] if fault else [], setpoints_silent=silent)
    assert (modes.mode, modes.reason) == (then, before if reason is None else reason)


# Mode, why it holds, a fault is there, set-points are silent -> mode, reason, with and without a lost station.
LOST, SILENT = "the base station is lost", "no set-point arrives any more"
AGAIN = "the base station is back"
STATION_OBSERVATIONS = [
    (Mode.DISARMED, False, False, False, True, Mode.DISARMED, "just started"),
    (Mode.ARMED, False, False, False, True, Mode.HOLD, LOST),
    (Mode.ARMED, False, False, True, True, Mode.HOLD, LOST),
    (Mode.ARMED, False, True, True, True, Mode.FAULT, "too hot; too fast"),
    (Mode.HOLD, False, False, False, True, Mode.HOLD, LOST),
    (Mode.HOLD, False, False, True, True, Mode.HOLD, LOST),
    (Mode.HOLD, False, True, False, True, Mode.FAULT, "too hot; too fast"),
    (Mode.HOLD, True, False, False, True, Mode.HOLD, LOST),
    (Mode.HOLD, True, True, False, True, Mode.FAULT, "too hot; too fast"),
    (Mode.HOLD, True, False, False, False, Mode.ARMED, AGAIN),
    (Mode.HOLD, True, False, True, False, Mode.HOLD, SILENT),
    (Mode.HOLD, True, True, False, False, Mode.FAULT, "too hot; too fast"),
    (Mode.FAULT, False, False, False, True, Mode.FAULT, "smoke"),
]


@pytest.mark.parametrize(("mode", "was_lost", "fault", "silent", "lost", "then", "reason"), STATION_OBSERVATIONS)
def test_a_lost_station_holds_with_a_reason_of_its_own(  # noqa: PLR0913, PLR0917 - the columns of the table
    mode: Mode,
    was_lost: bool,  # noqa: FBT001 - a column of the table
    fault: bool,  # noqa: FBT001 - a column of the table
    silent: bool,  # noqa: FBT001 - a column of the table
    lost: bool,  # noqa: FBT001 - a column of the table
    then: Mode,
    reason: str,
) -> None:
    modes = reach(mode, station_lost=was_lost)
    modes.observe(["too hot", "too fast"] if fault else [], setpoints_silent=silent, station_lost=lost)
    assert (modes.mode, modes.reason) == (then, reason)


def test_each_reason_to_hold_is_kept_and_none_twice() -> None:
    modes = reach(Mode.HOLD)
    for lost, silent in [(True, True), (True, False), (False, True), (False, True), (False, False)]:
        modes.observe([], setpoints_silent=silent, station_lost=lost)
    assert [(transition.mode, transition.reason) for transition in modes.history][1:] == [
        (Mode.HOLD, SILENT),
        (Mode.HOLD, LOST),
        (Mode.HOLD, SILENT),
        (Mode.ARMED, "set-points arrive again"),
    ]


@pytest.mark.parametrize("mode", Mode)
def test_the_robot_disarms_itself_only_where_it_is_active(mode: Mode) -> None:
    modes = reach(mode)
    before = modes.mode, modes.reason
    modes.disarm(LOST)
    assert (modes.mode, modes.reason) == ((Mode.DISARMED, LOST) if mode in ACTIVE else before)


@pytest.mark.parametrize("mode", Mode)
def test_failing_is_possible_from_everywhere_and_the_first_reason_stays(mode: Mode) -> None:
    modes = reach(mode)
    modes.fail("the bus is gone")
    modes.fail("and more")
    assert (modes.mode, modes.reason) == (Mode.FAULT, "smoke" if mode is Mode.FAULT else "the bus is gone")


def test_every_transition_is_kept_with_its_cycle_and_reason() -> None:
    modes = Modes()
    assert list(modes.history) == []
    for modes.cycle, action in enumerate((Action.ARM, Action.ARM, Action.STOP, Action.STOP, Action.CLEAR_FAULT), 7):
        modes.ask(action)
    modes.cycle = 20
    modes.ask(Action.DISARM)  # from DISARMED: a new reason is kept too
    assert list(modes.history) == [
        Transition(7, Mode.ARMED, "asked to arm"),
        Transition(9, Mode.FAULT, "stop was pressed"),
        Transition(11, Mode.DISARMED, "fault cleared"),
        Transition(20, Mode.DISARMED, "asked to disarm"),
    ]


def test_the_history_is_bounded_and_keeps_the_newest() -> None:
    modes = Modes()
    for modes.cycle in range(1000):
        modes.ask(Action.DISARM if modes.cycle % 2 else Action.ARM)
    assert [transition.cycle for transition in modes.history] == list(range(936, 1000))
