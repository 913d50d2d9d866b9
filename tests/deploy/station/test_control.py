# SPDX-License-Identifier: MIT
from collections.abc import Callable

import pytest

from segway_ecc.deploy.station.control import Control
from segway_ecc.deploy.station.fleet import EventLog
from segway_ecc.deploy.station.views import Act


@pytest.fixture
def control(events: EventLog) -> Control:
    return Control(events)


@pytest.mark.parametrize("act", [Act.ARM, Act.PLAY, Act.STAND, Act.SIT])
def test_who_first_moves_a_robot_has_control(control: Control, act: Act) -> None:
    assert control.refusal("/a", "ann", act) is None
    assert control.of("/a") == "ann"
    assert control.of("/b") == ""


@pytest.mark.parametrize("act", [Act.DISARM, Act.CLEAR_FAULT, Act.BREAK_OFF, Act.STOP])
def test_what_ends_movement_gives_no_control(control: Control, act: Act) -> None:
    assert control.refusal("/a", "ann", act) is None
    assert control.of("/a") == ""


@pytest.mark.parametrize("act", sorted(set(Act) - {Act.STOP, Act.TAKE_CONTROL, Act.RELEASE_CONTROL}))
def test_second_operator_is_refused_with_holder_name(control: Control, act: Act) -> None:
    control.give("/a", "ann")
    assert control.refusal("/a", "bob", act) == "ann has control; take it first"
    assert control.refusal("/a", "ann", act) is None


def test_a_stop_needs_no_control(control: Control) -> None:
    control.give("/a", "ann")
    assert control.refusal("/a", "bob", Act.STOP) is None
    assert control.of("/a") == "ann"


def test_driving(control: Control) -> None:
    assert control.may_drive("/a", "ann")
    assert not control.may_drive("/a", "bob")
    assert control.may_drive("/a", "ann")


def test_takeover_is_logged_with_both_names(control: Control, events: EventLog, texts: Callable[[], list[str]]) -> None:
    assert control.give("/a", "ann") == ""
    assert control.give("/a", "bob") == "ann"
    assert control.give("/a", "bob") == "bob"
    assert texts() == ["ann has control", "bob took control from ann"]
    assert [event.level for event in events.after(0)] == ["info", "warning"]


def test_only_who_has_control_gives_it_up(control: Control, texts: Callable[[], list[str]]) -> None:
    control.give("/a", "ann")
    assert not control.release("/a", "bob")
    assert control.robots_of("ann") == ["/a"]
    assert control.release("/a", "ann")
    assert control.of("/a") == ""
    assert texts() == ["ann has control", "ann gave up control"]
