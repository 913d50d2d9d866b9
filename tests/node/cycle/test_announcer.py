import logging

import pytest

from segway_ecc.node.cycle.announcer import Announcer
from segway_ecc.node.safety.modes import Action, Modes
from segway_ecc.testing import ScriptedClock

SECOND = 1_000_000_000


@pytest.fixture
def clock() -> ScriptedClock:
    return ScriptedClock()


@pytest.fixture
def announcer(clock: ScriptedClock, caplog: pytest.LogCaptureFixture) -> Announcer:
    caplog.set_level(logging.INFO, logger="segway_ecc.node.cycle.announcer")
    return Announcer(clock)


def test_the_mode_is_told_with_its_reason_at_once(announcer: Announcer, caplog: pytest.LogCaptureFixture) -> None:
    announcer.tell(Modes(), None)
    assert caplog.messages == ["DISARMED: just started"]


def test_what_keeps_it_from_arming_is_told_instead(announcer: Announcer, caplog: pytest.LogCaptureFixture) -> None:
    announcer.tell(Modes(), "no supply: 100 % off")
    assert caplog.messages == ["DISARMED, cannot arm: no supply: 100 % off"]


def test_nothing_new_is_told_but_once(
    announcer: Announcer, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(10):
        announcer.tell(Modes(), None)
        clock.spend(SECOND)
    assert len(caplog.messages) == 1


def test_the_reason_behind_what_keeps_it_from_arming_is_not_told_again(
    announcer: Announcer, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    modes = Modes()
    announcer.tell(modes, "no supply")
    clock.spend(2 * SECOND)
    modes.disarm("asked to")
    announcer.tell(modes, "no supply")
    assert len(caplog.messages) == 1


def test_a_flicker_is_told_at_most_once_a_second(
    announcer: Announcer, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    modes = Modes()
    for n in range(1000):  # ten seconds of a new mode every 10 ms, and 5 ms out of step with the seconds
        modes.ask(Action.ARM if n % 2 else Action.DISARM)
        announcer.tell(modes, None)
        clock.spend(SECOND // 100)
    assert 9 <= len(caplog.messages) <= 10


def test_of_what_was_held_back_the_newest_is_told_as_soon_as_the_second_is_over(
    announcer: Announcer, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    modes = Modes()
    announcer.tell(modes, None)
    modes.ask(Action.ARM)
    announcer.tell(modes, None)
    modes.ask(Action.STOP)
    clock.spend(SECOND - 1)
    announcer.tell(modes, None)
    assert len(caplog.messages) == 1
    clock.spend(1)
    announcer.tell(modes, None)
    assert caplog.messages[1:] == ["FAULT: stop was pressed"]
