# SPDX-License-Identifier: MIT
"""What sequence control and supervision say, and when."""

from collections.abc import Sequence

from segway_ecc.hil.placement.bench import (
    Message,
    NodeReport,
    Program,
    StampedSequence,
    Supervisor,
    UnstampedSequence,
)
from segway_ecc.node.cycle.interfaces import Heartbeat, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.sequence.manoeuvre import single_segment

MS = 1_000_000
S = 1_000_000_000
AHEAD, REST = Setpoint(1.0, 0.5), Setpoint(0.0, 0.0)


def said(program: Program, until_ms: int, heard: Sequence[NodeReport] = ()) -> list[tuple[int, Message]]:
    """What it says every 5 ms, with when, ms."""
    return [(ms, message) for ms in range(0, until_ms, 5) for message in program.step(ms * MS, heard)]


def test_unstamped_set_points_are_sent_by_the_senders_own_clock_and_renewed() -> None:
    found = said(UnstampedSequence(single_segment(1.0, 0.5, 0.25), 1 * S), 2000)
    assert found == [
        (1000, StampedSetpoint(AHEAD, None)),
        (1100, StampedSetpoint(AHEAD, None)),
        (1200, StampedSetpoint(AHEAD, None)),
        (1250, StampedSetpoint(REST, None)),
    ]


def test_stamped_set_points_are_sent_half_a_second_ahead_of_the_robots_last_stamp() -> None:
    program = StampedSequence(single_segment(1.0, 0.5, 0.25), 10 * S)
    assert program.step(0, [NodeReport(10 * S - 501 * MS, Mode.ARMED)]) == []
    assert program.step(0, [NodeReport(10 * S - 500 * MS, Mode.ARMED)]) == [StampedSetpoint(AHEAD, 10 * S)]
    assert program.step(0, []) == []
    assert program.step(0, [NodeReport(10 * S - 250 * MS, Mode.ARMED)]) == [
        StampedSetpoint(AHEAD, 10 * S + 100 * MS),
        StampedSetpoint(AHEAD, 10 * S + 200 * MS),
        StampedSetpoint(REST, 10 * S + 250 * MS),
    ]


def test_a_supervisor_beats_ten_times_a_second() -> None:
    found = said(Supervisor(None), 1000)
    assert [ms for ms, _ in found] == [0, 100, 200, 300, 400, 500, 600, 700, 800, 900]
    assert {type(message) for _, message in found} == {Heartbeat}


def test_a_stop_is_requested_again_until_the_node_reports_that_it_has_stopped() -> None:
    supervisor = Supervisor(300 * MS)
    asked = [ms for ms, message in said(supervisor, 700, [NodeReport(0, Mode.ARMED)]) if message is Action.STOP]
    assert asked == [300, 400, 500, 600]
    assert Action.STOP not in supervisor.step(700 * MS, [NodeReport(0, Mode.FAULT)])
    assert Action.STOP not in supervisor.step(900 * MS, [])


def test_a_fault_before_the_stop_does_not_take_it_back() -> None:
    supervisor = Supervisor(300 * MS)
    supervisor.step(0, [NodeReport(0, Mode.FAULT)])
    assert Action.STOP in supervisor.step(300 * MS, [NodeReport(0, Mode.ARMED)])
