# SPDX-License-Identifier: MIT
import logging

import pytest

from segway_ecc.node.cycle.loop import StateLog
from segway_ecc.node.safety.modes import Action, Modes
from segway_ecc.testing import ScriptedClock

SECOND = 1_000_000_000


@pytest.fixture
def clock() -> ScriptedClock:
    return ScriptedClock()


@pytest.fixture
def state_log(clock: ScriptedClock, caplog: pytest.LogCaptureFixture) -> StateLog:
    caplog.set_level(logging.INFO, logger="segway_ecc.node.cycle.loop")
    return StateLog(clock)


def test_mode_is_logged_with_its_reason_at_once(state_log: StateLog, caplog: pytest.LogCaptureFixture) -> None:
    state_log.log_state(Modes(), None)
    assert caplog.messages == ["DISARMED: just started"]


def test_arming_refusal_is_logged_instead_of_the_reason(state_log: StateLog, caplog: pytest.LogCaptureFixture) -> None:
    state_log.log_state(Modes(), "no supply: 100 % off")
    assert caplog.messages == ["DISARMED, cannot arm: no supply: 100 % off"]


def test_unchanged_state_is_logged_once(
    state_log: StateLog, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(10):
        state_log.log_state(Modes(), None)
        clock.spend(SECOND)
    assert len(caplog.messages) == 1


def test_mode_reason_behind_an_arming_refusal_is_not_logged_again(
    state_log: StateLog, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    modes = Modes()
    state_log.log_state(modes, "no supply")
    clock.spend(2 * SECOND)
    modes.disarm("asked to")
    state_log.log_state(modes, "no supply")
    assert len(caplog.messages) == 1


def test_flicker_is_logged_at_most_once_a_second(
    state_log: StateLog, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    modes = Modes()
    for n in range(1000):  # ten seconds of a new mode every 10 ms, and 5 ms out of step with the seconds
        modes.ask(Action.ARM if n % 2 else Action.DISARM)
        state_log.log_state(modes, None)
        clock.spend(SECOND // 100)
    assert 9 <= len(caplog.messages) <= 10


def test_newest_suppressed_state_is_logged_after_a_second(
    state_log: StateLog, clock: ScriptedClock, caplog: pytest.LogCaptureFixture
) -> None:
    modes = Modes()
    state_log.log_state(modes, None)
    modes.ask(Action.ARM)
    state_log.log_state(modes, None)
    modes.ask(Action.STOP)
    clock.spend(SECOND - 1)
    state_log.log_state(modes, None)
    assert len(caplog.messages) == 1
    clock.spend(1)
    state_log.log_state(modes, None)
    assert caplog.messages[1:] == ["FAULT: stop was pressed"]
