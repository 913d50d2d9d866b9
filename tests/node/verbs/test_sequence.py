# SPDX-License-Identifier: MIT
"""The arguments of `segway-ecc sequence`; what it does with them is in tests/node/ros."""

from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.node.errors import RosUnavailableError

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
