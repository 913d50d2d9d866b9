# SPDX-License-Identifier: MIT
from collections.abc import Callable

import pytest

from tests.command import Outcome

SegwayEcc = Callable[..., Outcome]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["cart", "--rate", "0"], 2, "--rate is more than 0 and at most 100 MB/s"),
        (["cart", "--rate", "101"], 2, "--rate is more than 0 and at most 100 MB/s"),
        (["nowhere.yaml"], 2, "cannot read robot file 'nowhere.yaml'"),
    ],
)
def test_invalid_arguments_are_reported_in_one_line(
    segway_ecc: SegwayEcc, words: list[str], code: int, message: str
) -> None:
    outcome = segway_ecc("log", "archive", *words)
    assert (outcome.code, outcome.out) == (code, "")
    (line,) = outcome.errors
    assert message in line


def test_missing_ros_is_reported(segway_ecc: SegwayEcc, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.node.ros.runtime.missing_packages", lambda: ["rclpy"])
    outcome = segway_ecc("log", "archive", "cart")
    assert outcome.code == 5
    assert "rclpy" in outcome.errors[0]
