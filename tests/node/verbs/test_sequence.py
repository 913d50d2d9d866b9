# SPDX-License-Identifier: MIT
"""The arguments of `segway-ecc sequence`; what it does with them is in tests/node/ros."""

from collections.abc import Callable
from typing import Any
from unittest.mock import MagicMock

import pytest

from segway_ecc.node.cycle.trajectory import TrajectoryState, TrajectoryStatus
from segway_ecc.node.errors import RosUnavailableError
from segway_ecc.node.sequence.manoeuvre import Odometry, Player, single_segment
from segway_ecc.node.verbs.sequence import _found

Run = Callable[..., Any]


@pytest.fixture(autouse=True)
def no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arguments that are taken lead to exit code 5: there is no ROS here."""

    def refuse(*_arguments: object) -> None:
        raise RosUnavailableError("taken")

    monkeypatch.setattr("segway_ecc.node.verbs.sequence.ros_node", refuse)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["1"], "cannot read sequence file '1': No such file or directory"),
        (["1", "2"], "give LINEAR ANGULAR DURATION, or one file"),
        (["1", "2", "3", "4"], "give LINEAR ANGULAR DURATION, or one file"),
        (["fast", "2", "3"], "LINEAR ANGULAR DURATION must be numbers: could not convert string to float: 'fast'"),
        (["1_0", "2", "3"], "LINEAR ANGULAR DURATION must be numbers: could not convert string to float: '1_0'"),
        (["nan", "2", "3"], "sequence: linear of segment 0 is nan; it must be finite"),
        (["1", "inf", "3"], "sequence: angular of segment 0 is inf; it must be finite"),
        (["1", "2", "inf"], "the duration must be more than 0 s and at most 86400 s, not inf"),
        (["1", "2", "nan"], "the duration must be more than 0 s and at most 86400 s, not nan"),
        (["1", "2", "0"], "the duration must be more than 0 s and at most 86400 s, not 0.0"),
        (["1", "2", "-3"], "the duration must be more than 0 s and at most 86400 s, not -3.0"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_arguments_that_make_no_sense_are_refused(segway_ecc: Run, words: list[str], expected: str) -> None:
    outcome = segway_ecc("sequence", *words)

    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.errors == [f"segway-ecc: {expected}"]


@pytest.mark.parametrize("duration", ["86401", "1e300"])
def test_a_duration_longer_than_a_file_may_have_is_refused(segway_ecc: Run, duration: str) -> None:
    outcome = segway_ecc("sequence", "1", "2", duration)

    assert outcome.code == 2
    (line,) = outcome.errors
    assert "duration" in line


@pytest.mark.parametrize("wait", ["-1", "0", "86401"])
def test_a_time_to_wait_that_is_none_is_refused(segway_ecc: Run, wait: str) -> None:
    outcome = segway_ecc("sequence", "1", "2", "3", "--wait", wait)

    assert outcome.code == 2
    assert outcome.errors == ["segway-ecc: --wait must be more than 0 s and at most 86400 s"]


def finished(took_s: float) -> tuple[dict[str, object], str, str]:
    """What a sequence of 8 s prints that took so long."""
    player = Player(single_segment(1.0, 0.5, 8.0))
    digest = player.trajectory(1).digest
    player.receive_status(TrajectoryStatus(1, TrajectoryState.DONE, "", 10**9, 9 * 10**9, 800, digest))
    player.receive_odometry(Odometry(9 * 10**9, 1.0, 2.0, 0.0, 0.0, 0.0))
    return _found(player, [], MagicMock(took_s=took_s))


def test_a_sequence_that_took_longer_than_it_is_says_so_and_in_json() -> None:
    document, text, warning = finished(9.5)

    assert document["took_s"] == 9.5
    assert text == "after 8 s at x 1.0000 m, y 2.0000 m, heading 0.0000 rad\n"
    assert warning == (
        "segway-ecc: the sequence took 9.5 s instead of 8 s: the robot's loop was late, or its messages were; it drove "
        "all of it, and its stamps count cycles\n"
    )


@pytest.mark.parametrize(("counted", "took_s"), [(8.1, 8.1), (3.0, 8.0)], ids=["the way", "this process was stopped"])
def test_a_sequence_that_took_as_long_as_it_is_says_no_more(counted: float, took_s: float) -> None:
    document, _, warning = finished(counted)

    assert (document["took_s"], warning) == (took_s, "")


@pytest.mark.parametrize("angular", ["-2", "-0.5", "-.5", "-1e-3"])
def test_negative_numbers_are_taken(segway_ecc: Run, angular: str) -> None:
    outcome = segway_ecc("sequence", "1", angular, "3")

    assert (outcome.code, outcome.errors) == (5, ["segway-ecc: taken"])


def test_a_file_with_a_key_that_does_not_exist_is_refused_with_those_that_do(segway_ecc: Run, tmp_path: Any) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text("segments: [{speed: 1.0, duration: 1.0}]", "utf-8")
    outcome = segway_ecc("sequence", str(path))

    assert outcome.code == 2
    (line,) = outcome.errors
    assert line.startswith(f"segway-ecc: {path}: ")
    assert "unknown field `speed`" in line
