# SPDX-License-Identifier: MIT
import pytest
from canopen.profiles.p402 import State402

from segway_ecc.firmware_io.drives.cia402.frames import Controlword, DriveState, state_of, step_towards_operation


def by_canopen(statusword: int) -> str | None:
    """The state as the canopen library's masks tell it."""
    return next((name for name, (mask, bits) in State402.SW_MASK.items() if statusword & mask == bits), None)


def test_every_statusword_has_the_state_of_the_canopen_library() -> None:
    for statusword in range(0x10000):
        found = state_of(statusword)
        assert (None if found is None else found.upper()) == by_canopen(statusword)


def test_states_that_the_profile_does_not_know_are_none() -> None:
    assert state_of(0x0001) is None


@pytest.mark.parametrize(
    ("state", "last_sent", "expected"),
    [
        (DriveState.SWITCH_ON_DISABLED, 0x00, 0x06),
        (DriveState.READY, 0x06, 0x07),
        (DriveState.SWITCHED_ON, 0x07, 0x0F),
        (DriveState.OPERATION_ENABLED, 0x0F, 0x0F),
        (DriveState.FAULT, 0x00, 0x80),
        (DriveState.FAULT, 0x80, 0x00),
        (DriveState.FAULT_REACTION_ACTIVE, 0x0F, 0x00),
        (DriveState.NOT_READY, 0x00, 0x00),
        (DriveState.QUICK_STOP_ACTIVE, 0x0F, 0x00),
        (None, 0x00, 0x00),
    ],
)
def test_one_step_at_a_time(state: DriveState | None, last_sent: int, expected: int) -> None:
    assert step_towards_operation(state, last_sent) == expected


@pytest.mark.parametrize("word", Controlword)
def test_controlwords_are_those_of_the_canopen_library(word: Controlword) -> None:
    assert word in State402.CW_CODE_COMMANDS
