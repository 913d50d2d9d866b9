# SPDX-License-Identifier: MIT
"""Several players of one robot at once: the robot drives one manoeuvre, and each knows whether it was its own."""

import itertools
import os
from collections.abc import Sequence

import pytest

from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.timing import TimeBase
from segway_ecc.node.cycle.trajectory import TrajectoryFollower, TrajectoryState
from segway_ecc.node.sequence.manoeuvre import LEAD_NS, Odometry, Player, PlayState, single_segment, start_stamp

PERIOD_NS = 10_000_000
EPOCH = 1_700_000_000_000_000_000
AGAIN = 50
LAST = 400
WAITS = (PlayState.WAITING, PlayState.REFUSED)
"""Both send again, the second with a later stamp, as the players over ROS do."""


def play_together(players: Sequence[Player], sent_in: Sequence[int]) -> TrajectoryFollower:
    """Let players send to one robot in these cycles, and again until it answers; all receive what it reports."""
    time_base = TimeBase(PERIOD_NS)
    time_base.anchor(0, EPOCH)
    follower, reported = TrajectoryFollower(time_base, Setpoint(3.0, 3.0), 1000), None
    for now in range(LAST):
        for player, first in zip(players, sent_in, strict=True):
            if now >= first and (now - first) % AGAIN == 0 and player.state in WAITS:
                follower.take(
                    player.trajectory(start_stamp(EPOCH, LEAD_NS + now // AGAIN * LEAD_NS)), now, is_armed=True
                )
        follower.due(now)
        statuses = [*follower.refused, *([] if follower.status == reported else [follower.status])]
        follower.refused.clear()
        reported = follower.status
        for player in players:
            player.receive_odometry(Odometry(time_base.stamp_ns(now), 0.0, 0.0, 0.0, 0.0, 0.0))
            for status in statuses:
                player.receive_status(status)
    return follower


@pytest.mark.parametrize("sent_in", [(0, 0, 0), (0, 1, 2), (2, 1, 0), (0, 20, 60)])
@pytest.mark.parametrize("durations", [(1.0, 1.5, 0.5), (1.0, 1.0, 1.0)])
def test_of_several_players_one_is_done_with_its_own_manoeuvre_and_the_others_are_told(
    monkeypatch: pytest.MonkeyPatch, durations: Sequence[float], sent_in: Sequence[int]
) -> None:
    numbers = itertools.count()
    monkeypatch.setattr(os, "urandom", lambda count: next(numbers).to_bytes(count))
    players = [Player(single_segment(1.0, 0.0, duration)) for duration in durations]
    follower = play_together(players, sent_in)
    (done,) = (player for player in players if player.state is PlayState.DONE)
    assert follower.status.state is TrajectoryState.DONE
    assert done.status == follower.status
    assert (done.end_ns or 0) - (done.start_ns or 0) == done.manoeuvre.duration_ns
    assert {player.state for player in players if player is not done} == {PlayState.BROKEN_OFF}


def test_the_digest_differs_with_the_stamp_and_with_every_number_of_a_point() -> None:
    whole = Player(single_segment(1.0, 0.5, 1.0)).trajectory(EPOCH)
    first, last = whole.points
    others = [
        whole._replace(stamp_ns=EPOCH + 1),
        whole._replace(points=(first._replace(offset_ns=1), last)),
        whole._replace(points=(first._replace(setpoint=Setpoint(1.0, 0.25)), last)),
        whole._replace(points=(first._replace(setpoint=Setpoint(1.5, 0.5)), last)),
        whole._replace(points=(first,)),
    ]
    assert len({whole.digest, *(other.digest for other in others)}) == len(others) + 1
