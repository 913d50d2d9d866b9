# SPDX-License-Identifier: MIT
"""What sequence control and supervision say, and when."""

from collections.abc import Sequence

from segway_ecc.hil.placement.bench import (
    STATION,
    Introduction,
    Message,
    NodeReport,
    Program,
    Supervisor,
    sequence_program,
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
    return [(ms, message) for ms in range(0, until_ms, 5) for message in program(ms * MS, heard)]


def test_unstamped_set_points_are_sent_by_the_senders_own_clock_and_renewed() -> None:
    found = said(sequence_program(single_segment(1.0, 0.5, 0.25), 1 * S, stamped=False), 2000)
    assert found == [
        (1000, StampedSetpoint(AHEAD, None)),
        (1100, StampedSetpoint(AHEAD, None)),
        (1200, StampedSetpoint(AHEAD, None)),
        (1250, StampedSetpoint(REST, None)),
    ]


def test_stamped_set_points_are_sent_half_a_second_ahead_of_the_robots_last_stamp() -> None:
    program = sequence_program(single_segment(1.0, 0.5, 0.25), 10 * S, stamped=True)
    assert program(0, [NodeReport(10 * S - 501 * MS, Mode.ARMED)]) == []
    assert program(0, [NodeReport(10 * S - 500 * MS, Mode.ARMED)]) == [StampedSetpoint(AHEAD, 10 * S)]
    assert program(0, []) == []
    assert program(0, [NodeReport(10 * S - 250 * MS, Mode.ARMED)]) == [
        StampedSetpoint(AHEAD, 10 * S + 100 * MS),
        StampedSetpoint(AHEAD, 10 * S + 200 * MS),
        StampedSetpoint(REST, 10 * S + 250 * MS),
    ]


def test_a_supervisor_introduces_itself_and_beats_ten_times_a_second() -> None:
    found = said(Supervisor(None), 1000)
    beats = [ms for ms, message in found if isinstance(message, Heartbeat)]
    assert beats == [0, 100, 200, 300, 400, 500, 600, 700, 800, 900]
    others = [(ms, message) for ms, message in found if not isinstance(message, Heartbeat)]
    assert others == [(0, Introduction(STATION))]


def test_a_stop_is_requested_again_until_the_node_reports_that_it_has_stopped() -> None:
    supervisor = Supervisor(300 * MS)
    asked = [ms for ms, message in said(supervisor, 700, [NodeReport(0, Mode.ARMED)]) if message is Action.STOP]
    assert asked == [300, 400, 500, 600]
    assert Action.STOP not in supervisor(700 * MS, [NodeReport(0, Mode.FAULT)])
    assert Action.STOP not in supervisor(900 * MS, [])


def test_a_fault_before_the_stop_does_not_take_it_back() -> None:
    supervisor = Supervisor(300 * MS)
    supervisor(0, [NodeReport(0, Mode.FAULT)])
    assert Action.STOP in supervisor(300 * MS, [NodeReport(0, Mode.ARMED)])
