# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.sequence.manoeuvre import LEAD_NS, Manoeuvre, Odometry, Player, PlayState, Segment, TimedSetpoint

MS = 1_000_000
EPOCH = 1_700_000_000_000_000_000
AHEAD, TURN = Setpoint(1.0, 0.0), Setpoint(0.0, -0.5)
# 0.25 s ahead, then 0.3 s of turn: sent at 0, 100, 200, 250, 350, 450 and, rest, at 550 ms.
MANOEUVRE = Manoeuvre(segments=(Segment(linear=1.0, duration=0.25), Segment(angular=-0.5, duration=0.3)))
EXPECTED = [(0, AHEAD), (100, AHEAD), (200, AHEAD), (250, TURN), (350, TURN), (450, TURN), (550, REST)]
LEAD = 150


@pytest.fixture
def player() -> Player:
    return Player(MANOEUVRE, lead_ns=LEAD * MS)


def at(ms: int) -> Odometry:
    """The robot, `ms` after the first stamp seen."""
    return Odometry(EPOCH + ms * MS, float(ms), 0.0, 0.0, 0.0, 0.0)


def offsets(sent: list[TimedSetpoint]) -> list[float]:
    return [one.offset_ns / MS for one in sent]


def test_without_odometry_nothing_is_sent_or_known(player: Player) -> None:
    assert player.due_setpoints() == []
    assert (player.start_ns, player.end_ns, player.fraction) == (None, None, 0.0)
    assert player.unconfirmed(()) == 0
    assert player.abandon() == []


def test_the_manoeuvre_starts_a_lead_after_the_first_stamp_and_ends_after_its_length(player: Player) -> None:
    player.update(at(0))
    player.update(at(10))
    assert player.start_ns == EPOCH + LEAD * MS
    assert player.end_ns == EPOCH + (LEAD + 550) * MS
    assert Player(MANOEUVRE).lead_ns == LEAD_NS == 500 * MS


def test_every_set_point_is_sent_once_and_a_lead_ahead(player: Player) -> None:
    sent: list[tuple[int, TimedSetpoint]] = []
    for ms in range(0, 1000, 10):
        player.update(at(ms))
        sent += [(ms, one) for one in player.due_setpoints()]
    assert [(one.offset_ns // MS, one.setpoint) for _, one in sent] == EXPECTED
    # Received at `ms`, the robot is at `ms - LEAD` of the manoeuvre; what is for `ms` or earlier is sent now.
    assert [ms for ms, _ in sent] == [0, 100, 200, 250, 350, 450, 550]


def test_after_a_gap_everything_due_is_sent_at_once(player: Player) -> None:
    player.update(at(0))
    assert offsets(player.due_setpoints()) == [0]
    player.update(at(260))
    assert offsets(player.due_setpoints()) == [100, 200, 250]
    assert player.due_setpoints() == []


def test_it_is_done_when_the_robot_reaches_the_end(player: Player) -> None:
    assert [player.update(at(ms)) for ms in (0, LEAD, LEAD + 549)] == [PlayState.RUNNING] * 3
    assert [player.update(at(ms)) for ms in (LEAD + 550, LEAD + 560)] == [PlayState.DONE] * 2


def test_odometry_is_kept_from_start_to_end_both_included(player: Player) -> None:
    for ms in (0, LEAD - 1, LEAD, LEAD + 300, LEAD + 550, LEAD + 551):
        player.update(at(ms))
    assert player.received == [at(LEAD), at(LEAD + 300), at(LEAD + 550)]


def test_the_fraction_is_that_of_the_manoeuvre(player: Player) -> None:
    fractions = []
    for ms in (0, LEAD, LEAD + 275, LEAD + 550, LEAD + 9999):
        player.update(at(ms))
        fractions.append(player.fraction)
    assert fractions == [0.0, 0.0, 0.5, 1.0, 1.0]


def test_what_the_robot_did_not_bring_into_force_in_its_own_cycle_is_counted(player: Player) -> None:
    player.update(at(0))
    start = EPOCH + LEAD * MS
    due = {start + ms * MS for ms, _ in EXPECTED}
    assert player.unconfirmed(()) == 7
    assert player.unconfirmed(due) == 0
    assert player.unconfirmed(due - {start + 250 * MS} | {start + 260 * MS}) == 1


def test_abandoning_sends_rest_now_and_in_place_of_all_that_was_sent_ahead(player: Player) -> None:
    player.update(at(0))
    player.due_setpoints()
    player.update(at(270))  # at 120 ms of the manoeuvre
    assert offsets(player.due_setpoints()) == [100, 200, 250]
    assert player.abandon() == [TimedSetpoint(ms * MS, REST) for ms in (120, 100, 200, 250)]


def test_past_set_points_are_not_sent_again_on_abandoning(player: Player) -> None:
    for ms in (0, 270, 380):  # at 230 ms of the manoeuvre at last
        player.update(at(ms))
        player.due_setpoints()
    assert player.abandon() == [TimedSetpoint(ms * MS, REST) for ms in (230, 250, 350)]


def test_after_abandoning_nothing_more_is_sent(player: Player) -> None:
    player.update(at(0))
    player.due_setpoints()
    player.abandon()
    player.update(at(400))
    assert player.due_setpoints() == []
