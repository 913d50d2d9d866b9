# SPDX-License-Identifier: MIT
"""What arrives at the robot over a command link that fails."""

import math

import pytest

from segway_ecc.hil.campaign.commander import Commander
from segway_ecc.hil.faults.fault import Fault, Injections, Type
from segway_ecc.node.cycle.interfaces import Inbox
from segway_ecc.node.safety.modes import Action, Answer
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

CYCLE_MS = 50
MANOEUVRE = Manoeuvre(segments=(Segment(linear=1.0, duration=0.5), Segment(linear=2.0, duration=0.5)))
SAID = [1, None, 1, None, 1, None, 1, None, 1, None, 2, None, 2, None, 2, None, 2, None, 2, None]
"""Linear set-points of each cycle of 50 ms: each is said again every 100 ms."""


def arrived(kind: Type | None, amount: float | None = None, for_s: float | None = 0.3) -> list[list[float]]:
    """Linear set-points that arrive in each cycle of 50 ms; the fault is there from 0.3 s on."""
    now = [0]
    fault = [Fault(target="command_link", type=kind, at_s=0.3, for_s=for_s, amount=amount)] if kind else []
    faults = Injections(fault, 0, lambda: now[0])
    commander = Commander(MANOEUVRE, faults)
    assert commander.take_inbox().setpoints == []
    assert not commander.wants_reports  # which nobody reads
    faults.timeline.start()
    rows = []
    for cycle in range(20):
        now[0] = cycle * CYCLE_MS * 1_000_000
        inbox = commander.take_inbox()
        assert commander.over is None
        assert all(setpoint.stamp_ns is None for setpoint in inbox.setpoints)
        rows.append([setpoint.setpoint.linear_velocity for setpoint in inbox.setpoints])
    now[0] = 1_000_000_000
    commander.take_inbox()
    assert commander.over == "the manoeuvre is over"
    return rows


def expected(changed: dict[int, list[float]]) -> list[list[float]]:
    return [changed.get(cycle, [] if value is None else [float(value)]) for cycle, value in enumerate(SAID)]


def test_a_whole_link() -> None:
    assert arrived(None) == expected({})


@pytest.mark.parametrize(
    ("kind", "amount", "changed"),
    [
        ("off", None, {6: [], 8: [], 10: []}),
        ("wrong", 3.0, {6: [4.0], 8: [4.0], 10: [5.0]}),
        ("intermittent", 1.0, {6: [], 8: [], 10: []}),
        ("intermittent", 0.0, {}),
        ("delayed", 0.15, {6: [], 8: [], 9: [1.0], 10: [], 11: [1.0], 13: [2.0]}),
        ("stuck", 2.0, {6: [1] * 3, 7: [1] * 2, 8: [1] * 3, 9: [1] * 2, 10: [2] * 3, 11: [2] * 2}),
    ],
)
def test_a_link_that_fails_for_a_while(kind: Type, amount: float | None, changed: dict[int, list[float]]) -> None:
    assert arrived(kind, amount) == expected(changed)


def test_what_is_garbage_is_never_finite() -> None:
    rows = arrived("garbage")
    assert all(not math.isfinite(value) for row in rows[6:12] for value in row)
    assert [len(row) for row in rows] == [len(row) for row in expected({})]


def inboxes(*faults: Fault) -> list[Inbox]:
    """What arrives in each cycle of 50 ms; every request and write is refused, for the same reason."""
    now = [0]
    injections = Injections(faults, 0, lambda: now[0])
    commander = Commander(MANOEUVRE, injections)
    injections.timeline.start()
    found = []
    for cycle in range(20):
        now[0] = cycle * CYCLE_MS * 1_000_000
        found.append(commander.take_inbox())
        for request in found[-1].requests:
            request.answer(Answer(accepted=False, message="no"))
        for write in found[-1].writes:
            write.answer("no")
    assert list(commander.refusals) == (["no"] if any(inbox.requests or inbox.writes for inbox in found) else [])
    return found


@pytest.mark.parametrize(
    ("kind", "asked"),
    [("off", [Action.STOP]), ("wrong", [Action.DISARM]), ("stuck", [Action.CLEAR_FAULT, Action.ARM])],
)
def test_an_operator_asks_while_the_fault_is_there(kind: Type, asked: list[Action]) -> None:
    found = inboxes(Fault(target="operator", type=kind, at_s=0.3, for_s=0.1))
    assert [[request.action for request in inbox.requests] for inbox in found[5:9]] == [[], asked, asked, []]


def test_a_parameter_is_written_while_the_fault_is_there() -> None:
    found = inboxes(Fault(target="parameter", type="wrong", name="Track", amount=2.0, at_s=0.3, for_s=0.05))
    assert [[write.values for write in inbox.writes] for inbox in found[5:8]] == [[], [[("Track", 2.0)]], []]


def test_nothing_arrives_while_the_ros_process_is_lost() -> None:
    lost = Fault(target="ros", type="off", at_s=0.3, for_s=0.3)
    found = inboxes(lost, Fault(target="operator", type="off", at_s=0.5, for_s=0.2))
    assert [bool(inbox.setpoints) for inbox in found] == [cycle % 2 == 0 and not 6 <= cycle < 12 for cycle in range(20)]
    assert [cycle for cycle, inbox in enumerate(found) if inbox.requests] == [12, 13]
