# SPDX-License-Identifier: MIT
"""What the guard sees of a hoverboard's line, and what it sends there."""

from typing import Any

import pytest

from segway_ecc.firmware_io.drives.hoverboard.frames import COMMAND, FEEDBACK, command_frame
from segway_ecc.firmware_io.drives.hoverboard.stopper import HoverboardStopper
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.links.link import Frame


@pytest.mark.parametrize(
    ("commands", "meaning"), [((0, 0), Meaning.DISABLE), ((1, 0), Meaning.MOVE), ((0, -1000), Meaning.MOVE)]
)
def test_a_command_moves_the_board_unless_it_is_zero_for_both(commands: tuple[int, int], meaning: Meaning) -> None:
    assert HoverboardStopper().read(command_frame(*commands)) == Observation("board", meaning)


@pytest.mark.parametrize(
    "frame",
    [
        {"arbitration_id": FEEDBACK},
        {"data": bytes(3)},
        {"data": bytes(5)},
        {"is_extended": True},
    ],
)
def test_what_is_no_command_means_nothing(frame: dict[str, Any]) -> None:
    fields: dict[str, Any] = {"arbitration_id": COMMAND, "data": bytes(4), **frame}
    assert HoverboardStopper().read(Frame(**fields)) is None


def test_zero_for_both_stops_the_board_which_reports_no_off() -> None:
    stopper = HoverboardStopper()
    assert stopper.stop() == (Frame(COMMAND, bytes(4)),)
    assert (stopper.drives, stopper.reports) == (("board",), False)
