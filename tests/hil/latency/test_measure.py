# SPDX-License-Identifier: MIT
"""The measurement itself, on a real bus between processes; what is asserted holds on any machine."""

import itertools

import pytest

from segway_ecc.hil.latency.measure import Latency, Where, measure
from segway_ecc.hil.latency.same_process import ThreadStage
from segway_ecc.hil.latency.setpoints import MOST, Echo, publish_all
from segway_ecc.node.cycle.interfaces import StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint

pytestmark = pytest.mark.real_time


def test_a_set_point_comes_out_of_the_model_as_it_is() -> None:
    model = Echo()
    assert model.initialize([0.0]) == [0.0, 0.0]
    assert model.step([0.123]) == [0.123, 0.123]


def test_each_number_is_published_once_in_order_and_its_time_noted_before() -> None:
    values: list[float] = []
    said = publish_all(5, 1e-4, values.append)
    assert values == pytest.approx([0.001, 0.002, 0.003, 0.004, 0.005])
    assert [number for number, _ in said] == [1, 2, 3, 4, 5]
    times = [at_ns for _, at_ns in said]
    assert all(later - earlier >= 200_000 for earlier, later in itertools.pairwise(times))


def test_what_a_thread_sends_is_in_the_next_inbox_once() -> None:
    stage = ThreadStage()
    stage.send(0.5)
    assert stage.take_inbox().setpoints == [StampedSetpoint(Setpoint(0.5, 0.0), None)]
    assert stage.take_inbox().setpoints == []


@pytest.mark.parametrize("trials", [0, MOST + 1])
def test_more_trials_than_the_frame_has_values_are_refused(trials: int) -> None:
    with pytest.raises(ValueError, match="trials"):
        measure(Where.SAME_PROCESS, trials=trials)


def check(found: Latency, where: Where, least_s: float) -> None:
    assert (found.where, found.trials, found.period_s) == (str(where), 20, 0.01)
    assert found.missed <= 10
    assert least_s <= found.p50_s <= found.p99_s <= found.max_s


def test_in_the_same_process() -> None:
    check(measure(Where.SAME_PROCESS, trials=20), Where.SAME_PROCESS, 0.0)


def test_commands_that_leave_in_the_next_cycle_take_a_period_more() -> None:
    """A set-point that is taken in a cycle leaves a whole period after that cycle began."""
    check(measure(Where.SAME_PROCESS, trials=20, actuate="next_cycle"), Where.SAME_PROCESS, 0.008)


@pytest.mark.ros
def test_from_another_process_over_ros() -> None:
    check(measure(Where.OTHER_PROCESS, trials=20), Where.OTHER_PROCESS, 0.0)
