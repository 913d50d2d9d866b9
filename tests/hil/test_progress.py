# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.hil.progress import show_all_progress


def test_without_a_terminal_there_is_one_line_for_each_name_that_has_ended(capsys: pytest.CaptureFixture[str]) -> None:
    with show_all_progress(lines=True) as update:
        for done in range(4):
            update("ros", done, 3)
        update("can", 0, 3)

    assert capsys.readouterr().err == "segway-ecc: ros: 3 of 3 runs done\n"


def test_without_a_terminal_nothing_is_written_unless_it_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    with show_all_progress() as update:
        update("ros", 3, 3)

    assert capsys.readouterr().err == ""
