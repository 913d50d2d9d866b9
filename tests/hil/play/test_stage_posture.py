# SPDX-License-Identifier: MIT
"""Standing up and sitting down: what is requested, in which cycle."""

import pytest

from segway_ecc.hil.play.stage import Posture
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import SetValue
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.robot import build_robot
from segway_ecc.testing import ScriptedClock


class Model:
    """Stands in for a model in a phase."""

    def __init__(self, phase: Phase) -> None:
        self.phase = phase

    def read(self, name: str) -> float:
        assert name == "Phase"
        return float(self.phase)


def posture(phase: Phase) -> Posture:
    found = Posture(build_robot(load_robot("segway"), ScriptedClock()))
    found._model = Model(phase)  # type: ignore[assignment]  # what is read of a model
    return found


@pytest.mark.parametrize(
    ("phase", "requested"),
    [
        (Phase.RESTING, [0.0, 1.0]),
        (Phase.STANDING_UP, [0.0]),
        (Phase.BALANCING, [0.0]),
        (Phase.SITTING_DOWN, [0.0, 1.0]),
        (Phase.GIVEN_UP, [0.0, 1.0]),
    ],
)
def test_one_that_is_up_has_to_sit_and_one_that_is_down_to_sit_and_then_to_stand(
    phase: Phase, requested: list[float]
) -> None:
    robot = posture(phase)
    assert robot.take_requests() == []
    robot.change()
    assert [robot.take_requests() for _ in range(3)] == [
        *([SetValue(0, value)] for value in requested),
        *[[]] * (3 - len(requested)),
    ]


def test_the_last_word_counts() -> None:
    robot = posture(Phase.GIVEN_UP)
    robot.change()
    robot.change()
    assert [robot.take_requests() for _ in range(3)] == [[SetValue(0, 0.0)], [SetValue(0, 1.0)], []]


def test_the_phase_is_reported_in_words() -> None:
    assert posture(Phase.GIVEN_UP).doing == "given up"


def test_a_cart_has_none() -> None:
    robot = Posture(build_robot(load_robot("cart-can"), ScriptedClock()))
    assert (robot.can_change, robot.doing, robot.take_requests()) == (False, None, [])
